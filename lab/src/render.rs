//! `cargo xtask render`: frames of a scene as files.

use std::ops::Range;
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use bvh_core::{Bvh, Triangles};
use bvh_update::{Strategy, Updater};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbaImage};
use rt_cpu::{Bvh8, Image, RenderOptions, Traversal, render_with, srgb};
use scenes::{FrameStage, LightEffects, SceneOptions};

use crate::pool::Threads;
use crate::progress::Progress;
use crate::stage::{self, Stage};
use crate::{files, interrupt};

/// Arguments of `render`.
#[derive(clap::Args)]
pub struct Args {
    /// A scene's name, a .glb, .gltf, .obj, .ply, .stl or .aff file, or a folder of .ply or .obj
    /// key frames
    scene: String,
    /// The frame to render, from 0 [default: 0; of a .gif all]
    #[arg(long, value_name = "N", conflicts_with = "frames")]
    frame: Option<usize>,
    /// Frames from A up to but without B; a long range can be split over machines
    #[arg(long, value_name = "A..B", value_parser = range)]
    frames: Option<Range<usize>>,
    /// How the tree is brought to the frame: updates run from frame 0, rebuilds build the frame's
    /// own tree; see `list`
    #[arg(long, value_name = "NAME", default_value = "refit+rotate")]
    strategy: Strategy,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    size: (u32, u32),
    /// A .png or .exr file, a .gif of all frames (NAME.part.gif of those before an interrupt), or a
    /// folder for PNG files [default: target/render]
    #[arg(long, value_name = "FILE|DIR")]
    out: Option<PathBuf>,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    clip: Option<String>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: Threads,
    /// How rays are grouped: tile, packet (8 x 8, as published in 2007) or single; images do not
    /// depend on it
    #[arg(long, value_name = "NAME", default_value = "tile")]
    traversal: Traversal,
    /// Show each triangle's own normal; else normals are interpolated
    #[arg(long)]
    flat: bool,
    /// What light does: some of shadows, textures, alpha, mirror, ambient-occlusion,
    /// diffuse-bounces with commas between them, or none [default: what the scene calls for]
    #[arg(long, value_name = "LIST", value_parser = effects)]
    effects: Option<LightEffects>,
    /// Samples of each pixel [default: 64 with diffuse-bounces, 4 with ambient-occlusion, else 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    samples: Option<u32>,
    /// Load a file relative to the middle of its model: at the earth's radius details stay
    #[arg(long)]
    local_origin: bool,
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let parse = |n: &str| n.trim().parse::<usize>().ok();
    match text.split_once("..").map(|(a, b)| (parse(a), parse(b))) {
        Some((Some(a), Some(b))) if a < b => Ok(a..b),
        Some((Some(_), Some(_))) => Err("the range is empty; A..B is from A up to but without B".to_owned()),
        _ => Err("expected two numbers as in 0..50".to_owned()),
    }
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |n: &str| n.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    text.split_once('x')
        .and_then(|(w, h)| Some((parse(w)?, parse(h)?)))
        .ok_or_else(|| "expected WxH as in 1024x1024, each 1 to 16384".to_owned())
}

