//! Solids as signed distance functions: rounded primitives blended smoothly, some of them carved
//! away.
//!
//! Distances are bounds, negative inside (Quilez, "Distance functions"); blends are his polynomial
//! smooth minimum.

use glam::{Vec3, vec3};

/// A primitive shape.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// A cone between two spheres, rounded by them.
    Cone { from: Vec3, to: Vec3, radius: (f32, f32) },
    /// An ellipsoid along the axes.
    Ellipsoid { center: Vec3, radii: Vec3 },
    /// A triangle grown by a distance.
    Triangle { corners: [Vec3; 3], grown: f32 },
    /// A box grown by a distance.
    Block { center: Vec3, half: Vec3, grown: f32 },
}

/// A shape and how it joins those before it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Element {
    shape: Shape,
    blend: f32,
    carve: bool,
    /// Whether it is the shape's mirror image in the plane x = 0.
    mirrored: bool,
}

/// A solid, the elements joined in order.
///
/// An element blends with those before it over a distance, the first argument of each function
/// that adds elements.
#[derive(Clone, Debug, Default)]
pub(crate) struct Solid {
    elements: Vec<Element>,
}

impl Solid {
    pub(crate) fn add(&mut self, blend: f32, shape: Shape) {
        self.elements.push(Element { shape, blend, carve: false, mirrored: false });
    }

    /// Takes a shape away from the elements before it.
    pub(crate) fn carve(&mut self, blend: f32, shape: Shape) {
        self.elements.push(Element { shape, blend, carve: true, mirrored: false });
    }

    pub(crate) fn ball(&mut self, blend: f32, center: Vec3, radius: f32) {
        self.ellipsoid(blend, center, Vec3::splat(radius));
    }

    pub(crate) fn ellipsoid(&mut self, blend: f32, center: Vec3, radii: Vec3) {
        self.add(blend, Shape::Ellipsoid { center, radii });
    }

    /// A limb through points with a radius at each.
    pub(crate) fn limb(&mut self, blend: f32, points: &[(Vec3, f32)]) {
        for pair in points.windows(2) {
            let [(from, r0), (to, r1)] = [pair[0], pair[1]];
            self.add(blend, Shape::Cone { from, to, radius: (r0, r1) });
        }
    }

    /// Adds the elements of another solid, and all of them again mirrored in the plane x = 0.
    pub(crate) fn both_sides(&mut self, half: &Self) {
        self.elements.extend(&half.elements);
        self.elements.extend(half.elements.iter().map(|e| Element { mirrored: !e.mirrored, ..*e }));
    }

    /// Distance to the surface, positive outside.
    pub(crate) fn distance(&self, p: Vec3) -> f32 {
        let mut d = f32::MAX;
        for e in &self.elements {
            let s = e.distance(p);
            d = if e.carve { -smooth_min(-d, s, e.blend) } else { smooth_min(d, s, e.blend) };
        }
        d
    }

    /// Only the elements that can matter within `radius` of `center`.
    pub(crate) fn near(&self, center: Vec3, radius: f32) -> Self {
        let distances: Vec<_> = self.elements.iter().map(|e| (e, e.distance(center))).collect();
        let nearest = distances.iter().filter(|(e, _)| !e.carve).map(|&(_, d)| d).fold(f32::MAX, f32::min);
        // Elements farther away than the nearest can still pull at it, through those that they
        // blend with.
        let widest = self.elements.iter().map(|e| e.blend).fold(0.0, f32::max);
        let slack = 2.2 * radius + 1.5 * widest;
        let limit = |e: &Element| slack + if e.carve { 0.0 } else { nearest.max(0.0) };
        let elements = distances.iter().filter(|(e, d)| *d <= limit(e)).map(|&(e, _)| *e).collect();
        Self { elements }
    }

    /// Outward unit normal of the surface through a point, from differences over `step` to a
    /// tetrahedron's corners.
    pub(crate) fn normal(&self, p: Vec3, step: f32) -> Vec3 {
        let corners = [vec3(1.0, -1.0, -1.0), vec3(-1.0, -1.0, 1.0), vec3(-1.0, 1.0, -1.0), Vec3::ONE];
        corners.into_iter().map(|c| c * self.distance(p + c * step)).sum::<Vec3>().normalize_or_zero()
    }
}

impl Element {
    fn distance(&self, p: Vec3) -> f32 {
        self.shape.distance(if self.mirrored { p.with_x(-p.x) } else { p })
    }
}

impl Shape {
    fn distance(&self, p: Vec3) -> f32 {
        match *self {
            Self::Cone { from, to, radius } => {
                let axis = to - from;
                let along = ((p - from).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0);
                p.distance(from + axis * along) - (radius.0 + (radius.1 - radius.0) * along)
            }
            Self::Ellipsoid { center, radii } => {
                let q = p - center;
                let (k0, k1) = ((q / radii).length(), (q / (radii * radii)).length());
                if k1 > 0.0 { k0 * (k0 - 1.0) / k1 } else { -radii.min_element() }
            }
            Self::Triangle { corners, grown } => nearest_on_triangle(corners, p).distance(p) - grown,
            Self::Block { center, half, grown } => {
                let q = (p - center).abs() - half;
                q.max(Vec3::ZERO).length() + q.max_element().min(0.0) - grown
            }
        }
    }
}

fn smooth_min(a: f32, b: f32, blend: f32) -> f32 {
    let h = (blend - (a - b).abs()).max(0.0);
    if h > 0.0 { a.min(b) - h * h / (4.0 * blend) } else { a.min(b) }
}

/// Ericson, "Real-Time Collision Detection", section 5.1.5.
fn nearest_on_triangle([a, b, c]: [Vec3; 3], p: Vec3) -> Vec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{dragon, lion_solid};

    #[test]
    fn pruned_solid_has_the_same_distance_nearby() {
        for solid in [dragon::solid(), lion_solid::solid()] {
            let mut random = fastrand::Rng::with_seed(9);
            let mut number = |scale: f32| scale * (2.0 * random.f32() - 1.0);
            let mut checked = 0;
            while checked < 20_000 {
                let center = Vec3::new(number(6.0), 4.5 + number(4.5), number(6.0));
                let radius = if checked % 40 == 0 { 0.4 } else { 0.02 };
                if solid.distance(center).abs() > 0.3 {
                    continue;
                }
                let near = solid.near(center, radius);
                for _ in 0..20 {
                    let p = center
                        + Vec3::new(number(1.0), number(1.0), number(1.0)).clamp_length_max(1.0) * radius;
                    let (whole, part) = (solid.distance(p), near.distance(p));
                    assert!((whole - part).abs() < 1e-4, "{whole} {part} at {p}, from {center}");
                    checked += 1;
                }
            }
        }
    }
}
