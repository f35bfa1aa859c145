//! Two loads that are not pictures, and what each strategy makes of them: a torus of 97,200
//! triangles that shatters under 20,000 single rays a frame, and the broad phase of 20,000 boxes
//! that drift apart. `Auto` is given the load as it is. All strategies must find the same. One
//! thread: `cargo run --release -p pivot-benches --example loads`.

use std::f32::consts::TAU;
use std::ops::ControlFlow::Continue;

use bvh_build::{BuildOptions, Builder, build};
use bvh_core::{Aabb, Bvh, Primitives, Ray, TriangleTest, Triangles, Vec3, Visits, closest_hit_counted};
use bvh_update::{Decision, Load, PartialRebuild, Rotate, Strategy, Updater};
use pivot_benches::measure::{quads, timed};
use pivot_tests::{noise, pool};

const FRAMES: usize = 120;
const QUERIES: usize = 20_000;

/// A point of the cube from -1 to 1.
fn random(seed: u64, i: usize) -> Vec3 {
    2.0 * noise(seed, i) - 1.0
}

/// A strategy with its tree, the times of its frames, and how often it decided something.
struct Lane {
    strategy: Strategy,
    updater: Updater,
    bvh: Bvh,
    /// Milliseconds of each update, and of the queries after it.
    frames: Vec<[f64; 2]>,
    decisions: usize,
}

impl Lane {
    /// The strategies that are compared, all over the same first tree.
    fn all(primitives: &(impl Primitives + ?Sized)) -> Vec<Self> {
        let bvh = build(primitives, Builder::BinnedParallel).expect("few enough");
        let lane = |strategy| {
            let (updater, bvh) = (Updater::new(strategy), bvh.clone());
            Self { strategy, updater, bvh, frames: Vec::new(), decisions: 0 }
        };
        let rebuild = |builder| Strategy::Rebuild(builder, BuildOptions::default());
        [
            Strategy::default(),
            rebuild(Builder::Lbvh),
            rebuild(Builder::Ploc),
            Strategy::RefitRotate(Rotate::default()),
            Strategy::PartialRebuild(PartialRebuild::default()),
        ]
        .map(lane)
        .into()
    }

    /// One frame: an update, and `query`, which gives what it found and the load to report.
    fn frame<T>(
        &mut self,
        primitives: &(impl Primitives + ?Sized),
        query: impl FnOnce(&Bvh) -> (T, Load),
    ) -> T {
        let (update_ns, update) =
            timed(|| self.updater.update(&mut self.bvh, primitives).expect("same count"));
        let (query_ns, (found, load)) = timed(|| query(&self.bvh));
        self.updater.report(load);
        self.frames.push([update_ns, query_ns].map(|ns| ns / 1e6));
        self.decisions += usize::from(update.decision != Decision::AsAlways);
        found
    }
}

fn print(what: &str, lanes: &[Lane]) {
    println!("{what}\n{:22}  update  queries  frame  longest (ms)  decisions", "");
    let mut means = Vec::new();
    for Lane { strategy, frames, decisions, .. } in lanes {
        let mean = |part: usize| frames.iter().map(|frame| frame[part]).sum::<f64>() / FRAMES as f64;
        let (name, update, query) = (strategy.name(), mean(0), mean(1));
        let frame = update + query;
        let longest = frames.iter().map(|[update, query]| update + query).fold(0.0, f64::max);
        println!("{name:22} {update:7.2} {query:8.2} {frame:6.2} {longest:8.2} {decisions:16}");
        means.push(frame);
    }
    println!("auto over lbvh: {:.2}\n", means[0] / means[1]);
}

/// Pieces of a torus fly apart, each also turning away from its neighbours in the end.
fn torus() {
    const ROUND: usize = 270;
    const AROUND: usize = 180;
    const PIECE: usize = 9;
    let indices = quads(ROUND * AROUND);
    let positions = |frame: usize| -> Vec<Vec3> {
        let away = 0.02 * frame.saturating_sub(10) as f32;
        let corner = |i: usize| {
            let (quad, corner) = (i / 4, i % 4);
            let (u, v) = (quad % ROUND, quad / ROUND);
            let piece = u / PIECE + ROUND / PIECE * (v / PIECE);
            let (a, b) =
                (TAU * (u + corner % 2) as f32 / ROUND as f32, TAU * (v + corner / 2) as f32 / AROUND as f32);
            let ring = 3.0 + b.cos();
            Vec3::new(ring * a.cos(), ring * a.sin(), b.sin())
                + (random(1, piece) + random(0, quad) * 0.3) * away
        };
        (0..4 * ROUND * AROUND).map(corner).collect()
    };
    let rays: Vec<Ray> = (0..QUERIES)
        .map(|i| {
            let from = random(0, i).normalize_or(Vec3::X) * 12.0;
            Ray::new(from, random(1, i) * 3.0 - from)
        })
        .collect();
    let first = positions(0);
    let mut lanes = Lane::all(&Triangles { positions: &first, indices: &indices });
    for frame in 1..=FRAMES {
        let now = positions(frame);
        let triangles = Triangles { positions: &now, indices: &indices };
        let cast = |bvh: &Bvh| {
            let (mut hits, mut visits) = (Vec::with_capacity(QUERIES), Visits::default());
            for ray in &rays {
                let test = TriangleTest::default();
                let hit = closest_hit_counted(bvh, &triangles, ray, f32::INFINITY, test, &mut visits);
                hits.push(hit.map_or(f32::INFINITY, |hit| hit.t));
            }
            (hits, Load::SingleRays(QUERIES as u64))
        };
        let found: Vec<_> = lanes.iter_mut().map(|lane| lane.frame(&triangles, cast)).collect();
        assert!(found.iter().all(|hits| *hits == found[0]), "frame {frame}: other hits");
    }
    print(&format!("A torus of {} triangles, {QUERIES} single rays", indices.len()), &lanes);
}

/// Boxes drift, each on its own way.
fn broad_phase() {
    let boxes = |frame: usize| -> Vec<Aabb> {
        let place = |i: usize| (random(0, i) + random(1, i) * 0.02 * frame as f32) * 30.0;
        (0..QUERIES).map(place).map(|p| Aabb::new(p - 0.4, p + 0.4)).collect()
    };
    let mut lanes = Lane::all(&boxes(0)[..]);
    for frame in 1..=FRAMES {
        let now = boxes(frame);
        let pairs = |bvh: &Bvh| {
            let mut pairs = 0u64;
            let _ = bvh.for_each_pair(&now[..], |_, _| {
                pairs += 1;
                Continue(())
            });
            (pairs, Load::Pairs)
        };
        let found: Vec<_> = lanes.iter_mut().map(|lane| lane.frame(&now[..], pairs)).collect();
        assert!(found.iter().all(|pairs| *pairs == found[0]), "frame {frame}: {found:?}");
    }
    print(&format!("The broad phase of {QUERIES} boxes"), &lanes);
}

fn main() {
    pool(1).install(|| {
        torus();
        broad_phase();
    });
}
