//! How much is measured.

use clap::ValueEnum;

use rt_cpu::Traversal;

use super::SPEEDS;
use crate::pool::PAPER_THREADS;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Under a minute: few frames, small pictures.
    Quick,
    /// A quarter of an hour on two cores.
    Standard,
    /// The paper's protocol: its frames, loops, sizes and packets of rays.
    Full,
}

/// The settings that a preset stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Values {
    /// Fraction of the triangles of scenes that are simulated for minutes; all of them if `None`.
    pub(crate) detail: Option<f32>,
    /// Frames in a loop.
    pub(crate) frames: usize,
    pub(crate) loops: f64,
    /// Pixels on each side.
    pub(crate) size: u32,
    /// How rays are grouped.
    pub(crate) traversal: Traversal,
    /// One frame in this number is measured; the second number is for scenes of many triangles.
    pub(crate) measure_every: [usize; 2],
    /// Whether figure 5 is part of "everything".
    pub(crate) speeds: bool,
    /// Loops of figure 5.
    pub(crate) speed_loops: f64,
    /// Frames compared with brute force, and rays on each.
    pub(crate) check_frames: usize,
    pub(crate) check_rays: usize,
    /// Pictures of each scene.
    pub(crate) pictures: usize,
    /// Pixels on each side of those, and of heat maps.
    pub(crate) picture_size: [u32; 2],
    /// Frames of a loop measured beside other libraries.
    pub(crate) peer_frames: usize,
    /// Most triangles of a scene for which offline builders are tried.
    pub(crate) offline: usize,
    /// Most triangles of a scene for which methods that know the animation are prepared: on the lion
    /// that takes minutes (`reproduce fig6 --preset full --scene lion --strategy t-sah --frames 2`).
    pub(crate) prepared: usize,
}

/// Scenes of more triangles count as having many.
pub(crate) const MANY: usize = 500_000;

impl Preset {
    pub(crate) fn values(self) -> Values {
        match self {
            Self::Quick => Values {
                detail: Some(0.15),
                frames: 10,
                loops: 1.5,
                size: 160,
                traversal: Traversal::Tile,
                measure_every: [1, 1],
                speeds: false,
                speed_loops: 2.0,
                check_frames: 2,
                check_rays: 100,
                pictures: 3,
                picture_size: [240, 160],
                peer_frames: 2,
                offline: 0,
                prepared: MANY,
            },
            Self::Standard => Values {
                detail: None,
                frames: 50,
                loops: 1.5,
                size: 512,
                traversal: Traversal::Tile,
                measure_every: [5, 10],
                speeds: true,
                speed_loops: 3.0,
                check_frames: 4,
                check_rays: 200,
                pictures: 5,
                picture_size: [400, 240],
                peer_frames: 5,
                offline: 200_000,
                prepared: MANY,
            },
            Self::Full => Values {
                detail: None,
                frames: 100,
                loops: 2.3,
                size: 1024,
                traversal: Traversal::Packet,
                measure_every: [1, 1],
                speeds: true,
                speed_loops: 5.0,
                check_frames: 10,
                check_rays: 500,
                pictures: 5,
                picture_size: [400, 240],
                peer_frames: 20,
                offline: usize::MAX,
                prepared: usize::MAX,
            },
        }
    }
}

impl Values {
    /// Of how many frames of a scene one is measured.
    pub(crate) fn interval(&self, triangles: usize) -> usize {
        self.measure_every[usize::from(triangles > MANY)]
    }

    /// What differs from the paper's protocol, of figure 5 if that is run, one sentence each.
    pub(crate) fn departures(&self, figure_5: bool, threads: usize) -> Vec<String> {
        let paper = Preset::Full.values();
        let mut less = Vec::new();
        if let Some(detail) = self.detail {
            less.push(format!("cloth and statues at {:.0} % of their triangles", 100.0 * detail));
        }
        if self.frames != paper.frames {
            less.push(format!("{} frames a loop instead of {}", self.frames, paper.frames));
        }
        if self.loops != paper.loops {
            less.push(format!("{} loops instead of {}", self.loops, paper.loops));
        }
        if self.size != paper.size {
            less.push(format!("{0} x {0} pixels instead of {1} x {1}", self.size, paper.size));
        }
        if self.traversal != paper.traversal {
            less.push(format!(
                "rays traced by {} instead of packets of 8 x 8 with interval arithmetic",
                self.traversal
            ));
        }
        if threads != PAPER_THREADS {
            less.push(format!("{threads} threads instead of {PAPER_THREADS}"));
        }
        less.push("always: scenes are stand-ins, triangles are tested watertight, boxes and rotations are computed with SIMD".to_owned());
        if self.measure_every != paper.measure_every {
            let [few, many] = self.measure_every;
            less.push(format!(
                "every frame updated, one in {few} measured, in scenes above {MANY} triangles one in {many}; accuracy of \
                 trees of those over a fifth of the loop, without annealing"
            ));
        }
        if figure_5 && self.speed_loops != paper.speed_loops {
            less.push(format!("figure 5 over {} loops instead of {}", self.speed_loops, paper.speed_loops));
        }
        if figure_5 && self.measure_every != paper.measure_every {
            less.push(format!("of each loop of figure 5 {} frames measured", SPEEDS[0]));
        }
        if !self.speeds && !figure_5 {
            less.push("figure 5 only if named; what accuracy costs on one scene".to_owned());
        }
        if self.prepared < paper.prepared {
            less.push(format!("decomposition and t-sah in scenes of at most {} triangles", self.prepared));
        }
        if self.offline < paper.offline {
            less.push(match self.offline {
                0 => "no offline builders".to_owned(),
                most => format!("offline builders in scenes of at most {most} triangles"),
            });
        }
        less
    }
}
