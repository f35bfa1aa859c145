//! Other programs that are run in the workspace.

use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::files;

/// Returns the program of that name; for cargo the one that runs this.
pub fn program(name: &str) -> Command {
    let cargo = std::env::var_os("CARGO").filter(|_| name == "cargo");
    Command::new(cargo.unwrap_or_else(|| name.into()))
}

/// Returns what a program prints in the workspace, without spaces at its end.
///
/// # Errors
///
/// If the program fails; the message has what it says.
pub fn output(name: &str, arguments: &[&str]) -> Result<String> {
    let output = program(name).args(arguments).current_dir(files::workspace()).output();
    let output = output.with_context(|| format!("{name}: cannot be started"))?;
    let error = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{name} {}: {error}", arguments.join(" "));
    Ok(String::from_utf8(output.stdout)?.trim_end().to_owned())
}
