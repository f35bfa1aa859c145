//! What a tree holds, seen from the outside: numbered boxes.

use glam::Vec3;

use crate::{Aabb, prefetch};

/// The primitives of a tree: how many, and the box of each.
///
/// Builders and updates ask for boxes whenever they need them, so an implementation streams its vertices and
/// nobody keeps a second array of boxes. The number of primitives must not change while a tree refers to
/// them; boxes may.
pub trait Primitives: Sync {
    /// Number of primitives.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Box of primitive `i`, already [`sanitized`](Aabb::sanitized).
    ///
    /// # Panics
    /// If `i` is not below [`len`](Self::len).
    fn aabb(&self, i: usize) -> Aabb;

    /// A hint that `aabb(i)` will be asked for soon: whatever tells where its data lies.
    #[inline]
    fn prefetch_index(&self, _i: usize) {}

    /// A hint that `aabb(i)` will be asked for very soon, given after `prefetch_index`: the data itself.
    #[inline]
    fn prefetch_data(&self, _i: usize) {}
}

impl Primitives for [Aabb] {
    #[inline]
    fn len(&self) -> usize {
        <[Aabb]>::len(self)
    }

    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        self[i].sanitized()
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        prefetch(self, i);
    }
}

impl Primitives for Vec<Aabb> {
    #[inline]
    fn len(&self) -> usize {
        <[Aabb]>::len(self)
    }

    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        self.as_slice().aabb(i)
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        prefetch(self, i);
    }
}

/// Triangles that share vertices: triangle `i` has the corners `positions[indices[i][0..3]]`.
///
/// A triangle that names a vertex out of range has an empty box, like one with a vertex at infinity.
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertex positions.
    pub positions: &'a [Vec3],
    /// Three vertex numbers a triangle.
    pub indices: &'a [[u32; 3]],
}

impl Triangles<'_> {
    /// Corners of triangle `i`, NaN where it names a vertex out of range.
    ///
    /// # Panics
    /// If `i` is not below the number of triangles.
    #[must_use]
    #[inline]
    pub fn corners(&self, i: usize) -> [Vec3; 3] {
        self.indices[i].map(|v| self.positions.get(v as usize).copied().unwrap_or(Vec3::NAN))
    }
}

impl Primitives for Triangles<'_> {
    #[inline]
    fn len(&self) -> usize {
        self.indices.len()
    }

    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        Aabb::around(&self.corners(i))
    }

    #[inline]
    fn prefetch_index(&self, i: usize) {
        prefetch(self.indices, i);
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        if let Some(triangle) = self.indices.get(i) {
            for &v in triangle {
                prefetch(self.positions, v as usize);
            }
        }
    }
}

/// Primitives seen through a tree's order: number `s` here is primitive `order[s]` there.
#[derive(Clone, Copy, Debug)]
pub struct InOrder<'a, P: ?Sized> {
    /// The primitives, by their own numbers.
    pub primitives: &'a P,
    /// For each slot, a primitive's number.
    pub order: &'a [u32],
}

impl<P: Primitives + ?Sized> Primitives for InOrder<'_, P> {
    #[inline]
    fn len(&self) -> usize {
        self.order.len()
    }

    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        self.primitives.aabb(self.order[i] as usize)
    }

    #[inline]
    fn prefetch_index(&self, i: usize) {
        if let Some(&p) = self.order.get(i) {
            self.primitives.prefetch_index(p as usize);
        }
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        if let Some(&p) = self.order.get(i) {
            self.primitives.prefetch_data(p as usize);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_with_wild_indices_are_dropped_not_fatal() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let indices = [[0, 1, 2], [0, 1, 9], [u32::MAX, 1, 2]];
        let t = Triangles { positions: &positions, indices: &indices };
        assert_eq!(t.aabb(0), Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
        assert!(t.aabb(1).is_empty() && t.aabb(2).is_empty());
        (0..10).for_each(|i| t.prefetch_data(i));
    }
}
