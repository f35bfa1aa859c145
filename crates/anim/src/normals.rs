//! Vertex normals for smooth shading.

use glam::{DVec3, Vec3};

/// Makes a unit normal for each vertex: the mean of the normals of its triangles, weighted by area.
///
/// Triangles are counter-clockwise seen from outside. Those of zero area, with a vertex that is not
/// finite or out of range contribute nothing; a vertex to which nothing contributes gets the zero
/// vector. O(triangles + vertices).
#[must_use]
pub fn vertex_normals(triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<Vec3> {
    // Twice the area is the length of the cross product, which overflows f32 for edges of 1e19 and
    // vanishes at 1e-23.
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for corners in triangles {
        let [Some(a), Some(b), Some(c)] = corners.map(|corner| positions.get(corner as usize)) else {
            continue;
        };
        let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        let doubled = (b - a).cross(c - a);
        if doubled.is_finite() {
            for &corner in corners {
                sums[corner as usize] += doubled;
            }
        }
    }
    let unit = |sum: DVec3| {
        // Scaled first, since the square of a tiny area is no f64 any more.
        let largest = sum.abs().max_element();
        if largest > 0.0 { (sum / largest).normalize().as_vec3() } else { Vec3::ZERO }
    };
    sums.into_iter().map(unit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weighted_by_area() {
        // Around the z axis: area 1/2 facing +z, area 1 facing -y.
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, 0.0, 2.0)];
        let normals = vertex_normals(&[[0, 1, 2], [0, 1, 3]], &positions);
        let expected = (Vec3::Z + 2.0 * Vec3::NEG_Y).normalize();
        assert!(normals[0].abs_diff_eq(expected, 1e-6) && normals[1].abs_diff_eq(expected, 1e-6));
        assert_eq!(normals[2], Vec3::Z);
        assert_eq!(normals[3], Vec3::NEG_Y);
    }

    #[test]
    fn useless_triangles_contribute_nothing() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::INFINITY, Vec3::NAN, Vec3::ZERO];
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5], [0, 1, 99]];
        assert_eq!(
            vertex_normals(&triangles, &positions),
            [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]
        );
    }

    #[test]
    fn huge_and_tiny_triangles() {
        for size in [1e30, 1e18, 1e-30, 1e-44] {
            let positions = [Vec3::ZERO, Vec3::X * size, Vec3::Y * size];
            assert_eq!(vertex_normals(&[[0, 1, 2]], &positions), [Vec3::Z; 3], "{size}");
        }
    }
}
