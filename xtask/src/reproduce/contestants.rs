//! The rows of every table: strategies as measured, and two kinds of accounting the paper uses.

use bvh_update::Strategy;

use crate::pool::PAPER_THREADS;

/// A way of updating, and how its time is counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Contestant {
    pub(crate) name: &'static str,
    /// What is run.
    pub(crate) strategy: Strategy,
    pub(crate) counted: Counted,
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

/// An instant sweep rebuild: the bound for every update (Kopta et al. 2012, section 3, "ideal update").
pub(crate) const IDEAL: &str = "ideal";
/// A binned rebuild that scales perfectly (there, "ideal parallel binned").
pub(crate) const IDEAL_PARALLEL_BINNED: &str = "ideal-parallel-binned";

impl Contestant {
    /// All of them.
    pub(crate) fn all() -> Vec<Self> {
        let measured =
            |strategy: Strategy| Self { name: strategy.name(), strategy, counted: Counted::Measured };
        let mut all: Vec<_> = Strategy::all().into_iter().map(measured).collect();
        for (name, of, counted) in
            [(IDEAL, "sweep", Counted::Free), (IDEAL_PARALLEL_BINNED, "binned", Counted::Divided)]
        {
            all.extend(Strategy::from_name(of).map(|strategy| Self { name, strategy, counted }));
        }
        all
    }

    /// The one of that name.
    pub(crate) fn from_name(name: &str) -> Result<Self, String> {
        let all = Self::all();
        all.iter().copied().find(|c| c.name == name).ok_or_else(|| {
            let names: Vec<_> = all.iter().map(|c| c.name).collect();
            format!("no such strategy; there are {}", names.join(", "))
        })
    }

    /// How its update time comes about, in words; nothing if it is simply measured.
    pub(crate) fn accounting(&self) -> Option<String> {
        match self.counted {
            Counted::Measured => None,
            Counted::Free => Some(format!("{} rebuild, its time not counted", self.strategy.name())),
            Counted::Divided => {
                Some(format!("serial {} rebuild, its time divided by {PAPER_THREADS}", self.strategy.name()))
            }
        }
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
