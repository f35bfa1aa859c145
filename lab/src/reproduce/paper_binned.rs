//! A serial binned rebuild with bins along one axis only, after Wald 2007.
//!
//! Serial, top down: the longest axis of the box around the centres, 16 bins along it, the cheapest
//! of the 15 planes between them by surface area; then the primitives are partitioned by that
//! plane. One primitive a leaf. It shows what a plain rebuild of
//! that time costs today, is no copy of the authors' code, and decides no verdict.

use anyhow::Result;
use bvh_core::{Aabb, Bvh, MAX_HEIGHT, Node, Primitives, Triangles, Vec3};
use bvh_update::Update;

const BINS: usize = 16;

/// A primitive while the tree grows.
#[derive(Clone, Copy)]
struct Item {
    aabb: Aabb,
    /// Of its box; finite.
    center: Vec3,
    number: u32,
}

/// Puts a new tree in the place of `bvh`.
pub(super) fn update(bvh: &mut Bvh, triangles: &Triangles<'_>) -> Result<Update> {
    let mut items: Vec<Item> = (0..triangles.len())
        .map(|i| {
            let aabb = triangles.aabb(i);
            let center = if aabb.is_empty() { Vec3::ZERO } else { aabb.center() };
            Item { aabb, center, number: i as u32 }
        })
        .collect();
    let dropped = items.iter().filter(|item| item.aabb.is_empty()).count() as u64;
    let mut update = Update::default();
    (update.rebuilt, update.dropped) = (true, dropped);
    if items.is_empty() {
        *bvh = Bvh::default();
        return Ok(update);
    }
    let mut nodes = vec![Node::NOTHING; 2];
    nodes.reserve(2 * items.len());
    nodes[0] = grow(&mut items, 0, 0, &mut nodes);
    *bvh = Bvh::new(&nodes, items.iter().map(|item| item.number).collect())?;
    (update.height, update.nodes_visited) = (bvh.height(), bvh.nodes().len() as u64 - 1);
    Ok(update)
}

/// The node over `items`, which fill the slots from `slot` on.
fn grow(items: &mut [Item], slot: u32, depth: u32, nodes: &mut Vec<Node>) -> Node {
    if let [item] = items {
        return Node::leaf(item.aabb, slot, 1);
    }
    // Halves from here on are sure to fit.
    let must_halve = depth + items.len().next_power_of_two().ilog2() >= MAX_HEIGHT;
    let left = if must_halve { None } else { split(items) }.unwrap_or(items.len() / 2);
    let pair = nodes.len();
    nodes.extend([Node::NOTHING; 2]);
    let (l, r) = items.split_at_mut(left);
    nodes[pair] = grow(l, slot, depth + 1, nodes);
    nodes[pair + 1] = grow(r, slot + left as u32, depth + 1, nodes);
    Node::parent(&nodes[pair], &nodes[pair + 1], pair as u32)
}

fn join(a: (Aabb, usize), b: (Aabb, usize)) -> (Aabb, usize) {
    (a.0.union(b.0), a.1 + b.1)
}

/// Partitions the items along the longest axis of their centres, and says how many go to the left;
/// `None` if the bins do not separate any two.
fn split(items: &mut [Item]) -> Option<usize> {
    let (min, max) = items
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), i| (min.min(i.center), max.max(i.center)));
    let extent = max - min;
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b]))?;
    let scale = BINS as f32 / extent[axis];
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let bin = |item: &Item| (((item.center[axis] - min[axis]) * scale) as usize).min(BINS - 1);
    let mut bins = [(Aabb::EMPTY, 0usize); BINS];
    for item in &*items {
        let (aabb, count) = &mut bins[bin(item)];
        (*aabb, *count) = (aabb.union(item.aabb), *count + 1);
    }
    // What is in each bin and those before it, and in each bin and those after it.
    let (mut left, mut right) = (bins, bins);
    for i in 1..BINS {
        left[i] = join(left[i - 1], bins[i]);
        right[BINS - 1 - i] = join(right[BINS - i], bins[BINS - 1 - i]);
    }
    let cost = |(aabb, count): (Aabb, usize)| f64::from(aabb.half_area()) * count as f64;
    let planes = (1..BINS).filter(|&plane| left[plane - 1].1 > 0 && right[plane].1 > 0);
    let costs = planes.map(|plane| (cost(left[plane - 1]) + cost(right[plane]), plane));
    let (_, plane) = costs.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // In place, with two pointers.
    let (mut left, mut end) = (0, items.len());
    while left < end {
        if bin(&items[left]) < plane {
            left += 1;
        } else {
            end -= 1;
            items.swap(left, end);
        }
    }
    Some(left)
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::sah_cost;

    use super::*;

    fn soup(n: u32, place: impl Fn(&mut fastrand::Rng) -> Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let mut random = fastrand::Rng::with_seed(7);
        let mut corner = |at: Vec3| at + Vec3::new(random.f32(), random.f32(), random.f32());
        let mut other = fastrand::Rng::with_seed(8);
        let positions = (0..n).map(|_| place(&mut other)).flat_map(|p| [corner(p), corner(p), corner(p)]);
        (positions.collect(), (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    }

    #[test]
    fn trees_are_valid_and_cost_little_more_than_swept_ones() {
        let (positions, indices) =
            soup(2000, |r| Vec3::new(r.f32() * 90.0, r.f32() * 30.0, r.f32() * r.f32() * 60.0));
        let triangles = Triangles { positions: &positions, indices: &indices };
        let mut bvh = Bvh::default();
        assert!(update(&mut bvh, &triangles).unwrap().rebuilt);
        bvh.validate(&triangles).unwrap();
        let sweep = build(&triangles, Builder::Sweep).unwrap();
        let over = sah_cost(&bvh) / sah_cost(&sweep);
        assert!((1.0..1.2).contains(&over), "{over}");
    }

    #[test]
    fn hard_cases_build() {
        let nan = Vec3::splat(f32::NAN);
        let powers = |r: &mut fastrand::Rng| Vec3::X * 2f32.powi(r.i32(-120..120));
        for n in [0, 1, 2, 3, 400] {
            for (positions, indices) in [
                soup(n, |_| Vec3::ZERO),
                soup(n, powers),
                soup(n, |r| if r.bool() { nan } else { Vec3::ONE }),
            ] {
                let triangles = Triangles { positions: &positions, indices: &indices };
                let mut bvh = Bvh::default();
                update(&mut bvh, &triangles).unwrap();
                bvh.validate(&triangles).unwrap();
                assert_eq!(bvh.len(), n as usize);
            }
        }
    }
}
