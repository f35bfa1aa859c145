//! What results were measured with: machine and revision.

use std::time::SystemTime;

use bvh_core::SimdLevel;
use serde::{Deserialize, Serialize};
use sysinfo::{CpuRefreshKind, MemoryRefreshKind, RefreshKind, System};

use crate::pool::cores;
use crate::process::output;

/// The machine and its state when the run began.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Machine {
    pub(crate) cpu: String,
    /// Hardware threads this process may use.
    pub(crate) cores: usize,
    /// Best SIMD level, which the updates use.
    pub(crate) simd: String,
    /// What was compiled in beyond the defaults; empty in older files.
    #[serde(default)]
    pub(crate) flags: String,
    pub(crate) memory_gib: Option<f64>,
    pub(crate) os: String,
    pub(crate) rustc: Option<String>,
    /// Mean number of processes that wanted to run in the minute before: other work disturbs
    /// timings.
    pub(crate) load: Option<f64>,
    /// Start of the run, UTC.
    pub(crate) started: String,
}

/// The state of the source tree.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Revision {
    /// Commit, where the tree is a git repository.
    pub(crate) commit: Option<String>,
    /// Whether tracked files differ from that commit.
    pub(crate) dirty: bool,
}

impl Machine {
    pub(crate) fn read() -> Self {
        let wanted = RefreshKind::nothing().with_cpu(CpuRefreshKind::nothing());
        let system = System::new_with_specifics(wanted.with_memory(MemoryRefreshKind::everything()));
        let cpu = system.cpus().first().map(|cpu| cpu.brand().trim()).filter(|brand| !brand.is_empty());
        Self {
            cpu: cpu.unwrap_or(std::env::consts::ARCH).to_owned(),
            cores: cores(),
            simd: SimdLevel::best().name().to_owned(),
            flags: flags(),
            memory_gib: Some(system.total_memory() as f64 / f64::from(1 << 30)).filter(|gib| *gib > 0.0),
            os: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            rustc: output("rustc", &["--version"]).ok(),
            load: cfg!(unix).then(|| System::load_average().one),
            started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        }
    }
}

/// The target features that the compiler could use beyond the target's own, and debug assertions.
/// Neon is not among them, since aarch64 always has it.
fn flags() -> String {
    let flags = [
        ("sse4.2", cfg!(target_feature = "sse4.2")),
        ("avx", cfg!(target_feature = "avx")),
        ("avx2", cfg!(target_feature = "avx2")),
        ("fma", cfg!(target_feature = "fma")),
        ("bmi2", cfg!(target_feature = "bmi2")),
        ("avx512f", cfg!(target_feature = "avx512f")),
        ("sve", cfg!(target_feature = "sve")),
        ("debug-assertions", cfg!(debug_assertions)),
    ];
    let on: Vec<_> = flags.into_iter().filter_map(|(name, is_on)| is_on.then_some(name)).collect();
    if on.is_empty() { "default".to_owned() } else { on.join(" ") }
}

/// Memory of this process in MiB, or 0 where the system does not report it.
pub(crate) fn resident_mib() -> f64 {
    let Ok(this) = sysinfo::get_current_pid() else { return 0.0 };
    let mut system = System::new();
    system.refresh_processes(sysinfo::ProcessesToUpdate::Some(&[this]), false);
    system.process(this).map_or(0.0, |process| process.memory() as f64 / f64::from(1 << 20))
}

impl Revision {
    pub(crate) fn read() -> Self {
        let commit = output("git", &["rev-parse", "HEAD"]).ok();
        let changes = output("git", &["status", "--porcelain", "--untracked-files=no"]);
        Self { commit, dirty: changes.is_ok_and(|c| !c.is_empty()) }
    }

    /// A short form: the commit's first digits, and whether there are changes on top.
    pub(crate) fn short(&self) -> String {
        let Some(commit) = &self.commit else { return "unknown revision".to_owned() };
        let digits = commit.get(..10).unwrap_or(commit);
        format!("{digits}{}", if self.dirty { " with uncommitted changes" } else { "" })
    }
}
