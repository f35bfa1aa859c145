//! The memory limit: the bytes that refitting a binary tree moves, and next to no arithmetic.

use bvh_core::{Triangles, Vec3};
use rayon::prelude::*;

use crate::mesh::Mesh;
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// Two nodes' worth of memory, which is what a tree has for each triangle.
#[repr(C, align(64))]
#[derive(Clone, Copy)]
struct Pair([f32; 16]);

/// Reads each triangle's three vertex numbers and three vertices, in order, and writes 64 bytes.
pub(crate) struct Limit {
    mesh: Mesh,
    pairs: Vec<Pair>,
}

impl Limit {
    pub(crate) fn new(triangles: &Triangles<'_>) -> Self {
        Self { mesh: Mesh::new(triangles), pairs: vec![Pair([0.0; 16]); triangles.indices.len()] }
    }
}

impl Contestant for Limit {
    fn pose(&mut self, positions: &[Vec3]) {
        self.mesh.pose(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        let triangles = self.mesh.triangles();
        let writes = self.pairs.par_iter_mut().zip(triangles.indices).with_min_len(8192);
        writes.for_each(|(pair, indices)| {
            let [a, b, c] = indices.map(|v| triangles.positions[v as usize]);
            let (min, max) = (a.min(b).min(c), a.max(b).max(c));
            let node = [min.x, min.y, min.z, 0.0, max.x, max.y, max.z, 0.0];
            *pair = Pair(std::array::from_fn(|i| node[i % 8]));
        });
        std::hint::black_box(&self.pairs);
        Ok(())
    }

    /// Nothing is hit: there is no tree.
    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        (0..rays.len()).for_each(|i| hits.set(i, None));
    }

    fn occluded(&self, _rays: &Rays, blocked: &mut [bool; RAYS]) {
        blocked.fill(false);
    }

    fn triangles(&self) -> Triangles<'_> {
        self.mesh.triangles()
    }
}
