//! The oracle: every ray against every triangle.

use bvh_core::{Triangles, Vec3};
use rt_cpu::{TriangleTest, closest_hit_brute};

use pivot_benches::{Contestant, Failure, Hits, RAYS, Rays};

/// Tests every triangle; has no tree.
pub(crate) struct Brute {
    positions: Vec<Vec3>,
    indices: Vec<[u32; 3]>,
}

impl Brute {
    /// With its own copy of the triangles.
    pub(crate) fn new(triangles: &Triangles<'_>) -> Self {
        Self { positions: triangles.positions.to_vec(), indices: triangles.indices.to_vec() }
    }
}

impl Contestant for Brute {
    fn pose(&mut self, positions: &[Vec3]) {
        self.positions.copy_from_slice(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        Ok(())
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let triangles = self.triangles();
        for i in 0..rays.len() {
            let hit = closest_hit_brute(&triangles, &rays.ray(i), rays.t_max[i], TriangleTest::default());
            hits.set(i, hit);
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let triangles = self.triangles();
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            let hit = closest_hit_brute(&triangles, &rays.ray(i), rays.t_max[i], TriangleTest::default());
            *blocked = hit.is_some();
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, indices: &self.indices }
    }
}
