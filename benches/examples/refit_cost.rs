//! What a refit with and without rotations costs, stage by stage, and how its blocks would be
//! scheduled on many workers.
//!
//! ```text
//! cargo run --release -p pivot-benches --example refit_cost -- [SCENE ...] [--threads=N] [--cold]
//!     scenes: still, sheet, numbers, pieces, sixteenth, uneven, large
//! RUSTFLAGS='--cfg refit_without="validity"' cargo run ...      without one guard of three
//! ```
//!
//! The other guards are `heights` and `moving`.
//!
//! The program updates on one thread, or on N with `--threads=N`. With `--cold` it writes 64 MiB
//! before each update, so that the update finds nothing in the caches. It prints the median and the
//! least frame, and the stages of the least frame that it recorded, as sums over all threads.
//!
//! The schedule is that of a pool whose workers steal, as rayon's do, with the prices of a join and
//! of a theft that are measured first. Workers never sleep, and memory is as fast for many of
//! them as for one: so the efficiencies are upper bounds.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::hint::{black_box, spin_loop};
use std::sync::OnceLock;
use std::time::Instant;

use bvh_build::{Builder, build};
use bvh_core::{SimdLevel, Triangles, Vec3};
use bvh_update::{BlockCost, Rotate, Strategy, Updater, refit_and_rotate};
use pivot_benches::measure::{median, timed};
use pivot_tests::pool;

/// A sheet of triangles of which some parts move.
struct Scene {
    name: &'static str,
    side: usize,
}

const SCENES: [Scene; 7] = [
    Scene { name: "still", side: 215 },
    Scene { name: "sheet", side: 215 },
    Scene { name: "numbers", side: 215 },
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
                // Counts as moving, but stays: no rotation is left to apply.
                "still" => Vec3::new(x, y, 9.0 * (0.11 * x).sin() * (0.07 * y).cos()),
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

/// What sharing work costs, in nanoseconds.
#[derive(Clone, Copy)]
struct Prices {
    /// A join of which no other thread takes a half.
    join: u64,
    /// From a join until another thread, which looks for work, begins with its second half.
    theft: u64,
}

impl Prices {
    /// Those of rayon on this machine, medians.
    fn measured() -> Self {
        let join = pool(1).install(|| {
            let thousand = || (0..1000).for_each(|i| _ = rayon::join(|| black_box(i), || black_box(i)));
            median((0..100).map(|_| timed(thousand).0 / 1000.0).collect())
        });
        let theft = pool(2).install(|| {
            let one = || {
                let (begin, stolen) = (Instant::now(), OnceLock::new());
                let wait = || {
                    while stolen.get().is_none() {
                        spin_loop();
                    }
                };
                rayon::join(wait, || stolen.set(begin.elapsed()).expect("set once"));
                stolen.get().expect("waited for").as_nanos() as f64
            };
            median((0..10_000).map(|_| one()).collect())
        });
        Self { join: join as u64, theft: theft as u64 }
    }
}

/// What a worker is at, in the order of ends.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Work {
    /// First half of a block, down to its leaves.
    Down(usize),
    /// Second half.
    Up(usize),
    /// Fetching blocks that it has stolen.
    Theft(Vec<usize>),
}

/// A pool of workers that steal: each takes the newest of what it has put off, else the oldest of
/// another's. Who ends the last block below another goes on with that one; in rayon that is the one
/// who began it, once it is free.
struct Pool<'a> {
    costs: &'a [BlockCost],
    prices: Prices,
    /// Blocks below each, and how many of them have not ended.
    below: Vec<Vec<usize>>,
    open: Vec<usize>,
    /// Blocks that each worker has put off, siblings together.
    put_off: Vec<VecDeque<Vec<usize>>>,
    /// By end and worker.
    busy: BinaryHeap<Reverse<(u64, usize, Work)>>,
}

/// How long the blocks take on some workers.
fn scheduled(costs: &[BlockCost], workers: usize, prices: Prices) -> u64 {
    let mut below = vec![Vec::new(); costs.len()];
    for (block, cost) in costs.iter().enumerate() {
        cost.parent.into_iter().for_each(|parent| below[parent].push(block));
    }
    let open = below.iter().map(Vec::len).collect();
    let put_off = vec![VecDeque::new(); workers];
    let mut pool = Pool { costs, prices, below, open, put_off, busy: BinaryHeap::new() };
    let (mut now, mut idle) = (0, (1..workers).collect::<Vec<_>>());
    pool.begin(now, 0, Work::Down(0));
    while let Some(Reverse((end, worker, work))) = pool.busy.pop() {
        now = end;
        match work {
            Work::Theft(siblings) => pool.share(now, worker, siblings),
            Work::Down(block) if pool.open[block] == 0 => pool.begin(now, worker, Work::Up(block)),
            Work::Down(block) => pool.share(now, worker, pool.below[block].clone()),
            Work::Up(block) => {
                let above = costs[block].parent.inspect(|&parent| pool.open[parent] -= 1);
                if let Some(parent) = above.filter(|&parent| pool.open[parent] == 0) {
                    pool.begin(now, worker, Work::Up(parent));
                } else if let Some(siblings) = pool.put_off[worker].pop_back() {
                    pool.share(now, worker, siblings);
                } else {
                    idle.push(worker);
                }
            }
        }
        idle.retain(|&thief| !pool.steals(now, thief));
    }
    now
}

