//! What updates keep with a tree, opaque here, and what others have changed in the meantime.

/// Words that updates keep with a tree from frame to frame. A clone of the tree carries them along;
/// a new tree starts with zeros. Only the crate that updates trees interprets them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UpdateState {
    /// The words.
    pub words: [u64; Self::WORDS],
    /// Changes that an update learns of by comparing them with those that it has seen.
    pub changes: Changes,
}

impl UpdateState {
    /// Number of words.
    pub const WORDS: usize = 32;
}

/// How often something about a tree was changed from outside of updates.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Changes {
    /// Which primitives may move.
    pub dynamic: u32,
    /// Numbers of primitives.
    pub numbering: u32,
    /// Which pairs of nodes are where.
    pub structure: u32,
}
