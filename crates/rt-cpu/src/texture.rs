//! Images on surfaces.

use std::sync::{Arc, LazyLock};

use bvh_core::glam::Vec2;

/// What continues an image beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    #[default]
    Repeat,
    /// The image, mirrored every other time.
    MirroredRepeat,
    /// The texels at the edge.
    ClampToEdge,
}

/// How a colour between texels is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The nearest texel's.
    Nearest,
    /// A bilinear blend of the nearest four, in linear colours.
    #[default]
    Linear,
}

/// An image and how it is continued between and beyond its texels. There are no smaller versions of
/// it: what is far away flickers unless pixels get many samples.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Red, green and blue in sRGB, and linear opacity, in rows from the top, each row from the
    /// left. With fewer than `width * height`, or none, the texture is white.
    pub texels: Arc<[[u8; 4]]>,
    /// Texels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Continuation to the left and right, and above and below.
    pub wrap: [Wrap; 2],
    /// What is seen between texels.
    pub filter: Filter,
}

impl Texture {
    /// Returns linear red, green and blue, and opacity, each 0 to 1, at a point: (0, 0) is the
    /// upper left corner of the image, (1, 1) the lower right one. Coordinates that are not finite
    /// count as 0.
    #[must_use]
    pub fn sample(&self, at: Vec2) -> [f32; 4] {
        let (width, height) = (self.width as usize, self.height as usize);
        let enough = width.checked_mul(height).is_some_and(|n| n > 0 && n <= self.texels.len());
        if !enough {
            return [1.0; 4];
        }
        let texel = |x: i64, y: i64| {
            let (x, y) = (wrapped(x, width, self.wrap[0]), wrapped(y, height, self.wrap[1]));
            linear(self.texels[y * width + x])
        };
        let place = |u: f32, n: usize| if u.is_finite() { f64::from(u) * n as f64 } else { 0.0 };
        let (x, y) = (place(at.x, width), place(at.y, height));
        if self.filter == Filter::Nearest {
            return texel(x.floor() as i64, y.floor() as i64);
        }
        // Centres of texels are at halves.
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (fx, fy) = ((x - 0.5 - left) as f32, (y - 0.5 - top) as f32);
        let (left, top) = (left as i64, top as i64);
        let (right, below) = (left.saturating_add(1), top.saturating_add(1));
        let (a, b, c, d) = (texel(left, top), texel(right, top), texel(left, below), texel(right, below));
        let mix = |a: f32, b: f32, f: f32| a * (1.0 - f) + b * f;
        std::array::from_fn(|k| mix(mix(a[k], b[k], fx), mix(c[k], d[k], fx), fy))
    }
}

/// The texel of a row of `n` that stands at `i`.
fn wrapped(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    let i = match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::MirroredRepeat => {
            let i = i.rem_euclid(2 * n);
            i.min(2 * n - 1 - i)
        }
        Wrap::ClampToEdge => i.clamp(0, n - 1),
    };
    i as usize
}

fn linear([r, g, b, a]: [u8; 4]) -> [f32; 4] {
    let [r, g, b] = [r, g, b].map(|c| FROM_SRGB[usize::from(c)]);
    [r, g, b, f32::from(a) / 255.0]
}

/// Linear values of 8-bit sRGB (IEC 61966-2-1).
static FROM_SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let c = byte as f64 / 255.0;
        (if c <= 0.04045 { c / 12.92 } else { libm::pow((c + 0.055) / 1.055, 2.4) }) as f32
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_srgb() {
        for (i, &found) in FROM_SRGB.iter().enumerate() {
            let c = i as f64 / 255.0;
            let expected = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(found) - expected).abs() < 1e-7, "{i}: {found}, {expected}");
        }
    }

    /// The texture's value by definition, in double precision: a sum over texel centres near the
    /// point of tents of width 1, over a plane that is tiled explicitly.
    fn reference(texture: &Texture, u: f64, v: f64) -> [f64; 4] {
        let size = [f64::from(texture.width), f64::from(texture.height)];
        let at = [u * size[0], v * size[1]];
        let fold = |i: f64, n: f64, wrap: Wrap| match wrap {
            Wrap::Repeat => i - n * (i / n).floor(),
            Wrap::MirroredRepeat => {
                let period = (i / n).floor();
                let inside = i - n * period;
                if period % 2.0 == 0.0 { inside } else { n - 1.0 - inside }
            }
            Wrap::ClampToEdge => i.max(0.0).min(n - 1.0),
        };
        let mut sum = [0.0; 4];
        for dy in -2..=2 {
            for dx in -2..=2 {
                let cell = [at[0].floor() + f64::from(dx), at[1].floor() + f64::from(dy)];
                let weight = |k: usize| match texture.filter {
                    Filter::Linear => (1.0 - (at[k] - (cell[k] + 0.5)).abs()).max(0.0),
                    Filter::Nearest => f64::from(u8::from(cell[k] == at[k].floor())),
                };
                let x = fold(cell[0], size[0], texture.wrap[0]);
                let y = fold(cell[1], size[1], texture.wrap[1]);
                let texel = linear(texture.texels[(y * size[0] + x) as usize]);
                for k in 0..4 {
                    sum[k] += weight(0) * weight(1) * f64::from(texel[k]);
                }
            }
        }
        sum
    }

    #[test]
    fn lookups_agree_with_their_definition() {
        let texels: Arc<[[u8; 4]]> = (0..15u8).map(|i| [i * 17, 255 - i * 9, i * i, 40 + i * 14]).collect();
        let modes = [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge];
        for wrap in modes.iter().flat_map(|&u| modes.map(|v| [u, v])) {
            for filter in [Filter::Nearest, Filter::Linear] {
                let texture = Texture { texels: Arc::clone(&texels), width: 5, height: 3, wrap, filter };
                for i in -60..=60 {
                    for j in -60..=60 {
                        let at = Vec2::new(i as f32 * 0.0737, j as f32 * 0.0911);
                        let found = texture.sample(at);
                        let expected = reference(&texture, f64::from(at.x), f64::from(at.y));
                        for k in 0..4 {
                            let error = (f64::from(found[k]) - expected[k]).abs();
                            assert!(error < 1e-5, "{wrap:?} {filter:?} {at}: {found:?}, {expected:?}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn odd_input_has_a_colour() {
        let texels = Arc::new([[255, 0, 0, 255], [0, 255, 0, 0]]);
        let texture =
            Texture { texels, width: 2, height: 1, wrap: [Wrap::Repeat; 2], filter: Filter::Linear };
        for at in [Vec2::NAN, Vec2::INFINITY, Vec2::splat(f32::MAX), Vec2::splat(-f32::MAX)] {
            assert!(texture.sample(at).iter().all(|c| (0.0..=1.0).contains(c)), "{at}");
        }
        for (width, height) in [(0, 0), (0, 3), (2, 2), (u32::MAX, u32::MAX)] {
            assert_eq!(Texture { width, height, ..texture.clone() }.sample(Vec2::ZERO), [1.0; 4]);
        }
    }
}
