//! `cargo xtask contact-sheet`: five frames of each scene in one picture.

use std::io::Cursor;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use bvh_build::{Builder, build};
use font8x8::UnicodeFonts;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, replace, resize};
use image::{Rgb, RgbImage};

use crate::progress::Progress;
use crate::reproduce::picture;
use crate::stage::{self, Stage};
use crate::{files, interrupt, pool};

/// Frames of each scene, evenly spread from the first to the last.
const COLUMNS: u32 = 5;
/// Pixels on a side of each picture, of the gap between two, and of the line above a scene's.
const SIDE: u32 = 200;
const GAP: u32 = 4;
const LINE: u32 = 16;
const QUALITY: u8 = 80;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// The JPEG file to write; the pictures themselves go to target/contact-sheet
    #[arg(long, value_name = "FILE.jpg", default_value = "docs/scenes.jpg")]
    out: PathBuf,
    /// Threads for building and rendering [default: 8, or the cores there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let extension = args.out.extension().unwrap_or_default().to_ascii_lowercase();
    ensure!(extension == "jpg" || extension == "jpeg", "{}: a contact sheet is a .jpg", args.out.display());
    let pool = pool::pool(args.threads.map_or_else(pool::default_threads, |n| n as usize))?;
    let scenes = scenes::list();
    let (width, height) = (COLUMNS * (SIDE + GAP) + GAP, scenes.len() as u32 * (LINE + SIDE + GAP));
    let mut sheet = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    for (row, info) in (0..).zip(scenes) {
        if interrupt::requested() {
            return Ok(());
        }
        let top = row * (LINE + SIDE + GAP);
        pool.install(|| frames(&mut sheet, top, info.name))?;
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&sheet)?;
    files::write_whole(&args.out, &jpeg)?;
    files::print(&files::shown(&args.out))
}

/// Renders a scene's frames into its row of the sheet.
fn frames(sheet: &mut RgbImage, top: u32, name: &str) -> Result<()> {
    let folder = files::workspace().join("target/contact-sheet");
    files::make_folder(&folder)?;
    let mut stage = Stage::new(stage::load(name, None, 0)?)?;
    let last = stage.scene.frames - 1;
    let progress = Progress::new(format!("rendering {name}"), COLUMNS.into());
    for column in 0..COLUMNS {
        let frame = last * column as usize / (COLUMNS as usize - 1);
        stage.pose(stage.time_of(frame, last + 1));
        let tree =
            build(&stage.triangles(), Builder::BinnedParallel).with_context(|| format!("{name}: no tree"))?;
        // Rendered twice as large: the mean of four pixels has smoother edges.
        let png = picture(&mut stage, &tree, 2 * SIDE, &folder.join(format!("{name}-{frame:04}.png")))?;
        let small = resize(
            &image::ImageReader::new(Cursor::new(png)).with_guessed_format()?.decode()?.into_rgb8(),
            SIDE,
            SIDE,
            FilterType::Triangle,
        );
        let left = GAP + column * (SIDE + GAP);
        replace(sheet, &small, left.into(), (top + LINE).into());
        let label = if column == 0 { format!("{name}, frame {frame}") } else { format!("frame {frame}") };
        write(sheet, left, top + 4, &label);
        progress.at(u64::from(column) + 1);
    }
    Ok(())
}

/// Writes text in letters of 8 by 8 pixels.
fn write(sheet: &mut RgbImage, left: u32, top: u32, text: &str) {
    for (at, letter) in (left..).step_by(8).zip(text.chars()) {
        let rows = font8x8::BASIC_FONTS.get(letter).unwrap_or_default();
        for (y, row) in (top..).zip(rows) {
            for x in (0..8).filter(|x| row >> x & 1 == 1) {
                if let Some(pixel) = sheet.get_pixel_mut_checked(at + x, y) {
                    *pixel = Rgb([40; 3]);
                }
            }
        }
    }
}
