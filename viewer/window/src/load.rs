//! Scenes, made ready beside the thread that draws.

use std::path::PathBuf;

use anyhow::{Context, Result};
use scenes::SceneOptions;
use viewer_core::{Event, Ready};

/// Scenes that the window offers: that of the command line, and those that have a name.
pub(crate) fn names(first: &str) -> Vec<String> {
    let known = scenes::list().iter().map(|info| info.name).filter(|&name| name != first);
    std::iter::once(first).chain(known).map(str::to_owned).collect()
}

/// Loads a scene and makes it ready. Simulations are recorded where `cargo xtask` records them.
pub(crate) fn ready(name: &str, progress: &(dyn Fn(f32) + Sync)) -> Result<Ready> {
    let cache = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../target/scenes");
    let options =
        SceneOptions { cache_dir: Some(cache), progress: Some(progress), ..SceneOptions::default() };
    let scene = scenes::load(name, None, &options)?;
    Ready::new(scene).with_context(|| format!("{name}: no tree"))
}

/// Loads a scene on a thread of its own, and then looks for the costs of fresh trees. What comes of it goes to `send`,
/// which is false once nobody listens.
pub(crate) fn begin(name: String, send: impl Fn(Event) -> bool + Send + Sync + 'static) {
    std::thread::spawn(move || {
        let work = || {
            let progress = |part: f32| {
                send(Event::Message(format!("simulating {name}: {:.0} %", 100.0 * part)));
            };
            let fresh = match ready(&name, &progress) {
                Ok(mut ready) => {
                    let fresh = ready.take_fresh_costs();
                    send(Event::Scene(Box::new(ready)));
                    fresh
                }
                Err(error) => {
                    send(Event::Failed(format!("{error:#}")));
                    None
                }
            };
            let mut costs = fresh.into_iter().flatten();
            while costs.next().is_some_and(|(frame, cost)| send(Event::Fresh(frame, cost))) {}
        };
        // One thread of its own, so that drawing does not wait for it.
        if let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() {
            pool.install(work);
        } else {
            work();
        }
    });
}
