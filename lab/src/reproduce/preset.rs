//! How much is measured.

use clap::ValueEnum;

use rt_cpu::Traversal;

use super::SPEED_SAMPLES;
use super::lane::{LONG_MS, MOST_TWINS, SHORT_MS};
use crate::pool::PAPER_THREADS;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Half a minute on two cores: few frames, small scenes and pictures.
    Quick,
    /// About six minutes on two cores.
    Standard,
    /// The paper's protocol: its frames, loops, sizes and packets of rays.
    Full,
}

/// The settings that a preset stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Values {
    /// Fraction of the scenes' triangles ([`scenes::SceneOptions::detail`]); all of them if `None`.
    pub(crate) detail: Option<f32>,
    /// Frames in a loop.
    pub(crate) frames: usize,
    pub(crate) loops: f64,
    /// Pixels on each side.
    pub(crate) size: u32,
    /// How rays are grouped.
    pub(crate) traversal: Traversal,
    /// Turns that each strategy has in a frame, 1 or 2; the shorter times count.
    pub(crate) turns: usize,
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
    /// Most triangles of a scene for which offline builders are tried, where a claim judges them.
    pub(crate) offline: usize,
    /// Most triangles of a scene for which methods that know the animation are prepared: on the
    /// lion that takes minutes (`reproduce fig6 --preset full --scene lion --strategy t-sah
    /// --frames 2`). With the museum's 75,796 triangles `time cargo xtask reproduce fig4 --preset
    /// standard --scene bart-museum --frames 1 --loops 1 --strategy t-sah` took 8.2 s and 13.4 s of
    /// processor time, with `--strategy refit` 0.4 and 0.5 (EPYC Zen 3, 2 cores, 2026-11-27,
    /// d2c5478).
    pub(crate) prepared: usize,
}

/// Scenes of more triangles count as having many.
pub(crate) const MANY: usize = 500_000;

impl Preset {
    /// What belongs to this preset, of three.
    pub(crate) fn pick<T>(self, [quick, standard, full]: [T; 3]) -> T {
        match self {
            Self::Quick => quick,
            Self::Standard => standard,
            Self::Full => full,
        }
    }

    pub(crate) fn values(self) -> Values {
        Values {
            detail: self.pick([Some(0.05), None, None]),
            frames: self.pick([10, 50, 100]),
            loops: self.pick([1.5, 1.5, 2.3]),
            size: self.pick([128, 512, 1024]),
            traversal: self.pick([Traversal::Tile, Traversal::Tile, Traversal::Packet]),
            turns: self.pick([1, 2, 2]),
            measure_every: self.pick([[1, 1], [5, 10], [1, 1]]),
            speeds: self.pick([false, true, true]),
            speed_loops: self.pick([2.0, 3.0, 5.0]),
            check_frames: self.pick([2, 4, 10]),
            check_rays: self.pick([100, 100, 500]),
            pictures: self.pick([3, 5, 5]),
            picture_size: self.pick([[240, 160], [400, 240], [400, 240]]),
            peer_frames: self.pick([2, 5, 20]),
            offline: self.pick([0, 200_000, usize::MAX]),
            prepared: self.pick([6_000, MANY, usize::MAX]),
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
        let (paper, [few, many]) = (Preset::Full.values(), self.measure_every);
        let samples = self.measure_every != paper.measure_every;
        let instead =
            |ours: String, papers: String| (ours != papers).then(|| format!("{ours} instead of {papers}"));
        let other = |words: fn(&Self) -> String| instead(words(self), words(&paper));
        let less = [
            self.detail.map(|part| format!("scenes at about {:.0} % of their triangles", 100.0 * part)),
            other(|v| format!("{} frames a loop", v.frames)),
            other(|v| format!("{} loops", v.loops)),
            other(|v| format!("{0} x {0} pixels", v.size)),
            other(|v| format!("traversal by {}", v.traversal)),
            instead(format!("{threads} threads"), format!("{PAPER_THREADS} threads")),
            Some(
                "always: scenes are stand-ins; triangles are tested watertight; boxes and rotations are computed with SIMD; \
                 subtrees that stand still are skipped; trees have at most 96 levels, and triangles are stored in the order of \
                 the first tree's leaves; rebuilds try up to 32 bins on three axes; packets go first to the child that is \
                 nearer along their first ray, and shadow rays form packets of 64 successive hits, from the light; offline builders \
                 where the claim about annealing is judged"
                    .to_owned(),
            ),
            (self.turns > 1).then(|| {
                format!(
                    "each strategy has two equal trees, updated and traced in turns; of either time the shorter counts (where an \
                     update takes less than {SHORT_MS} ms, of up to {} equal trees; what takes more than {LONG_MS} ms has one \
                     turn); strategies that know the animation have one tree, which is traced twice, and those that build in the \
                     background play the loops by themselves, once",
                    1.0 + MOST_TWINS
                )
            }),
            samples.then(|| {
                format!(
                    "every frame updated, one in {few} measured, in scenes above {MANY} triangles one in {many}, there in one turn; accuracy of \
                     trees of those over a fifth of the loop, without annealing"
                )
            }),
            other(|v| format!("{} loops of figure 5", v.speed_loops)).filter(|_| figure_5),
            (figure_5 && samples).then(|| format!("of each loop of figure 5 {SPEED_SAMPLES} frames measured")),
            (!self.speeds && !figure_5)
                .then(|| "figure 5 only if named; what accuracy costs on one scene".to_owned()),
            (self.prepared < paper.prepared)
                .then(|| format!("decomposition and t-sah in scenes of at most {} triangles", self.prepared)),
            (self.offline < paper.offline)
                .then(|| format!("offline builders in scenes of at most {} triangles", self.offline)),
        ];
        less.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_is_the_papers_protocol_and_says_where_it_departs() {
        let full = Preset::Full.values();
        assert_eq!((full.detail, full.frames, full.loops, full.size), (None, 100, 2.3, 1024));
        assert_eq!((full.traversal, full.measure_every, full.speeds), (Traversal::Packet, [1, 1], true));
        let [always, twins] = &full.departures(true, PAPER_THREADS)[..] else { panic!("other departures") };
        for words in
            ["stand-ins", "watertight", "SIMD", "skipped", "96 levels", "three axes", "64 successive"]
        {
            assert!(always.contains(words), "{words}");
        }
        assert!(twins.contains("two equal trees"));
        let few = full.departures(true, 2);
        assert!(few.contains(&"2 threads instead of 8 threads".to_owned()), "{few:?}");
        let standard = Preset::Standard.values().departures(true, PAPER_THREADS).join("\n");
        for words in ["50 frames a loop instead of 100", "512 x 512", "by tile", "one in 5 measured"] {
            assert!(standard.contains(words), "{words}: {standard}");
        }
    }
}
