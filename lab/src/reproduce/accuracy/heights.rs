//! The bound on the height of trees: what a lower one would keep rotations from.
//!
//! The bound is a constant of the library. Here the paper's plain update runs with the library's
//! own `rotate`, which refuses what would be too high, from a depth that makes the bound lower.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_core::rotation::{area_changes_at, best, rotate};
use bvh_core::{Aabb, Bvh, MAX_HEIGHT, Node, Primitives, Triangles};

use super::bench::{Bench, Over};
use super::point::Point;
use crate::interrupt;
use crate::stage::ms;

/// Updates the subtree at `n`, which is `depth` below where the bound counts from.
fn update(nodes: &mut [Node], n: usize, depth: u32, order: &[u32], triangles: &Triangles<'_>) {
    let node = nodes[n];
    if !node.is_dynamic() {
        return;
    }
    let first = node.first();
    if node.is_leaf() {
        let slots = &order[first..first + node.count()];
        let boxes = slots.iter().map(|&p| triangles.aabb(p as usize));
        return nodes[n].set_aabb(boxes.fold(Aabb::EMPTY, Aabb::union));
    }
    update(nodes, first, depth + 1, order, triangles);
    update(nodes, first + 1, depth + 1, order, triangles);
    if let Some(rotation) = best(area_changes_at(nodes, first)) {
        rotate(nodes, first, rotation, depth);
    }
    let (l, r) = (nodes[first], nodes[first + 1]);
    nodes[n].refit(&l, &r);
}

/// Bounds from the height of the first tree up to the library's.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    if !bench.moves() {
        return Ok(());
    }
    let lowest = bench.stage.first_tree.height();
    let bounds: Vec<u32> = [32, 40, 48, 64, MAX_HEIGHT].into_iter().filter(|&b| b > lowest).collect();
    let bounds = [vec![lowest], bounds].concat();
    let (order, frames) = (bench.stage.first_tree.order().to_vec(), bench.log.effort.frames);
    let mut trees: Vec<(Vec<Node>, f64)> =
        bounds.iter().map(|_| (bench.stage.first_tree.nodes().to_vec(), 0.0)).collect();
    let played = bench.log.effort.played;
    for frame in 1..played {
        if interrupt::requested() {
            return Ok(());
        }
        bench.stage.pose(bench.stage.time_of(frame, frames));
        for ((nodes, time_ms), bound) in trees.iter_mut().zip(&bounds) {
            let start = Instant::now();
            update(nodes, 0, MAX_HEIGHT - bound, &order, &bench.stage.triangles());
            *time_ms += ms(start) / (played - 1) as f64;
        }
        bench.log.done(frame, played);
    }
    let built = trees.iter().map(|(nodes, _)| Bvh::new(nodes, order.clone()).context("not a tree"));
    let built = built.collect::<Result<Vec<Bvh>>>()?;
    let sweep = bench.sweep()?;
    let Some(Over { errors, selves }) = bench.over(&sweep, &built.iter().collect::<Vec<_>>()) else {
        return Ok(());
    };
    for (((bound, tree), (_, time_ms)), errors) in bounds.iter().zip(&built).zip(&trees).zip(errors) {
        let note = format!(
            "time of the plain update, mean of {}; errors on the last frame; bound {bound}, the tree is {} high",
            played - 1,
            tree.height()
        );
        let setting = match *bound == lowest {
            true => "height of the first tree".to_owned(),
            false => format!("{bound} levels"),
        };
        let point = Point::new("height bound", setting, *bound == MAX_HEIGHT, *time_ms).noted(note);
        bench.log.add_tree(&point, errors, &selves)?;
    }
    Ok(())
}
