//! Tests of one ray against one triangle.

use glam::{DVec3, Vec3};

use crate::{Aabb, Hit, Ray, slab};

/// How a ray is tested against a triangle. All tests are two-sided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum TriangleTest {
    /// Möller and Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection*, 1997. Rays may slip
    /// through between neighbours.
    MollerTrumbore,
    /// Woop, Benthin and Wald, *Watertight Ray/Triangle Intersection*, 2013: no ray passes between
    /// triangles that share an edge or a vertex.
    #[default]
    Watertight,
    /// The same projection in double precision throughout: a reference to measure the others by.
    Double,
}

crate::named!(
    TriangleTest,
    "triangle test",
    MollerTrumbore = "fast",
    Watertight = "watertight",
    Double = "f64"
);

/// Distance and weights of B and C.
pub type Found = (f32, f32, f32);

/// A triangle test with what it precomputes for a ray. Hits have `0 <= t < inf`.
pub trait Test {
    /// How much later than computed a single ray leaves a box, so that rounding loses no hit. With
    /// 1 boxes are not conservative: `docs/ACCURACY.md` has what that saves and loses.
    const WIDEN: f32 = Ray::WIDEN;
    /// Precomputes what the test needs of a ray.
    fn new(ray: &Ray) -> Self;
    /// Where the ray meets the plane inside the triangle.
    fn test(&self, corners: &[Vec3; 3]) -> Option<Found>;
}

/// Returns a hit as the crate defines it, of the triangle numbered `primitive`.
#[inline(always)]
pub fn intersect<T: Test>(
    ray: &Ray,
    test: &T,
    corners: &[Vec3; 3],
    primitive: u32,
    t_max: f32,
) -> Option<Hit> {
    in_box(ray, test.test(corners)?, corners, primitive, t_max, T::WIDEN)
}

/// Restricts a triangle test's answer to the triangle's box.
#[inline]
pub fn in_box(
    ray: &Ray,
    (t, u, v): Found,
    corners: &[Vec3; 3],
    primitive: u32,
    t_max: f32,
    widen: f32,
) -> Option<Hit> {
    let near = slab::enters(ray, &Aabb::around(corners), t_max, widen)?;
    let t = slab::max(t, near);
    // Along a direction whose reciprocal is infinite, even a box that is near is entered at
    // infinity.
    (t <= t_max && t < f32::INFINITY).then_some(Hit { t, u, v, primitive })
}

/// [`TriangleTest::MollerTrumbore`] for a ray.
pub struct MollerTrumbore {
    origin: Vec3,
    direction: Vec3,
}

impl Test for MollerTrumbore {
    #[inline]
    fn new(ray: &Ray) -> Self {
        Self { origin: ray.origin(), direction: ray.direction() }
    }

    #[inline]
    fn test(&self, &[a, b, c]: &[Vec3; 3]) -> Option<Found> {
        let (e1, e2) = (b - a, c - a);
        let p = self.direction.cross(e2);
        let inv_det = 1.0 / e1.dot(p);
        let s = self.origin - a;
        let u = s.dot(p) * inv_det;
        let q = s.cross(e1);
        let v = self.direction.dot(q) * inv_det;
        let t = e2.dot(q) * inv_det;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (0.0..f32::INFINITY).contains(&t)).then_some((t, u, v))
    }
}

/// Least and greatest magnitude of a determinant for which single precision will do: its reciprocal
/// and the products with it stay normal.
pub const DET_RANGE: (f32, f32) = (1.0 / (1u128 << 100) as f32, (1u128 << 100) as f32);

/// [`TriangleTest::Watertight`] for a ray.
pub struct Watertight {
    /// The ray's longest axis last, after the two that follow it.
    pub axes: [usize; 3],
    /// The origin along these axes.
    pub origin: Vec3,
    /// Slopes along the first two axes, and one over the extent along the last.
    pub shear: Vec3,
}

impl Watertight {
    /// Tests where single precision cannot tell: projected corners, and their distances along the
    /// axis, to be multiplied by `unit`.
    ///
    /// Products of two single precision numbers are exact in double precision, so signs of edges
    /// are.
    #[cold]
    pub fn exactly(x: [f32; 3], y: [f32; 3], z: [f32; 3], unit: f32) -> Option<Found> {
        // As in single precision, where that does not overflow.
        let scaled =
            |z: f32| if (z * unit).is_finite() { (z * unit).into() } else { f64::from(z) * f64::from(unit) };
        weigh(x.map(f64::from), y.map(f64::from), z.map(scaled))
    }
}

