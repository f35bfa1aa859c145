//! A strategy at work on a scene: its tree, its twins, and what they took.

use anyhow::{Context, Result};
use bvh_core::{Bvh, Triangles, Vec3, sah_cost};
use bvh_update::{Load, Update};
use rt_cpu::RenderStats;

use super::contestants::{Method, Worker};
use super::record::Row;
use super::stages::primitives_refit;
use crate::stage::{self, Renderer, Stage};

/// A strategy at work: its trees and their memory.
pub(super) struct Lane {
    pub(super) name: &'static str,
    pub(super) method: Method,
    /// The tree, and after it its twins: trees of the later turns, of which the first is traced.
    /// None where trees take long to prepare or to update: then the tree itself is traced once more.
    pub(super) trees: Vec<(Bvh, Worker)>,
    /// Whether the tree fits the present frame.
    pub(super) is_current: bool,
    /// The row of the present frame; [`weigh`](Self::weigh) completes it.
    pub(super) last: Option<Row>,
    /// What updated the tree in the present frame, and then each twin.
    updates: Vec<Update>,
    pub(super) between: Between,
}

/// Updates since the last frame that was measured.
#[derive(Clone, Copy, Default)]
pub(super) struct Between {
    pub(super) updates: u64,
    pub(super) ms: f64,
    /// Shortest time so far of the present frame's update.
    pub(super) least_ms: f64,
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
    pub(super) fn new(
        name: &'static str,
        method: Method,
        stage: &Stage,
        poses: &[Vec<Vec3>],
    ) -> Result<Self> {
        let trees = vec![start(name, method, stage, poses)?];
        let (updates, between) = (Vec::new(), Between::default());
        Ok(Self { name, method, trees, is_current: false, last: None, updates, between })
    }

    pub(super) fn tree(&self) -> &Bvh {
        &self.trees[0].0
    }

    /// Adds twins, as many as updates of this length are to have.
    pub(super) fn add_twins(&mut self, stage: &Stage, update_ms: f64) -> Result<()> {
        if update_ms <= LONG_MS {
            let twins = (SHORT_MS / update_ms).ceil().clamp(1.0, MOST_TWINS) as usize;
            for _ in 0..twins {
                self.trees.push(start(self.name, self.method, stage, &[])?);
            }
        }
        Ok(())
    }

    /// Updates the tree in the first turn, each twin in one of the others, without rendering.
    pub(super) fn update(&mut self, turn: usize, stage: &Stage) -> Result<()> {
        let Some(tree) = self.trees.get_mut(turn) else { return Ok(()) };
        let (update_ms, _) = timed(self.name, tree, stage)?;
        self.between.least_ms = self.between.least_ms.min(update_ms);
        Ok(())
    }

    /// Reports the rays of a frame that an earlier run has measured, so that the tree takes the
    /// same course.
    pub(super) fn recall(&mut self, rows: &[Row], round: usize, frame: usize) {
        let is_it = |row: &&Row| row.strategy == self.name && [row.round, row.frame] == [round, frame];
        if let Some(row) = rows.iter().find(is_it) {
            let load = Load::PacketNodes(row.nodes_opened);
            self.trees.iter_mut().for_each(|(_, worker)| worker.report(load));
        }
    }

    /// Updates and renders a frame; gives the row, whose other columns are in `common`.
    pub(super) fn run(
        &mut self,
        stage: &Stage,
        common: &Row,
        renderer: &mut Renderer,
    ) -> Result<(Row, RenderStats)> {
        let (update_ms, update) = timed(self.name, &mut self.trees[0], stage)?;
        let (stats, trace_ms) = renderer.draw(stage, self.tree());
        self.trees[0].1.report(Load::PacketNodes(stats.nodes_visited));
        let row = Row {
            update_ms,
            rotations: update.rotations_applied(),
            height: update.height,
            nodes_visited: update.nodes_visited,
            dropped: update.dropped,
            // Without commas, which would part columns for a simple reader.
            decision: update.decision.to_string().replace(',', ";"),
            ..common.clone()
        };
        self.updates = vec![update];
        Ok((row.traced(&stats, trace_ms), stats))
    }

    /// Updates the twin of a turn from 1 on, and in turn 1 renders it, or the tree itself once more;
    /// the shorter times count.
    pub(super) fn run_again(&mut self, turn: usize, stage: &Stage, renderer: &mut Renderer) -> Result<()> {
        let Some(mut row) = self.last.take() else { return Ok(()) };
        if let Some(twin) = self.trees.get_mut(turn) {
            let (update_ms, update) = timed(self.name, twin, stage)?;
            twin.1.report(Load::PacketNodes(row.nodes_opened));
            self.updates.push(update);
            row.update_ms = row.update_ms.min(update_ms);
        }
        if turn == 1 && row.trace_ms <= LONG_MS {
            let (tree, _) = self.trees.get(1).unwrap_or(&self.trees[0]);
            let (stats, trace_ms) = renderer.draw(stage, tree);
            if trace_ms < row.trace_ms {
                row = row.traced(&stats, trace_ms);
            }
        }
        // Twins were added by the first update, which may have been shorter than later ones. Two
        // turns in a row are seldom disturbed.
        if turn == 1 && row.update_ms > LONG_MS {
            self.trees.truncate(1);
        }
        self.last = Some(row);
        Ok(())
    }

    /// Adds to the row what takes a look at the whole tree. Gives whether the twins have the same
    /// cost.
    pub(super) fn weigh(&mut self) -> bool {
        let (Some(row), [update, updates @ ..]) = (&mut self.last, &self.updates[..]) else { return true };
        let cost = |tree: &Bvh, update: &Update| update.sah_cost.unwrap_or_else(|| sah_cost(tree));
        let (tree, _) = &self.trees[0];
        row.sah_cost = cost(tree, update);
        row.primitives_refit = primitives_refit(tree, update);
        self.trees[1..].iter().zip(updates).all(|((twin, _), update)| cost(twin, update) == row.sah_cost)
    }
}

/// A copy of the first tree, and what updates it by a method.
fn start(name: &str, method: Method, stage: &Stage, poses: &[Vec<Vec3>]) -> Result<(Bvh, Worker)> {
    let indices = stage.triangles().indices;
    let poses: Vec<_> = poses.iter().map(|positions| Triangles { positions, indices }).collect();
    let mut tree = Bvh::clone(&stage.first_tree);
    let worker = method.start(&mut tree, &poses).with_context(|| format!("{name}: not prepared"))?;
    Ok((tree, worker))
}

/// Updates a tree, and gives the time in ms.
fn timed(name: &str, (tree, worker): &mut (Bvh, Worker), stage: &Stage) -> Result<(f64, Update)> {
    let (update, update_ms) = stage::timed(|| worker.update(tree, &stage.triangles()));
    Ok((update_ms, update.with_context(|| format!("{}: {name} failed", stage.scene.name))?))
}
