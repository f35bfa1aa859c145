//! The rows of every table: strategies as measured, and two kinds of accounting the paper uses.
//!
//! A strategy of `bvh_update` is a contestant by itself; one that lives elsewhere is a line in
//! [`Contestant::all`]. `docs/EXTENDING.md` shows how.

use anyhow::Result;
use bvh_build::BuildOptions;
use bvh_core::{Bvh, Triangles};
use bvh_related::System;
use bvh_update::{Background, Builder, Load, Rotate, Strategy, Update, Updater};

use super::paper_binned;
use crate::pool::PAPER_THREADS;

/// A way of updating, and how its time is counted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contestant {
    pub(crate) name: &'static str,
    /// Name of the contestant that is run: another's where only the time is counted differently.
    pub(crate) of: &'static str,
    /// What is run.
    pub(crate) method: Method,
    /// What counts of an update's measured time: 1 as measured, 0 for an update that happens
    /// instantly, 1 / the paper's threads for a serial update that scales perfectly.
    pub(crate) factor: f64,
}

/// How a tree is brought up to date.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Method {
    Strategy(Strategy),
    /// A function that builds a new tree, and what it is, in words.
    Rebuild(fn(&mut Bvh, &Triangles<'_>) -> Result<Update>, &'static str),
    /// A system of another paper.
    System(System),
}

/// An instant sweep rebuild: the bound for every update (Kopta et al. 2012, section 3, "ideal
/// update").
pub(crate) const IDEAL: &str = "ideal";
/// A binned rebuild that scales perfectly (there, "ideal parallel binned").
pub(crate) const IDEAL_PARALLEL_BINNED: &str = "ideal-parallel-binned";
/// Poses, evenly spread over a loop, that are shown to methods that know the animation in advance.
pub(crate) const POSES: usize = 9;
/// A serial binned rebuild with bins along one axis, after Wald 2007.
pub(crate) const PAPER_BINNED: &str = "paper-binned";

/// Trees built in the background by all threads (Wald, Ize, Parker 2008), alone and with rotations
/// between one tree and the next (Kopta et al. 2012, section 5).
pub(crate) const ASYNCHRONOUS: &str = "asynchronous";
pub(crate) const ROTATE_ASYNCHRONOUS: &str = "rotate+asynchronous";

/// What runs only if asked for. All else runs: the paper's experiments and what it suggests, the
/// systems it is measured against, today's fastest rebuilds, and this project's own.
const ON_DEMAND: [&str; 4] = ["refit+rebuild", "refit+regrow", "refit+background", "refit+rotate+reinsert"];

impl Contestant {
    /// All of them.
    pub(crate) fn all() -> Vec<Self> {
        let measured = |name, method| Self { name, of: name, method, factor: 1.0 };
        let strategies = Strategy::all();
        let mut all: Vec<_> = strategies.iter().map(|&s| measured(s.name(), Method::Strategy(s))).collect();
        let about = "serial binned rebuild with bins along one axis";
        all.push(measured(PAPER_BINNED, Method::Rebuild(paper_binned::update, about)));
        all.extend(System::ALL.map(|s| measured(s.name(), Method::System(s))));
        for (name, rotate) in [(ASYNCHRONOUS, None), (ROTATE_ASYNCHRONOUS, Some(Rotate::default()))] {
            let background = Background::default().with_rotate(rotate).with_builder(Builder::BinnedParallel);
            all.push(measured(name, Method::Strategy(Strategy::Background(background))));
        }
        for (name, builder, factor) in [
            (IDEAL, Builder::Sweep, 0.0),
            (IDEAL_PARALLEL_BINNED, Builder::Binned, 1.0 / PAPER_THREADS as f64),
        ] {
            let method = Method::Strategy(Strategy::Rebuild(builder, BuildOptions::default()));
            all.push(Self { name, of: builder.name(), method, factor });
        }
        all
    }

    /// Those that run unless others are asked for.
    pub(crate) fn default_ones() -> Vec<Self> {
        Self::all().into_iter().filter(|c| !ON_DEMAND.contains(&c.name)).collect()
    }

    /// The one of that name.
    pub(crate) fn from_name(name: &str) -> Result<Self, String> {
        let all = Self::all();
        all.iter().copied().find(|c| c.name == name).ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|c| c.name).collect();
            format!("no such strategy; there are {}", names.join(", "))
        })
    }

    /// How its update time comes about, in words; nothing if it is a strategy's, simply measured.
    pub(crate) fn accounting(&self) -> Option<String> {
        match self.method {
            _ if self.factor == 0.0 => Some(format!("{} rebuild, its time not counted", self.of)),
            _ if self.factor < 1.0 => {
                Some(format!("serial {} rebuild, its time divided by {PAPER_THREADS}", self.of))
            }
            Method::Strategy(_) => None,
            Method::Rebuild(_, about) => Some(about.to_owned()),
            Method::System(system) => system
                .knows_animation()
                .then(|| format!("knows {POSES} poses in advance; preparation not counted")),
        }
    }
}

