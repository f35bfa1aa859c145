//! A strategy at work on a scene: its tree, its twins, and what they took.

use anyhow::{Context, Result};
use bvh_core::{Bvh, Triangles, Vec3, sah_cost};
use bvh_update::{Load, Update};
use rt_cpu::RenderStats;

use super::contestants::{Contestant, Method, Worker};
use super::record::Row;
use super::stages::primitives_refit;
use crate::stage::{Renderer, Stage, timed};

/// A strategy at work: its trees and their memory.
pub(super) struct Lane {
    pub(super) name: &'static str,
    pub(super) method: Method,
    /// The tree, and after it its twins: trees of the later turns, of which the first is traced.
    /// None where trees take long to prepare or to update: then the tree itself is traced once
    /// more.
    pub(super) trees: Vec<Tree>,
    /// What rays ask of each tree.
    pub(super) load: Load,
    /// Whether the tree fits the present frame.
    pub(super) is_current: bool,
    /// Shortest time of the present frame's update.
    pub(super) update_ms: f64,
    /// Shorter time of rendering the present frame; infinite if it is not rendered.
    trace_ms: f64,
    /// What the last rendering did.
    pub(super) stats: RenderStats,
    /// Updates since the last frame that was measured, one for each frame.
    pub(super) updates: u64,
    /// What they took together, the shortest time of each.
    pub(super) updates_ms: f64,
}

/// A copy of the first tree, what updates it, and what its last update did.
pub(super) struct Tree {
    bvh: Bvh,
    worker: Worker,
    update: Update,
}

/// Updates that are shorter than this have several twins, so that those of a frame take about as
/// long together, and this many at most. With one twin,
/// `cargo xtask reproduce claims --preset standard` found the forest's refits of 0.25 ms dependent
/// on the frame in one run of three.
pub(super) const SHORT_MS: f64 = 2.0;
pub(super) const MOST_TWINS: f64 = 5.0;
/// Updates and pictures that are longer than this have one turn. Second turns on rows alone took
/// 74 s of a run of 12 min 56 s (docs/benchmarks/2026-11-26-reproduce-epyc-zen4-a8b1f89).
pub(super) const LONG_MS: f64 = 40.0;

impl Lane {
    pub(super) fn new(of: &Contestant, load: Load, stage: &Stage, poses: &[Vec<Vec3>]) -> Result<Self> {
        let Contestant { of: name, method, .. } = *of;
        Ok(Self {
            name,
            method,
            trees: vec![Tree::new(name, method, stage, poses)?],
            load,
            is_current: false,
            update_ms: f64::INFINITY,
            trace_ms: f64::INFINITY,
            stats: RenderStats::default(),
            updates: 0,
            updates_ms: 0.0,
        })
    }

    pub(super) fn tree(&self) -> &Bvh {
        &self.trees[0].bvh
    }

    /// Runs once on a copy of the tree that is thrown away. Where there are second turns, adds as
    /// many twins as updates of that length are to have.
    pub(super) fn warm_up(&mut self, stage: &Stage, turns: usize, renderer: &mut Renderer) -> Result<()> {
        // A method that knows the animation refits like the others, and would be prepared again.
        if self.method.knows_animation() {
            return Ok(());
        }
        let new = || Tree::new(self.name, self.method, stage, &[]);
        let mut tree = new()?;
        let update_ms = tree.update(self.name, stage, self.load)?;
        renderer.draw(stage, &tree.bvh);
        if turns > 1 && update_ms <= LONG_MS {
            let twins = (SHORT_MS / update_ms).ceil().clamp(1.0, MOST_TWINS) as usize;
            self.trees.extend((0..twins).map(|_| new()).collect::<Result<Vec<_>>>()?);
        }
        Ok(())
    }

    /// Begins a frame.
    pub(super) fn begin(&mut self, is_current: bool) {
        (self.is_current, self.update_ms, self.trace_ms) = (is_current, f64::INFINITY, f64::INFINITY);
    }

    /// Updates the tree in the first turn, each twin in one of the others.
    pub(super) fn update(&mut self, turn: usize, stage: &Stage) -> Result<()> {
        if let Some(tree) = self.trees.get_mut(turn) {
            self.update_ms = self.update_ms.min(tree.update(self.name, stage, self.load)?);
        }
        Ok(())
    }

    /// Renders the tree in the first turn, in the second its twin, or the tree itself once more.
    pub(super) fn trace(&mut self, turn: usize, stage: &Stage, renderer: &mut Renderer) {
        if turn == 0 || turn == 1 && self.trace_ms <= LONG_MS {
            let tree = self.trees.get(turn).unwrap_or(&self.trees[0]);
            let (stats, trace_ms) = renderer.draw(stage, &tree.bvh);
            if trace_ms < self.trace_ms {
                (self.stats, self.trace_ms) = (stats, trace_ms);
            }
        }
    }

    /// Ends a frame: counts its update, and takes as the next one's load how many nodes the rays
    /// opened, if there were any.
    pub(super) fn end(&mut self, nodes_opened: Option<u64>) {
        self.updates += 1;
        self.updates_ms += self.update_ms;
        self.load = nodes_opened.map_or(self.load, Load::PacketNodes);
    }

    /// The row of a frame that was measured, whose other columns are in `common`; and whether the
    /// twins have the same cost.
    pub(super) fn row(&self, common: &Row) -> (Row, bool) {
        let cost = |tree: &Tree| tree.update.sah_cost.unwrap_or_else(|| sah_cost(&tree.bvh));
        let Tree { bvh, update, .. } = &self.trees[0];
        let row = Row {
            update_ms: self.update_ms,
            sah_cost: cost(&self.trees[0]),
            rotations: update.rotations_applied(),
            height: update.height,
            nodes_visited: update.nodes_visited,
            dropped: update.dropped,
            primitives_refit: primitives_refit(bvh, update),
            // Without commas, which would part columns for a simple reader.
            decision: update.decision.to_string().replace(',', ";"),
            updates: self.updates,
            updates_ms: self.updates_ms,
            ..common.clone()
        };
        let same = self.trees[1..].iter().all(|twin| cost(twin) == row.sah_cost);
        (row.traced(&self.stats, self.trace_ms), same)
    }
}

impl Tree {
    fn new(name: &str, method: Method, stage: &Stage, poses: &[Vec<Vec3>]) -> Result<Self> {
        let indices = stage.triangles().indices;
        let poses: Vec<_> = poses.iter().map(|positions| Triangles { positions, indices }).collect();
        let mut bvh = Bvh::clone(&stage.first_tree);
        let worker = method.start(&mut bvh, &poses).with_context(|| format!("{name}: not prepared"))?;
        Ok(Self { bvh, worker, update: Update::default() })
    }

    /// Updates the tree, and gives the milliseconds.
    fn update(&mut self, name: &str, stage: &Stage, load: Load) -> Result<f64> {
        let Self { bvh, worker, .. } = self;
        let (updated, update_ms) = timed(|| worker(bvh, &stage.triangles(), load));
        self.update = updated.with_context(|| format!("{}: {name} failed", stage.scene.name))?;
        Ok(update_ms)
    }
}
