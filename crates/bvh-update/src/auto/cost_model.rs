//! What work costs, in nanoseconds of one core: the one table that [`Auto`](super::Auto) decides
//! by.
//!
//! Only ratios matter to decisions, unless a load is a time. They differ between machines, those of
//! repairs by up to six times.
//! `cargo run --release -p pivot-benches --example unit_costs` prints the prices for the machine at
//! hand, over a regular sheet whose tree is in cache. The constants are of the six scenes, which
//! are less regular: `cargo xtask compare update --threads 1` (EPYC Zen 4, 2026-11-23, revision
//! 31e535c) had 27 to 39 ns a primitive for refitting and rotating, 30 to 40 for LBVH, and 75 to 94
//! for PLOC. By `compare frame` of that revision pictures took 3 to 7 % longer with LBVH than with
//! PLOC, and by `--example loads` single rays no longer.
//!
//! `unit_costs`, two runs each (Zen 4: AVX-512, revision a8fd55b, 2026-11-29, beside other work;
//! Zen 3, slower memory: virtual, AVX2, 2026-11-24):
//!
//! ```text
//! constant         here   Zen 4                        Zen 3
//! NODE             15     13; of a query 19 to 67      28 to 31; of a query 20 to 112
//! FRONTIER_NODE    9      8 to 13 (9bde7b9)            1 to 11
//! TOP_SUBTREE      400    118 to 292 (9bde7b9)         1046 to 1691
//! GOOD_BUILD       85     57 to 59                     121 to 123
//! FAST_BUILD       32     22 to 25                     41 to 63
//! PACKET_RAY       25     33                           90 to 97
//! SINGLE_RAY       1400   1352 to 1402                 1992 to 2356
//! PACKET_NODE      90     75                           207 to 224
//! PAIRS            220    216 to 247                   222 to 356
//! FAST_BUILD_LOSS  0.05   0.02 to 0.04; single rays 0.05 to 0.08   0.02 to 0.05; single rays 0.08 to 0.12
//! PACKET_SLOPE     0.4    0.54; single rays 0.72       0.35; single rays 0.86; in a tree of 16 times the cost
//! ```
//!
//! The two prices of repairs are parts of one time, and noise shifts one into the other. At a8fd55b
//! they were 12 and 415 to 460 on Zen 4. The lion, which no cache holds, defends 9 and 400: above
//! 104,166 subtrees of 3.2 million nodes two threads took 25 and 15 ms, 80 ms of one core, where
//! these prices say 70 (trial build of 9bde7b9).
//!
//! Prices of work are those of the six scenes, above. That of packet rays is lower than printed
//! here: a higher one gains no more than the noise (`docs/TUNING.md`, prices of loads). A node is
//! priced as a pass visits it. Nodes of queries cost up to 4.5 times that on Zen 4, so who reports
//! [`Load::Nodes`] gets fewer repairs than who reports the rays.
//!
//! Before, `unit_costs` printed 60 ns for a packet's node on Zen 4. It is 90 here: with 60 the mean
//! frame of cloth-ball took 4 to 9 % longer, those of BrainStem and exploding-dragon as long
//! (`compare frame --frames 24 --threads 2`, two runs each on a quiet machine, 2026-11-23). With 45
//! and 65 ns bart-museum took 4 to 8 % longer than LBVH in every frame, with 90 as long; no other
//! scene differed (`reproduce fig6`, two runs each in turns, 2147e3a, 2026-11-26). A price of 700
//! or 1000 ns for a subtree gained nothing on lion and exploding-dragon (2026-11-25).

use std::time::Duration;

use bvh_build::Builder;

/// A node that a pass refits and rotates, or that a single query visits.
const NODE: f64 = 15.0;
/// Looking at a node for the frontier of a repair.
pub(super) const FRONTIER_NODE: f64 = 9.0;
/// Building a new top, for each subtree below it.
pub(super) const TOP_SUBTREE: f64 = 400.0;
/// Subtrees that a first repair is expected to keep, for each node. Repairs of `auto` and of
/// `refit+rotate+regrow` kept 0.02 to 0.09 in four scenes, 0.003 in n-body
/// (`cargo xtask reproduce fig4 --preset standard`, column `decision`). `docs/ABLATION.md` says
/// what this number is worth.
const FIRST_KEPT: f64 = 0.03;
/// Building a good tree, and a fast one, for each primitive.
pub(super) const GOOD_BUILD: f64 = 85.0;
pub(super) const FAST_BUILD: f64 = 32.0;
/// A ray of a coherent packet through a good tree, and a ray alone.
const PACKET_RAY: f64 = 25.0;
const SINGLE_RAY: f64 = 1400.0;
/// A node that a packet visits, with the triangles and rays that hang on it.
const PACKET_NODE: f64 = 90.0;
/// Finding all overlapping pairs, for each primitive.
const PAIRS: f64 = 220.0;

/// By what part queries take longer in a tree of the fast builder than in one of the good one.
const FAST_BUILD_LOSS: f64 = 0.05;
/// By what part packets take longer in a tree of twice the SAH cost: they look at a part of the
/// scene and share what they visit. Other queries take twice as long there, as the cost model has
/// it.
const PACKET_SLOPE: f64 = 0.4;

