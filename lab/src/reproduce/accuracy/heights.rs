//! The bound on the height of trees: what a lower one would keep rotations from.
//!
//! The bound is a constant of the library. Here the paper's plain update runs with the library's
//! own `rotate`, which refuses what would be too high, from a depth that makes the bound lower.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_core::rotation::{area_changes_at, best, rotate};
use bvh_core::{Aabb, Bvh, MAX_HEIGHT, Node, Primitives, Triangles};

use super::bench::Bench;
use super::trees::{Entrant, play};
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
    let first = Bvh::clone(&bench.stage.first_tree);
    let lowest = first.height();
    let higher = [32, 40, 48, 64, MAX_HEIGHT].into_iter().filter(|&bound| bound > lowest);
    let entrant = |bound: u32| {
        let (mut nodes, order) = (first.nodes().to_vec(), first.order().to_vec());
        let setting = match bound == lowest {
            true => "height of the first tree".to_owned(),
            false => format!("{bound} levels"),
        };
        let run = move |tree: &mut Bvh, triangles: &Triangles<'_>| {
            let start = Instant::now();
            update(&mut nodes, 0, MAX_HEIGHT - bound, &order, triangles);
            let time_ms = ms(start);
            *tree = Bvh::new(&nodes, order.clone()).context("not a tree")?;
            Ok((time_ms, tree.height()))
        };
        Entrant::new(setting, bound == MAX_HEIGHT, first.clone(), Box::new(run))
    };
    let entrants = std::iter::once(lowest).chain(higher).map(entrant).collect();
    play(bench, "height bound", entrants)
}
