//! Images in memory and in files.

use std::fs::File;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use exr::image::SpecificChannels;
use exr::image::write::WritableImage;
use exr::math::Vec2;
use thiserror::Error;

use crate::srgb::srgb;

/// Linear colours (red, green, blue) in rows from the top, each row from the left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

/// Why an image was not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// A file name that ends in neither `.png` nor `.exr`.
    #[error("{}: an image file's name must end in .png or .exr", .0.display())]
    UnknownFormat(PathBuf),
    /// Encoding or writing failed.
    #[error("{}: cannot write the image", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What went wrong.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl Image {
    /// A black image.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
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

    /// All pixels.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// All pixels, to be written.
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

    /// Multiplies all colours by `factor`: the mean of n images that were added is their sum scaled by 1 / n.
    pub fn scale(&mut self, factor: f32) {
        self.pixels.iter_mut().flatten().for_each(|c| *c *= factor);
    }

    /// Writes a PNG or an EXR file, as the name says; see [`save_png`](Self::save_png) and
    /// [`save_exr`](Self::save_exr).
    ///
    /// # Errors
    /// If the name ends in something else, or as those do.
    pub fn save(&self, path: &Path) -> Result<(), ImageError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "png" => self.save_png(path),
            "exr" => self.save_exr(path),
            _ => Err(ImageError::UnknownFormat(path.to_owned())),
        }
    }

    /// Writes a PNG file, 8 bits a channel in sRGB; values outside 0 to 1 are clamped, NaN becomes 0.
    ///
    /// The file appears under its name when it is complete, not before.
    ///
    /// # Errors
    /// If the file cannot be written; nothing is left behind then.
    pub fn save_png(&self, path: &Path) -> Result<(), ImageError> {
        atomically(path, |file| {
            let bytes = self.pixels.iter().flatten().map(|&c| srgb(c)).collect();
            let png = image::RgbImage::from_raw(self.width, self.height, bytes).ok_or("image too large")?;
            Ok(png.write_to(file, image::ImageFormat::Png)?)
        })
    }

    /// Writes an OpenEXR file, linear, 32 bits a channel; otherwise as [`save_png`](Self::save_png).
    ///
    /// # Errors
    /// If the file cannot be written; nothing is left behind then.
    pub fn save_exr(&self, path: &Path) -> Result<(), ImageError> {
        atomically(path, |file| {
            let (width, height) = (self.width as usize, self.height as usize);
            let channels =
                SpecificChannels::rgb(|Vec2(x, y)| <(f32, f32, f32)>::from(self.pixels[y * width + x]));
            Ok(exr::image::Image::from_channels((width, height), channels).write().to_buffered(file)?)
        })
    }
}

/// A hidden name beside `path` for a file that is not whole yet. It does not grow with the name of the file, which may be
/// as long as names can be.
fn partial(path: &Path) -> PathBuf {
    let mut hasher = DefaultHasher::new();
    path.file_name().hash(&mut hasher);
    path.with_file_name(format!(".{:016x}.{}.partial", hasher.finish(), std::process::id()))
}

/// Lets `write` fill a file beside `path` and renames that.
fn atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Box<dyn std::error::Error + Send + Sync>>,
) -> Result<(), ImageError> {
    let partial = partial(path);
    let fill = || {
        let mut file = BufWriter::new(File::create(&partial)?);
        write(&mut file)?;
        // The last bytes: dropping would write them too, but not say if it cannot. Some file systems say as late as
        // the sync that the disk is full.
        file.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
        Ok(std::fs::rename(&partial, path)?)
    };
    fill().map_err(|source| {
        // It may not even exist, and the first error is the one to tell.
        let _ = std::fs::remove_file(&partial);
        ImageError::Write { path: path.to_owned(), source }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Image {
        let mut image = Image::new(5, 3);
        for (i, p) in image.pixels_mut().iter_mut().enumerate() {
            *p = [i as f32 / 14.0, 0.5, f32::NAN];
        }
        image
    }

    #[test]
    fn files_hold_what_the_image_holds() {
        let dir = std::env::temp_dir().join(format!("rt-cpu-image-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("temporary directory");
        let (png, exr, image) = (dir.join("a.png"), dir.join("a.exr"), gradient());
        image.save(&png).expect("written");
        image.save(&exr).expect("written");

        let back = image::open(&png).expect("a PNG").into_rgb8();
        assert_eq!((back.width(), back.height()), (5, 3));
        assert_eq!(back.get_pixel(0, 0).0, [0, 188, 0]);
        assert_eq!(back.get_pixel(4, 2).0, [255, 188, 0]);

        let back = exr::prelude::read_first_rgba_layer_from_file(
            &exr,
            |size, _| vec![[0.0f32; 3]; size.area()],
            |pixels, at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * 5 + at.x()] = [r, g, b],
        )
        .expect("an EXR file");
        let bits = |p: &[[f32; 3]]| p.iter().flatten().map(|c| c.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back.layer_data.channel_data.pixels), bits(image.pixels()));

        assert_eq!(std::fs::read_dir(&dir).expect("readable").count(), 2, "nothing else is left");
        std::fs::remove_dir_all(&dir).expect("removable");
    }

    /// However little of a file is still to be written when the disk is full.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_leaves_nothing() {
        let dir = std::env::temp_dir().join(format!("rt-cpu-full-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("temporary directory");
        for name in ["a.png", "a.exr"] {
            std::os::unix::fs::symlink("/dev/full", partial(&dir.join(name))).expect("a link");
            let error = gradient().save(&dir.join(name)).expect_err("no space");
            let cause = std::error::Error::source(&error).expect("a cause").to_string();
            assert!(error.to_string().contains(name) && cause.contains("No space"), "{error}: {cause}");
        }
        std::fs::remove_dir(&dir).expect("nothing in it");
    }

    #[test]
    fn a_name_may_be_as_long_as_names_can_be() {
        let dir = std::env::temp_dir().join(format!("rt-cpu-long-{}", std::process::id()));
        std::fs::create_dir_all(&dir).expect("temporary directory");
        let long = dir.join("n".repeat(251) + ".png");
        gradient().save(&long).expect("written");
        std::fs::remove_file(&long).expect("a file");
        std::fs::remove_dir(&dir).expect("nothing else in it");
    }

    #[test]
    fn errors_name_the_file_and_leave_nothing() {
        let missing = std::env::temp_dir().join("rt-cpu-no-such-directory/a.png");
        let error = gradient().save(&missing).expect_err("no such directory").to_string();
        assert!(error.contains("rt-cpu-no-such-directory"), "{error}");
        let error = gradient().save(Path::new("a.bmp")).expect_err("unknown format").to_string();
        assert!(error.contains(".png or .exr"), "{error}");
    }
}
