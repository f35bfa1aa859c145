//! What a tree holds, seen from the outside: numbered boxes.

use glam::{Vec3, Vec4};

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

    /// The same box for SIMD kernels, each in the first three of four lanes: minimum, maximum, and a *doubt*, which is
    /// finite only if the box is not empty; where it is not finite, the other two mean nothing and
    /// [`aabb`](Self::aabb) tells. What is in the fourth lanes does not matter.
    ///
    /// # Panics
    /// If `i` is not below [`len`](Self::len).
    #[inline]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        let aabb = self.aabb(i);
        let doubt = if aabb.is_empty() { Vec4::NAN } else { Vec4::ZERO };
        [aabb.min.extend(0.0), aabb.max.extend(0.0), doubt]
    }

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

/// Passes everything on to what `$this` is a way to.
macro_rules! forward {
    ($self:ident => $this:expr) => {
        #[inline]
        fn len(&$self) -> usize {
            Primitives::len($this)
        }

        #[inline]
        fn aabb(&$self, i: usize) -> Aabb {
            $this.aabb(i)
        }

        #[inline(always)]
        fn aabb_lanes(&$self, i: usize) -> [Vec4; 3] {
            $this.aabb_lanes(i)
        }

        #[inline]
        fn prefetch_index(&$self, i: usize) {
            $this.prefetch_index(i);
        }

        #[inline]
        fn prefetch_data(&$self, i: usize) {
            $this.prefetch_data(i);
        }
    };
}

impl Primitives for Vec<Aabb> {
    forward!(self => self.as_slice());
}

impl<const N: usize> Primitives for [Aabb; N] {
    forward!(self => self.as_slice());
}

impl<P: Primitives + ?Sized> Primitives for &P {
    forward!(self => *self);
}

impl<P: Primitives + Send + ?Sized> Primitives for Box<P> {
    forward!(self => self.as_ref());
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
        // Spelt out because `array::map` is a call.
        let [a, b, c] = self.indices[i];
        let at = |v: u32| self.positions.get(v as usize).copied().unwrap_or(Vec3::NAN);
        [at(a), at(b), at(c)]
    }
}

impl Triangles<'_> {
    /// Position `v` in the first three of four lanes, NaN if there is none.
    #[inline(always)]
    fn lanes(&self, v: usize) -> Vec4 {
        // One load of four floats, but for the last vertex, behind which there is no fourth.
        match self.positions.get(v..v.saturating_add(2)) {
            Some(two) => Vec4::from_slice(&bytemuck::cast_slice(two)[..4]),
            None => self.last(v),
        }
    }

    #[cold]
    fn last(&self, v: usize) -> Vec4 {
        self.positions.get(v).copied().unwrap_or(Vec3::NAN).extend(0.0)
    }
}

impl Primitives for Triangles<'_> {
    #[inline]
    fn len(&self) -> usize {
        self.indices.len()
    }

    #[inline]
    #[expect(clippy::eq_op, reason = "a number less itself is NaN if it is not finite")]
    fn aabb(&self, i: usize) -> Aabb {
        let [a, b, c] = self.indices[i].map(|v| self.lanes(v as usize));
        // +0 where all three corners are finite, else NaN.
        let zero = (a - a) + (b - b) + (c - c);
        if zero.is_nan_mask().bitmask() & 0b111 != 0 {
            return Aabb::EMPTY;
        }
        // Makes negative zeros positive.
        let (min, max) = (a.min(b).min(c) + 0.0, a.max(b).max(c) + 0.0);
        Aabb::new(min.truncate(), max.truncate())
    }

    // Used twice in one loop it is not inlined otherwise, and then half of an update goes into calls.
    #[inline(always)]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        let [a, b, c] = self.indices[i];
        let (a, b, c) = (self.lanes(a as usize), self.lanes(b as usize), self.lanes(c as usize));
        // The sum is not finite if one of them is not, and seldom else.
        [a.min(b).min(c) + 0.0, a.max(b).max(c) + 0.0, a + b + c]
    }

    #[inline]
    fn prefetch_index(&self, i: usize) {
        prefetch(self.indices, i);
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        // Of three corners two are neighbours in most meshes, so that the third's line is one of theirs.
        if let Some(&[a, _, c]) = self.indices.get(i) {
            prefetch(self.positions, a as usize);
            prefetch(self.positions, c as usize);
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

    #[inline(always)]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        self.primitives.aabb_lanes(self.order[i] as usize)
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

    #[test]
    fn boxes_of_triangles_are_those_around_their_corners() {
        let odd = [0.0, -0.0, 1.5, -2.0, f32::MAX, -f32::MAX, 1e-40, f32::NAN, f32::INFINITY];
        let positions: Vec<_> =
            (0..300).map(|i| Vec3::new(odd[i % 9], odd[i / 9 % 7], odd[i / 31 % 7])).collect();
        let indices: Vec<_> = (0..298).map(|i| [i, (i * 7) % 300, 299]).collect();
        let t = Triangles { positions: &positions, indices: &indices };
        let bits = |b: Aabb| (b.min.to_array().map(f32::to_bits), b.max.to_array().map(f32::to_bits));
        let (mut dropped, mut certain) = (0, 0);
        for i in 0..t.len() {
            assert_eq!(bits(t.aabb(i)), bits(Aabb::around(&t.corners(i))), "{:?}", t.corners(i));
            dropped += usize::from(t.aabb(i).is_empty());
            let [min, max, doubt] = t.aabb_lanes(i);
            if doubt.truncate().is_finite() {
                assert_eq!(bits(Aabb::new(min.truncate(), max.truncate())), bits(t.aabb(i)));
                certain += 1;
            }
        }
        assert!(certain > 100, "{certain}");
        assert!(dropped > 20 && dropped < 200, "{dropped}");
    }
}
