//! Builds a tree over the triangles of a sphere, casts a grid of rays at it and draws what they
//! hit.

use pivot_bvh::{BuildError, Builder, Ray, TriangleTest, Triangles, Vec3, build, closest_hit, stats};
use pivot_examples::sphere;

fn main() -> Result<(), BuildError> {
    let (positions, indices) = sphere(200);
    let triangles = Triangles { positions: &positions, indices: &indices };

    // Binned SAH on all threads; `Builder::Sweep` takes longer for a slightly better tree.
    let bvh = build(&triangles, Builder::BinnedParallel)?;
    println!("{:#?}", stats(&bvh));

    // Looking along -z, lit from the upper left.
    let light = Vec3::new(-1.0, 1.0, 1.0).normalize();
    for row in 0..24 {
        let line: String = (0..60)
            .map(|column| {
                let (x, y) = (column as f32 / 25.0 - 1.2, 1.2 - row as f32 / 10.0);
                let ray = Ray::new(Vec3::new(x, y, 5.0), Vec3::NEG_Z);
                match closest_hit(&bvh, &triangles, &ray, f32::INFINITY, TriangleTest::Watertight) {
                    None => ' ',
                    Some(hit) => {
                        let [a, b, c] = triangles.corners(hit.primitive as usize);
                        let facing = (b - a).cross(c - a).normalize_or_zero().dot(light).abs();
                        [b'.', b':', b'-', b'=', b'+', b'*', b'#', b'%', b'@'][(facing * 8.99) as usize]
                            as char
                    }
                }
            })
            .collect();
        println!("{line}");
    }
    Ok(())
}