fn effects(list: &str) -> Result<LightEffects, String> {
    let mut effects = LightEffects::empty();
    let known =
        || LightEffects::all().iter_names().map(|(n, flag)| (n.to_lowercase().replace('_', "-"), flag));
    for name in list.split(',').map(str::trim).filter(|name| *name != "none") {
        let found = known().find(|(known, _)| known == name);
        let names = || known().map(|(known, _)| known + ", ").collect::<String>();
        effects |= found.ok_or_else(|| format!("no such effect as '{name}'; there are {}none", names()))?.1;
    }
    Ok(effects)
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    let target = Target::of(args)?;
    let pool = args.threads.pool()?;
    let &Args { seed, effects: light, local_origin, .. } = args;
    let is_file = scenes::list().iter().all(|info| info.name != args.scene);
    ensure!(is_file || !local_origin, "--local-origin: {} is no file, whose origin it is for", args.scene);
    let options = SceneOptions { seed, light, local_origin, ..SceneOptions::default() };
    let scene = stage::load_with(&args.scene, args.clip.as_deref(), options)?;
    let count = scene.frames.max(1);
    let wanted = match (&args.frames, args.frame, &target) {
        (Some(frames), ..) => frames.clone(),
        (None, None, Target::Film(_)) => 0..count,
        (None, frame, _) => {
            let frame = frame.unwrap_or(0);
            frame..frame.saturating_add(1)
        }
    };
    ensure!(
        wanted.end <= count,
        "{}: no frame {}; its frames are 0 to {}",
        stage::label(&args.scene),
        wanted.end - 1,
        count - 1
    );
    // Before anything long begins.
    files::ensure_writable(&target.file(&stage::label(&args.scene), wanted.start))?;
    for note in &scene.notes {
        files::remark(&format!("note: {note}"));
    }
    let stages: Vec<_> = scene.effects.stages().map(FrameStage::name).collect();
    files::remark(&format!("a frame runs {}", stages.join(", ")));
    for (stage, why) in scene.stage_reasons() {
        files::remark(&format!("  {}: {why}", stage.name()));
    }
    let mut stage = pool.install(|| stage::ready(scene))?;
    pool.install(|| frames(args, &target, &mut stage, wanted))
}

fn frames(args: &Args, target: &Target, stage: &mut Stage, wanted: Range<usize>) -> Result<()> {
    let label = &stage::label(&args.scene);
    let mut tree = Bvh::clone(&stage.first_tree);
    let light = stage.scene.effects.light;
    let samples = args.samples.unwrap_or(::stage::default_samples(light));
    let (smooth, seed, traversal) = (!args.flat, args.seed, args.traversal);
    let options = RenderOptions { smooth, seed, traversal, ..stage.render_options() };
    let mut updater = Updater::new(args.strategy);
    let (mut film, mut filmed) = (Vec::new(), 0);
    let mut encoder = GifEncoder::new_with_speed(&mut film, 10);
    encoder.set_repeat(Repeat::Infinite)?;
    // A rebuilt tree depends on its own frame only.
    let first = if matches!(args.strategy, Strategy::Rebuild(..)) { wanted.start } else { 0 };
    let steps = |frame: usize| {
        (frame - first) as u64 + frame.saturating_sub(wanted.start) as u64 * u64::from(samples)
    };
    let progress = Progress::new(format!("rendering {label}"), steps(wanted.end));
    for frame in (first..wanted.end).take_while(|_| !interrupt::requested()) {
        stage.pose(stage.time_of(frame, stage.scene.frames));
        let updated = stage.update(&mut tree, &mut updater);
        updated.with_context(|| format!("{label}, frame {frame}"))?;
        if wanted.contains(&frame) {
            if frame == wanted.start {
                remark_on_broken(&stage.triangles());
            }
            if !args.flat {
                stage.smooth();
            }
            let done = |sample: u32| progress.at(steps(frame) + u64::from(sample));
            let Some(image) = picture(stage, &tree, args.size, &options, samples, done) else { break };
            let path = target.file(label, frame);
            if let Target::Film(_) = target {
                encoder.encode_frame(film_frame(&image)?)?;
                filmed += 1;
            } else {
                let is_exr = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
                let file = if is_exr { image.exr() } else { image.png() };
                let file = file.with_context(|| format!("{}: cannot be encoded", path.display()))?;
                files::write_and_name(&path, &file)?;
            }
        }
        progress.at(steps(frame + 1));
    }
    drop((progress, encoder));
    if let (Target::Film(path), 1..) = (target, filmed) {
        let is_whole = filmed == wanted.len();
        if !is_whole {
            files::remark(&format!("interrupted: a film of the first {filmed} of {} frames", wanted.len()));
        }
        // Part of a film does not take the place of a whole one.
        let part = path.with_extension("part.gif");
        files::write_and_name(if is_whole { path } else { &part }, &film)?;
    }
    let light = scenes::Effects { light, ..Default::default() };
    files::remark(&format!("effects: {light}; samples: {samples}"));
    Ok(())
}

