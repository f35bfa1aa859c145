//! What a tree holds, seen from outside: numbered boxes.

use glam::{Vec3, Vec4};

use crate::{Aabb, prefetch};

/// The primitives of a tree: their number, and the box of each.
///
/// Primitives are numbered from 0. Builders and updates ask for a box whenever they need it, so an
/// implementation can compute boxes from vertices; a build copies boxes while it runs, and nobody
/// keeps a second array of them. Boxes may change from update to update. A tree over another number
/// of primitives is a new tree; where primitives come and go, [`Aabb::EMPTY`] keeps a number free
/// without that: no query finds it.
///
/// An implementation gives [`len`](Self::len) and [`bounds`](Self::bounds). Any box will do: the
/// library asks through [`aabb`](Self::aabb), which drops boxes that are not finite.
///
/// ```
/// use bvh_core::{Aabb, Primitives, Vec3};
///
/// struct Balls(Vec<(Vec3, f32)>);
///
/// impl Primitives for Balls {
///     fn len(&self) -> usize {
///         self.0.len()
///     }
///     fn bounds(&self, i: usize) -> Aabb {
///         let (center, radius) = self.0[i];
///         Aabb::new(center, center).grown(radius)
///     }
/// }
///
/// let balls = Balls(vec![(Vec3::ZERO, 1.0), (Vec3::NAN, 1.0)]);
/// assert_eq!(balls.aabb(0), Aabb::new(-Vec3::ONE, Vec3::ONE));
/// assert!(balls.aabb(1).is_empty());
/// ```
pub trait Primitives: Sync {
    /// Number of primitives.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Box of primitive `i`. A box with a NaN, an infinity or `min > max` counts as empty.
    ///
    /// # Panics
    /// May panic if `i` is not below [`len`](Self::len).
    fn bounds(&self, i: usize) -> Aabb;

    /// Box of primitive `i` as trees store it: [`bounds`](Self::bounds),
    /// [`sanitized`](Aabb::sanitized). Override it only where the result is the same and faster.
    ///
    /// # Panics
    /// As [`bounds`](Self::bounds).
    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        self.bounds(i).sanitized()
    }

    /// The same box for SIMD kernels: minimum, maximum and *validity*, each in the first three of
    /// four lanes. A validity that is not finite means that the kernel must ask
    /// [`aabb`](Self::aabb) instead; it must not be finite if the box is empty. The fourth lanes
    /// may hold anything. Override it only where the result is the same and faster.
    ///
    /// # Panics
    /// As [`bounds`](Self::bounds).
    #[inline]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        let aabb = self.aabb(i);
        let [min, max] = [aabb.min.extend(0.0), aabb.max.extend(0.0)];
        // Not finite either where an `aabb` of the caller's own lets an infinity through.
        let validity = if aabb.is_empty() { Vec4::NAN } else { min + max };
        [min, max, validity]
    }

    /// Hint that `aabb(i)` will be asked for soon: prefetch the index that locates its data.
    #[inline]
    fn prefetch_index(&self, _i: usize) {}

    /// Hint that `aabb(i)` will be asked for very soon, after `prefetch_index`: prefetch the data.
    #[inline]
    fn prefetch_data(&self, _i: usize) {}
}

impl Primitives for [Aabb] {
    #[inline]
    fn len(&self) -> usize {
        <[Aabb]>::len(self)
    }

    #[inline]
    fn bounds(&self, i: usize) -> Aabb {
        self[i]
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        prefetch(self, i);
    }
}

