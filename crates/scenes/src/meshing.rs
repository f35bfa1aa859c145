//! From a solid to triangles: surface nets on a grid, then every vertex moved onto the surface.

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::Vec3;
use rayon::prelude::*;

use crate::implicit::Solid;
use crate::shape::Mesh;

/// Meshes the part of a solid inside of a box, with cubic cells of the given edge.
///
/// The solid must not reach the faces of the box. Cells are sampled only near the surface: far away, a block of
/// cells takes the distance at its centre.
pub(crate) fn mesh(solid: &Solid, low: Vec3, high: Vec3, cell: f32) -> Mesh {
    const BLOCK: usize = 16;
    let size = ((high - low) / cell).ceil().as_uvec3() + 2;
    let [nx, ny, nz] = size.to_array().map(|n| n as usize);
    let mut samples = vec![0.0_f32; nx * ny * nz];
    let reach = 0.5 * BLOCK as f32 * cell * 3.0_f32.sqrt();
    samples.par_chunks_mut(BLOCK * nx * ny).enumerate().for_each(|(slab, samples)| {
        let depth = samples.len() / (nx * ny);
        for (y0, x0) in (0..ny).step_by(BLOCK).flat_map(|y| (0..nx).step_by(BLOCK).map(move |x| (y, x))) {
            let at = |x: usize, y: usize, z: usize| low + cell * Vec3::new(x as f32, y as f32, z as f32);
            let center = at(x0, y0, slab * BLOCK) + Vec3::splat(0.5 * BLOCK as f32 * cell);
            let far = solid.distance(center);
            let near = (far.abs() < 2.0 * reach).then(|| solid.near(center, reach));
            for z in 0..depth {
                for y in y0..(y0 + BLOCK).min(ny) {
                    for x in x0..(x0 + BLOCK).min(nx) {
                        samples[(z * ny + y) * nx + x] =
                            near.as_ref().map_or(far, |near| near.distance(at(x, y, slab * BLOCK + z)));
                    }
                }
            }
        }
    });
    let mut nets = SurfaceNetsBuffer::default();
    let shape = RuntimeShape::<u32, 3>::new(size.to_array());
    debug_assert_eq!(shape.as_array(), size.to_array());
    surface_nets(&samples, &shape, [0; 3], (size - 1).to_array(), &mut nets);
    let project = |p: Vec3| {
        let near = solid.near(p, 2.0 * cell);
        (0..3)
            .fold(p, |p, _| p - near.normal(p, 0.25 * cell) * near.distance(p).clamp(-0.5 * cell, 0.5 * cell))
    };
    Mesh {
        positions: nets.positions.par_iter().map(|&p| project(low + cell * Vec3::from(p))).collect(),
        triangles: nets.indices.as_chunks::<3>().0.to_vec(),
    }
}
