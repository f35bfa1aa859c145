//! Memory of passes. Each thread keeps its own, for all trees that it updates: a program with
//! thousands of small trees does not pay for each.

use std::cell::RefCell;
use std::thread::LocalKey;

use bytemuck::{Zeroable, zeroed_box};

use super::block::{Block, Lists};

/// Blocks that a thread makes at first. It uses one for each block on its stack, also for those
/// that it takes up while it waits in a join; if it ever needs more, it makes and keeps them.
/// `tests/no_allocation.rs`, with 80,000 boxes, fails with 3 and passes with 4.
const BLOCKS: usize = 8;

/// What a thread has not in use.
type Spare<T> = RefCell<Vec<Box<T>>>;

thread_local! {
    pub(super) static SPARE_BLOCKS: Spare<Block> = spares(BLOCKS);
    // Where primitives start tasks of their own, a thread may need several.
    pub(super) static SPARE_LISTS: Spare<Lists> = spares(1);
}

/// Bytes that each thread keeps, or more if it needed more.
pub(crate) const THREAD_MEMORY: usize = BLOCKS * size_of::<Block>() + size_of::<Lists>();

/// Zeroed by the allocator, which writes nothing where pages are new: a small tree then touches few
/// of them.
fn spares<T: Zeroable>(count: usize) -> Spare<T> {
    RefCell::new((0..count).map(|_| zeroed_box()).collect())
}

/// Lends this thread's memory to `work`, which may ask primitives, and so come back here.
pub(super) fn lend<T: Zeroable, R>(spare: &'static LocalKey<Spare<T>>, work: impl FnOnce(&mut T) -> R) -> R {
    // A thread that is ending, and updates a tree in a destructor, has nothing to spare.
    let mut lent = spare.try_with(|spare| spare.borrow_mut().pop()).ok().flatten().unwrap_or_else(zeroed_box);
    let result = work(&mut lent);
    _ = spare.try_with(|spare| spare.borrow_mut().push(lent));
    result
}