/// Forwards all methods to `$this`.
macro_rules! forward {
    ($self:ident => $this:expr) => {
        #[inline]
        fn len(&$self) -> usize {
            Primitives::len($this)
        }

        #[inline]
        fn bounds(&$self, i: usize) -> Aabb {
            $this.bounds(i)
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

impl<P: Primitives + ?Sized> Primitives for Box<P> {
    forward!(self => self.as_ref());
}

/// Triangles that share vertices: triangle `i` has the corners `positions[indices[i][0..3]]`.
///
/// A triangle has an empty box if it names a vertex out of range or a vertex that is not finite.
///
/// ```
/// use bvh_core::{Aabb, Primitives, Triangles, Vec3};
///
/// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let triangles = Triangles { positions: &positions, indices: &[[0, 1, 2], [0, 1, 9]] };
/// assert_eq!(triangles.aabb(0), Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
/// assert!(triangles.aabb(1).is_empty());
///
/// let arrays = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let same = Triangles::from_flat(arrays.as_flattened(), &[0, 1, 2]).expect("multiples of three");
/// assert_eq!(same.aabb(0), triangles.aabb(0));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertex positions.
    pub positions: &'a [Vec3],
    /// Three vertex numbers a triangle.
    pub indices: &'a [[u32; 3]],
}

impl<'a> Triangles<'a> {
    /// Makes triangles from flat arrays: three coordinates a vertex, three vertex numbers a
    /// triangle. `None` if the length of either is no multiple of three. Arrays of arrays, such as
    /// `&[[f32; 3]]`, are flat by `as_flattened()`.
    #[must_use]
    pub fn from_flat(positions: &'a [f32], indices: &'a [u32]) -> Option<Self> {
        let (indices, rest) = indices.as_chunks();
        let positions = bytemuck::try_cast_slice(positions).ok()?;
        rest.is_empty().then_some(Self { positions, indices })
    }

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

    /// Position `v` in the first three of four lanes, NaN if there is none.
    #[inline(always)]
    fn lanes(&self, v: usize) -> Vec4 {
        // One load of four floats, except for the last vertex, which no fourth float follows.
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
    fn bounds(&self, i: usize) -> Aabb {
        self.aabb(i)
    }

    #[inline]
    fn aabb(&self, i: usize) -> Aabb {
        let [min, max, validity] = self.aabb_lanes(i);
        if validity.is_finite_mask().bitmask() & 0b111 == 0b111 {
            Aabb::new(min.truncate(), max.truncate())
        } else {
            Aabb::around(&self.corners(i))
        }
    }

    // Kernels use it twice in one loop. Not inlined there, calls take half of an update.
    #[inline(always)]
    fn aabb_lanes(&self, i: usize) -> [Vec4; 3] {
        let [a, b, c] = self.indices[i];
        let (a, b, c) = (self.lanes(a as usize), self.lanes(b as usize), self.lanes(c as usize));
        // Adding 0 makes negative zeros positive. The sum is not finite if a corner is not, and
        // rarely otherwise.
        [a.min(b).min(c) + 0.0, a.max(b).max(c) + 0.0, a + b + c]
    }

    #[inline]
    fn prefetch_index(&self, i: usize) {
        prefetch(self.indices, i);
    }

    #[inline]
    fn prefetch_data(&self, i: usize) {
        // In most meshes two of three corners are neighbours in memory.
        if let Some(&[a, _, c]) = self.indices.get(i) {
            prefetch(self.positions, a as usize);
            prefetch(self.positions, c as usize);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_with_wild_indices_are_dropped() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let indices = [[0, 1, 2], [0, 1, 9], [u32::MAX, 1, 2]];
        let t = Triangles { positions: &positions, indices: &indices };
        assert_eq!(t.aabb(0), Aabb::new(Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)));
        assert!(t.aabb(1).is_empty() && t.aabb(2).is_empty());
        (0..10).for_each(|i| t.prefetch_data(i));
    }

    #[test]
    fn boxed_primitives_are_primitives() {
        let count = |primitives: Box<dyn Primitives>| Primitives::len(&primitives);
        assert_eq!(count(Box::new([Aabb::EMPTY; 3])), 3);
    }

    #[test]
    fn flat_arrays_of_other_lengths_are_refused() {
        let positions = [0.0, 0.0, 0.0, 1.0, 2.0, 3.0];
        let t = Triangles::from_flat(&positions, &[0, 1, 1]).expect("multiples of three");
        assert_eq!(t.corners(0), [Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 2.0, 3.0)]);
        assert!(Triangles::from_flat(&positions[..5], &[0, 1, 1]).is_none());
        assert!(Triangles::from_flat(&positions, &[0, 1]).is_none());
        assert!(Triangles::from_flat(&[], &[]).is_some_and(|t| t.is_empty()));
    }

    #[test]
    fn boxes_that_are_not_sanitized_are_dropped_on_all_ways() {
        struct Careless;
        impl Primitives for Careless {
            fn len(&self) -> usize {
                3
            }
            fn bounds(&self, i: usize) -> Aabb {
                Aabb::new(Vec3::splat(-0.0), Vec3::new(1.0, [f32::NAN, f32::INFINITY, 1.0][i], 1.0))
            }
        }
        for i in 0..2 {
            assert_eq!(Careless.aabb(i), Aabb::EMPTY);
            assert!(!Careless.aabb_lanes(i)[2].truncate().is_finite());
        }
        assert!(Careless.aabb(2).min.to_array().iter().all(|x| x.is_sign_positive()));
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
            let [min, max, validity] = t.aabb_lanes(i);
            if validity.truncate().is_finite() {
                assert_eq!(bits(Aabb::new(min.truncate(), max.truncate())), bits(t.aabb(i)));
                certain += 1;
            }
        }
        assert!(certain > 100, "{certain}");
        assert!(dropped > 20 && dropped < 200, "{dropped}");
    }
}
