//! What is seen through a pixel.

use crate::Hit;

/// What a pixel's ray hits, and whether light arrives there, in 16 bytes.
#[repr(C, align(16))]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Pixel {
    t: f32,
    u: f32,
    v: f32,
    /// Bits 0-30 the number of the triangle, or [`NOTHING`]; bit 31 whether light arrives.
    primitive: u32,
}

const LIT: u32 = 1 << 31;
/// In place of a triangle's number; trees number fewer.
const NOTHING: u32 = LIT - 1;

impl Pixel {
    /// Makes a pixel with this hit, lit or not.
    #[must_use]
    #[inline]
    pub fn new(hit: Option<Hit>, is_lit: bool) -> Self {
        let Hit { t, u, v, primitive } = hit.unwrap_or(Hit { t: 0.0, u: 0.0, v: 0.0, primitive: NOTHING });
        Self::packed([t, u, v], Self::word(primitive, is_lit))
    }

    /// Returns a triangle's number, or any number beyond those for nothing, and whether light
    /// arrives.
    #[must_use]
    #[inline(always)]
    pub fn word(primitive: u32, is_lit: bool) -> f32 {
        f32::from_bits(primitive & NOTHING | u32::from(is_lit) << 31)
    }

    /// Returns a pixel of what it is packed from: `t`, `u` and `v` of a hit, and a
    /// [`word`](Self::word).
    #[must_use]
    #[inline(always)]
    pub fn packed([t, u, v]: [f32; 3], word: f32) -> Self {
        Self { t, u, v, primitive: word.to_bits() }
    }

    /// Returns what the ray through the pixel's centre hits.
    #[must_use]
    #[inline]
    pub fn hit(&self) -> Option<Hit> {
        let primitive = self.primitive & NOTHING;
        (primitive != NOTHING).then_some(Hit { t: self.t, u: self.u, v: self.v, primitive })
    }

    /// Returns whether light arrives there: false where nothing is hit, in shadow, and on surfaces
    /// that face away. True for every hit if there is no light or shadows are off.
    #[must_use]
    #[inline]
    pub fn is_lit(&self) -> bool {
        self.primitive & LIT != 0
    }

    /// Sets whether light arrives there.
    #[inline]
    pub fn set_lit(&mut self, is_lit: bool) {
        self.primitive = self.primitive & NOTHING | u32::from(is_lit) << 31;
    }
}

impl Default for Pixel {
    /// A pixel that sees nothing.
    fn default() -> Self {
        Self::new(None, false)
    }
}

impl PartialEq for Pixel {
    fn eq(&self, other: &Self) -> bool {
        self.hit() == other.hit() && self.is_lit() == other.is_lit()
    }
}
