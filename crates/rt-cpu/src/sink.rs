//! What is made of a traced tile: colours, hits as they are, or a picture of the work.

use bvh_core::prefetch;
use fearless_simd::{Simd, f32x4};

use crate::Pixel;
use crate::bundle::{Hits, RAYS};
use crate::cast::{Frame, TILE, Tile};
use crate::options::RenderStats;
use crate::shade::Shader;
use crate::simd::load;
use crate::wide::WideTest;

/// The pixels of a rectangle; rows below the image are empty.
pub(crate) type Rows<'a, P> = [&'a mut [P]; TILE];

/// What is made of the pixels of a traced tile.
pub(crate) trait PixelSink: Sync {
    type Pixel: Send;

    /// `corner` is the tile's upper left pixel.
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        corner: (u32, u32),
        rows: &mut Rows<'_, Self::Pixel>,
        stats: &mut RenderStats,
    );
}

impl PixelSink for Shader<'_> {
    type Pixel = [f32; 3];

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, [f32; 3]>,
        _: &mut RenderStats,
    ) {
        self.shade(simd, &tile.seen, &tile.hits, &tile.surfaces, &tile.lit, &mut tile.colors);
        let [r, g, b] = &tile.colors;
        for (i, &[x, y]) in tile.at[..tile.seen.count].iter().enumerate() {
            rows[y as usize][x as usize] = [r[i], g[i], b[i]];
        }
    }
}

/// Gives hits as they are.
pub(crate) struct Caster;

impl PixelSink for Caster {
    type Pixel = Pixel;

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        simd: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, Pixel>,
        _: &mut RenderStats,
    ) {
        let Hits { t, u, v, primitive } = &tile.hits;
        // Numbers of primitives with the bit for light.
        let mut words = [0.0; RAYS];
        for (word, (&p, &lit)) in words.iter_mut().zip(primitive.iter().zip(&tile.lit)) {
            *word = Pixel::word(p, p != Hits::NONE && lit > 0.0);
        }
        for (y, rays) in tile.ray.chunks_exact(TILE).take(tile.size.1).enumerate() {
            // Rows of the image are far apart: the processor does not foresee the next.
            if let Some(later) = rows.get(y + 2) {
                (0..later.len()).step_by(4).for_each(|x| prefetch(later, x));
            }
            let row = &mut rows[y];
            if row.len() == TILE {
                // Rays of four neighbours are neighbours.
                let row: &mut [f32] = bytemuck::cast_slice_mut(row);
                for (four, rays) in row.as_chunks_mut().0.iter_mut().zip(rays.chunks_exact(4)) {
                    let first = rays[0] as usize;
                    let lanes = [
                        load::<S, f32x4<S>, RAYS>(simd, t, first),
                        load(simd, u, first),
                        load(simd, v, first),
                        load(simd, &words, first),
                    ];
                    simd.store_four_interleaved_f32x4(lanes, four);
                }
            } else {
                for (to, &ray) in row.iter_mut().zip(rays) {
                    let i = ray as usize;
                    *to = Pixel::packed([t[i], u[i], v[i]], words[i]);
                }
            }
        }
    }
}

/// Shows the number of nodes.
pub(crate) struct Heat {
    pub(crate) most: u32,
}

impl PixelSink for Heat {
    type Pixel = [f32; 3];

    #[inline(always)]
    fn finish<S: Simd, T: WideTest>(
        &self,
        _: S,
        _: &Frame<'_>,
        tile: &mut Tile,
        _: (u32, u32),
        rows: &mut Rows<'_, [f32; 3]>,
        _: &mut RenderStats,
    ) {
        for (i, &[x, y]) in tile.at[..tile.seen.count].iter().enumerate() {
            rows[y as usize][x as usize] = heat(tile.nodes[i] as f32 / self.most.max(1) as f32);
        }
    }
}

/// Colour of a number from 0 to 1.
fn heat(x: f32) -> [f32; 3] {
    const RAMP: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.0], [0.05, 0.05, 0.6], [0.8, 0.05, 0.05], [1.0, 0.8, 0.05], [1.0, 1.0, 1.0]];
    let at = x.clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let i = (at as usize).min(RAMP.len() - 2);
    let f = at - i as f32;
    std::array::from_fn(|c| RAMP[i][c] + (RAMP[i + 1][c] - RAMP[i][c]) * f)
}
