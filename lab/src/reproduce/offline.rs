//! Trees that are built once, with all the time in the world: what annealing is worth with path
//! tracing (Kensler 2008).

use anyhow::Result;
use bvh_build::{Builder, build};
use bvh_core::{Bvh, sah_cost};
use rt_cpu::{RenderOptions, Traversal};
use scenes::LightEffects;
use serde::{Deserialize, Serialize};

use crate::compare::turns;
use crate::interrupt;
use crate::stage::{Renderer, Stage, timed};

/// Builders; the others are compared with the first.
pub(crate) const BUILDERS: [Builder; 3] = [Builder::Sweep, Builder::HillClimbed, Builder::Annealed];
/// Pictures taken through each tree; their mean time counts.
const PICTURES: u32 = 5;

/// A tree over the first frame of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct OfflineTree {
    pub(crate) builder: String,
    pub(crate) build_ms: f64,
    pub(crate) sah_cost: f64,
    /// A picture of the first frame with one path a pixel, mean of several.
    pub(crate) path_ms: f64,
}

/// Builds a tree by each builder, and traces paths through all of them in turn; nothing after an
/// interrupt.
pub(super) fn measure(stage: &mut Stage, size: u32) -> Result<Vec<OfflineTree>> {
    stage.pose(0.0);
    let mut trees: Vec<(OfflineTree, Bvh)> = Vec::new();
    for builder in BUILDERS {
        if interrupt::requested() {
            return Ok(Vec::new());
        }
        let (bvh, build_ms) = timed(|| build(&stage.triangles(), builder));
        let (bvh, name) = (bvh?, builder.name().to_owned());
        let sah_cost = sah_cost(&bvh);
        trees.push((OfflineTree { builder: name, build_ms, sah_cost, path_ms: 0.0 }, bvh));
    }
    let light = stage.scene.effects.light | LightEffects::DIFFUSE_BOUNCES;
    // One by one, through the tree that was annealed: a wider view of it would be optimised again.
    let (smooth, traversal) = (false, Traversal::Single);
    let options = RenderOptions { smooth, traversal, ..stage.options_with(light) };
    let mut renderer = Renderer::new(options, size);
    // The first picture through each tree warms up and does not count.
    for sample in 0..=PICTURES {
        renderer.options.sample = sample;
        for i in turns(trees.len(), sample as usize) {
            let (tree, bvh) = &mut trees[i];
            let (_, time_ms) = renderer.draw(stage, bvh);
            tree.path_ms += if sample > 0 { time_ms / f64::from(PICTURES) } else { 0.0 };
        }
    }
    Ok(trees.into_iter().map(|(tree, _)| tree).collect())
}
