//! Measures the unit costs that `Strategy::Auto` decides by
//! (`crates/bvh-update/src/auto/cost_model.rs`), on one thread of this machine:
//! `cargo run --release -p pivot-benches --example unit_costs`.

use std::ops::ControlFlow::Continue;

use bvh_build::{BuildOptions, BuildScratch, Builder, build, rebuild};
use bvh_core::{Bvh, Ray, TriangleTest, Triangles, Vec3, Visits, closest_hit_counted, sah_cost};
use bvh_update::{Decision, PartialRebuild, Rotate, Strategy, Updater, refit};
use pivot_benches::measure::{median, quads, timed};
use pivot_tests::{noise, pool};
use rt_cpu::{Camera, Pixel, RenderOptions, RenderStats, cast};

/// Quads on each side of the sheet.
const SIDE: usize = 350;
const PIECE: usize = 10;
const FRAMES: usize = 24;

/// A waving sheet of quads with corners of their own, which bursts into square pieces.
fn positions(frame: usize) -> Vec<Vec3> {
    let time = frame as f32;
    let corner = |i: usize| {
        let (quad, corner) = (i / 4, i % 4);
        let (x, y) = (quad % SIDE, quad / SIDE);
        let piece = x / PIECE + SIDE / PIECE * (y / PIECE);
        let away = noise(0, piece) - 0.5;
        let (x, y) = ((x + corner % 2) as f32, (y + corner / 2) as f32);
        Vec3::new(x, y, 4.0 * (0.1 * x + 0.2 * time).sin()) + away * 6.0 * time
    };
    (0..4 * SIDE * SIDE).map(corner).collect()
}

fn print(name: &str, value: f64, of: &str) {
    println!("{name:<16} {value:>10.1} ns  {of}");
}

/// Plays the burst; gives for each frame the time of an update, the nodes that it visited, and what
/// it decided.
fn play(strategy: Strategy, first: &Bvh, indices: &[[u32; 3]]) -> Vec<(f64, f64, Decision)> {
    let (mut bvh, mut updater) = (first.clone(), Updater::new(strategy));
    let frame = |frame| {
        let now = positions(frame);
        let triangles = Triangles { positions: &now, indices };
        let (time, done) = timed(|| updater.update(&mut bvh, &triangles).expect("same count"));
        (time, done.nodes_visited as f64, done.decision)
    };
    (1..FRAMES).map(frame).collect()
}

fn measure() {
    let indices = quads(SIDE * SIDE);
    let start = positions(0);
    let triangles = Triangles { positions: &start, indices: &indices };
    let count = indices.len() as f64;
    let first = build(&triangles, Builder::Sweep).expect("few enough");

    let rotate = play(Strategy::RefitRotate(Rotate::default()), &first, &indices);
    let partial = play(Strategy::PartialRebuild(PartialRebuild::default()), &first, &indices);
    let of_passes = rotate.iter().map(|(time, nodes, _)| time / nodes);
    print("NODE", median(of_passes.collect()), "for each node, of refitting and rotating");
    // Repairs of many subtrees give the cost of a subtree, those of few that of the frontier.
    let repairs: Vec<(f64, f64, f64)> = partial
        .iter()
        .zip(&rotate)
        .filter_map(|((time, nodes, decision), (without, ..))| match decision {
            Decision::PartialRebuild { subtrees } => Some((time - without, *nodes, *subtrees as f64)),
            _ => None,
        })
        .collect();
    let sum = |f: fn(&(f64, f64, f64)) -> f64| repairs.iter().map(f).sum::<f64>();
    // Least squares of time = a * nodes + b * subtrees.
    let (nn, ns_, ss) = (sum(|r| r.1 * r.1), sum(|r| r.1 * r.2), sum(|r| r.2 * r.2));
    let (tn, ts) = (sum(|r| r.0 * r.1), sum(|r| r.0 * r.2));
    let determinant = nn * ss - ns_ * ns_;
    print("FRONTIER_NODE", (tn * ss - ts * ns_) / determinant, "for each node, of repairs");
    print("TOP_SUBTREE", (nn * ts - ns_ * tn) / determinant, "for each subtree kept");

    for (name, builder) in [("GOOD_BUILD", Builder::Ploc), ("FAST_BUILD", Builder::Lbvh)] {
        let (mut bvh, mut scratch) = (Bvh::default(), BuildScratch::default());
        let options = BuildOptions::default();
        let mut once = || rebuild(&mut bvh, &triangles, builder, &options, &mut scratch).expect("few");
        print(name, median_of(|| timed(&mut once)).0 / count, "for each primitive");
    }

    let mut pixels = vec![Pixel::default(); PIXELS];
    let (time, stats) = median_of(|| picture(&first, &triangles, &mut pixels));
    print("PACKET_RAY", time / stats.rays() as f64, "for each primary ray");
    print("PACKET_NODE", time / stats.nodes_visited as f64, "for each node of a packet");
    let (time, (visits, _)) = median_of(|| single_rays(&first, &triangles));
    print("SINGLE_RAY", time / SINGLE_RAYS as f64, "for each ray, in no order");
    print("NODE", time / visits.nodes as f64, "for each node of such rays");

    let mut pairs = 0;
    let (time, visits) = timed(|| {
        first.for_each_pair(&triangles, |_, _| {
            pairs += 1;
            Continue(())
        })
    });
    print("PAIRS", time / count, "for each primitive");
    print("NODE", time / visits.nodes as f64, "for each node of a pair search");
    measure_losses(&first, &indices);
}

