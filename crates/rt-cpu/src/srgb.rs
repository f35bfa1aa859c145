//! Colours as 8-bit sRGB.

/// Encodes one channel from linear to 8-bit sRGB (IEC 61966-2-1); what is below 0 or NaN becomes 0,
/// above 1 255.
#[must_use]
pub fn srgb(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 };
    // A NaN casts to 0.
    (encoded * 255.0 + 0.5) as u8
}
