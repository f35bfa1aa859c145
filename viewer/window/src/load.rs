//! Scenes, made ready beside the thread that draws.

use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use scenes::SceneOptions;
use viewer_core::{Event, Ready};

/// Scenes that the window offers: that of the command line, and those that have a name.
pub(crate) fn names(first: &str) -> Vec<String> {
    let known = scenes::list().iter().map(|info| info.name).filter(|&name| name != first);
    std::iter::once(first).chain(known).map(str::to_owned).collect()
}

/// Loads a scene and makes it ready. Simulations are recorded where `cargo xtask` records them.
pub(crate) fn ready(name: &str, clip: Option<&str>, progress: &(dyn Fn(f32) + Sync)) -> Result<Ready> {
    let cache = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../target/scenes");
    let options =
        SceneOptions { cache_dir: Some(cache), progress: Some(progress), ..SceneOptions::default() };
    let scene = scenes::load(name, clip, &options)?;
    Ready::new(scene).with_context(|| format!("{name}: no tree"))
}

/// How far something is that began at `start`, and how long it will take.
fn progress_line(what: &str, part: f64, start: Instant) -> String {
    let left = start.elapsed().as_secs_f64() * (1.0 - part) / part.max(1e-3);
    format!("{what}: {:.0} %, about {left:.0} s left", 100.0 * part)
}

/// Says on standard error how far something is, a line every few seconds.
pub(crate) struct Pace {
    start: Instant,
    last: Mutex<Instant>,
}

impl Pace {
    const QUIET: Duration = Duration::from_secs(3);

    pub(crate) fn new() -> Self {
        let start = Instant::now();
        Self { start, last: Mutex::new(start) }
    }

    pub(crate) fn at(&self, what: &str, part: f64) {
        if let Ok(mut last) = self.last.lock()
            && last.elapsed() >= Self::QUIET
        {
            *last = Instant::now();
            eprintln!("{}", anim::printable(&progress_line(what, part, self.start)));
        }
    }
}

/// Number of the last load.
static LATEST: AtomicU64 = AtomicU64::new(0);

/// Loads a scene on a thread of its own, and then looks for the costs of fresh trees until another
/// scene is to be loaded. What comes of it goes to `send`, which is false once nobody listens.
pub(crate) fn begin(
    name: String,
    clip: Option<String>,
    send: impl Fn(Event) -> bool + Send + Sync + 'static,
) {
    let number = LATEST.fetch_add(1, Ordering::Relaxed) + 1;
    std::thread::spawn(move || {
        let work = || {
            step_back();
            let start = Instant::now();
            let progress = |part: f32| {
                send(Event::Message(progress_line(&format!("simulating {name}"), part.into(), start)));
            };
            let fresh = match ready(&name, clip.as_deref(), &progress) {
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
            // Costs of this scene are none of the next.
            let mut send_cost =
                |(frame, cost)| LATEST.load(Ordering::Relaxed) == number && send(Event::Fresh(frame, cost));
            while costs.next().is_some_and(&mut send_cost) {}
        };
        // One thread of its own, so that drawing does not wait for it.
        if let Ok(pool) = rayon::ThreadPoolBuilder::new().num_threads(1).build() {
            pool.install(work);
        } else {
            work();
        }
    });
}

/// How much this thread steps back behind those that draw, which otherwise wait for it: of two
/// cores it then gets a tenth while they have work, and all that is left else.
#[cfg(target_os = "linux")]
const STEP_BACK: i32 = 10;

/// Gives way to the threads that draw. Only on Linux has each thread a priority of its own.
fn step_back() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(STEP_BACK) {
        eprintln!("note: pictures may wait while a scene is made ready: {error}");
    }
}