/// By what part queries take longer in a worse tree, and in one of the fast builder.
fn measure_losses(first: &Bvh, indices: &[[u32; 3]]) {
    let burst = positions(FRAMES / 2);
    let triangles = Triangles { positions: &burst, indices };
    let [good, fast] = [Builder::Ploc, Builder::Lbvh].map(|builder| build(&triangles, builder).expect("few"));
    let mut refitted = first.clone();
    refit(&mut refitted, &triangles).expect("same count");
    let growth = sah_cost(&refitted) / sah_cost(&good) - 1.0;
    let mut pixels = vec![Pixel::default(); PIXELS];
    // Both trees in turns, so that what disturbs the machine disturbs both.
    let mut longer = |bvh: &Bvh, than: &Bvh, triangles: &Triangles<'_>| {
        let mut rounds = [Vec::new(), Vec::new()];
        for _ in 0..ROUNDS {
            let [of, other] = [bvh, than].map(|bvh| picture(bvh, triangles, &mut pixels).0);
            rounds[0].push(of / other - 1.0);
            let [of, other] = [bvh, than].map(|bvh| single_rays(bvh, triangles));
            assert_eq!(of.1.1, other.1.1, "hits do not depend on the tree");
            rounds[1].push(of.0 / other.0 - 1.0);
        }
        rounds.map(median).into()
    };
    let (of_picture, of_rays): (f64, f64) = longer(&refitted, &good, &triangles);
    let of = format!("of the time, in a tree of {:.2} times the cost", 1.0 + growth);
    println!("PACKET_SLOPE     {:>10.2}     {of}", of_picture / growth);
    println!("of single rays   {:>10.2}     {of}", of_rays / growth);
    let (of_picture, of_rays) = longer(&fast, &good, &triangles);
    println!("FAST_BUILD_LOSS  {of_picture:>10.2}     of a picture's time, {of_rays:.2} of single rays'");
}

const ROUNDS: usize = 9;
const PIXELS: usize = 1024 * 1024;
const SINGLE_RAYS: usize = 50_000;

/// The median time of some runs, and what the first gave.
fn median_of<T>(mut run: impl FnMut() -> (f64, T)) -> (f64, T) {
    let (first, result) = run();
    let others = (1..ROUNDS).map(|_| run().0);
    (median(std::iter::once(first).chain(others).collect()), result)
}

/// The time of a picture from above, and what it did.
fn picture(bvh: &Bvh, triangles: &Triangles<'_>, pixels: &mut [Pixel]) -> (f64, RenderStats) {
    let middle = Vec3::new(0.5, 0.5, 0.0) * SIDE as f32;
    let camera = Camera::look_at(middle + Vec3::Z * SIDE as f32, middle, Vec3::Y, 0.9, 1024, 1024);
    timed(|| cast(bvh, triangles, &camera, None, &RenderOptions::default(), pixels))
}

/// The time of rays in no order, the nodes that they visit, and the triangles that they hit.
fn single_rays(bvh: &Bvh, triangles: &Triangles<'_>) -> (f64, (Visits, Vec<u32>)) {
    let target = |i: usize| noise(1, i) * Vec3::new(1.0, 1.0, 0.0) * SIDE as f32;
    let mut visits = Visits::default();
    let cast = |i: usize| {
        let from = target(i + SINGLE_RAYS) + Vec3::Z * 50.0;
        let (ray, test) = (Ray::new(from, target(i) - from), TriangleTest::default());
        closest_hit_counted(bvh, triangles, &ray, f32::INFINITY, test, &mut visits).map(|hit| hit.primitive)
    };
    let (time, hits) = timed(|| (0..SINGLE_RAYS).filter_map(cast).collect::<Vec<_>>());
    assert!(!hits.is_empty(), "rays meet the sheet");
    (time, (visits, hits))
}

fn main() {
    pool(1).install(measure);
}
