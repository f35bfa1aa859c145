//! Pictures of a frame: as it looks, and how many nodes its rays visit.

use std::path::Path;

use anyhow::Result;
use bvh_core::Bvh;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use rt_cpu::{Image, Output, RenderOptions, render};

use crate::files;
use crate::stage::Stage;

/// Strategies whose trees are shown as heat maps; the last is that of a fresh build.
pub(crate) const HEAT_MAPS: [&str; 4] = ["refit", "refit+rotate", "auto", "sweep"];

/// Nodes visited for a pixel that heat maps show white, over the mean of the first frame with its
/// fresh tree.
const HOTTEST: u64 = 24;

/// Makes a picture of the stage as it is, smooth, and gives the PNG file's bytes.
pub(crate) fn picture(stage: &mut Stage, tree: &Bvh, size: u32, path: &Path) -> Result<Vec<u8>> {
    stage.smooth();
    let mut image = Image::new(size, size);
    let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
    render(tree, &mesh, &camera, Some(&light), &stage.render_options(), &mut image);
    let png = image.png()?;
    files::write_whole(path, &png)?;
    Ok(png)
}

/// The number of nodes that heat maps of a scene show white.
pub(crate) fn hottest(stage: &Stage, size: u32) -> u32 {
    let pixels = u64::from(size) * u64::from(size);
    let (_, nodes) = nodes_visited(stage, &stage.first_tree, size, 1);
    (HOTTEST * nodes / pixels.max(1)).clamp(16, 100_000) as u32
}

/// Makes a heat map of the stage as it is, and gives the JPEG file's bytes.
pub(crate) fn heat_map(stage: &Stage, tree: &Bvh, size: u32, most: u32, path: &Path) -> Result<Vec<u8>> {
    let (image, _) = nodes_visited(stage, tree, size, most);
    let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8;
    let bytes: Vec<u8> = image.pixels().iter().flatten().map(|&x| byte(x)).collect();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 85).encode(&bytes, size, size, ExtendedColorType::Rgb8)?;
    files::write_whole(path, &jpeg)?;
    Ok(jpeg)
}

fn nodes_visited(stage: &Stage, tree: &Bvh, size: u32, most: u32) -> (Image, u64) {
    let mut image = Image::new(size, size);
    let options = RenderOptions { output: Output::NodesVisited { most }, ..stage.render_options() };
    let (mesh, camera, light) = (stage.mesh(), stage.camera(size, size), stage.light());
    let stats = render(tree, &mesh, &camera, Some(&light), &options, &mut image);
    (image, stats.nodes_visited)
}
