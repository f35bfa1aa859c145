//! What rendering a frame took: rays, and the time of each stage.

use std::time::{Duration, Instant};

use derive_more::{Add, AddAssign, Sum};

use crate::scene::Work;

/// Time by what it was spent on, added up over threads: on `n` busy threads it passes `n` times as
/// fast as on a clock. All zero unless [`RenderOptions::timed`](crate::RenderOptions::timed), and
/// on `wasm32-unknown-unknown`, where the standard library has no clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Add, AddAssign, Sum)]
pub struct StageTimes {
    /// Rays from the eye, finding and shading what they hit, and whatever has no stage of its own.
    pub primary: Duration,
    /// Tracing rays again because they met a surface with holes.
    pub alpha: Duration,
    /// Reading colours from textures.
    pub textures: Duration,
    /// Making and tracing shadow rays.
    pub shadow: Duration,
    /// Tracing rays reflected by mirrors.
    pub mirror: Duration,
    /// Rays that look for what hides the sky.
    pub ambient_occlusion: Duration,
    /// Tracing rays reflected by diffuse surfaces.
    pub diffuse_bounces: Duration,
}

impl StageTimes {
    /// Returns the sum of all times.
    #[must_use]
    pub fn total(&self) -> Duration {
        let Self { primary, alpha, textures, shadow, mirror, ambient_occlusion, diffuse_bounces } = *self;
        primary + alpha + textures + shadow + mirror + ambient_occlusion + diffuse_bounces
    }
}

/// What rendering a frame took. Numbers of rays, except for `rays_again`, and of hits are the same
/// for every [`Traversal`](crate::Traversal).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Add, AddAssign, Sum)]
pub struct RenderStats {
    /// Rays from the eye: one a pixel.
    pub rays_primary: u64,
    /// Rays from the light: one for each hit that faces it.
    pub rays_shadow: u64,
    /// Rays reflected by mirrors.
    pub rays_mirror: u64,
    /// Rays that look for what hides the sky.
    pub rays_ambient_occlusion: u64,
    /// Rays reflected by diffuse surfaces.
    pub rays_bounce: u64,
    /// Rays from the eye or the light traced a second time because they met a surface with holes.
    pub rays_again: u64,
    /// Rays from the eye that hit something.
    pub hits: u64,
    /// Shadow rays that did not arrive.
    pub shadowed: u64,
    /// Inner nodes opened, once for each ray or packet.
    pub nodes_visited: u64,
    /// Surfaces whose colour was read from a texture.
    pub textured: u64,
    /// How long the stages took, if [`RenderOptions::timed`](crate::RenderOptions::timed).
    pub times: StageTimes,
}

impl RenderStats {
    /// Rays of all kinds, those that were traced a second time once more.
    #[must_use]
    pub fn rays(&self) -> u64 {
        let direct = self.rays_primary + self.rays_shadow + self.rays_again;
        direct + self.rays_mirror + self.rays_ambient_occlusion + self.rays_bounce
    }
}

/// Counts of a tile, and a clock that gives each stretch of its time to one stage, so that nothing
/// counts twice.
#[derive(Default)]
pub(crate) struct Tally {
    pub(crate) stats: RenderStats,
    /// Only its `nodes` are read.
    pub(crate) work: Work,
    /// When the last stretch ended; `None` if nobody asked for times, or there is no clock.
    last: Option<Instant>,
}

impl Tally {
    pub(crate) fn start(timed: bool) -> Self {
        // There, asking for the time ends the program.
        let has_clock = !cfg!(all(target_family = "wasm", target_os = "unknown"));
        Self { last: (timed && has_clock).then(Instant::now), ..Self::default() }
    }

    /// Gives the time since the last call to a stage.
    #[inline]
    pub(crate) fn end(&mut self, stage: impl FnOnce(&mut StageTimes) -> &mut Duration) {
        if let Some(lap) = self.lap() {
            *stage(&mut self.stats.times) += lap;
        }
    }

    /// Gives the time since the last call to mirrors and diffuse bounces, by the numbers of their
    /// rays.
    pub(crate) fn end_reflected(&mut self, mirrored: usize, all: usize) {
        if let Some(lap) = self.lap() {
            let mirror = lap.mul_f64(mirrored as f64 / all.max(1) as f64).min(lap);
            self.stats.times.mirror += mirror;
            self.stats.times.diffuse_bounces += lap - mirror;
        }
    }

    fn lap(&mut self) -> Option<Duration> {
        let last = self.last.as_mut()?;
        let now = Instant::now();
        Some(now - std::mem::replace(last, now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_of_time_go_to_one_stage_each() {
        let mut tally = Tally::start(true);
        let start = tally.last.unwrap();
        tally.end(|t| &mut t.primary);
        std::thread::sleep(Duration::from_millis(2));
        tally.end(|t| &mut t.shadow);
        std::thread::sleep(Duration::from_millis(2));
        tally.end_reflected(1, 4);
        let times = tally.stats.times;
        assert_eq!(times.total(), tally.last.unwrap() - start);
        assert!(times.shadow >= Duration::from_millis(2));
        assert!(times.mirror > Duration::ZERO && times.diffuse_bounces > times.mirror * 2);
    }

    #[test]
    fn nobody_asks_nothing_is_timed() {
        let mut tally = Tally::start(false);
        tally.end(|t| &mut t.primary);
        tally.end_reflected(1, 2);
        assert_eq!(tally.stats.times, StageTimes::default());
    }
}
