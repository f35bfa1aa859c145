//! Embree 3 and 4, loaded at run time.
//!
//! Only what is needed of its C interface is declared, by hand, as of versions 3.13 and 4.4. Where
//! the two versions differ (what goes with a query) the one that is loaded decides.

mod api;
mod load;
mod not_found;
mod scene;

use std::path::Path;
use std::sync::Arc;

pub use not_found::{NotFound, VARIABLE};

use bvh_core::SimdLevel;

use crate::contest::{Contest, Entry};
use api::{Api, DeviceHandle};
use scene::{Config, Quality, Scene, Width};

/// The loaded library.
#[derive(Clone)]
pub struct Embree {
    api: Arc<Api>,
}

impl Embree {
    /// Loads the library at a path, which may be the file or a folder that it lies in. Without a
    /// path, the one that the environment variable `PIVOT_EMBREE` names, else the first of the
    /// usual names that the system finds.
    ///
    /// A TBB that lies beside the library is loaded first, as wheels from PyPI need it.
    ///
    /// # Errors
    /// If there is none, or it cannot be loaded.
    pub fn load(path: Option<&Path>) -> Result<Self, NotFound> {
        Ok(Self { api: Arc::new(load::load(path)?) })
    }

    /// Makes a device that builds on this number of threads.
    ///
    /// # Errors
    /// If Embree gives none, as on processors that it does not support.
    pub fn device(&self, threads: usize) -> Result<Device, NotFound> {
        let handle = |isa| DeviceHandle::new(&self.api, threads, isa).map(Arc::new);
        let has_more = SimdLevel::best() == SimdLevel::Avx512;
        // One that the library does not make for lack of the kernels is left out.
        let avx2 = if has_more { handle(Some("avx2")).ok() } else { None };
        Ok(Device { handle: handle(None)?, avx2 })
    }
}

/// A device: everything that is made with it builds on the same threads.
#[derive(Clone)]
pub struct Device {
    handle: Arc<DeviceHandle>,
    /// One limited to AVX2, where the processor has more.
    avx2: Option<Arc<DeviceHandle>>,
}

impl Device {
    /// Returns the version of the library, such as 4.4.0.
    #[must_use]
    pub fn version(&self) -> String {
        let v = self.handle.version;
        format!("{}.{}.{}", v / 10_000, v / 100 % 100, v % 100)
    }
}

/// What is there for geometry that moves.
const DYNAMIC: [(&str, Quality); 3] =
    [("refit", Quality::Refit), ("low", Quality::Low), ("medium", Quality::Medium)];

/// Adds this library's contestants.
pub(crate) fn enter(contest: Contest, device: &Device, entries: &mut Vec<Entry>) {
    let mut add_with = |handle: &Arc<DeviceHandle>, name: &str, config: Config| {
        let handle = Arc::clone(handle);
        let keeps_tree = config.quality == Quality::Refit;
        entries.push(Entry::new(format!("embree {name}"), keeps_tree, move |triangles| {
            Ok(Box::new(Scene::new(&handle, config, triangles)?))
        }));
    };
    let plain =
        Config { quality: Quality::Medium, width: Width::One, dynamic: false, robust: false, coherent: true };
    let widths = [("packets of 8", Width::Eight), ("packets of 16", Width::Sixteen)];
    let mut add = |name: &str, config: Config| add_with(&device.handle, name, config);
    match contest {
        Contest::Update => {
            for (name, quality) in DYNAMIC {
                add(name, Config { quality, dynamic: true, ..plain });
            }
        }
        Contest::Build => {
            for (name, quality) in
                [("low", Quality::Low), ("medium", Quality::Medium), ("high", Quality::High)]
            {
                add(name, Config { quality, ..plain });
            }
        }
        Contest::Trace => {
            add("single", plain);
            for (rays, width) in widths {
                add(rays, Config { width, ..plain });
            }
            add("packets of 16, robust", Config { width: Width::Sixteen, robust: true, ..plain });
            add("packets of 16, high", Config { quality: Quality::High, width: Width::Sixteen, ..plain });
            if let Some(avx2) = &device.avx2 {
                add_with(avx2, "packets of 8, avx2", Config { width: Width::Eight, ..plain });
            }
        }
        Contest::Incoherent => {
            let plain = Config { coherent: false, ..plain };
            add("single", plain);
            add("single, robust", Config { robust: true, ..plain });
            add("packets of 8", Config { width: Width::Eight, ..plain });
        }
        Contest::Frame => {
            for (name, quality) in DYNAMIC {
                for (rays, width) in [("single", Width::One)].into_iter().chain(widths) {
                    add(&format!("{name}, {rays}"), Config { quality, width, dynamic: true, ..plain });
                }
            }
        }
    }
}