impl Test for Watertight {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let d = ray.direction();
        let kz = d.abs().max_position();
        let axes = [(kz + 1) % 3, (kz + 2) % 3, kz];
        let along = |v: Vec3| Vec3::new(v[axes[0]], v[axes[1]], v[axes[2]]);
        let shear = Vec3::new(d[axes[0]] / d[kz], d[axes[1]] / d[kz], 1.0 / d[kz]);
        Self { origin: along(ray.origin()), axes, shear }
    }

    /// Section 3 of the paper. The corners are projected along the ray onto the plane through its
    /// origin, each by itself, so neighbours agree on where they are; and a rounded difference of
    /// rounded products is zero or has the right sign, so they agree on which side of an edge the
    /// ray is.
    #[inline(always)]
    fn test(&self, [a, b, c]: &[Vec3; 3]) -> Option<Found> {
        let [kx, ky, kz] = self.axes;
        let (origin, shear) = (self.origin, self.shear);
        let z = [a[kz] - origin.z, b[kz] - origin.z, c[kz] - origin.z];
        let along = |p: &Vec3, z: f32| (p[kx] - origin.x - shear.x * z, p[ky] - origin.y - shear.y * z);
        let ((xa, ya), (xb, yb), (xc, yc)) = (along(a, z[0]), along(b, z[1]), along(c, z[2]));
        let wa = xc * yb - yc * xb;
        let wb = xa * yc - ya * xc;
        let wc = xb * ya - yb * xa;
        // Minima rather than comparisons, which branches would follow that nobody can predict.
        let least = slab::min(slab::min(wa, wb), wc);
        let greatest = slab::max(slab::max(wa, wb), wc);
        if least < 0.0 && greatest > 0.0 {
            return None;
        }
        let det = wa + wb + wc;
        let plain = det.abs() >= DET_RANGE.0 && det.abs() <= DET_RANGE.1;
        let inv_det = 1.0 / det;
        let (u, v) = (wb * inv_det, wc * inv_det);
        let t = wa * inv_det * (shear.z * z[0]) + u * (shear.z * z[1]) + v * (shear.z * z[2]);
        // Inside, a zero is the least or the greatest. Corners may be too far where the hit is not.
        if !plain || least == 0.0 || greatest == 0.0 || !t.is_finite() {
            return Self::exactly([xa, xb, xc], [ya, yb, yc], z, shear.z);
        }
        (t >= 0.0).then_some((t, u, v))
    }
}

/// [`TriangleTest::Double`] for a ray.
pub struct Double {
    origin: DVec3,
    axes: [usize; 3],
    shear: DVec3,
}

impl Test for Double {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let d = ray.direction().as_dvec3();
        let kz = d.abs().max_position();
        let axes = [(kz + 1) % 3, (kz + 2) % 3, kz];
        let shear = DVec3::new(d[axes[0]] / d[kz], d[axes[1]] / d[kz], 1.0 / d[kz]);
        Self { origin: ray.origin().as_dvec3(), axes, shear }
    }

    #[inline]
    fn test(&self, corners: &[Vec3; 3]) -> Option<Found> {
        let [kx, ky, kz] = self.axes;
        let p = corners.map(|c| c.as_dvec3() - self.origin);
        let x = p.map(|p| p[kx] - self.shear.x * p[kz]);
        let y = p.map(|p| p[ky] - self.shear.y * p[kz]);
        weigh(x, y, p.map(|p| self.shear.z * p[kz]))
    }
}

/// Watertight test of corners projected along the ray, in double precision.
fn weigh(x: [f64; 3], y: [f64; 3], z: [f64; 3]) -> Option<Found> {
    let wa = x[2] * y[1] - y[2] * x[1];
    let wb = x[0] * y[2] - y[0] * x[2];
    let wc = x[1] * y[0] - y[1] * x[0];
    let inside = (wa >= 0.0 && wb >= 0.0 && wc >= 0.0) || (wa <= 0.0 && wb <= 0.0 && wc <= 0.0);
    let det = wa + wb + wc;
    if !inside || det == 0.0 {
        return None;
    }
    let (u, v) = (wb / det, wc / det);
    let t = wa / det * z[0] + u * z[1] + v * z[2];
    // Rounded last, and an infinity if it does not fit.
    let t32 = t as f32;
    // Zeros without signs, whatever signs they come from.
    (t >= 0.0 && t32 < f32::INFINITY).then_some((t32, u as f32 + 0.0, v as f32 + 0.0))
}

/// Runs `$body` with the type `$test` standing for a [`TriangleTest`].
#[doc(hidden)]
#[macro_export]
macro_rules! with_test {
    ($which:expr, $test:ident => $body:expr) => {
        $crate::with_test!($which, $test => $body; MollerTrumbore, Watertight, Double)
    };
    ($which:expr, $test:ident => $body:expr; $($name:ident),+) => {
        match $which {
            $($crate::TriangleTest::$name => {
                type $test = $crate::triangle::$name;
                $body
            })+
        }
    };
}
