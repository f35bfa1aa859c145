//! The kernels in plain Rust, for any processor.

use std::hint::select_unpredictable;
use std::ops::Range;

use bvh_core::Primitives;

use crate::block::{GROUP, LISTED, Next, Queue, Twigs};
use crate::kernels::{Accepted, Areas, Fitted, evaluate, fit_inner, fit_leaf, is_usual, refit};
use crate::raw::SharedNodes;
use crate::sweep::{Lists, stretches};

/// See [`kernels::gather`](crate::kernels::gather).
pub(crate) fn gather(nodes: SharedNodes<'_>, queue: &mut Queue, twigs: &mut Twigs, end: usize) {
    while queue.done < end && queue.has_room() {
        for done in queue.done..end.min(queue.done + GROUP) {
            let (slot, pair) = (queue.slots[done], queue.pairs[done]);
            let children = nodes.pair(pair as usize);
            // A node or child is appended to each list that it may be for, and then counted in at most one: branches
            // here would be mispredicted often. The remainders change nothing but spare checks.
            queue.spurs[queue.spur_count % LISTED] = slot;
            queue.forks[(done - queue.spur_count) % LISTED] = slot;
            queue.spur_count += usize::from((children[0].height() == 0) | (children[1].height() == 0));
            for (child, slot) in children.iter().zip(pair..) {
                let height = child.height();
                nodes.prefetch::<false>(select_unpredictable(height == 0, pair as usize, child.first()));
                queue.slots[queue.listed % LISTED] = slot;
                queue.pairs[queue.listed % LISTED] = child.first() as u32;
                twigs.slots[twigs.count % (2 * LISTED)] = slot;
                twigs.pairs[twigs.count % (2 * LISTED)] = child.first() as u32;
                let inner = usize::from(height > 0) & usize::from(child.is_dynamic());
                let beyond_twig = usize::from(height > 1) & inner;
                queue.listed += beyond_twig;
                twigs.count += inner - beyond_twig;
            }
            queue.done = done + 1;
        }
    }
}

/// See [`kernels::twigs`](crate::kernels::twigs).
pub(crate) fn twigs<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &Twigs,
    _next: Next<'_>,
) -> Fitted {
    let (mut usual, mut others) = (Fitted::default(), Fitted::default());
    for (&slot, &pair) in list.slots.iter().zip(&list.pairs).take(list.count) {
        let leaves = nodes.pair(pair as usize);
        let all_usual = leaves.iter().all(|leaf| is_usual(leaf, primitives));
        fit_inner(nodes, primitives, slot as usize, if all_usual { &mut usual } else { &mut others });
    }
    others.and(&usual)
}

/// See [`kernels::spurs`](crate::kernels::spurs).
pub(crate) fn spurs<P: Primitives + ?Sized, const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Fitted {
    let (mut usual, mut others) = (Fitted::default(), Fitted::default());
    for &slot in list {
        let children = nodes.pair(nodes.get(slot as usize).first());
        let any_usual = children.iter().any(|child| is_usual(child, primitives));
        fit_inner(nodes, primitives, slot as usize, if any_usual { &mut usual } else { &mut others });
        if ROTATE {
            evaluate(nodes, slot, accepted);
        }
    }
    others.and(&usual)
}

/// See [`kernels::forks`](crate::kernels::forks).
pub(crate) fn forks<const ROTATE: bool>(
    nodes: SharedNodes<'_>,
    list: &[u32],
    accepted: &mut Vec<Accepted>,
) -> Areas {
    let mut areas = Areas::default();
    for &slot in list {
        refit(nodes, slot as usize, &mut areas);
        if ROTATE {
            evaluate(nodes, slot, accepted);
        }
    }
    areas
}

/// See [`sweep::sweep`](crate::sweep::sweep).
pub(crate) fn sweep<P: Primitives + ?Sized>(
    nodes: SharedNodes<'_>,
    primitives: &P,
    piece: Range<usize>,
    _lists: &mut [Lists; 2],
) -> Fitted {
    let (mut usual, mut others) = (Fitted::default(), Fitted::default());
    for stretch in stretches(piece) {
        let slots = 2 * stretch.start..2 * stretch.end;
        for of_one in [true, false] {
            for slot in slots.clone() {
                let node = nodes.get(slot);
                if node.is_leaf() && node.is_dynamic() && (node.count() == 1) == of_one {
                    let fitted = if is_usual(&node, primitives) { &mut usual } else { &mut others };
                    fit_leaf(nodes, primitives, slot, fitted);
                }
            }
        }
        for slot in slots.rev() {
            let node = nodes.get(slot);
            if !node.is_leaf() && node.is_dynamic() {
                refit(nodes, slot, &mut usual.inner_areas);
                usual.inner += 1;
            }
        }
    }
    others.and(&usual)
}
