//! What a refit with and without rotations costs, stage by stage, and how its blocks would be
//! scheduled on many workers.
//!
//! ```text
//! cargo bench -p bvh-update --bench refit_cost -- [sheet|pieces|sixteenth|uneven|large ...] [--threads=N]
//! RUSTFLAGS='--cfg refit_without="validity"' cargo bench ...      with one guard left out: validity, heights, moving
//! ```
//!
//! The bench updates on one thread, or on N with `--threads=N`. It prints the median and the least
//! frame, and the stages of the least frame that it recorded, as sums over all threads. The
//! schedule is greedy: a worker without work takes the block that has waited longest, after 500 ns.
//! A work-stealing pool comes close to it if memory is as fast for many cores as for one.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::time::Instant;

use bvh_build::{Builder, build};
use bvh_core::{SimdLevel, Triangles, Vec3};
use bvh_update::{BlockCost, Rotate, Strategy, Updater, refit_and_rotate};

/// A sheet of triangles of which some parts move.
struct Scene {
    name: &'static str,
    side: usize,
}

const SCENES: [Scene; 5] = [
    Scene { name: "sheet", side: 215 },
    Scene { name: "pieces", side: 354 },
    Scene { name: "sixteenth", side: 896 },
    Scene { name: "uneven", side: 896 },
    Scene { name: "large", side: 2237 },
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
                // Pieces of some hundred triangles fly apart.
                "pieces" => {
                    let piece = (i % n / 9 + i / n / 11 * 1000) as f32;
                    let away = Vec3::new((piece * 1.7).sin(), (piece * 2.3).cos(), (piece * 3.1).sin());
                    Vec3::new(x, y, wave) + away * 20.0 * time
                }
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

/// How long the blocks take on some workers.
fn scheduled(costs: &[BlockCost], workers: usize) -> u64 {
    const TAKING: u64 = 500;
    let mut below = vec![Vec::new(); costs.len()];
    let mut open: Vec<usize> = vec![0; costs.len()];
    for (block, cost) in costs.iter().enumerate() {
        if let Some(parent) = cost.parent {
            below[parent].push(block);
            open[parent] += 1;
        }
    }
    // A piece of work is the first half of a block, down to its leaves, or the second.
    let mut waiting: VecDeque<(usize, bool)> =
        (0..costs.len()).filter(|&b| costs[b].parent.is_none()).map(|b| (b, false)).collect();
    let mut busy = BinaryHeap::new();
    let (mut now, mut idle) = (0, workers);
    loop {
        while idle > 0 && !waiting.is_empty() {
            let (block, is_second) = waiting.pop_front().expect("not empty");
            let cost = costs[block];
            let takes = if is_second { cost.boxes + cost.rotations } else { cost.list + cost.leaves };
            busy.push(Reverse((now + takes + TAKING * u64::from(workers > 1), block, is_second)));
            idle -= 1;
        }
        let Some(Reverse((end, block, is_second))) = busy.pop() else { return now };
        now = end;
        idle += 1;
        if !is_second {
            if below[block].is_empty() {
                waiting.push_front((block, true));
            }
            waiting.extend(below[block].iter().map(|&b| (b, false)));
        } else if let Some(parent) = costs[block].parent {
            open[parent] -= 1;
            if open[parent] == 0 {
                waiting.push_front((parent, true));
            }
        }
    }
}

fn measure(scene: &Scene, strategy: &Strategy, level: SimdLevel, with_sums: bool, out_of_order: bool) {
    let indices = scene.indices();
    let count = indices.len() as f64;
    let start = scene.positions(0.0);
    let triangles = Triangles { positions: &start, indices: &indices };
    let mut bvh = build(&triangles, Builder::BinnedParallel).expect("few enough");
    bvh.set_dynamic(|p| indices[p].iter().any(|&v| scene.moves(v as usize)));
    let map = bvh.reorder_primitives();
    let indices: Vec<_> = map.into_iter().map(|p| indices[p as usize]).collect();
    let mut updater = Updater::with_level(Strategy::default(), level);
    updater.report_cost(with_sums);
    if out_of_order {
        // One pass of rotations, so that refits take the way of blocks.
        let triangles = Triangles { positions: &start, indices: &indices };
        refit_and_rotate(&mut bvh, &triangles).expect("same count");
    }
    // Other programs interrupt blocks: of several frames the one that took least is the least
    // disturbed.
    let frames = if count > 5e6 { 5 } else { 30 };
    let (mut alone, mut plain, mut best) = (Vec::new(), f64::INFINITY, (u64::MAX, Vec::new(), 1.0));
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
        let all = scheduled(&costs, 1);
        if all < best.0 {
            best = (all, costs, moving);
        }
    }
    let (all, costs, moving) = best;
    let sum = |of: fn(&BlockCost) -> u64| costs.iter().map(of).sum::<u64>() as f64 / moving;
    let [list, leaves, boxes] = [sum(|c| c.list), sum(|c| c.leaves), sum(|c| c.boxes)];
    let rotations = sum(|c| c.rotations);
    let name = format!("{}{}", strategy.name(), if out_of_order { ", any order" } else { "" });
    print!(
        "{:10} {name:22} {:8} {:>5} {:8.1} {plain:7.1} {list:7.1} {leaves:7.1} {boxes:7.1} {rotations:9.1}",
        scene.name,
        level.name(),
        if with_sums { "sums" } else { "" },
        median(alone),
    );
    if costs.len() > 1 {
        print!(" {:7}", costs.len());
        for workers in [8, 16, 64] {
            print!(" {:6.2}", all as f64 / (workers as f64 * scheduled(&costs, workers) as f64));
        }
    }
    println!();
}

fn main() {
    let (flags, wanted): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|a| a.starts_with("--"));
    let threads = flags.iter().find_map(|f| f.strip_prefix("--threads="));
    let threads = threads.map_or(1, |n| n.parse().expect("a number of threads"));
    let without: Vec<_> = [
        (cfg!(refit_without = "validity"), "validity"),
        (cfg!(refit_without = "heights"), "heights"),
        (cfg!(refit_without = "moving"), "moving"),
    ]
    .into_iter()
    .filter_map(|(is_out, name)| is_out.then_some(name))
    .collect();
    println!("ns per moving triangle, threads: {threads}; without: {without:?}");
    println!(
        "{:55} {:>7} {:>7} {:>7} {:>7} {:>7} {:>9} {:>7} efficiency on 8, 16, 64 workers",
        "", "median", "least", "list", "leaves", "boxes", "rotations", "blocks"
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let rotate = Strategy::RefitRotate(Rotate::default());
    for scene in SCENES
        .iter()
        .filter(|s| if wanted.is_empty() { s.name != "large" } else { wanted.iter().any(|w| w == s.name) })
    {
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
