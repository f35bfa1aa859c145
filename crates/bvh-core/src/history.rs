//! What updates remember of a tree.

/// What updates remember of a tree from frame to frame: plain data of the crate `bvh-update`, which a clone of the tree
/// carries along. More may be added to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct History {
    /// Updates since the tree was built.
    pub updates: u32,
    /// Updates since it was built or last repaired.
    pub since_repair: u32,
    /// What `reference` and the references of nodes are measures of.
    pub measure: Measure,
    /// How good the tree was when it was built or last repaired, in that measure; 0 until it is measured.
    pub reference: f64,
    /// The reference as it was measured, where `reference` is lowered when the tree gets better.
    pub measured: f64,
    /// What doing nothing about worse trees has cost since, in the strategy's own measure.
    pub regret: f64,
    /// Number of the build in the background that is for this tree; 0 for none.
    pub background_job: u64,
    /// Whether that build knows which primitives move. What says so anew sets this to false.
    pub background_knows_moving: bool,
    /// Rotations are tried at each node in one of 2 to the power of this many updates, where the strategy chooses.
    pub rotation_pause: u32,
    /// Whether a repair was found to be too much work since.
    pub is_beyond_repair: bool,
    /// How often a look for what is worth a repair has found nothing since.
    pub looks_in_vain: u32,
    /// How many new trees were no better since.
    pub trees_in_vain: u32,
    /// How many of the last repairs built the whole tree anew and could not wait, each soon after the one before.
    pub rebuilds_in_a_row: u32,
    /// Left node of the first of those pairs that are kept for later use, 0 if there is none. The left node of each is a
    /// leaf without primitives, whose first slot is the left node of the next. What moves pairs about sets
    /// this and their number to 0.
    pub spare_pair: u32,
    /// How many of them there are.
    pub spare_pair_count: u32,
    /// Half area of the leaves that moved, of the root, and of the leaves that did not, when the tree was measured.
    pub sizes: [f64; 3],
    /// The size of the scene after the last update that told.
    pub size: f64,
    /// What the size that follows from `sizes` is multiplied by: other than 1 once other primitives move than when the tree
    /// was measured.
    pub size_factor: f64,
    /// Whether it has been said which primitives move since `sizes` were taken.
    pub has_other_moving: bool,
    /// How even the leaves were in size then: 1 if all were alike, near 0 if most area was in a few.
    pub evenness: f64,
    /// Updates between the last two repairs, or between the build and the first; 0 if there was none.
    pub period: u32,
    /// How many subtrees were kept below the last new top; 0 if there was none.
    pub kept: u32,
    /// Whether the next update is to build the tree anew.
    pub is_due: bool,
    /// How the tree lies in its arena. What moves pairs about sets this to [`Layout::Other`], or to
    /// [`Layout::Unknown`] if that may have put them in order.
    pub layout: Layout,
    /// A new tree in the place of this one gets no larger leaves than this; 0 stands for no larger ones than there are.
    pub largest_leaf: u32,
    /// What has become of leaves, where the strategy chooses when to merge them.
    pub leaves: LeafHistory,
    /// Whether the tree was built in haste: by a builder that is known not to be the best.
    pub is_hasty: bool,
}

/// What updates remember of leaves that they merge now and then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LeafHistory {
    /// Whether there are leaves of several primitives that move.
    pub is_merged: bool,
    /// Whether there were when the tree was measured.
    pub was_merged: bool,
    /// In how many parts of the tree leaves have been merged since they last came apart.
    pub turns: u32,
    /// Updates since they last came apart.
    pub calm: u32,
    /// What `calm` was when merging last began.
    pub merging_since: u32,
    /// What rays have lost to the growth of leaves since these were last seen to, in the strategy's own measure.
    pub regret: f64,
    /// What `calm` must be before leaves are merged again.
    pub wait: u32,
    /// By what part the areas of leaves may grow before leaves are split; 0 for the least.
    pub slack: f64,
    /// The least sum of areas of leaves that move, since leaves were last seen to.
    pub area: f64,
    /// By what part this sum is greater by what has merged since the tree was measured.
    pub growth: f64,
    /// By what part the cost of the whole tree has changed by that: `reference` is of merged leaves.
    pub cost: f64,
    /// How many spare pairs there were when leaves were last seen to.
    pub spare_pair_count: u32,
    /// Whether leaves that merged then have paid for that by now.
    pub has_paid: bool,
    /// In how many parts of the tree leaves are still to be split.
    pub splitting: u32,
    /// What that has saved of the tree's cost so far.
    pub split_gain: f64,
    /// By how much the areas of the leaves seen to so far are greater than those of leaves of one primitive each.
    pub split_merged: f64,
}

/// How a tree lies in its arena, as far as updates have looked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// Not looked at yet.
    #[default]
    Unknown,
    /// In depth-first order, left before right and without gaps, and at least half of the nodes move.
    Linear,
    /// Otherwise.
    Other,
}

/// What updates judge a tree by. A strategy that finds another's measure takes its own anew.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Measure {
    /// Nothing as yet.
    #[default]
    None,
    /// Areas of nodes.
    Areas,
    /// Distances between the centres of nodes' children.
    Divergence,
    /// The mean ratio of nodes' areas to their children's.
    Ratio,
    /// Areas of leaves.
    Leaves,
}
