//! Scenes by name or path, for the commands: loading with progress, names for tables and files.

use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::Bvh;
use rt_cpu::{Image, RenderOptions, RenderStats, render};
use scenes::{Scene, SceneOptions};

pub(crate) use stage::Stage;

use crate::files;
use crate::progress::Progress;

/// Loads a scene by name or path; simulations are recorded under `target/scenes`.
pub(crate) fn load_with(name_or_path: &str, clip: Option<&str>, options: SceneOptions<'_>) -> Result<Scene> {
    let progress = Progress::new(format!("preparing {name_or_path}"), 100);
    let report = |done: f32| progress.at((100.0 * done) as u64);
    let options = SceneOptions { cache_dir: Some(files::scene_cache()), progress: Some(&report), ..options };
    Ok(scenes::load(name_or_path, clip, &options)?)
}

/// Simulates a scene afresh. Gives it and the milliseconds from the first to the last of its key
/// frames: meshing is not among them.
pub(crate) fn simulated(name: &str, options: SceneOptions<'_>) -> Result<(Scene, f64)> {
    let reported: Mutex<Option<[Instant; 2]>> = Mutex::new(None);
    let progress = |_| {
        if let Ok(mut reported) = reported.lock() {
            let now = Instant::now();
            *reported = Some(reported.map_or([now; 2], |[first, _]| [first, now]));
        }
    };
    let scene = scenes::load(name, None, &SceneOptions { progress: Some(&progress), ..options })?;
    let time = reported.into_inner().ok().flatten();
    Ok((scene, time.map_or(0.0, |[first, last]| 1e3 * (last - first).as_secs_f64())))
}

/// Loads a source that may not be there or be broken, so that this shows before anything else is
/// done; scenes of the registry, which may take long, only when their turn comes.
pub(crate) fn load_first(source: &str, load: impl FnOnce() -> Result<Scene>) -> Result<Option<Scene>> {
    let is_known = scenes::list().iter().any(|info| info.name == source);
    (!is_known).then(load).transpose()
}

/// A scene at time 0.
pub(crate) fn ready(scene: Scene) -> Result<Stage> {
    Ok(ready_timed(scene)?.0)
}

/// A scene at time 0, and the milliseconds that its first tree took.
pub(crate) fn ready_timed(scene: Scene) -> Result<(Stage, f64)> {
    let (name, mut build_ms) = (scene.name.clone(), 0.0);
    let stage = Stage::with_tree(scene, |triangles| {
        let tree;
        (tree, build_ms) = timed(|| build(triangles, Builder::Sweep));
        tree
    });
    Ok((stage.with_context(|| format!("{name}: no tree"))?, build_ms))
}

/// A fresh tree by the sweep builder over the stage as it is.
pub(crate) fn fresh_tree(stage: &Stage) -> Result<Bvh> {
    build(&stage.triangles(), Builder::Sweep).with_context(|| format!("{}: no tree", stage.scene.name))
}

/// Rendering by one set of options, into one image.
pub(crate) struct Renderer {
    pub(crate) options: RenderOptions,
    pub(crate) image: Image,
}

impl Renderer {
    /// With `size` pixels on each side.
    pub(crate) fn new(options: RenderOptions, size: u32) -> Self {
        Self { options, image: Image::new(size, size) }
    }

    /// Renders the stage as it is, with the scene's camera and light, and gives the milliseconds;
    /// an image of another size shows more pixels, not more of the scene.
    pub(crate) fn draw(&mut self, stage: &Stage, tree: &Bvh) -> (RenderStats, f64) {
        let Self { options, image } = self;
        let (camera, light) = (stage.camera(image.width(), image.height()), stage.light());
        timed(|| render(tree, &stage.mesh(), &camera, Some(&light), options, image))
    }
}

/// What `work` gives, and the milliseconds that it takes.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}

/// A short name of a scene for tables: its own, or the file's; a folder's ends in a slash.
pub(crate) fn label(name_or_path: &str) -> String {
    if scenes::list().iter().any(|info| info.name == name_or_path) {
        return name_or_path.to_owned();
    }
    let path = std::path::Path::new(name_or_path);
    let name = path.file_name().map_or_else(|| name_or_path.into(), |name| name.to_string_lossy());
    format!("{name}{}", if path.is_dir() { "/" } else { "" })
}

/// The [`label`] of each scene, numbered where two have the same: files may share a name, but not a
/// row or a picture.
pub(crate) fn labels(sources: &[impl AsRef<str>]) -> Vec<String> {
    let mut labels: Vec<String> = Vec::new();
    for source in sources {
        let label = label(source.as_ref());
        let mut names = (1..).map(|n| if n == 1 { label.clone() } else { format!("{label}-{n}") });
        let free =
            names.find(|name| labels.iter().all(|taken| !slug(taken).eq_ignore_ascii_case(&slug(name))));
        labels.extend(free);
    }
    labels
}

/// A label as part of a file's name.
pub(crate) fn slug(label: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '-' };
    label.trim_end_matches('/').chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_scenes_have_one_label() {
        let sources = ["n-body", "a/x.glb", "b/X.glb", "x.glb-2", "n-body", "c/x glb"];
        assert_eq!(
            labels(&sources),
            ["n-body", "x.glb", "X.glb-2", "x.glb-2-2", "n-body-2", "x glb-3"],
            "also in names of files, where case, a space and a point make no difference"
        );
    }
}
