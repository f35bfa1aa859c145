//! Triangle tests in whole frames of a scene, as users render them.

use anyhow::Result;
use rt_cpu::{RenderOptions, Traversal, TriangleTest};

use super::bench::{Bench, differing, in_turns};
use super::point::Point;
use crate::stage::fresh_tree;

/// Every test, in tiles, in packets and ray by ray: frames with shadows, against those of `f64`.
pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    bench.pose_in_the_middle();
    let tree = fresh_tree(bench.stage)?;
    for (condition, traversal, rounds) in [
        ("tiles", Traversal::Tile, 6),
        ("packets", Traversal::Packet, 3),
        ("single rays", Traversal::Single, 2),
    ] {
        let with = |triangle_test| RenderOptions { triangle_test, traversal, ..bench.flat() };
        let all = TriangleTest::ALL;
        let times =
            in_turns(rounds * bench.log.effort.rounds, all.len(), |i| Ok(bench.trace(&tree, &with(all[i]))))?;
        let see = |test| bench.see(&tree, &bench.stage.triangles(), &with(test));
        let exact = see(TriangleTest::Double);
        let errors = all.map(|test| differing(&see(test), &exact));
        for ((test, time_ms), error) in all.into_iter().zip(times).zip(errors) {
            let knob = format!("triangle test at {condition}");
            let note = "time of a frame with primary and shadow rays, in the middle of the loop".to_owned();
            let is_default = test == TriangleTest::default();
            let point = Point { note, ..Point::new(&knob, test.name(), is_default, time_ms) };
            let name = "pixels seen or lit otherwise than with f64";
            bench.log.add(point.with(name, error, "in a million"))?;
        }
    }
    Ok(())
}
