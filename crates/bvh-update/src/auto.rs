//! The strategy that chooses: what to do about a tree, from counted work and measured cost.
//!
//! The model of a frame's time is the work of the update plus rays times the SAH cost. The constants below put both on
//! one scale, in nanoseconds of one core; only their ratios matter, and those vary little between machines.
//!
//! * *Rotations* are worth while if the cost that they saved in this update, kept for some frames, pays for trying.
//!   If they are not, each node is tried half as often, down to every eighth update; if they are, twice as often.
//! * *Repairs* follow a ski-rental rule: the time that rays have lost to excess cost since the last repair is added up,
//!   and once it exceeds the price of a repair, the tree is regrown (`regrow.rs`). So no schedule that knows the
//!   future is more than about twice as good.
//! * *A new tree* is built where a regrown top would be a large part of the tree; and where that has happened in a row,
//!   without trying anything else first.

use std::fmt;

use bvh_core::{Bvh, History, Primitives};

use crate::cut::{Regrown, regrow, scale, take_references};
use crate::pass::{Scratch, pass};
use crate::raw;
use crate::regrow::{LARGEST_CUT, rebuild_all};
use crate::strategy::{Rotate, Update, UpdateError};

/// Settings of [`Strategy::Auto`](crate::Strategy::Auto).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Auto {
    /// How many rays will be cast through the tree before the next update; the default is two for each pixel of
    /// 1024 x 1024. The more there are, the more a better tree is worth.
    pub rays: u64,
}

impl Default for Auto {
    fn default() -> Self {
        Self { rays: 2 << 20 }
    }
}

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
    /// The same, and the tree was built anew above subtrees that are still good.
    Regrow {
        /// How many of them there are.
        subtrees: usize,
    },
    /// The whole tree was built anew: too little of it was good.
    Rebuild,
    /// A tree from the background took the place of this one.
    Swap,
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AsAlways => f.write_str("as always"),
            Self::Refit { one_in: 1 } => f.write_str("refit, rotations at every node"),
            Self::Refit { one_in } => write!(f, "refit, rotations at one node in {one_in}: they save little"),
            Self::Regrow { subtrees } => {
                write!(f, "regrown above {subtrees} subtrees: lost time exceeded the price of it")
            }
            Self::Swap => f.write_str("a tree built in the background took over"),
            Self::Rebuild => f.write_str("built anew: too few subtrees were good"),
        }
    }
}

/// Trying rotations at a node, averaged over all nodes.
const ROTATE_NODE: f64 = 3.0;
/// Looking at a node for a cut.
const CUT_NODE: f64 = 6.0;
/// Building the top, for each subtree below it.
const GRAFT_SUBTREE: f64 = 300.0;
/// Building the whole tree, for each primitive.
const REBUILD_PRIMITIVE: f64 = 90.0;
/// A ray, for each unit of SAH cost: traced in coherent packets.
const RAY_COST: f64 = 1.0;

/// What a cut is expected to be, as part of the primitives.
const SMALL_CUT: f64 = 0.02;
/// For how many frames the gain of a rotation is taken to last.
const GAIN_LASTS: f64 = 8.0;
/// Rotations are tried at one node in 2 to the power of this at least.
const LONGEST_PAUSE: u32 = 3;
/// After as many rebuilds in a row, further ones are made without a pass before; but for one in `LOOK_AGAIN`.
const IN_A_ROW: u32 = 2;
const LOOK_AGAIN: u32 = 8;

/// What a pass has found, for the choices after it.
struct Found {
    primitives: f64,
    /// Nodes visited.
    nodes: f64,
    /// SAH cost that the rotations of this pass have saved.
    gain: f64,
    /// SAH cost above that after the last repair.
    excess: f64,
}

impl Auto {
    /// Time that the rays take for this much SAH cost.
    fn lost(self, cost: f64) -> f64 {
        self.rays as f64 * RAY_COST * cost.max(0.0)
    }

    /// Chooses how often to try rotations from now on, by what they have saved.
    fn choose_pause(self, history: &mut History, found: &Found) {
        let saved = self.lost(found.gain) * GAIN_LASTS;
        let tried = found.nodes * ROTATE_NODE / f64::from(1u32 << history.rotation_pause);
        // More to come back than to go: no swinging to and fro.
        if saved < tried && history.rotation_pause < LONGEST_PAUSE {
            history.rotation_pause += 1;
        } else if saved > 4.0 * tried && history.rotation_pause > 0 {
            history.rotation_pause -= 1;
        }
    }

    /// The excess, as part of the root's area, above which a subtree is opened: what its rebuild costs must come back
    /// in as many frames as have passed since the last repair.
    fn threshold(self, history: &History) -> f64 {
        let frames = f64::from(history.since_repair.clamp(1, 8));
        GRAFT_SUBTREE / (self.rays.max(1) as f64 * RAY_COST * frames)
    }
}

pub(crate) fn update<P: Primitives + ?Sized>(
    bvh: &mut Bvh,
    primitives: &P,
    auto: Auto,
    scratch: &mut Scratch,
) -> Result<Update, UpdateError> {
    let in_a_row = bvh.history().rebuilds_in_a_row;
    if in_a_row >= IN_A_ROW && !in_a_row.is_multiple_of(LOOK_AGAIN) {
        return rebuild_all(bvh, primitives, 0, scratch);
    }
    take_references(bvh);
    let one_in = 1 << bvh.history().rotation_pause;
    let tally = pass(bvh, primitives, Some(Rotate { period: one_in }), scratch);
    let refitted = |bvh: &Bvh| Update { decision: Decision::Refit { one_in }, ..tally.update(bvh) };

    let root = bvh.root().aabb().half_area_f64();
    let reference = bvh.history().reference * scale(tally.leaf_area);
    let per_root = |area: f64| if root > 0.0 { area / root } else { 0.0 };
    let found = Found {
        primitives: bvh.len() as f64,
        nodes: (tally.leaves + tally.inner) as f64,
        gain: per_root(tally.gain),
        excess: per_root(tally.area + bvh.still_area() - reference),
    };
    let history = raw::parts(bvh).history;
    auto.choose_pause(history, &found);
    history.since_repair += 1;
    history.regret += auto.lost(found.excess);
    let price_of_new = found.primitives * REBUILD_PRIMITIVE;
    let price = found.nodes * CUT_NODE + SMALL_CUT * found.primitives * GRAFT_SUBTREE;
    if history.regret <= if history.is_beyond_repair { price_of_new } else { price } {
        return Ok(refitted(bvh));
    }
    if history.is_beyond_repair {
        return rebuild_all(bvh, primitives, tally.dropped, scratch);
    }
    let threshold = auto.threshold(history) * root;
    match regrow(bvh, tally.leaf_area, threshold, (LARGEST_CUT * found.primitives) as usize, scratch) {
        Regrown::Top(0) => {
            // Paid for looking; wait as long again before the next time.
            raw::parts(bvh).history.regret = 0.0;
            Ok(refitted(bvh))
        }
        Regrown::Top(subtrees) => {
            let decision = Decision::Regrow { subtrees };
            Ok(Update { decision, sah_cost: None, ..refitted(bvh) })
        }
        Regrown::TooMuch if bvh.history().regret > price_of_new => {
            rebuild_all(bvh, primitives, tally.dropped, scratch)
        }
        Regrown::TooMuch => {
            raw::parts(bvh).history.is_beyond_repair = true;
            Ok(refitted(bvh))
        }
    }
}
