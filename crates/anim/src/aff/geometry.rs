//! Shapes: triangles with keys of their own, and round shapes cut into triangles.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec3, Vec3};

use crate::key_frames::segment;

/// Triangles around a sphere's equator, a cone or a cylinder.
const SEGMENTS: u32 = 16;
/// Bands of triangles from pole to pole of a sphere.
const BANDS: u32 = 8;

/// Where vertices are given: still, under an animated transform or the world.
#[derive(Clone, Copy, Default)]
pub(super) struct Frame {
    /// Number of the animated transform, counted as in [`Source::node`].
    pub(super) node: Option<u32>,
    /// From here to there.
    pub(super) fixed: DAffine3,
}

/// A triangle with keys of its own (`tpa`): times, and its corners then.
pub(super) struct Patch(pub(super) Vec<(f64, [Vec3; 3])>);

impl Patch {
    pub(super) fn moves(&self) -> bool {
        self.0.len() > 1
    }

    /// Times of the first and the last key.
    pub(super) fn span(&self) -> (f64, f64) {
        (self.0[0].0, self.0[self.0.len() - 1].0)
    }

    /// Linear from key to key, and still before the first and after the last.
    pub(super) fn at(&self, time: f64) -> [Vec3; 3] {
        let (first, u, _) = segment(&self.0, time, |key| key.0);
        let corners = self.0[first].1;
        if u == 0.0 {
            return corners;
        }
        let next = self.0[first + 1].1;
        [0, 1, 2].map(|corner| corners[corner].lerp(next[corner], u))
    }
}

/// What a part of the topology is made from: its triangles have keys of their own, or they all stay
/// where `local` has them under the node.
#[derive(Default)]
pub(super) struct Source {
    /// Number of the animated transform that the part is under. The reader counts all of them;
    /// once the parts are placed, only those that move count.
    pub(super) node: Option<u32>,
    /// Positions under the node, one for each vertex, or none if there are patches.
    pub(super) local: Vec<Vec3>,
    /// One for each triangle, or none.
    pub(super) patches: Vec<Patch>,
}

/// Vertices and triangles.
pub(super) type Shape = (Vec<DVec3>, Vec<[u32; 3]>);

/// A cone, truncated cone or cylinder without caps, seen from outside.
pub(super) fn cone(base: (DVec3, f64), apex: (DVec3, f64)) -> Shape {
    let across = (apex.0 - base.0).try_normalize().unwrap_or(DVec3::Y).any_orthonormal_pair();
    // A radius of 0 leaves triangles without area, which harm nothing, and keeps the counts the
    // same for all.
    let vertices = [base, apex].into_iter().flat_map(|(center, radius)| ring(center, radius, across));
    (vertices.collect(), band(0))
}

/// Vertices in rings of [`SEGMENTS`], poles included, seen from outside.
pub(super) fn sphere(center: DVec3, radius: f64) -> Shape {
    let vertices = (0..=BANDS).flat_map(|number| {
        let (out, height) = libm::sincos(PI * f64::from(number) / f64::from(BANDS));
        ring(center - radius * height * DVec3::Y, radius * out, (DVec3::Z, DVec3::X))
    });
    // At the poles one triangle of each pair would have no area.
    let triangles = (0..BANDS).flat_map(|ring| {
        band(ring * SEGMENTS).into_iter().enumerate().filter_map(move |(number, triangle)| {
            let pole = (ring == 0 && number % 2 == 0) || (ring == BANDS - 1 && number % 2 == 1);
            (!pole).then_some(triangle)
        })
    });
    (vertices.collect(), triangles.collect())
}

/// [`SEGMENTS`] points around `center`, from `x` towards `y`.
fn ring(center: DVec3, radius: f64, (x, y): (DVec3, DVec3)) -> impl Iterator<Item = DVec3> {
    (0..SEGMENTS).map(move |i| {
        let (sine, cosine) = libm::sincos(TAU * f64::from(i) / f64::from(SEGMENTS));
        center + radius * (cosine * x + sine * y)
    })
}

/// Two triangles for each segment between the ring that starts at vertex `first` and the next one:
/// the first with an edge on the lower ring, the second with one on the upper.
fn band(first: u32) -> Vec<[u32; 3]> {
    let pair = |i| {
        let (low, low_next) = (first + i, first + (i + 1) % SEGMENTS);
        let (high, high_next) = (low + SEGMENTS, low_next + SEGMENTS);
        [[low, low_next, high_next], [low, high_next, high]]
    };
    (0..SEGMENTS).flat_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The volume that the triangles enclose, positive if they face outwards.
    fn volume((vertices, triangles): &Shape) -> f64 {
        let volume = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| vertices[corner as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        triangles.iter().map(volume).sum()
    }

    #[test]
    fn a_sphere_is_closed_and_faces_outwards() {
        let center = DVec3::new(1.0, 2.0, 3.0);
        let shape = sphere(center, 2.0);
        assert!(shape.0.iter().all(|vertex| (vertex.distance(center) - 2.0).abs() < 1e-12));
        assert_eq!(shape.1.len() as u32, 2 * SEGMENTS * (BANDS - 1));
        let ball = 4.0 / 3.0 * PI * 8.0;
        assert!((0.9 * ball..ball).contains(&volume(&shape)), "{} of {ball}", volume(&shape));
    }

    #[test]
    fn a_cone_has_its_radii_and_faces_outwards() {
        let (base, apex) = (DVec3::new(0.0, -1.0, 0.0), DVec3::new(0.0, 2.0, 0.0));
        let (vertices, triangles) = cone((base, 2.0), (apex, 0.5));
        assert_eq!(triangles.len() as u32, 2 * SEGMENTS);
        for vertex in &vertices {
            let (center, radius) = if vertex.y < 0.0 { (base, 2.0) } else { (apex, 0.5) };
            assert!((vertex.distance(center) - radius).abs() < 1e-12 && (vertex.y - center.y).abs() < 1e-12);
        }
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| vertices[corner as usize]);
            assert!((b - a).cross(c - a).dot((a + b + c) * DVec3::new(1.0, 0.0, 1.0)) > 0.0);
        }
    }

    #[test]
    fn patches_blend_between_their_own_keys() {
        let key = |time, x| (time, [Vec3::splat(x); 3]);
        let patch = Patch(vec![key(1.0, 0.0), key(2.0, 4.0), key(2.0, 6.0), key(4.0, 8.0)]);
        for (time, x) in [(0.0, 0.0), (1.0, 0.0), (1.25, 1.0), (2.0, 6.0), (3.0, 7.0), (4.0, 8.0), (9.0, 8.0)]
        {
            assert_eq!(patch.at(time), [Vec3::splat(x); 3], "at {time}");
        }
    }
}
