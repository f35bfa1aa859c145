//! From a solid to triangles: surface nets on a grid, then every vertex moved onto the surface.

use fast_surface_nets::ndshape::RuntimeShape;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::Vec3;
use rayon::prelude::*;

use crate::implicit::Solid;
use crate::shape::Mesh;

/// Edge of the blocks, in cells, that share the part of a solid near to them.
const BLOCK: usize = 8;

/// Meshes the part of a solid inside of a box, with cubic cells of the given edge.
///
/// The solid must not reach the faces of the box.
pub(crate) fn mesh(solid: &Solid, low: Vec3, high: Vec3, cell: f32) -> Mesh {
    let size = ((high - low) / cell).ceil().as_uvec3() + 2;
    let [nx, ny, nz] = size.to_array().map(|n| n as usize);
    let [bx, by, bz] = [nx, ny, nz].map(|n| n.div_ceil(BLOCK));
    // Of each block beside the surface the part of the solid that matters to it, and the part that
    // matters up to two cells around it, where vertices are looked for.
    let near = |block: usize| {
        let block = Vec3::new((block % bx) as f32, (block / bx % by) as f32, (block / bx / by) as f32);
        let center = low + cell * (BLOCK as f32 * (block + 0.5));
        let reach = 0.5 * BLOCK as f32 * cell * 3.0_f32.sqrt();
        let is_near = solid.distance(center).abs() <= 2.0 * reach + cell;
        is_near.then(|| [reach, reach + 2.0 * cell].map(|radius| solid.near(center, radius)))
    };
    let blocks: Vec<Option<[Solid; 2]>> = (0..bx * by * bz).into_par_iter().map(near).collect();
    let mut samples = vec![0.0_f32; nx * ny * nz];
    samples.par_chunks_mut(BLOCK * nx * ny).enumerate().for_each(|(slab, samples)| {
        let size = [nx, ny, samples.len() / (nx * ny)];
        let mut grid = Grid { size, first: slab * BLOCK, low, cell, samples };
        for (i, near) in blocks[slab * bx * by..][..bx * by].iter().enumerate() {
            let near = near.as_ref().map_or(solid, |[within, _]| within);
            grid.sample(near, [i % bx * BLOCK, i / bx * BLOCK, 0], BLOCK);
        }
    });
    let mut nets = SurfaceNetsBuffer::default();
    let shape = RuntimeShape::<u32, 3>::new(size.to_array());
    surface_nets(&samples, &shape, [0; 3], (size - 1).to_array(), &mut nets);
    let onto_surface = |&vertex: &[f32; 3]| {
        let [x, y, z] = vertex.map(|x| x as usize / BLOCK);
        let near = blocks[(z * by + y) * bx + x].as_ref().map_or(solid, |[_, around]| around);
        let project = |p: Vec3| {
            let step = near.distance(p).clamp(-0.5 * cell, 0.5 * cell);
            p - near.normal(p, 0.25 * cell) * step
        };
        project(project(low + cell * Vec3::from(vertex)))
    };
    Mesh {
        positions: nets.positions.par_iter().map(onto_surface).collect(),
        triangles: nets.indices.as_chunks::<3>().0.to_vec(),
    }
}

/// Samples of distances, row after row.
struct Grid<'a> {
    size: [usize; 3],
    /// The first layer is this one above `low`.
    first: usize,
    low: Vec3,
    cell: f32,
    samples: &'a mut [f32],
}

impl Grid<'_> {
    /// Samples a cube of `edge` cells, [`BLOCK`] or a part of that.
    ///
    /// Nets take the sign of a sample, and its value only beside the surface. So a cube far from
    /// the surface takes the distance at its centre: one that is more than twice the way to a
    /// corner and a cell besides, since distances are bounds.
    fn sample(&mut self, solid: &Solid, [x, y, z]: [usize; 3], edge: usize) {
        let ([nx, ny, nz], cell) = (self.size, self.cell);
        if x >= nx || y >= ny || z >= nz {
            return;
        }
        let corner = self.low + cell * Vec3::new(x as f32, y as f32, (self.first + z) as f32);
        if edge == 1 {
            self.samples[(z * ny + y) * nx + x] = solid.distance(corner);
            return;
        }
        let center = corner + Vec3::splat(0.5 * edge as f32 * cell);
        let (far, reach) = (solid.distance(center), 0.5 * edge as f32 * cell * 3.0_f32.sqrt());
        if far.abs() > 2.0 * reach + cell {
            for row in (z..nz.min(z + edge)).flat_map(|z| (y..ny.min(y + edge)).map(move |y| z * ny + y)) {
                self.samples[row * nx + x..row * nx + nx.min(x + edge)].fill(far);
            }
            return;
        }
        for octant in 0..8 {
            let [dx, dy, dz] = [octant & 1, octant >> 1 & 1, octant >> 2].map(|bit| bit * (edge / 2));
            self.sample(solid, [x + dx, y + dy, z + dz], edge / 2);
        }
    }
}
