//! A scene with all that takes long to make: to be made beside the thread that draws.

use bvh_build::{BuildError, Builder, build};
use bvh_core::{Triangles, Vec3, sah_cost};
use rt_cpu::{Image, Output, RenderOptions, render};
use scenes::Scene;
use stage::Stage;

use crate::boxes::TypicalCost;

/// Nodes visited for a pixel that the heat shows white, over the mean of the first frame with its
/// fresh tree.
const HOTTEST: u64 = 8;
/// Side of the picture that this mean is taken from.
const HEAT_SIZE: u32 = 64;

/// Frames whose fresh trees are built. Between them costs are interpolated.
const FRESH_FRAMES: usize = 13;

/// A scene that is ready to be shown.
pub struct Ready {
    pub(crate) stage: Stage,
    pub(crate) typical: TypicalCost,
    pub(crate) hottest: u32,
    /// SAH cost of the first tree.
    pub(crate) first_cost: f64,
    fresh: Option<FreshCosts>,
}

/// The costs of fresh trees, still to be found: work for another thread, or for moments between
/// frames.
pub struct FreshCosts {
    triangles: Vec<[u32; 3]>,
    /// The frames that are left, each with its positions.
    poses: Vec<(usize, Vec<Vec3>)>,
}

impl Ready {
    /// Makes a scene ready: builds its first tree and looks at it. Takes about a second for 300,000
    /// triangles.
    ///
    /// # Errors
    /// If the scene has more triangles than a tree can number.
    pub fn new(scene: Scene) -> Result<Self, BuildError> {
        Stage::new(scene).map(Self::of)
    }

    /// Makes a stage ready, which must be at time 0. Takes a third of the time that the stage took
    /// to make.
    #[must_use]
    pub fn of(mut stage: Stage) -> Self {
        let (frames, typical) = (stage.scene.frames.max(1), TypicalCost::of(&stage.first_tree));
        let options = RenderOptions { output: Output::NodesVisited { most: 1 }, ..stage.render_options() };
        let (camera, light) = (stage.camera(HEAT_SIZE, HEAT_SIZE), stage.light());
        let mut image = Image::new(HEAT_SIZE, HEAT_SIZE);
        let stats = render(&stage.first_tree, &stage.mesh(), &camera, Some(&light), &options, &mut image);
        let mean = HOTTEST * stats.nodes_visited / u64::from(HEAT_SIZE * HEAT_SIZE);
        let count = FRESH_FRAMES.min(frames);
        let at = |i: usize| (frames - 1) * i / (count - 1).max(1);
        let poses = (0..count).rev().map(|i| {
            stage.pose(stage.time_of(at(i), frames));
            (at(i), stage.triangles().positions.to_vec())
        });
        let poses = poses.collect();
        let fresh = FreshCosts { triangles: stage.triangles().indices.to_vec(), poses };
        stage.smooth();
        let first_cost = sah_cost(&stage.first_tree);
        let hottest = mean.clamp(16, 100_000) as u32;
        Self { stage, typical, hottest, first_cost, fresh: Some(fresh) }
    }

    /// Hands over the costs of fresh trees to be found; `None` the second time. What is found is an
    /// [`Event::Fresh`](crate::Event::Fresh).
    pub fn take_fresh_costs(&mut self) -> Option<FreshCosts> {
        self.fresh.take()
    }
}

impl Iterator for FreshCosts {
    type Item = (usize, f64);

    /// Builds a tree with the sweep builder and gives the frame and the tree's SAH cost. O(n log n)
    /// for n triangles.
    fn next(&mut self) -> Option<(usize, f64)> {
        let (frame, positions) = self.poses.pop()?;
        let tree = build(&Triangles { positions: &positions, indices: &self.triangles }, Builder::Sweep);
        Some((frame, tree.map_or(0.0, |tree| sah_cost(&tree))))
    }
}
