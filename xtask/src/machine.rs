//! What results were measured with: machine and revision.

use std::fs;
use std::process::Command;
use std::time::SystemTime;

use bvh_core::SimdLevel;
use serde::{Deserialize, Serialize};

use crate::files;

/// The machine and its state when the run began.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Machine {
    pub(crate) cpu: String,
    /// Hardware threads this process may use.
    pub(crate) cores: usize,
    /// Best SIMD level, which the updates use.
    pub(crate) simd: String,
    pub(crate) memory_gib: Option<f64>,
    pub(crate) os: String,
    pub(crate) rustc: Option<String>,
    /// Processes that wanted to run in the minute before, where the system tells: other work disturbs timings.
    pub(crate) load: Option<f64>,
    /// Start of the run, UTC.
    pub(crate) started: String,
}

/// The state of the source tree.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Revision {
    /// Commit, where the tree is a git repository.
    pub(crate) commit: Option<String>,
    /// Whether tracked files differ from that commit.
    pub(crate) dirty: bool,
}

impl Machine {
    pub(crate) fn read() -> Self {
        let field = |file: &str, key: &str| {
            let text = fs::read_to_string(file).ok()?;
            let line = text.lines().find(|l| l.starts_with(key))?;
            Some(line.split_once(':')?.1.trim().to_owned())
        };
        let cpu = field("/proc/cpuinfo", "model name")
            .or_else(|| output("sysctl", &["-n", "machdep.cpu.brand_string"]))
            .unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        let memory = field("/proc/meminfo", "MemTotal")
            .and_then(|m| m.strip_suffix("kB")?.trim().parse::<f64>().ok())
            .map(|kib| kib / f64::from(1 << 20));
        let load = fs::read_to_string("/proc/loadavg")
            .ok()
            .and_then(|text| text.split_whitespace().next()?.parse().ok());
        Self {
            cpu,
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            simd: SimdLevel::best().name().to_owned(),
            memory_gib: memory,
            os: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            rustc: output("rustc", &["--version"]),
            load,
            started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        }
    }
}

impl Revision {
    pub(crate) fn read() -> Self {
        let commit = output("git", &["rev-parse", "HEAD"]);
        let changes = output("git", &["status", "--porcelain", "--untracked-files=no"]);
        Self { commit, dirty: changes.is_some_and(|c| !c.is_empty()) }
    }

    /// A short form: the commit's first digits, and whether there are changes on top.
    pub(crate) fn short(&self) -> String {
        let Some(commit) = &self.commit else { return "unknown revision".to_owned() };
        let digits = commit.get(..10).unwrap_or(commit);
        format!("{digits}{}", if self.dirty { " with uncommitted changes" } else { "" })
    }
}

/// What a program prints, run in the workspace; `None` if it fails.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).current_dir(files::workspace()).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
