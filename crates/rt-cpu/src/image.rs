//! Images in memory, and their encodings as PNG (sRGB) and EXR (linear). The caller writes the
//! files: one that appears whole or not at all needs `tempfile`, which no renderer should have to
//! depend on.

use std::io::Cursor;

use image::{ExtendedColorType, ImageFormat, write_buffer_with_format};

/// Linear colours (red, green, blue) in rows from the top, each row from the left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

/// An image that cannot be encoded: without pixels, or too large for the format.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct ImageError(#[from] image::ImageError);

impl Image {
    /// Makes a black image.
    ///
    /// # Panics
    /// If its pixels, of 12 bytes each, take more bytes than `isize` can count.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 3]; (width as usize).saturating_mul(height as usize)] }
    }

    /// Pixels from left to right.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels from top to bottom.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns all pixels.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Returns all pixels, to be written.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.pixels
    }

    /// Adds another image, pixel by pixel.
    ///
    /// # Panics
    /// If it is not of the same size.
    pub fn add(&mut self, other: &Self) {
        assert_eq!((self.width, self.height), (other.width, other.height), "images of the same size");
        for (a, b) in self.pixels.iter_mut().flatten().zip(other.pixels.iter().flatten()) {
            *a += b;
        }
    }

    /// Multiplies all colours by `factor`: the mean of n images that were added is their sum scaled
    /// by 1 / n.
    pub fn scale(&mut self, factor: f32) {
        self.pixels.iter_mut().flatten().for_each(|c| *c *= factor);
    }

    /// Encodes it as a PNG file, 8 bits a channel in sRGB; values outside 0 to 1 are clamped, NaN
    /// becomes 0.
    ///
    /// # Errors
    /// If PNG files cannot be of its size.
    pub fn png(&self) -> Result<Vec<u8>, ImageError> {
        let bytes: Vec<u8> = self.pixels.iter().flatten().map(|&c| srgb(c)).collect();
        self.encoded(&bytes, ExtendedColorType::Rgb8, ImageFormat::Png)
    }

    /// Encodes it as an OpenEXR file, linear, 32 bits a channel.
    ///
    /// # Errors
    /// If EXR files cannot be of its size.
    pub fn exr(&self) -> Result<Vec<u8>, ImageError> {
        let bytes = bytemuck::cast_slice(&self.pixels);
        self.encoded(bytes, ExtendedColorType::Rgb32F, ImageFormat::OpenExr)
    }

    fn encoded(
        &self,
        bytes: &[u8],
        color: ExtendedColorType,
        format: ImageFormat,
    ) -> Result<Vec<u8>, ImageError> {
        if self.pixels.is_empty() {
            // The EXR encoder would write a file that is none.
            return Err(image::ImageError::from(std::io::Error::other("no pixels")).into());
        }
        let mut file = Cursor::new(Vec::new());
        write_buffer_with_format(&mut file, bytes, self.width, self.height, color, format)?;
        Ok(file.into_inner())
    }
}

/// Encodes one channel from linear to 8-bit sRGB (IEC 61966-2-1); what is below 0 or NaN becomes 0,
/// above 1 255.
#[must_use]
pub fn srgb(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::powf(c, 1.0 / 2.4) - 0.055 };
    // A NaN casts to 0.
    (encoded * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_hold_what_the_image_holds() {
        let mut image = Image::new(5, 3);
        for (i, p) in image.pixels_mut().iter_mut().enumerate() {
            *p = [i as f32 / 14.0, 0.5, f32::NAN];
        }
        let (png, exr) = (image.png().expect("encoded"), image.exr().expect("encoded"));

        let back = image::load_from_memory_with_format(&png, ImageFormat::Png).expect("a PNG").into_rgb8();
        assert_eq!((back.width(), back.height()), (5, 3));
        assert_eq!(back.get_pixel(0, 0).0, [0, 188, 0]);
        assert_eq!(back.get_pixel(4, 2).0, [255, 188, 0]);

        let back = image::load_from_memory_with_format(&exr, ImageFormat::OpenExr).expect("an EXR file");
        let bits = |channels: &[f32]| channels.iter().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(back.as_rgb32f().expect("colours")), bits(image.pixels().as_flattened()));
    }

    #[test]
    #[should_panic = "images of the same size"]
    fn an_image_of_another_size_is_not_added() {
        Image::new(5, 3).add(&Image::new(3, 5));
    }

    #[test]
    fn images_without_pixels_are_no_files() {
        for image in [Image::new(0, 3), Image::new(3, 0), Image::new(0, 0)] {
            assert!(image.png().is_err() && image.exr().is_err());
        }
    }
}
