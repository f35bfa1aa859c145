//! The rows of every table: strategies as measured, and two kinds of accounting the paper uses.
//!
//! A strategy of `bvh_update` is a contestant by itself; one that lives elsewhere is a line in
//! [`Contestant::all`]. `docs/EXTENDING.md` shows how.

use anyhow::{Context, Result};
use bvh_core::{Bvh, Triangles};
use bvh_update::{Auto, Load, Strategy, Update, Updater};

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
    pub(crate) counted: Counted,
}

/// How a tree is brought up to date.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Method {
    Strategy(Strategy),
    /// A function that builds a new tree, and what it is, in words.
    Rebuild(fn(&mut Bvh, &Triangles<'_>) -> Result<Update>, &'static str),
}

/// How the time of an update is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Counted {
    /// As measured.
    Measured,
    /// Not at all: an update that happens instantly.
    Free,
    /// Divided by the paper's number of threads: a serial update that scales perfectly.
    Divided,
}

/// An instant sweep rebuild: the bound for every update (Kopta et al. 2012, section 3, "ideal
/// update").
pub(crate) const IDEAL: &str = "ideal";
/// A binned rebuild that scales perfectly (there, "ideal parallel binned").
pub(crate) const IDEAL_PARALLEL_BINNED: &str = "ideal-parallel-binned";
/// A serial binned rebuild of 2012, with bins along one axis.
pub(crate) const PAPER_BINNED: &str = "paper-binned";

/// What runs unless something else is asked for: the paper's experiments and what it suggests,
/// today's fastest rebuilds, and this project's own.
const DEFAULT: [&str; 13] = [
    "refit",
    "refit+rotate",
    "refit+rotate+rebuild",
    "refit+rotate+regrow",
    "auto",
    "sweep",
    "binned",
    "binned-parallel",
    "lbvh",
    "ploc",
    PAPER_BINNED,
    IDEAL,
    IDEAL_PARALLEL_BINNED,
];

impl Contestant {
    /// All of them.
    pub(crate) fn all() -> Vec<Self> {
        let named = |name, of, method, counted| Self { name, of, method, counted };
        let strategies = Strategy::all();
        let mut all: Vec<_> = strategies
            .iter()
            .map(|&s| named(s.name(), s.name(), Method::Strategy(s), Counted::Measured))
            .collect();
        let paper_binned =
            Method::Rebuild(paper_binned::update, "serial binned rebuild with bins along one axis");
        all.push(named(PAPER_BINNED, PAPER_BINNED, paper_binned, Counted::Measured));
        for (name, of, counted) in
            [(IDEAL, "sweep", Counted::Free), (IDEAL_PARALLEL_BINNED, "binned", Counted::Divided)]
        {
            all.extend(strategies.iter().find(|s| s.name() == of).map(|&strategy| {
                let method = Method::Strategy(strategy);
                named(name, strategy.name(), method, counted)
            }));
        }
        all
    }

    /// Those that run unless others are asked for.
    pub(crate) fn default_ones() -> Vec<Self> {
        Self::all().into_iter().filter(|c| DEFAULT.contains(&c.name)).collect()
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
        match (self.counted, self.method) {
            (Counted::Measured, Method::Strategy(_)) => None,
            (Counted::Measured, Method::Rebuild(_, about)) => Some(about.to_owned()),
            (Counted::Free, _) => Some(format!("{} rebuild, its time not counted", self.of)),
            (Counted::Divided, _) => {
                Some(format!("serial {} rebuild, its time divided by {PAPER_THREADS}", self.of))
            }
        }
    }
}

impl Method {
    /// The same, with the number of rays that each tree is for.
    pub(crate) fn for_rays(self, rays: u64) -> Self {
        match self {
            Self::Strategy(Strategy::Auto(_)) => {
                Self::Strategy(Strategy::Auto(Auto { load: Load::PacketRays(rays) }))
            }
            other => other,
        }
    }

    /// Brings a tree up to date with the triangles.
    pub(crate) fn run(
        &self,
        tree: &mut Bvh,
        triangles: &Triangles<'_>,
        updater: &mut Updater,
    ) -> Result<Update> {
        match self {
            Self::Strategy(strategy) => {
                updater.set_strategy(*strategy).update(tree, triangles).context(strategy.name())
            }
            Self::Rebuild(function, _) => function(tree, triangles),
        }
    }

    /// Whether the tree depends on the current frame only.
    pub(crate) fn rebuilds(&self) -> bool {
        matches!(self, Self::Strategy(Strategy::Rebuild(..)) | Self::Rebuild(..))
    }
}

impl Counted {
    /// What counts of a measured time.
    pub(crate) fn of(self, ms: f64) -> f64 {
        match self {
            Self::Measured => ms,
            Self::Free => 0.0,
            Self::Divided => ms / PAPER_THREADS as f64,
        }
    }
}

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
        assert_eq!(Contestant::default_ones().len(), DEFAULT.len());
        let paper_binned = Contestant::from_name(PAPER_BINNED).unwrap();
        assert!(paper_binned.accounting().unwrap().contains("serial binned rebuild"));
        let another = Contestant { method: Method::Rebuild(paper_binned::update, "another"), ..paper_binned };
        assert_eq!(another.accounting().unwrap(), "another");
    }

    #[test]
    fn only_auto_takes_the_number_of_rays() {
        for contestant in Contestant::all() {
            match (contestant.method, contestant.method.for_rays(512)) {
                (Method::Strategy(Strategy::Auto(_)), Method::Strategy(Strategy::Auto(now))) => {
                    assert_eq!(now.load, Load::PacketRays(512));
                }
                (Method::Strategy(before), Method::Strategy(now)) => assert_eq!(before, now),
                (Method::Rebuild(..), Method::Rebuild(..)) => {}
                (before, now) => panic!("{before:?} became {now:?}"),
            }
        }
    }
}
