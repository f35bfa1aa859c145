//! Pictures: how coarse they are, tracing them, and what is measured on them.

use std::cmp::Reverse;

use bvh_core::TriangleTest;
use rayon::prelude::*;
use rt_cpu::{Camera, Image, Output, RenderOptions, render};
use scenes::LightEffects;
use stage::Stage;

use crate::canvas::{Canvas, Rect};
use crate::side::Side;
use crate::state::{Shown, State};

/// Milliseconds that a picture may take while something moves, and the least of them for tracing:
/// 25 frames a second, and 15 in a browser, which may have one thread.
const PICTURE_BUDGET: f64 = if cfg!(target_family = "wasm") { 60.0 } else { 36.0 };
const TRACE_BUDGET: f64 = 10.0;
/// Greatest width of the picture that triangle tests are compared on.
const PROBE: u32 = 96;

/// A triangle test beside that in double precision, on a small picture of a view that stands still.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    test: TriangleTest,
    /// Nanoseconds a ray with either.
    pub(crate) ns: f64,
    pub(crate) exact_ns: f64,
    /// Pixels that differ, and all of them.
    pub(crate) differ: usize,
    pub(crate) pixels: usize,
}

impl State {
    /// The parts of the canvas that show a tree each.
    pub(crate) fn ports(&self) -> Vec<Rect> {
        let (width, height) = (self.picture.width as i32, self.picture.height as i32);
        let all = Rect { x: 0, y: 0, width, height };
        match self.settings.right {
            Some(_) => vec![
                Rect { width: (width / 2).max(1), ..all },
                Rect { x: width / 2, width: width - width / 2, ..all },
            ],
            None => vec![all],
        }
    }

    pub(crate) fn camera(&self, stage: &Stage, port: Rect, coarse: u32) -> Camera {
        let size = |pixels: i32| (pixels as u32).div_ceil(coarse).max(1);
        stage::camera(self.eye.view(stage.view()), size(port.width), size(port.height))
    }

    /// Draws the viewer as it is now. While something moves, the picture of each tree is as coarse
    /// as it has to be to keep its pace, with as much time for either. Once nothing does, each call
    /// adds a sample, until the picture is that of `xtask render`, pixel for pixel.
    pub fn draw(&mut self) -> &Canvas {
        let start = (self.clock)();
        let (light, samples, plays) = (self.light_effects(), self.samples(), self.plays());
        let mut shown = self.shown.take();
        let did_trace = shown.as_mut().is_some_and(|shown| self.trace(shown, light, samples, plays));
        self.shown = shown;
        self.canvas.clone_from(&self.picture);
        self.draw_overlay();
        self.stale = false;
        if did_trace {
            let traced: f64 = self.sides().map(|side| side.trace_ms).sum();
            let rest = (1e3 * ((self.clock)() - start) - traced).max(0.0);
            self.last_ms = [std::mem::take(&mut self.step_ms), traced, rest];
        }
        &self.canvas
    }

    /// Hands the canvas to the overlay.
    pub(crate) fn on_canvas(&mut self, draw: impl FnOnce(&Self, &mut Canvas)) {
        let mut canvas = std::mem::take(&mut self.canvas);
        draw(self, &mut canvas);
        self.canvas = canvas;
    }

