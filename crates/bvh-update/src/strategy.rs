//! The strategies: named ways to bring a tree up to date with primitives that have moved.

use std::fmt;
use std::str::FromStr;

use bvh_build::{BuildOptions, Builder};
use bvh_core::UnknownName;
use bvh_core::named::by_name;

use crate::auto::Auto;
use crate::rebuild::{Background, Degraded};
use crate::refit::Rotate;
use crate::repair::PartialRebuild;

/// What to do with a tree between two frames.
///
/// | you have | take |
/// |---|---|
/// | anything that moves | [`Auto`](Self::Auto), the default, and [report](crate::Updater::report) what you ask of the tree |
/// | gentle motion, and the least code to trust | [`RefitRotate`](Self::RefitRotate) |
/// | chaos: everything elsewhere in every frame | [`Rebuild`](Self::Rebuild) by [`Builder::Lbvh`] |
/// | a paper to compare with | the others |
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Strategy {
    /// Recompute all boxes, structure fixed (Wald, Boulos, Shirley 2007).
    Refit,
    /// Refit and rotate in one pass (Kopta et al. 2012).
    RefitRotate(Rotate),
    /// Build a new tree. The same primitives stay dynamic.
    Rebuild(Builder, BuildOptions),
    /// Refit, with or without rotations, and build a new tree when this one has degraded
    /// (Lauterbach et al. 2006).
    Degraded(Degraded),
    /// Refit, with or without rotations, and build the tree again above those subtrees that are
    /// still good once it has degraded: see [`PartialRebuild`].
    PartialRebuild(PartialRebuild),
    /// Refit, with or without rotations, and put the worst few subtrees where they cost least
    /// (Bittner et al. 2013; Meister and Bittner 2018).
    Reinsert(Reinsertion),
    /// Refit, with or without rotations, while new trees are built in the background, each in turn
    /// put in the place of the one before (Ize et al. 2007). The trees depend on how long that
    /// takes. Where the system has no thread to give, as on `wasm32-unknown-unknown`, none is
    /// built, and the tree is only updated.
    Background(Background),
    /// Refit and rotate, and then keep the tree, build a new top, or build a new tree: what costs
    /// the least time for the [reported](crate::Updater::report) load. Where trees are bad again at
    /// once, build a new one without the pass.
    Auto(Auto),
}

impl Default for Strategy {
    /// [`Auto`](Self::Auto).
    fn default() -> Self {
        Self::Auto(Auto::default())
    }
}

/// The budget of insertion-based repair.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Reinsertion {
    /// The budget of rotations, if any are wanted.
    pub rotate: Option<Rotate>,
    /// Part of the nodes tried in each update, those of the greatest inefficiency; 0.01 by default.
    pub part: f64,
}

bvh_core::with_methods!(Reinsertion: with_rotate(rotate: Option<Rotate>), with_part(part: f64));

impl Default for Reinsertion {
    fn default() -> Self {
        Self { rotate: Some(Rotate::default()), part: 0.01 }
    }
}

impl Strategy {
    /// Returns all strategies, with their defaults.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let rotate = Some(Rotate::default());
        let partial = |rotate| Self::PartialRebuild(PartialRebuild { rotate, ..PartialRebuild::default() });
        let mut all = vec![
            Self::Refit,
            Self::RefitRotate(Rotate::default()),
            Self::Degraded(Degraded::default()),
            Self::Degraded(Degraded { rotate, ..Degraded::default() }),
            partial(None),
            partial(rotate),
            Self::Auto(Auto::default()),
            Self::Background(Background::default()),
            Self::Background(Background { rotate, ..Background::default() }),
            Self::Reinsert(Reinsertion::default()),
        ];
        all.extend(Builder::PER_FRAME.map(|builder| Self::Rebuild(builder, BuildOptions::default())));
        all
    }

    /// Returns the name as the command line and results have it. Only those of [`all`](Self::all)
    /// can be parsed, and stand for default settings.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Refit => "refit",
            Self::RefitRotate(_) => "refit+rotate",
            Self::Rebuild(builder, _) => builder.name(),
            Self::Degraded(Degraded { rotate: None, .. }) => "refit+rebuild",
            Self::Degraded(_) => "refit+rotate+rebuild",
            Self::PartialRebuild(PartialRebuild { rotate: None, .. }) => "refit+regrow",
            Self::PartialRebuild(_) => "refit+rotate+regrow",
            Self::Auto(_) => "auto",
            Self::Reinsert(Reinsertion { rotate: None, .. }) => "refit+reinsert",
            Self::Reinsert(_) => "refit+rotate+reinsert",
            Self::Background(Background { rotate: None, .. }) => "refit+background",
            Self::Background(_) => "refit+rotate+background",
        }
    }
}

impl FromStr for Strategy {
    type Err = UnknownName;

    /// The strategy of that [name](Self::name), with its defaults.
    fn from_str(name: &str) -> Result<Self, UnknownName> {
        by_name("strategy", &Self::all(), |strategy| strategy.name(), name)
    }
}

impl fmt::Display for Strategy {
    /// Its [name](Self::name).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
