//! From a solid to triangles: surface nets on a grid, then every vertex moved onto the surface.

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::Vec3;
use rayon::prelude::*;

use crate::implicit::Solid;
use crate::shape::Mesh;

/// Meshes the part of a solid inside of a box, with cubic cells of the given edge.
///
/// The solid must not reach the faces of the box. Cells are sampled only near the surface: far
/// away, a block of cells takes the distance at its centre.
pub(crate) fn mesh(solid: &Solid, low: Vec3, high: Vec3, cell: f32) -> Mesh {
    const BLOCK: usize = 8;
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
    Mesh {
        positions: onto_surface(solid, &nets.positions, low, cell),
        triangles: nets.indices.as_chunks::<3>().0.to_vec(),
    }
}

/// Vertices of the nets, in cells from `low`, moved onto the surface along its normal.
fn onto_surface(solid: &Solid, vertices: &[[f32; 3]], low: Vec3, cell: f32) -> Vec<Vec3> {
    const BLOCK: f32 = 8.0;
    let mut positions: Vec<Vec3> = vertices.iter().map(|&p| low + cell * Vec3::from(p)).collect();
    // Vertices of a block share the part of the solid that matters to them.
    let block = |p: [f32; 3]| p.map(|x| (x / BLOCK) as u32);
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&v| (block(vertices[v as usize]), v));
    let groups: Vec<&[u32]> =
        order.chunk_by(|&v, &w| block(vertices[v as usize]) == block(vertices[w as usize])).collect();
    let moved: Vec<Vec<Vec3>> = groups
        .par_iter()
        .map(|group| {
            let corner = Vec3::from(block(vertices[group[0] as usize]).map(|b| b as f32)) * BLOCK;
            let center = low + cell * (corner + 0.5 * BLOCK);
            let near = solid.near(center, cell * (0.5 * BLOCK * 3.0_f32.sqrt() + 2.0));
            let project = |p: Vec3| {
                let step = near.distance(p).clamp(-0.5 * cell, 0.5 * cell);
                p - near.normal(p, 0.25 * cell) * step
            };
            group.iter().map(|&v| project(project(positions[v as usize]))).collect()
        })
        .collect();
    for (&v, p) in order.iter().zip(moved.into_iter().flatten()) {
        positions[v as usize] = p;
    }
    positions
}
