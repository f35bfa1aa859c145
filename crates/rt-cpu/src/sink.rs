//! What is made of a traced tile: colours, hits as they are, or a picture of the work.

use bvh_core::{Vec3, prefetch};
use fearless_simd::{Simd, f32x4};

use crate::Pixel;
use crate::cast::{Frame, TILE, Tile};
use crate::shade::Shader;
use crate::simd::{load, vectorize};
use crate::times::Tally;
use crate::wave::{RAYS, Wave, set};
use crate::wavefront::Wavefront;
use crate::wide::WideTest;

/// How the pixels of a frame look.
pub(crate) enum Look<'a> {
    /// Nobody looks: hits are wanted as they are.
    Hits,
    /// As the number of nodes visited; from `most` on, white.
    Nodes { most: u32 },
    /// In the light of the light alone, with textures.
    Direct(Shader<'a>),
    /// With further effects.
    Effects(Wavefront<'a>),
}

impl Look<'_> {
    /// Finds the colours of a traced tile.
    #[inline(never)]
    pub(crate) fn color<S: Simd, T: WideTest>(
        &self,
        simd: S,
        frame: &Frame<'_>,
        tile: &mut Tile,
        tally: &mut Tally,
    ) {
        // Each in a function of its own: together they leave too little to inlining.
        match self {
            Self::Hits => {}
            &Self::Nodes { most } => heat_map(tile, most),
            Self::Direct(shader) => vectorize!(simd, {
                tile.appearance.open[..tile.seen.count].fill(1.0);
                shader.find_appearance(tile, tally);
                shader.shade(simd, tile);
            }),
            Self::Effects(effects) => vectorize!(simd, effects.follow::<S, T>(simd, frame, tile, tally)),
        }
    }
}

/// The pixels of a rectangle; rows below the image are empty.
pub(crate) type Rows<'a, P> = [&'a mut [P]; TILE];

/// What an image is made of.
pub(crate) trait TilePixel: Send + Sized {
    /// Writes the pixels of a tile.
    fn write<S: Simd>(simd: S, tile: &Tile, rows: &mut Rows<'_, Self>);
}

impl TilePixel for [f32; 3] {
    #[inline(always)]
    fn write<S: Simd>(_: S, tile: &Tile, rows: &mut Rows<'_, Self>) {
        let [r, g, b] = &tile.colors;
        for (row, rays) in rows.iter_mut().zip(tile.ray.chunks_exact(TILE)) {
            for (pixel, &ray) in row.iter_mut().zip(rays) {
                let i = ray as usize % RAYS;
                *pixel = [r[i], g[i], b[i]];
            }
        }
    }
}

impl TilePixel for Pixel {
    #[inline(always)]
    fn write<S: Simd>(simd: S, tile: &Tile, rows: &mut Rows<'_, Self>) {
        let Wave { t, u, v, primitive, .. } = &tile.seen;
        // Numbers of primitives with the bit for light.
        let mut words = [0.0; RAYS];
        for (word, (&p, &lit)) in words.iter_mut().zip(primitive.iter().zip(&tile.lit)) {
            *word = Self::word(p, p != Wave::NO_HIT && lit > 0.0);
        }
        for (y, rays) in tile.ray.chunks_exact(TILE).take(tile.size.1).enumerate() {
            // Rows of the image are far apart: the processor does not foresee the next.
            if let Some(later) = rows.get(y + 2) {
                (0..later.len()).step_by(4).for_each(|x| prefetch(later, x));
            }
            let row = &mut rows[y];
            let whole = row.len() / 4 * 4;
            // Rays of four neighbours are neighbours.
            let fours: &mut [f32] = bytemuck::cast_slice_mut(&mut row[..whole]);
            for (four, rays) in fours.as_chunks_mut().0.iter_mut().zip(rays.chunks_exact(4)) {
                let first = rays[0] as usize;
                let lanes = [
                    load::<S, f32x4<S>, RAYS>(simd, t, first),
                    load(simd, u, first),
                    load(simd, v, first),
                    load(simd, &words, first),
                ];
                simd.store_four_interleaved_f32x4(lanes, four);
            }
            for (to, &ray) in row.iter_mut().zip(rays).skip(whole) {
                let i = ray as usize;
                *to = Self::packed([t[i], u[i], v[i]], words[i]);
            }
        }
    }
}

/// Colours by the number of nodes that each ray and its shadow ray visited.
fn heat_map(tile: &mut Tile, most: u32) {
    let Tile { seen, shadow, whose, colors, .. } = tile;
    for (&nodes, &i) in shadow.nodes[..shadow.count].iter().zip(&*whose) {
        seen.nodes[i as usize] += nodes;
    }
    for (i, &nodes) in seen.nodes[..seen.count].iter().enumerate() {
        set(colors, i, heat(nodes as f32 / most.max(1) as f32));
    }
}

/// Colour of a number from 0 to 1.
fn heat(x: f32) -> Vec3 {
    const RAMP: [Vec3; 5] = [
        Vec3::ZERO,
        Vec3::new(0.05, 0.05, 0.6),
        Vec3::new(0.8, 0.05, 0.05),
        Vec3::new(1.0, 0.8, 0.05),
        Vec3::ONE,
    ];
    let at = x.clamp(0.0, 1.0) * (RAMP.len() - 1) as f32;
    let i = (at as usize).min(RAMP.len() - 2);
    RAMP[i] + (RAMP[i + 1] - RAMP[i]) * (at - i as f32)
}
