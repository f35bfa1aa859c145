//! SIMD levels: pixels and nodes that differ from what is computed one by one.

use std::time::Instant;

use anyhow::{Context, Result};
use bvh_core::SimdLevel;
use bvh_update::{Rotate, Scratch, Strategy, plain, update};
use rt_cpu::{RenderOptions, Traversal};

use super::bench::Bench;
use super::point::Point;
use crate::stage::ms;

/// Images against one traced ray by ray, trees against the plain recursion, at every level of this machine.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let first_tree = bench.stage.first_tree.clone();
    bench.pose_in_the_middle();
    let mut reference_tree = first_tree.clone();
    plain::update(&mut reference_tree, &bench.stage.triangles(), Some(Rotate::default()));
    let one_by_one =
        RenderOptions { traversal: Traversal::Single, simd: SimdLevel::Baseline, ..bench.flat() };
    let size = bench.effort.size;
    let (reference, _) = bench.trace(&reference_tree, &one_by_one, size, 1);

    for level in SimdLevel::available() {
        let mut tree = first_tree.clone();
        let mut scratch = Scratch::with_level(level);
        let rotate = Strategy::RefitRotate(Rotate::default());
        let mut update_ms = f64::INFINITY;
        for _ in 0..bench.effort.repeats {
            tree.clone_from(&first_tree);
            let start = Instant::now();
            update(&mut tree, &bench.stage.triangles(), &rotate, &mut scratch)
                .context("the update failed")?;
            update_ms = update_ms.min(ms(start));
        }
        let options = RenderOptions { simd: level, ..bench.flat() };
        let (image, trace_ms) = bench.trace(&tree, &options, size, bench.effort.repeats);
        let bits = |pixel: &[f32; 3]| pixel.map(f32::to_bits);
        let pixels = image.pixels().iter().zip(reference.pixels());
        let nodes = tree.nodes().iter().zip(reference_tree.nodes());
        for (error_name, error, unit, time_ms, note) in [
            (
                "pixels that differ from tracing one by one",
                pixels.filter(|(a, b)| bits(a) != bits(b)).count(),
                "pixels",
                trace_ms,
                format!("time of tracing {size} x {size} pixels; compared bit by bit"),
            ),
            (
                "nodes that differ from the plain recursion",
                nodes.filter(|(a, b)| a != b).count(),
                "nodes",
                update_ms,
                format!("time of refitting and rotating {} nodes once", tree.nodes().len()),
            ),
        ] {
            bench.add(Point {
                knob: "SIMD level".to_owned(),
                setting: level.name().to_owned(),
                is_default: level == SimdLevel::best(),
                error_name: error_name.to_owned(),
                error: error as f64,
                unit: unit.to_owned(),
                time_ms,
                note,
                ..Point::default()
            })?;
        }
    }
    Ok(())
}
