//! What knobs are measured with: how much to do, where points go, and a scene.

use anyhow::Result;
use bvh_core::{Bvh, Triangles, sah_cost};
use rt_cpu::{Pixel, RenderOptions, cast};

use super::Point;
use crate::compare::turns;
use crate::interrupt;
use crate::reproduce::journal::Journal;
use crate::reproduce::preset::{MANY, Preset, Values};
use crate::reproduce::record::rounded;
use crate::reproduce::{Args, Spread, median};
use crate::stage::{Renderer, Stage};

/// Where points go, and how much is measured of each knob. What one knob alone has stands with that
/// knob.
pub(crate) struct Log<'a> {
    /// The scene's name in tables; empty if there is none.
    pub(super) label: &'a str,
    preset: Preset,
    /// Frames in a loop, over which strategies update their trees.
    pub(super) frames: usize,
    /// Whether the scene is so large that a fifth of the loop is played, and nothing annealed.
    pub(super) is_cut: bool,
    /// Pixels on a side of the images that are timed.
    pub(super) size: u32,
    pub(super) seed: u64,
    journal: &'a mut Journal<Point>,
    pub(super) points: Vec<Point>,
}

impl<'a> Log<'a> {
    /// For a scene of `triangles` triangles.
    pub(crate) fn new(
        label: &'a str,
        args: &Args,
        triangles: usize,
        journal: &'a mut Journal<Point>,
    ) -> Self {
        let (preset, seed, Values { frames, size, .. }) = (args.preset, args.seed, args.values());
        let is_cut = preset != Preset::Full && triangles > MANY;
        let size = size.min(preset.pick([512, 512, size]));
        Self { label, preset, frames, is_cut, size, seed, journal, points: Vec::new() }
    }

    /// What belongs to the preset, of three.
    pub(super) fn pick<T>(&self, of: [T; 3]) -> T {
        self.preset.pick(of)
    }

    /// Rounds in which contestants take turns, where one turn is short.
    pub(super) fn rounds(&self) -> usize {
        self.pick([3, 7, 9])
    }

    /// Takes what was measured; it is in the file when this returns. After an interrupt nothing is
    /// taken: it may be of fewer rounds or frames than the rest.
    pub(super) fn add(&mut self, point: Point) -> Result<()> {
        if interrupt::requested() {
            return Ok(());
        }
        let point = Point { scene: self.label.to_owned(), time_ms: rounded(point.time_ms), ..point };
        self.journal.append(std::slice::from_ref(&point))?;
        self.points.push(point);
        Ok(())
    }

    /// Takes a tree with its errors over a fresh one: SAH cost, which has no noise, and trace time.
    pub(super) fn add_tree(&mut self, point: &Point, [cost, trace_ms]: [f64; 2], noise: f64) -> Result<()> {
        self.add(point.with("SAH cost over a fresh sweep build", cost, "ratio"))?;
        self.add(Point { noise: Some(noise), ..point.with("trace time", trace_ms, "ms") })
    }
}

/// A scene under measurement.
pub(super) struct Bench<'a> {
    pub(super) stage: &'a mut Stage,
    pub(super) log: Log<'a>,
}