/// Says how many triangles no ray can hit. An update that nothing calls for does not count them.
fn remark_on_broken(triangles: &Triangles<'_>) {
    let is_broken =
        |corners: &&[u32; 3]| corners.iter().any(|&i| !triangles.positions[i as usize].is_finite());
    let (broken, all) = (triangles.indices.iter().filter(is_broken).count(), triangles.indices.len());
    if broken > 0 {
        files::remark(&format!("note: {broken} of {all} triangles are not finite and are never hit"));
    }
}

/// The mean of the samples; nothing if interrupted before the last.
fn picture(
    stage: &Stage,
    tree: &Bvh,
    (width, height): (u32, u32),
    options: &RenderOptions,
    samples: u32,
    done: impl Fn(u32),
) -> Option<Image> {
    let (mesh, light, camera) = (stage.mesh(), stage.light(), stage.camera(width, height));
    let looks = options.effects.ambient_occlusion.is_some() || options.effects.diffuse_bounces.is_some();
    let wide = (samples > 1 && looks).then(|| {
        let mut wide = Bvh8::default();
        wide.update(tree, &mesh.triangles);
        wide
    });
    let [mut mean, mut image] = [(); 2].map(|()| Image::new(width, height));
    for sample in 0..samples {
        if sample > 0 && interrupt::requested() {
            return None;
        }
        done(sample);
        let options = RenderOptions { sample, ..*options };
        render_with(tree, wide.as_ref(), &mesh, &camera, Some(&light), &options, &mut image);
        mean.add(&image);
    }
    mean.scale(1.0 / samples as f32);
    Some(mean)
}

/// An image of a film, shown for 40 ms: GIFs count hundredths of a second.
fn film_frame(image: &Image) -> Result<Frame> {
    let bytes = image.pixels().iter().flat_map(|&[r, g, b]| [srgb(r), srgb(g), srgb(b), 255]).collect();
    let frame =
        RgbaImage::from_raw(image.width(), image.height(), bytes).context("an image of another size")?;
    Ok(Frame::from_parts(frame, 0, 0, Delay::from_numer_denom_ms(40, 1)))
}

/// Where images go.
enum Target {
    File(PathBuf),
    /// A GIF of all frames.
    Film(PathBuf),
    Folder(PathBuf),
}

impl Target {
    /// A name with a known extension is a file, without any, or with a slash at the end, a folder.
    fn of(args: &Args) -> Result<Self> {
        let Some(out) = &args.out else {
            return Ok(Self::Folder(files::workspace().join("target/render")));
        };
        let is_folder = out.is_dir() || out.as_os_str().to_string_lossy().ends_with(std::path::is_separator);
        let extension = out.extension().filter(|_| !is_folder);
        match extension.map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
            None => Ok(Self::Folder(out.clone())),
            Some("gif") => Ok(Self::Film(out.clone())),
            Some("png" | "exr") if args.frames.is_some() => {
                bail!("{}: a range of frames needs a folder or a .gif to go to", out.display())
            }
            Some("png" | "exr") => Ok(Self::File(out.clone())),
            Some(other) => bail!(
                "{}: cannot write .{other}; an image is .png, .exr or .gif, or name a folder",
                out.display()
            ),
        }
    }

    fn file(&self, label: &str, frame: usize) -> PathBuf {
        match self {
            Self::File(file) | Self::Film(file) => file.clone(),
            Self::Folder(folder) => folder.join(format!("{}-{frame:04}.png", stage::slug(label))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_named_as_scenes_name_them() {
        let all = "shadows,textures,alpha,mirror,ambient-occlusion,diffuse-bounces";
        let light = effects(all).expect("known names");
        let named = scenes::Effects { light, ..Default::default() }.to_string().replace(", ", ",");
        assert_eq!(named.replace(' ', "-"), all);
        assert_eq!(effects("none"), Ok(LightEffects::empty()));
        assert_eq!(effects("shadows"), Ok(LightEffects::SHADOWS));
        assert!(effects("caustics").expect_err("unknown").contains("diffuse-bounces"));
    }
}
