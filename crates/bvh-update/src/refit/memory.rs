//! Memory of passes. Each thread keeps its own, for all trees that it updates: whoever has thousands
//! of small trees does not pay for each.

use std::cell::RefCell;
use std::thread::LocalKey;

use bytemuck::{Zeroable, zeroed_box};

use super::block::{Block, Lists};

/// Blocks that a thread makes at first: more than it uses at a time, so that no later update
/// allocates. It uses one for each that it is below of, also where it waits for another thread and
/// takes up other blocks meanwhile. `tests/no_allocation.rs`, with 10,000 boxes, fails with 2 and
/// passes with 3.
const BLOCKS: usize = 8;

/// What a thread has not in use.
type Spare<T> = RefCell<Vec<Box<T>>>;

thread_local! {
    pub(super) static SPARE_BLOCKS: Spare<Block> = made(BLOCKS);
    // Primitives that start tasks of their own may make it use several.
    pub(super) static SPARE_LISTS: Spare<Lists> = made(1);
}

/// Bytes that each thread keeps.
pub(crate) const KEPT: usize = BLOCKS * size_of::<Block>() + size_of::<Lists>();

/// Zeroed: a small tree touches a few pages of it, and nothing is written where pages are new.
fn made<T: Zeroable>(count: usize) -> Spare<T> {
    RefCell::new((0..count).map(|_| zeroed_box()).collect())
}

/// Lends this thread's memory to `work`, which may ask primitives, and so come back here.
pub(super) fn lend<T: Zeroable, R>(spare: &'static LocalKey<Spare<T>>, work: impl FnOnce(&mut T) -> R) -> R {
    let mut lent = spare.with_borrow_mut(Vec::pop).unwrap_or_else(zeroed_box);
    let result = work(&mut lent);
    spare.with_borrow_mut(|spare| spare.push(lent));
    result
}
