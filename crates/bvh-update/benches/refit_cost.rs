//! What a refit with and without rotations costs, stage by stage.
//!
//! ```text
//! cargo bench -p bvh-update --bench refit_cost -- [sheet|sixteenth|uneven ...]
//! RUSTFLAGS='--cfg refit_without="validity"' cargo bench ...      with one guard left out: validity, heights, moving
//! ```
//!
//! Times are of one thread: the median and the least frame, and the stages of the least frame.

use std::time::Instant;

use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{SimdLevel, Triangles, Vec3};
use bvh_update::{Rotate, StageCost, Strategy, Updater};

/// A sheet of triangles of which some parts move.
struct Scene {
    name: &'static str,
    side: usize,
}

const SCENES: [Scene; 3] = [
    Scene { name: "sheet", side: 215 },
    Scene { name: "sixteenth", side: 896 },
    Scene { name: "uneven", side: 896 },
];

impl Scene {
    fn indices(&self) -> Vec<[u32; 3]> {
        let n = self.side as u32;
        let corners = (0..n - 1).flat_map(|y| (0..n - 1).map(move |x| y * n + x));
        corners.flat_map(|i| [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]]).collect()
    }

    fn positions(&self, time: f32) -> Vec<Vec3> {
        let n = self.side;
        let place = |i: usize| {
            let (x, y) = ((i % n) as f32, (i / n) as f32);
            let wave = 9.0 * (0.11 * x + time).sin() * (0.07 * y - 0.7 * time).cos();
            match self.name {
                "sixteenth" if !self.moves(i) => Vec3::new(x, y, 0.0),
                // Every place is nearer to the corner by a factor: large and small side by side.
                "uneven" => {
                    let (u, v) = (x / n as f32, y / n as f32);
                    Vec3::new((-18.0 * u).exp(), (-6.0 * v * v).exp(), 1e-3 * wave * (-18.0 * u).exp()) * 1e3
                }
                _ => Vec3::new(x, y, wave),
            }
        };
        (0..n * n).map(place).collect()
    }

    fn moves(&self, vertex: usize) -> bool {
        self.name != "sixteenth" || (vertex % self.side < self.side / 4 && vertex / self.side < self.side / 4)
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn measure(scene: &Scene, strategy: &Strategy, level: SimdLevel, with_sums: bool, out_of_order: bool) {
    let indices = scene.indices();
    let start = scene.positions(0.0);
    let triangles = Triangles { positions: &start, indices: &indices };
    let options = BuildOptions::default();
    let mut bvh = build_with(&triangles, Builder::BinnedParallel, &options).expect("few enough");
    if scene.name == "sixteenth" {
        bvh.set_dynamic(|p| indices[p].iter().any(|&v| scene.moves(v as usize)));
    }
    let map = bvh.reorder_primitives();
    let indices: Vec<_> = map.into_iter().map(|p| indices[p as usize]).collect();
    let mut updater = Updater::with_level(Strategy::default(), level);
    updater.report_cost(with_sums);
    if out_of_order {
        // One pass of rotations, so that refits take the way of blocks.
        let triangles = Triangles { positions: &start, indices: &indices };
        updater
            .set_strategy(Strategy::RefitRotate(Rotate::default()))
            .update(&mut bvh, &triangles)
            .expect("same");
    }
    // Other programs interrupt blocks: of several frames the one that took least is the least disturbed.
    let frames = 30;
    let (mut alone, mut plain, mut best) = (Vec::new(), f64::INFINITY, (u64::MAX, StageCost::default(), 1.0));
    for frame in 1..=2 * frames {
        let positions = scene.positions(frame as f32 * 0.05);
        let triangles = Triangles { positions: &positions, indices: &indices };
        if frame == frames {
            updater.record_costs();
        }
        let begin = Instant::now();
        let report = updater.set_strategy(*strategy).update(&mut bvh, &triangles).expect("same count");
        let took = begin.elapsed().as_nanos() as f64;
        let moving = (report.nodes_visited as f64 + 1.0) / 2.0;
        if frame < frames {
            alone.push(took / moving);
            plain = plain.min(took / moving);
            continue;
        }
        let costs = updater.take_costs();
        let all = costs.list + costs.leaves + costs.boxes + costs.rotations;
        if all < best.0 {
            best = (all, costs, moving);
        }
    }
    let (_, StageCost { list, leaves, boxes, rotations }, moving) = best;
    let [list, leaves, boxes, rotations] = [list, leaves, boxes, rotations].map(|ns| ns as f64 / moving);
    let name = format!("{}{}", strategy.name(), if out_of_order { ", any order" } else { "" });
    println!(
        "{:10} {name:22} {:8} {:>5} {:8.1} {plain:7.1} {list:7.1} {leaves:7.1} {boxes:7.1} {rotations:9.1}",
        scene.name,
        level.name(),
        if with_sums { "sums" } else { "" },
        median(alone),
    );
}

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let without: Vec<_> = [
        (cfg!(refit_without = "validity"), "validity"),
        (cfg!(refit_without = "heights"), "heights"),
        (cfg!(refit_without = "moving"), "moving"),
    ]
    .into_iter()
    .filter_map(|(is_out, name)| is_out.then_some(name))
    .collect();
    println!("ns per moving triangle, one thread; without: {without:?}");
    println!(
        "{:55} {:>7} {:>7} {:>7} {:>7} {:>7} {:>9}",
        "", "median", "least", "list", "leaves", "boxes", "rotations"
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let rotate = Strategy::RefitRotate(Rotate::default());
    for scene in SCENES.iter().filter(|s| wanted.is_empty() || wanted.iter().any(|w| w == s.name)) {
        pool.install(|| {
            let best = SimdLevel::best();
            measure(scene, &Strategy::Refit, best, false, false);
            measure(scene, &Strategy::Refit, best, false, true);
            for level in SimdLevel::available() {
                measure(scene, &rotate, level, false, false);
            }
            measure(scene, &rotate, best, true, false);
        });
    }
}