    /// Traces a picture or another sample of it, if there is need, and returns whether there was.
    fn trace(&mut self, shown: &mut Shown, light: LightEffects, samples: u32, plays: bool) -> bool {
        let moves = std::mem::take(&mut self.moved);
        let frame = shown.frame;
        let there = || shown.sides.iter().filter(|side| side.frame == frame);
        let done = there().map(|side| side.count).min().unwrap_or(0);
        // Between two frames of the animation the picture stays, and once nothing moves it becomes
        // finer. While a scene is loading it stays too: a fine picture may take a second, for which
        // the scene would wait.
        let waits = (plays || self.is_loading()) && done > 0 || there().all(|side| side.is_done(samples));
        if !moves && waits {
            return false;
        }
        let smooth = !self.settings.heat;
        if smooth && shown.stage.mesh().normals.is_none() {
            shown.stage.smooth();
        }
        let output =
            if self.settings.heat { Output::NodesVisited { most: shown.hottest } } else { Output::Shaded };
        let options = RenderOptions {
            triangle_test: self.settings.test,
            output,
            timed: true,
            ..shown.stage.options_with(light)
        };
        // A step that took long, as one with a rebuild, leaves less time to trace: in place by
        // waiting, beside it by its cores.
        let left = (PICTURE_BUDGET - self.step_ms - self.last_ms[2]).max(TRACE_BUDGET);
        let budget = moves.then_some(left / shown.sides.len().max(1) as f64);
        // A fine picture may take long, and events wait for it: one tree at a time, the one with
        // the coarser picture first.
        let mut sides: Vec<_> = shown.sides.iter_mut().zip(self.ports()).collect();
        sides.retain(|(side, _)| side.frame == frame);
        if !moves {
            sides.retain(|(side, _)| !side.is_done(samples));
            sides.sort_by_key(|(side, _)| (Reverse(side.coarse_now), side.count));
            sides.truncate(1);
        }
        for (side, port) in sides {
            side.choose_coarse(shown.frame, budget, plays);
            let coarse = side.coarse_now;
            let camera = self.camera(&shown.stage, port, coarse);
            side.trace(&shown.stage, shown.frame, &camera, &options, self.clock);
            if samples > 1 && coarse == 1 {
                side.estimate_noise();
            }
            self.copy(side, port, coarse);
        }
        let is_fine = shown.sides.first().is_some_and(|side| side.coarse_now == 1);
        if moves {
            self.probe = None;
        } else if smooth && is_fine && self.probe.is_none_or(|probe| probe.test != self.settings.test) {
            self.probe = self.compare_tests(shown, &options);
        }
        true
    }

    /// Traces a small picture with the triangle test that is set, and with that in double
    /// precision.
    fn compare_tests(&self, shown: &Shown, options: &RenderOptions) -> Option<Probe> {
        let (port, side) = (self.ports()[0], shown.sides.first()?);
        let camera = self.camera(&shown.stage, port, (port.width as u32).div_ceil(PROBE).max(1));
        let (mesh, light) = (shown.stage.mesh(), shown.stage.light());
        let (width, height) = (camera.width, camera.height);
        let traced = |triangle_test| {
            let options = RenderOptions { triangle_test, timed: false, ..*options };
            let mut image = Image::new(width, height);
            let start = (self.clock)();
            let stats = render(&side.tree, &mesh, &camera, Some(&light), &options, &mut image);
            (1e9 * ((self.clock)() - start) / stats.rays().max(1) as f64, image)
        };
        let ((ns, ours), (exact_ns, exact)) = (traced(options.triangle_test), traced(TriangleTest::Double));
        let seen = |pixel: &[f32; 3]| pixel.map(|c| self.table.encode(c));
        let differ = ours.pixels().iter().zip(exact.pixels()).filter(|(a, b)| seen(a) != seen(b)).count();
        Some(Probe { test: options.triangle_test, ns, exact_ns, differ, pixels: ours.pixels().len() })
    }

    /// Copies a traced picture to its part of the whole, in sRGB.
    fn copy(&mut self, side: &Side, port: Rect, coarse: u32) {
        let (width, factor) = (self.picture.width as usize, 1.0 / side.count.max(1) as f32);
        let (coarse, source) = (coarse as usize, side.sum.width().max(1) as usize);
        let encode = |&[r, g, b]: &[f32; 3]| [r, g, b].map(|c| self.table.encode(c * factor));
        let rows = self.picture.rgba.par_chunks_mut(4 * width).enumerate();
        rows.skip(port.y as usize).take(port.height as usize).for_each(|(y, row)| {
            let row = &mut row[4 * port.x as usize..][..4 * port.width as usize];
            let from = &side.sum.pixels()[y / coarse * source..][..source];
            for (to, pixel) in row.chunks_mut(4 * coarse).zip(from) {
                let [r, g, b] = encode(pixel);
                to.chunks_exact_mut(4).for_each(|to| to.copy_from_slice(&[r, g, b, 255]));
            }
        });
    }
}
