//! What an update decided to do, and why, in one line.

use std::fmt;

use bvh_build::Builder;

/// What an update decided to do about the tree.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Decision {
    /// What the strategy does every time.
    #[default]
    AsAlways,
    /// Refitted; rotations were tried at one in this many nodes.
    Refit {
        /// One in so many.
        one_in: u32,
    },
    /// The same, and leaves were merged.
    Merge {
        /// In one small subtree in so many.
        one_in: u32,
    },
    /// The same, and leaves were split.
    Split,
    /// The same, and the tree was built anew above subtrees that are still good.
    Regrow {
        /// How many of them there are.
        subtrees: usize,
    },
    /// The whole tree was built anew: too little of it was good, or rays visited ever more nodes.
    Rebuild {
        /// By whom.
        builder: Builder,
    },
    /// Refitted; a new tree was built, too, which was no better.
    Kept {
        /// By whom.
        builder: Builder,
    },
    /// A tree from the background took the place of this one.
    Swap,
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AsAlways => f.write_str("as always"),
            Self::Refit { one_in: 1 } => f.write_str("refit, rotations at every node"),
            Self::Refit { one_in } => write!(f, "refit, rotations at one node in {one_in}: they save little"),
            Self::Merge { one_in } => {
                write!(f, "refit, leaves merged in one subtree in {one_in}: what is in them stays together")
            }
            Self::Split => f.write_str("refit, leaves split: what is in them came apart"),
            Self::Regrow { subtrees } => {
                write!(f, "regrown above {subtrees} subtrees: lost time exceeded the price of it")
            }
            Self::Kept { builder } => {
                write!(f, "refit: a tree built anew by {} was no better than this one", builder.name())
            }
            Self::Swap => f.write_str("a tree built in the background took over"),
            Self::Rebuild { builder } => {
                write!(
                    f,
                    "built anew by {}: too little of the tree was good, or rays had lost too much",
                    builder.name()
                )
            }
        }
    }
}