impl Bench<'_> {
    /// Moves the scene to the middle of its loop, where it has moved far from where it began.
    pub(super) fn pose_in_the_middle(&mut self) {
        self.stage.pose(0.5 * self.stage.scene.animation.duration());
    }

    /// Rendering as the paper times it: with what the scene calls for, flat.
    pub(super) fn flat(&self) -> RenderOptions {
        RenderOptions { smooth: false, ..self.stage.render_options() }
    }

    /// Renders a frame and gives the time.
    pub(super) fn trace(&self, tree: &Bvh, options: &RenderOptions) -> f64 {
        Renderer::new(*options, self.log.size).draw(self.stage, tree).1
    }

    /// What the scene's camera sees of triangles, and where its light arrives.
    pub(super) fn see(&self, tree: &Bvh, triangles: &Triangles<'_>, options: &RenderOptions) -> Vec<Pixel> {
        let (stage, size) = (&*self.stage, self.log.size);
        let mut pixels = vec![Pixel::default(); (size * size) as usize];
        cast(tree, triangles, &stage.camera(size, size), Some(&stage.light()), options, &mut pixels);
        pixels
    }

    /// SAH cost over that of a fresh tree, `sweep`, and trace time, of trees; and the trace times
    /// of the fresh tree in each of its turns. Nothing after an interrupt.
    ///
    /// Trees are traced in turns, and the fresh one three times a round: its times beside one
    /// another show the noise.
    pub(super) fn over(&self, sweep: &Bvh, trees: &[&Bvh]) -> Option<(Vec<[f64; 2]>, Vec<f64>)> {
        let mut turns: Vec<_> = trees.iter().copied().map(Some).collect();
        // Nothing stands for the fresh one: at the end, in the middle, at the start.
        for place in [trees.len(), trees.len().div_ceil(2), 0] {
            turns.insert(place, None);
        }
        // Short frames are disturbed the most, and more rounds of them cost little.
        let more = (SHORT / self.trace(sweep, &self.flat())).clamp(1.0, 6.0);
        let times = in_turns(self.log.rounds() * more as usize, turns.len(), |turn| {
            Ok(self.trace(turns[turn].unwrap_or(sweep), &self.flat()))
        });
        let (mut errors, mut selves) = (Vec::new(), Vec::new());
        for (turn, time_ms) in turns.into_iter().zip(times.ok()?) {
            match turn {
                Some(tree) => errors.push([sah_cost(tree) / sah_cost(sweep), time_ms]),
                None => selves.push(time_ms),
            }
        }
        (!interrupt::requested()).then_some((errors, selves))
    }
}

/// The factor by which times differ that should all be one, to the digits that say something.
pub(super) fn noise(selves: &[f64]) -> f64 {
    let factor = Spread::of(selves.iter().copied()).map_or(1.0, |times| times.max / times.min);
    (factor * 1e3).round() / 1e3
}

/// Numbers in a million.
pub(super) fn in_a_million(count: usize, of: usize) -> f64 {
    1e6 * count as f64 / of.max(1) as f64
}

/// How many pixels in a million see another triangle, or are lit otherwise.
pub(super) fn differing(a: &[Pixel], b: &[Pixel]) -> f64 {
    let seen = |pixel: &Pixel| (pixel.hit().map(|hit| hit.primitive), pixel.is_lit());
    in_a_million(a.iter().zip(b).filter(|(a, b)| seen(a) != seen(b)).count(), a.len())
}

/// Milliseconds of a frame below which more rounds are measured.
const SHORT: f64 = 20.0;

/// The milliseconds of each of `count` contestants that take turns for `rounds` rounds, another
/// first each time; `run` does a turn and gives its milliseconds. Ends early when interrupted.
///
/// A contestant's time is its median share of a round, times the shortest round: what else the
/// machine does slows all turns of a round alike.
pub(super) fn in_turns(
    rounds: usize,
    count: usize,
    mut run: impl FnMut(usize) -> Result<f64>,
) -> Result<Vec<f64>> {
    let (mut shares, mut shortest) = (vec![Vec::new(); count], f64::INFINITY);
    for round in (0..rounds.max(1)).take_while(|&round| round == 0 || !interrupt::requested()) {
        let mut times = vec![0.0; count];
        for i in turns(count, round) {
            times[i] = run(i)?;
        }
        let whole: f64 = times.iter().sum();
        shortest = shortest.min(whole);
        shares.iter_mut().zip(times).for_each(|(shares, time)| shares.push(time / whole));
    }
    Ok(shares.into_iter().map(|shares| median(shares) * shortest).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_how_far_apart_equal_trees_are() {
        assert_eq!(noise(&[]), 1.0);
        assert_eq!(noise(&[1.0, 1.5]), 1.5);
        assert_eq!(noise(&[0.5, 1.25, 0.75]), 2.5);
    }

    #[test]
    fn contestants_take_turns_and_slow_rounds_count_for_little() {
        let mut order = Vec::new();
        let times = in_turns(3, 2, |turn| {
            order.push(turn);
            // The second round takes nine times as long.
            Ok([1.0, 3.0][turn] * if (3..=4).contains(&order.len()) { 9.0 } else { 1.0 })
        });
        assert_eq!((order, times.unwrap()), (vec![0, 1, 1, 0, 0, 1], vec![1.0, 3.0]));
    }
}
