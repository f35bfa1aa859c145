//! Triangles as they are read: parts in their own coordinates, and round shapes cut into triangles.

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DVec3, Vec3};

use crate::Topology;

/// Triangles around a sphere's equator, a cone or a cylinder.
const SEGMENTS: u32 = 16;
/// Bands of triangles from pole to pole of a sphere.
const BANDS: u32 = 8;

/// Where vertices are given: still, under an animated transform or the world.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Number of the animated transform.
    pub(super) node: Option<u32>,
    /// From here to there.
    pub(super) fixed: DAffine3,
}

impl Frame {
    pub(super) const WORLD: Self = Self { node: None, fixed: DAffine3::IDENTITY };
}

/// A triangle with keys of its own (`tpa`).
pub(super) struct Patch(pub(super) Vec<PatchKey>);

pub(super) struct PatchKey {
    pub(super) time: f64,
    pub(super) corners: [Vec3; 3],
}

impl Patch {
    pub(super) fn moves(&self) -> bool {
        self.0.len() > 1
    }

    /// Times of the first and the last key.
    pub(super) fn span(&self) -> (f64, f64) {
        (self.0[0].time, self.0[self.0.len() - 1].time)
    }

    pub(super) fn corners_mut(&mut self) -> impl Iterator<Item = &mut Vec3> {
        self.0.iter_mut().flat_map(|key| &mut key.corners)
    }

    /// Linear from key to key, and still before the first and after the last.
    pub(super) fn at(&self, time: f64) -> [Vec3; 3] {
        let Self(keys) = self;
        let after = keys.partition_point(|key| key.time <= time);
        let key = &keys[after.saturating_sub(1)];
        let Some(next) = keys.get(after).filter(|_| after > 0) else { return key.corners };
        let u = ((time - key.time) / (next.time - key.time)) as f32;
        if u == 0.0 {
            return key.corners;
        }
        [0, 1, 2].map(|corner| key.corners[corner].lerp(next.corners[corner], u))
    }
}

/// What a part of the topology is made from.
pub(super) struct Source {
    /// Animated transform that the part is under.
    pub(super) node: Option<u32>,
    /// One for each triangle, or none at all.
    pub(super) patches: Vec<Patch>,
}

/// All triangles so far. Positions are as given by [`Frame::node`].
#[derive(Default)]
pub(super) struct Geometry {
    pub(super) topology: Topology,
    pub(super) positions: Vec<Vec3>,
    /// One for each part.
    pub(super) sources: Vec<Source>,
}

/// What triangles in one part have in common.
#[derive(Clone, Copy)]
pub(super) struct Group<'a> {
    pub(super) name: &'a str,
    pub(super) frame: Frame,
    pub(super) material: u32,
}

impl Geometry {
    /// Adds triangles that number their own `vertices`. `None` if there are too many in all.
    pub(super) fn add(&mut self, group: Group<'_>, vertices: &[DVec3], triangles: &[[u32; 3]]) -> Option<()> {
        self.extend_part(group, vertices.len(), triangles, false)?;
        let place = |vertex: &DVec3| group.frame.fixed.transform_point3(*vertex).as_vec3();
        self.positions.extend(vertices.iter().map(place));
        Some(())
    }

    /// Adds an animated triangle. `None` if there are too many in all.
    pub(super) fn add_patch(&mut self, group: Group<'_>, patch: Patch) -> Option<()> {
        self.extend_part(group, 3, &[[0, 1, 2]], true)?;
        self.positions.extend(patch.0[0].corners);
        self.sources.last_mut()?.patches.push(patch);
        Some(())
    }

    /// Extends the last part, or starts another if the group is not the same.
    fn extend_part(
        &mut self,
        group: Group<'_>,
        vertices: usize,
        triangles: &[[u32; 3]],
        patches: bool,
    ) -> Option<()> {
        let parts = &mut self.topology.parts;
        let same = parts.last().zip(self.sources.last()).is_some_and(|(part, source)| {
            part.name == group.name
                && part.material == group.material
                && source.node == group.frame.node
                && source.patches.is_empty() != patches
        });
        let last = if same { parts.pop() } else { None };
        let name = group.name.to_owned();
        let part = self.topology.add_part(name, triangles, vertices, group.material)?;
        match last {
            Some(last) => {
                (part.triangles.start, part.vertices.start) = (last.triangles.start, last.vertices.start);
            }
            None => self.sources.push(Source { node: group.frame.node, patches: Vec::new() }),
        }
        Some(())
    }
}

/// Vertices and triangles.
pub(super) type Shape = (Vec<DVec3>, Vec<[u32; 3]>);

/// A cone, truncated cone or cylinder without caps, seen from outside.
pub(super) fn cone(base: (DVec3, f64), apex: (DVec3, f64)) -> Shape {
    let axis = (apex.0 - base.0).try_normalize().unwrap_or(DVec3::Y);
    let (x, y) = axis.any_orthonormal_pair();
    let ring = |(center, radius): (DVec3, f64)| {
        (0..SEGMENTS).map(move |i| {
            let (sine, cosine) = (TAU * f64::from(i) / f64::from(SEGMENTS)).sin_cos();
            center + radius * (cosine * x + sine * y)
        })
    };
    // A radius of 0 leaves triangles without area, which harm nothing, and keeps the counts the
    // same for all.
    let vertices = ring(base).chain(ring(apex)).collect();
    (vertices, band(0))
}

/// Vertices in rings of [`SEGMENTS`], poles included, seen from outside.
pub(super) fn sphere(center: DVec3, radius: f64) -> Shape {
    let mut vertices = Vec::new();
    for ring in 0..=BANDS {
        let (ring_radius, height) = (PI * f64::from(ring) / f64::from(BANDS)).sin_cos();
        for segment in 0..SEGMENTS {
            let (sine, cosine) = (TAU * f64::from(segment) / f64::from(SEGMENTS)).sin_cos();
            vertices.push(center + radius * DVec3::new(ring_radius * sine, -height, ring_radius * cosine));
        }
    }
    // At the poles one triangle of each pair would have no area.
    let triangles = (0..BANDS).flat_map(|ring| {
        band(ring * SEGMENTS).into_iter().enumerate().filter_map(move |(number, triangle)| {
            let pole = (ring == 0 && number % 2 == 0) || (ring == BANDS - 1 && number % 2 == 1);
            (!pole).then_some(triangle)
        })
    });
    (vertices, triangles.collect())
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
        let key = |time, x| PatchKey { time, corners: [Vec3::splat(x); 3] };
        let patch = Patch(vec![key(1.0, 0.0), key(2.0, 4.0), key(2.0, 6.0), key(4.0, 8.0)]);
        for (time, x) in [(0.0, 0.0), (1.0, 0.0), (1.25, 1.0), (2.0, 6.0), (3.0, 7.0), (4.0, 8.0), (9.0, 8.0)]
        {
            assert_eq!(patch.at(time), [Vec3::splat(x); 3], "at {time}");
        }
    }
}
