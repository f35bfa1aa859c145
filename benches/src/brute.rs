//! The oracle: every ray against every triangle.

use bvh_core::{Triangles, Vec3};
use rt_cpu::{TriangleTest, any_hit_brute, closest_hit_brute};

use crate::mesh::Mesh;
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// Tests every triangle; has no tree.
pub struct Brute {
    mesh: Mesh,
}

impl Brute {
    /// With its own copy of the triangles.
    #[must_use]
    pub fn new(triangles: &Triangles<'_>) -> Self {
        Self { mesh: Mesh::new(triangles) }
    }
}

impl Contestant for Brute {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        Ok(())
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let triangles = self.mesh.triangles();
        for i in 0..rays.len() {
            let hit = closest_hit_brute(&triangles, &rays.ray(i), rays.t_max[i], TriangleTest::default());
            hits.set(i, hit);
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let triangles = self.mesh.triangles();
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            *blocked = any_hit_brute(&triangles, &rays.ray(i), rays.t_max[i], TriangleTest::default());
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }
}