impl Pool<'_> {
    fn begin(&mut self, now: u64, worker: usize, work: Work) {
        let takes = match work {
            Work::Down(block) => self.costs[block].list + self.costs[block].leaves,
            Work::Up(block) => self.costs[block].boxes + self.costs[block].rotations,
            Work::Theft(..) => self.prices.theft,
        };
        self.busy.push(Reverse((now + takes, worker, work)));
    }

    /// Begins with the first of some blocks and puts off the others, half by half.
    fn share(&mut self, mut now: u64, worker: usize, mut siblings: Vec<usize>) {
        while siblings.len() > 1 {
            let half = siblings.split_off(siblings.len() / 2);
            self.put_off[worker].push_back(half);
            now += self.prices.join;
        }
        self.begin(now, worker, Work::Down(siblings[0]));
    }

    /// Steals from the next in line that has put off something; whether there is one.
    fn steals(&mut self, now: u64, thief: usize) -> bool {
        let workers = self.put_off.len();
        let stolen = (1..workers).find_map(|i| self.put_off[(thief + i) % workers].pop_front());
        stolen.map(|siblings| self.begin(now, thief, Work::Theft(siblings))).is_some()
    }
}

fn measure(
    scene: &Scene,
    prices: Prices,
    strategy: &Strategy,
    level: SimdLevel,
    with_sums: bool,
    out_of_order: bool,
    other_data: &mut [u64],
) {
    let indices = scene.indices();
    let count = indices.len() as f64;
    let start = scene.positions(0.0);
    let triangles = Triangles { positions: &start, indices: &indices };
    let mut bvh = build(&triangles, Builder::BinnedParallel).expect("few enough");
    bvh.set_dynamic(|p| indices[p].iter().any(|&v| scene.moves(v as usize)));
    // In "numbers" triangles keep their numbers, and leaves name them by the order of the tree.
    let indices = if scene.name == "numbers" {
        indices
    } else {
        bvh.reorder_primitives().into_iter().map(|p| indices[p as usize]).collect()
    };
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
    let (mut alone, mut plain, mut best) = (Vec::new(), f64::INFINITY, (u64::MAX, Vec::new(), 1.0, 0));
    for frame in 1..=2 * frames {
        let positions = scene.positions(frame as f32 * 0.05);
        let triangles = Triangles { positions: &positions, indices: &indices };
        if frame == frames {
            updater.record_costs();
        }
        other_data.iter_mut().for_each(|word| *word += 1);
        black_box(&mut *other_data);
        let update = || updater.set_strategy(*strategy).update(&mut bvh, &triangles).expect("same count");
        let (took, report) = timed(update);
        let moving = (report.nodes_visited as f64 + 1.0) / 2.0;
        if frame < frames {
            alone.push(took / moving);
            plain = plain.min(took / moving);
            continue;
        }
        let costs = updater.take_costs();
        let all = costs.iter().map(|c| c.list + c.leaves + c.boxes + c.rotations).sum();
        if all < best.0 {
            best = (all, costs, moving, report.rotations.iter().sum());
        }
    }
    let (all, costs, moving, applied) = best;
    let free = Prices { join: 0, theft: 0 };
    assert!(costs.is_empty() || scheduled(&costs, 1, free) == all, "one worker does all work");
    let sum = |of: fn(&BlockCost) -> u64| costs.iter().map(of).sum::<u64>() as f64 / moving;
    let [list, leaves, boxes] = [sum(|c| c.list), sum(|c| c.leaves), sum(|c| c.boxes)];
    let rotations = sum(|c| c.rotations);
    let name = format!("{}{}", strategy.name(), if out_of_order { ", any order" } else { "" });
    print!(
        "{:10} {name:22} {:8} {:>5} {:8.1} {plain:7.1} {list:7.1} {leaves:7.1} {boxes:7.1} {rotations:9.1} {:8.4}",
        scene.name,
        level.name(),
        if with_sums { "sums" } else { "" },
        median(alone),
        applied as f64 / moving,
    );
    if costs.len() > 1 {
        print!(" {:7}", costs.len());
        for workers in [8, 16, 64] {
            print!(" {:6.2}", all as f64 / (workers as f64 * scheduled(&costs, workers, prices) as f64));
        }
    }
    println!();
}

fn main() {
    let (flags, wanted): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|a| a.starts_with("--"));
    let threads = flags.iter().find_map(|f| f.strip_prefix("--threads="));
    let threads = threads.map_or(1, |n| n.parse().expect("a number of threads"));
    let is_cold = flags.iter().any(|f| f == "--cold");
    let other_data = &mut vec![0; if is_cold { 8 << 20 } else { 0 }][..];
    // Guards are left out by these flags.
    let compiled_with = option_env!("RUSTFLAGS").unwrap_or_default();
    let prices = Prices::measured();
    let Prices { join, theft } = prices;
    println!("a join: {join} ns; a theft: {theft} ns");
    println!("ns per moving triangle, threads: {threads}; cold: {is_cold}; RUSTFLAGS: {compiled_with}");
    println!(
        "{:46} {:>8} {:>7} {:>7} {:>7} {:>7} {:>9} {:>8} {:>7} efficiency on 8, 16, 64 workers",
        "", "median", "least", "list", "leaves", "boxes", "rotations", "applied", "blocks"
    );
    let pool = pool(threads);
    let rotate = Strategy::RefitRotate(Rotate::default());
    for scene in SCENES
        .iter()
        .filter(|s| if wanted.is_empty() { s.name != "large" } else { wanted.iter().any(|w| w == s.name) })
    {
        pool.install(|| {
            let best = SimdLevel::best();
            measure(scene, prices, &Strategy::Refit, best, false, false, other_data);
            measure(scene, prices, &Strategy::Refit, best, false, true, other_data);
            for level in SimdLevel::available() {
                measure(scene, prices, &rotate, level, false, false, other_data);
            }
            measure(scene, prices, &rotate, best, true, false, other_data);
        });
    }
}
