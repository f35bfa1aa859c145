//! `cargo xtask ci`: what a change must pass.

use std::path::Path;

use anyhow::{Context, Result};

use lab::process::{output, program};
use lab::{CheckFailed, files, interrupt};

/// Commands with what they set in the environment. The tests, which check the layering too, come
/// last: their summary ends the log. The README names their command.
const COMMANDS: [(&str, &[(&str, &str)]); 4] = [
    ("cargo fmt --all --check", &[]),
    ("cargo clippy --workspace --all-targets -- -D warnings", &[]),
    ("cargo doc --workspace --no-deps", &[("RUSTDOCFLAGS", "-D warnings")]),
    ("cargo test --workspace", &[]),
];

/// Targets with other code than x86-64, for which the libraries are linted where they are
/// installed.
const TARGETS: [&str; 2] = ["aarch64-unknown-linux-gnu", "wasm32-unknown-unknown"];

/// Runs everything, and fails with all that failed.
pub(crate) fn run() -> Result<()> {
    let mut failed = Vec::new();
    let mut commands = Vec::new();
    for target in TARGETS {
        let folder = output("rustc", &["--print", "target-libdir", "--target", target])?;
        if Path::new(&folder).exists() {
            let lint = format!("cargo clippy -p pivot-bvh -p rt-cpu --target {target} -- -D warnings");
            commands.push((lint, &[][..]));
        } else {
            files::remark(&format!("skipped: lints for {target}, which is not installed"));
        }
    }
    commands.extend(COMMANDS.map(|(command, environment)| (command.to_owned(), environment)));
    for (command, environment) in commands {
        files::remark(&format!("> {command}"));
        let mut words = command.split_whitespace();
        let status = program(words.next().unwrap_or_default())
            .args(words)
            .envs(environment.iter().copied())
            .current_dir(files::workspace())
            .status()
            .with_context(|| format!("{command}: cannot be started"))?;
        if interrupt::requested() {
            return Ok(());
        }
        failed.extend((!status.success()).then_some(command));
    }
    if failed.is_empty() { Ok(()) } else { Err(CheckFailed(format!("failed: {}", failed.join("; "))).into()) }
}
