//! Pictures of a frame: as it looks, and how many nodes its rays visit.

use anyhow::Result;
use bvh_core::Bvh;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use rt_cpu::{Image, Output, RenderOptions, srgb};

use crate::stage::{Renderer, Stage};

/// Strategies whose trees are shown as heat maps; the last is that of a fresh build.
pub(crate) const HEAT_MAPS: [&str; 4] = ["refit", "refit+rotate", "auto", "sweep"];

/// Nodes visited for a pixel that heat maps show white, over the mean of the first frame with its
/// fresh tree.
const HOTTEST: u64 = 24;

/// The stage as it is, smooth, as a PNG file.
pub(crate) fn picture(stage: &mut Stage, tree: &Bvh, size: u32) -> Result<Vec<u8>> {
    stage.smooth();
    let mut renderer = Renderer::new(stage.render_options(), size);
    renderer.draw(stage, tree);
    Ok(renderer.image.png()?)
}

/// The number of nodes that heat maps of a scene show white.
pub(crate) fn hottest(stage: &Stage, size: u32) -> u32 {
    let pixels = u64::from(size) * u64::from(size);
    let (_, nodes) = nodes_visited(stage, &stage.first_tree, size, 1);
    (HOTTEST * nodes / pixels.max(1)).clamp(16, 100_000) as u32
}

/// A heat map of the stage as it is, as a JPEG file.
pub(crate) fn heat_map(stage: &Stage, tree: &Bvh, size: u32, most: u32) -> Result<Vec<u8>> {
    let (image, _) = nodes_visited(stage, tree, size, most);
    let bytes: Vec<u8> = image.pixels().iter().flatten().map(|&x| srgb(x)).collect();
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 85).encode(&bytes, size, size, ExtendedColorType::Rgb8)?;
    Ok(jpeg)
}

fn nodes_visited(stage: &Stage, tree: &Bvh, size: u32, most: u32) -> (Image, u64) {
    let options = RenderOptions { output: Output::NodesVisited { most }, ..stage.render_options() };
    let mut renderer = Renderer::new(options, size);
    let (stats, _) = renderer.draw(stage, tree);
    (renderer.image, stats.nodes_visited)
}