/// What is asked of the tree between two updates. The more it is, the more a better tree is worth.
///
/// Rays and pairs are what will be asked before the next update; visits and time are those of the
/// queries since the last update, and the next ones are expected to take as much. However little is
/// reported, none at all included, a tree of twice the cost counts as a loss of at least the time
/// of one update, so that no tree rots. Where queries of several kinds are asked, their visits add
/// up.
///
/// ```
/// use bvh_build::{Builder, build};
/// use bvh_core::{Aabb, Vec3, Visits};
/// use bvh_update::{Load, Updater};
/// use std::ops::ControlFlow::Continue;
///
/// let boxes: Vec<_> = (0..100).map(|i| Vec3::X * i as f32).map(|p| Aabb::new(p, p + 1.5)).collect();
/// let mut bvh = build(&boxes, Builder::balanced())?;
/// let mut updater = Updater::default();
/// updater.update(&mut bvh, &boxes)?;
/// let mut visits = Visits::default();
/// visits += bvh.for_each_pair(&boxes, |_, _| Continue(()));
/// visits += bvh.for_each_overlap(&boxes, &boxes[7].grown(9.0), |_| Continue(()));
/// updater.report(Load::Nodes(visits.nodes));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Load {
    /// A number of rays in coherent packets.
    PacketRays(u64),
    /// A number of rays, one by one.
    SingleRays(u64),
    /// All overlapping pairs, once.
    Pairs,
    /// As many visits of nodes as the queries since the last update report
    /// ([`Visits::nodes`](bvh_core::Visits::nodes)).
    Nodes(u64),
    /// As many visits of nodes as the packets of rays since the last update report. A node that a
    /// packet visits counts once, however many of its rays go there.
    PacketNodes(u64),
    /// As much time of one core as the queries since the last update took. It is compared with the
    /// times of work on one machine (`auto/cost_model.rs`): where yours is slower, trees are
    /// repaired too often. Visits have no such error.
    Time(Duration),
}

/// A load in time: what queries take in a good tree, in nanoseconds, and how much more in a worse
/// one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct QueryCost {
    ns: f64,
    slope: f64,
}

impl QueryCost {
    /// The cost of this load in a good tree. `excess` is that of the tree in which a measured load
    /// was measured.
    pub(super) fn new(load: Load, primitives: f64, excess: f64) -> Self {
        let measured = |ns: f64, slope: f64| ns / (1.0 + slope * excess.max(0.0));
        let (ns, slope) = match load {
            Load::PacketRays(rays) => (rays as f64 * PACKET_RAY, PACKET_SLOPE),
            Load::SingleRays(rays) => (rays as f64 * SINGLE_RAY, 1.0),
            Load::Pairs => (primitives * PAIRS, 1.0),
            Load::Nodes(nodes) => (measured(nodes as f64 * NODE, 1.0), 1.0),
            Load::PacketNodes(nodes) => (measured(nodes as f64 * PACKET_NODE, PACKET_SLOPE), PACKET_SLOPE),
            Load::Time(time) => (measured(time.as_secs_f64() * 1e9, 1.0), 1.0),
        };
        Self { ns: ns.max(pass(2.0 * primitives) / slope), slope }
    }

    /// Time lost in one frame to a tree of this excess.
    pub(super) fn lost(self, excess: f64) -> f64 {
        self.ns * self.slope * excess
    }

    /// Time lost in one frame to a tree of the fast builder.
    pub(super) fn lost_to_fast_build(self) -> f64 {
        self.ns * FAST_BUILD_LOSS
    }

    /// What one frame costs beside the queries, and what they lose, if a new tree is built in each.
    pub(super) fn rebuild_every_frame(self, primitives: f64) -> f64 {
        let builder = self.builder(primitives, 1);
        let lost = if builder == Builder::Lbvh { self.lost_to_fast_build() } else { 0.0 };
        rebuild(builder, primitives) + lost
    }

    /// The builder for a tree that will serve for `frames`: the fast one where the good one does
    /// not pay.
    pub(super) fn builder(self, primitives: f64, frames: u32) -> Builder {
        let extra = primitives * (GOOD_BUILD - FAST_BUILD);
        if self.lost_to_fast_build() * f64::from(frames) < extra { Builder::Lbvh } else { Builder::Ploc }
    }
}

/// What a pass costs, given the dynamic nodes of the tree.
pub(super) fn pass(nodes: f64) -> f64 {
    nodes * NODE
}

/// What a rebuild costs.
pub(super) fn rebuild(builder: Builder, primitives: f64) -> f64 {
    primitives * if builder == Builder::Lbvh { FAST_BUILD } else { GOOD_BUILD }
}

/// What a repair costs, given the dynamic nodes of the tree and the subtrees that the last one
/// kept, if there was one.
pub(super) fn repair(nodes: f64, subtrees: u32) -> f64 {
    let subtrees = if subtrees > 0 { f64::from(subtrees) } else { nodes * FIRST_KEPT };
    nodes * FRONTIER_NODE + subtrees * TOP_SUBTREE
}

/// How many subtrees a repair may keep that is to cost no more than a rebuild at this price.
pub(super) fn most_subtrees(nodes: f64, price_of_rebuild: f64) -> usize {
    ((price_of_rebuild - nodes * FRONTIER_NODE) / TOP_SUBTREE) as usize
}