impl Method {
    /// The method at work on `tree`. Methods that know the animation look at `poses` and put a tree
    /// of their own in the place of `tree`.
    pub(crate) fn start(self, tree: &mut Bvh, poses: &[Triangles<'_>]) -> Result<Worker> {
        Ok(match self {
            Self::Strategy(strategy) => {
                let mut updater = Updater::new(strategy);
                Box::new(move |tree, triangles, load| {
                    updater.report(load);
                    Ok(updater.update(tree, triangles)?)
                })
            }
            Self::Rebuild(function, _) => Box::new(move |tree, triangles, _| function(tree, triangles)),
            Self::System(system) => {
                let mut keeper = bvh_related::Keeper::new(system, tree, poses)?;
                Box::new(move |tree, triangles, _| Ok(keeper.update(tree, triangles)?))
            }
        })
    }

    /// Whether the method has to know the animation in advance.
    pub(crate) fn knows_animation(&self) -> bool {
        matches!(self, Self::System(system) if system.knows_animation())
    }

    /// Whether trees depend on how long something takes.
    pub(crate) fn depends_on_time(&self) -> bool {
        matches!(self, Self::Strategy(Strategy::Background(_)))
    }

    /// Whether the tree depends on the current frame only.
    pub(crate) fn rebuilds(&self) -> bool {
        matches!(self, Self::Strategy(Strategy::Rebuild(..)) | Self::Rebuild(..))
    }
}

/// The load of a picture with `size` pixels on a side, before one is rendered: a ray from the eye
/// and one from the light for each pixel, in packets.
pub(super) fn load_of(size: u32) -> Load {
    Load::PacketRays(2 * u64::from(size).pow(2))
}

/// A method with what it keeps from frame to frame. Brings its tree up to date with the triangles;
/// the load is what rays ask of the tree.
pub(crate) type Worker = Box<dyn FnMut(&mut Bvh, &Triangles<'_>, Load) -> Result<Update> + Send + Sync>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_every_default_exists() {
        let all = Contestant::all();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a.name != b.name), "{} twice", a.name);
            assert!(all.iter().any(|b| b.name == a.of), "{} runs nothing", a.name);
        }
        assert_eq!(Contestant::default_ones().len(), all.len() - ON_DEMAND.len());
        let paper_binned = Contestant::from_name(PAPER_BINNED).unwrap();
        assert!(paper_binned.accounting().unwrap().contains("serial binned rebuild"));
        let another = Contestant { method: Method::Rebuild(paper_binned::update, "another"), ..paper_binned };
        assert_eq!(another.accounting().unwrap(), "another");
    }

    #[test]
    fn asynchronous_rebuilding_is_by_the_parallel_builder() {
        for (name, rotates) in [(ASYNCHRONOUS, false), (ROTATE_ASYNCHRONOUS, true)] {
            let Method::Strategy(Strategy::Background(background)) =
                Contestant::from_name(name).unwrap().method
            else {
                panic!("{name} is another strategy")
            };
            assert_eq!((background.builder, background.rotate.is_some()), (Builder::BinnedParallel, rotates));
        }
    }

    #[test]
    fn a_picture_asks_for_two_rays_a_pixel() {
        assert_eq!(load_of(16), Load::PacketRays(512));
    }

    #[test]
    fn auto_weighs_costs_by_the_load() {
        let indices: Vec<_> = (0..300).map(|i| [0, 1, 2].map(|corner| 3 * i + corner)).collect();
        let position = |v: u32, spread| [v / 3, v / 3 * spread * 7 % 300, v % 3].map(|x| x as f32).into();
        let positions =
            [0, 1].map(|spread| (0..900).map(|v| position(v, spread)).collect::<Vec<bvh_core::Vec3>>());
        let [before, after] = [0, 1].map(|i| Triangles { positions: &positions[i], indices: &indices });
        let lost_ms = |rays| {
            let mut tree = bvh_build::build(&before, Builder::Ploc).unwrap();
            let mut worker = Contestant::from_name("auto").unwrap().method.start(&mut tree, &[]).unwrap();
            worker(&mut tree, &after, Load::PacketRays(rays)).unwrap().reason.unwrap().lost_ms
        };
        assert!(lost_ms(1 << 40) > 1000.0 * lost_ms(0), "{} {}", lost_ms(1 << 40), lost_ms(0));
        assert!(lost_ms(0) > 0.0);
    }
}
