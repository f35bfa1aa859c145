//! `cargo xtask render`: frames of a scene as files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use bvh_update::{Scratch, Strategy, update};
use rt_cpu::{Image, RenderOptions, render};

use crate::progress::Progress;
use crate::stage::{self, Stage};
use crate::{files, interrupt, pool};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// A scene's name, a .glb, .gltf, .obj or .ply file, or a folder of key frames
    scene: String,
    /// The frame to render, from 0 [default: 0]
    #[arg(long, value_name = "N", conflicts_with = "frames")]
    frame: Option<usize>,
    /// Frames from A up to but without B; a long range can be split over machines
    #[arg(long, value_name = "A..B", value_parser = range)]
    frames: Option<Range<usize>>,
    /// How the tree is brought to the frame: updates run from frame 0, rebuilds build the frame's own tree
    #[arg(long, value_name = "NAME", default_value = "refit+rotate", value_parser = strategy)]
    strategy: Strategy,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    size: (u32, u32),
    /// A .png or .exr file, or a folder for PNG files [default: target/render]
    #[arg(long, value_name = "FILE|DIR")]
    out: Option<PathBuf>,
    /// Clip of a glTF file, by name or number [default: its first]
    #[arg(long, value_name = "NAME|NUMBER")]
    clip: Option<String>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads for updates and rendering [default: 8, or the cores there are]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Interpolate normals (the default)
    #[arg(long, overrides_with = "flat")]
    smooth: bool,
    /// Show each triangle's own normal
    #[arg(long, overrides_with = "smooth")]
    flat: bool,
}

fn range(text: &str) -> Result<Range<usize>, String> {
    let parse = |n: &str| n.trim().parse::<usize>().ok();
    match text.split_once("..").map(|(a, b)| (parse(a), parse(b))) {
        Some((Some(a), Some(b))) if a < b => Ok(a..b),
        Some((Some(_), Some(_))) => Err("the range is empty; A..B is from A up to but without B".to_owned()),
        _ => Err("expected two numbers as in 0..50".to_owned()),
    }
}

fn strategy(name: &str) -> Result<Strategy, String> {
    Strategy::from_name(name).ok_or_else(|| {
        let names = Strategy::all().map(|s| s.name());
        format!("no such strategy; there are {}", names.join(", "))
    })
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let parse = |n: &str| n.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    text.split_once('x')
        .and_then(|(w, h)| Some((parse(w)?, parse(h)?)))
        .ok_or_else(|| "expected WxH as in 1024x1024, each 1 to 16384".to_owned())
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let target = Target::of(args)?;
    let pool = pool::pool(args.threads.map_or_else(pool::default_threads, |n| n as usize))?;
    let scene = stage::load(&args.scene, args.clip.as_deref(), args.seed)?;
    let (count, label) = (scene.frames.max(1), stage::label(&args.scene));
    let wanted = match (&args.frames, args.frame.unwrap_or(0)) {
        (Some(range), _) => range.clone(),
        (None, frame) => frame..frame + 1,
    };
    ensure!(wanted.end <= count, "{label}: no frame {}; its frames are 0 to {}", wanted.end - 1, count - 1);
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
    eprintln!("a frame runs {}", scenes::FramePlan::new(&scene.effects));
    target.prepare()?;
    let mut stage = pool.install(|| Stage::new(scene))?;
    pool.install(|| frames(args, &target, &mut stage, &label, wanted, count))
}

fn frames(
    args: &Args,
    target: &Target,
    stage: &mut Stage,
    label: &str,
    wanted: Range<usize>,
    count: usize,
) -> Result<()> {
    let mut tree = stage.first_tree.clone();
    let (mut scratch, mut image) = (Scratch::new(), Image::new(args.size.0, args.size.1));
    let progress = Progress::new(format!("rendering {label}"), wanted.end as u64);
    // A rebuilt tree depends on its own frame only.
    let first = if matches!(args.strategy, Strategy::Rebuild(..)) { wanted.start } else { 0 };
    for frame in first..wanted.end {
        if interrupt::requested() {
            break;
        }
        stage.pose(stage.time_of(frame, count));
        update(&mut tree, &stage.triangles(), &args.strategy, &mut scratch)
            .with_context(|| format!("{label}, frame {frame}"))?;
        if wanted.contains(&frame) {
            if !args.flat {
                stage.smooth();
            }
            let options = RenderOptions { smooth: !args.flat, ..stage.render_options() };
            let camera = stage.camera(args.size.0, args.size.1);
            render(&tree, &stage.mesh(), &camera, Some(&stage.light()), &options, &mut image);
            let path = target.file(label, frame);
            image.save(&path)?;
            files::print(&files::shown(&path))?;
        }
        progress.at(frame as u64 + 1);
    }
    Ok(())
}

/// Where images go.
enum Target {
    File(PathBuf),
    Folder(PathBuf),
}

impl Target {
    /// A name with a known extension is a file, without any a folder.
    fn of(args: &Args) -> Result<Self> {
        let Some(out) = &args.out else {
            return Ok(Self::Folder(files::workspace().join("target/render")));
        };
        let extension = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            _ if out.is_dir() => Ok(Self::Folder(out.clone())),
            None => Ok(Self::Folder(out.clone())),
            Some("png" | "exr") if args.frames.is_some() => {
                bail!("{}: a range of frames needs a folder to go to", out.display())
            }
            Some("png" | "exr") => Ok(Self::File(out.clone())),
            Some(other) => {
                bail!("{}: cannot write .{other}; an image is .png or .exr, or name a folder", out.display())
            }
        }
    }

    /// Makes the folder, or checks that the file's is there, before anything long begins.
    fn prepare(&self) -> Result<()> {
        match self {
            Self::Folder(folder) => files::make_folder(folder),
            Self::File(file) => {
                let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
                ensure!(folder.is_dir(), "{}: there is no folder {}", file.display(), folder.display());
                Ok(())
            }
        }
    }

    fn file(&self, label: &str, frame: usize) -> PathBuf {
        match self {
            Self::File(file) => file.clone(),
            Self::Folder(folder) => folder.join(format!("{}-{frame:04}.png", stage::slug(label))),
        }
    }
}
