//! The registry: the scenes there are, and how a name or a path becomes a [`Scene`].

use std::path::Path;

use crate::{Make, Scene, SceneError, SceneInfo, SceneOptions, file};

/// Returns the scenes made by this crate.
#[must_use]
pub fn list() -> &'static [SceneInfo] {
    &[
        crate::bart_museum::INFO,
        crate::cloth_ball::INFO,
        crate::exploding_dragon::INFO,
        crate::fairy_forest::INFO,
        crate::lion::INFO,
        crate::n_body::INFO,
    ]
}

/// Makes the scene of a known name, or loads the file or folder of key frames at a path.
///
/// `bart-museum:3` is the museum started from its fourth shape of five.
/// `exploding-dragon:blended` is the dragon from 16 key frames, blended linearly.
///
/// `clip` picks one of a file's animations by name. A simulated scene takes up to two minutes when
/// it is not in the cache. Failing to write the cache is a note in [`Scene::notes`], not an error.
///
/// # Errors
/// If the name is neither a scene's nor a path that exists, an option is out of range, or the file
/// cannot be loaded.
pub fn load(name_or_path: &str, clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    check(options)?;
    let mut scene = make(name_or_path, clip, options)?;
    scene.effects.simulated -= options.without;
    scene.effects.light = options.light.unwrap_or(scene.effects.light);
    Ok(scene)
}

fn make(name: &str, clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, SceneError> {
    let named = list().iter().find_map(|info| {
        let variant = name.strip_prefix(info.name)?;
        info.make.iter().find(|made| made.0 == variant)
    });
    match (named, clip) {
        (Some((_, Make::Clip(make))), _) => make(clip, options),
        (Some((_, Make::Whole(make))), None) => Ok(Scene { name: name.to_owned(), ..make(options)? }),
        (Some(_), Some(clip)) => Err(SceneError::Request(format!(
            "scene {name} has no clips, so none named \"{clip}\"; leave the clip out"
        ))),
        (None, _) if Path::new(name).exists() => Ok(file::scene(Path::new(name), clip, options)?),
        (None, _) => {
            let known = list().iter().map(|info| info.name).collect::<Vec<_>>().join(", ");
            let mut message = format!("no scene or file named \"{name}\"; the scenes are {known}");
            if name.starts_with("bart-museum:") {
                message += "; bart-museum:1 to bart-museum:4 start from another shape";
            }
            Err(SceneError::Request(message))
        }
    }
}

fn check(options: &SceneOptions<'_>) -> Result<(), SceneError> {
    let message = if let Some(n) = options.substeps.filter(|n| !(1..=100_000).contains(n)) {
        format!("substeps is {n} but must be between 1 and 100000")
    } else if let Some(n) = options.key_frames.filter(|n| !(2..=10_000).contains(n)) {
        format!("key_frames is {n} but must be between 2 and 10000")
    } else if let Some(x) = options.detail.filter(|&x| !(x > 0.0 && x <= 1.0)) {
        format!("detail is {x} but must be above 0 and at most 1")
    } else {
        return Ok(());
    };
    Err(SceneError::Request(message))
}
