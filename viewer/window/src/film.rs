//! Pictures and films in files.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use color_quant::NeuQuant;
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use viewer_core::{Canvas, Event, Key, Settings, State};

use crate::load::Pace;
use crate::{Args, CLOCK, load};

/// Draws frames without a window.
pub(crate) fn draw(args: &Args, settings: Settings, out: &Path) -> Result<()> {
    let extension = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    // Before anything long begins.
    let folder = if extension.is_some() { out.parent().unwrap_or(out) } else { out };
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made a folder", folder.display()))?;
    let mut state = State::new(args.size.0, args.size.1, vec![args.scene.clone()], CLOCK);
    let pace = Pace::new();
    let mut ready =
        load::ready(&args.scene, args.clip.as_deref(), &|part| pace.at("simulating", part.into()))?;
    let fresh = ready.take_fresh_costs();
    state.apply(Event::Settings(settings));
    state.apply(Event::Scene(Box::new(ready)));
    fresh.into_iter().flatten().for_each(|(frame, cost)| state.apply(Event::Fresh(frame, cost)));
    let count = state.frame().map_or(1, |(_, count)| count);
    let wanted =
        args.frames.clone().unwrap_or(if extension.as_deref() == Some("gif") { 0..count } else { 0..1 });
    ensure!(wanted.end <= count, "no frame {}; the frames are 0 to {}", wanted.end - 1, count - 1);
    let mut film = match extension.as_deref() {
        Some("gif") => Film::Gif(out.to_owned(), Vec::new()),
        Some("png") if wanted.len() > 1 => {
            bail!("{}: frames need a folder or a .gif to go to", out.display())
        }
        Some("png") => Film::File(out.to_owned()),
        Some(other) => bail!("cannot write .{other}; a picture is .png or .gif, or name a folder"),
        None => Film::Folder(out.to_owned(), 0),
    };
    // Plays by hand, one frame at a time.
    state.apply(Event::Key(Key::Char(' '), true));
    let pace = Pace::new();
    for frame in 0..wanted.end {
        pace.at("drawing", frame as f64 / wanted.end as f64);
        if frame > 0 {
            state.apply(Event::Key(Key::Right, true));
        }
        // Trees of every frame, pictures of those that are wanted.
        let is_drawn = wanted.contains(&frame) && (frame - wanted.start).is_multiple_of(args.every as usize);
        if !is_drawn {
            continue;
        }
        loop {
            let canvas = state.draw().clone();
            if state.is_at_rest() {
                film.push_as(&canvas, frame)?;
                break;
            }
        }
    }
    println!("{}", anim::printable(&film.finish()?.display().to_string()));
    Ok(())
}

/// Where pictures go, one after another.
pub(crate) enum Film {
    File(PathBuf),
    /// A folder, and the number of the next picture.
    Folder(PathBuf, usize),
    /// A file, and the pictures for it.
    Gif(PathBuf, Vec<Canvas>),
}

impl Film {
    /// A folder for pictures, made if it does not exist.
    pub(crate) fn folder(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).with_context(|| format!("{}: cannot be made a folder", path.display()))?;
        Ok(Self::Folder(path.to_owned(), 0))
    }

    /// Adds a picture, in a folder with the number after the last one's.
    pub(crate) fn push(&mut self, canvas: &Canvas) -> Result<()> {
        let number = if let Self::Folder(_, next) = *self { next } else { 0 };
        self.push_as(canvas, number)
    }

    /// Adds a picture, in a folder with this number.
    fn push_as(&mut self, canvas: &Canvas, number: usize) -> Result<()> {
        match self {
            Self::File(path) => save(canvas, path),
            Self::Folder(path, next) => {
                *next = number + 1;
                save(canvas, &path.join(format!("frame-{number:04}.png")))
            }
            Self::Gif(_, frames) => {
                frames.push(canvas.clone());
                Ok(())
            }
        }
    }

    /// Completes the film and says where it is.
    pub(crate) fn finish(self) -> Result<PathBuf> {
        let (path, frames) = match self {
            Self::File(path) | Self::Folder(path, _) => return Ok(path),
            Self::Gif(path, frames) => (path, frames),
        };
        let bytes = encode(&frames).with_context(|| format!("{}: no film", path.display()))?;
        fs::write(&path, bytes).with_context(|| format!("{}: cannot be written", path.display()))?;
        Ok(path)
    }
}

/// Writes a PNG file.
pub(crate) fn save(canvas: &Canvas, path: &Path) -> Result<()> {
    let rgb = canvas.rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    let picture =
        image::RgbImage::from_raw(canvas.width, canvas.height, rgb).context("a picture of no size")?;
    picture.save(path).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Colours of a film. Fewer make it smaller.
const COLORS: usize = 128;
/// Hundredths of a second that a frame is shown.
const DELAY: u16 = 8;
/// One pixel in this number is among those that the colours are chosen from.
const SPARSE: usize = 7;

/// Encodes pictures of one size as a GIF with one palette. Pixels that stay as they are are left
/// out, which makes it several times smaller.
fn encode(frames: &[Canvas]) -> Result<Vec<u8>> {
    let first = frames.first().context("no frames")?;
    let size = |pixels: u32| u16::try_from(pixels).context("too large for a GIF");
    let (width, height) = (size(first.width)?, size(first.height)?);
    let sparse: Vec<u8> = frames
        .iter()
        .step_by(frames.len().div_ceil(8))
        .flat_map(|f| f.rgba.chunks_exact(4).step_by(SPARSE))
        .flatten()
        .copied()
        .collect();
    let palette = NeuQuant::new(1, COLORS, &sparse);
    let clear = COLORS as u8;
    let mut colors = palette.color_map_rgb();
    colors.extend([0; 3]);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height, &colors)?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut shown = vec![clear; first.rgba.len() / 4];
    for frame in frames {
        ensure!((frame.width, frame.height) == (first.width, first.height), "pictures of one size");
        let index = |pixel: &[u8]| palette.index_of(pixel) as u8;
        let now: Vec<u8> = frame.rgba.chunks_exact(4).map(index).collect();
        let pixels: Vec<u8> =
            now.iter().zip(&shown).map(|(&now, &was)| if now == was { clear } else { now }).collect();
        let frame = Frame {
            width,
            height,
            delay: DELAY,
            dispose: DisposalMethod::Keep,
            transparent: Some(clear),
            buffer: pixels.into(),
            ..Frame::default()
        };
        encoder.write_frame(&frame)?;
        shown = now;
    }
    drop(encoder);
    Ok(bytes)
}
