//! `cargo xtask`: reruns the paper's experiments, renders scenes, lists what there is, checks the
//! tree.
//!
//! This file is the command line and the exit codes: 0 for success, 1 if a check failed, 2 for bad
//! input (one line says what, where, and what would be right), 130 after an interrupt.

mod ci;
mod viewer;

use std::io;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Arg, CommandFactory, FromArgMatches, Parser, Subcommand};
use lab::{CheckFailed, compare, effects, export, files, interrupt, list, render, reproduce, soak};

#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, about, max_term_width = 100)]
#[command(about = "Reruns the paper's experiments, renders scenes, lists what there is, checks the tree")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Rerun the paper's experiments: every strategy on every scene, checked against brute force
    Reproduce(reproduce::Args),
    /// Render frames of a scene to PNG, EXR or GIF files
    Render(render::Args),
    /// Play a scene in a window and show how its tree fares
    View(viewer::View),
    /// Write the viewer as a page for a browser
    Web(viewer::Web),
    /// Write the scene fairy-forest or toys as a glTF file
    Export(export::Args),
    /// Measure this project beside other libraries: same work, same hits, one run
    Compare(compare::Args),
    /// Play thousands of frames and check that time, cost, height and memory do not grow
    Soak(soak::Args),
    /// Show what a frame of each scene runs and why, and what each effect costs
    Effects(effects::Args),
    /// List scenes with the effects each calls for, strategies, builders and SIMD levels
    List(list::Args),
    /// Format, lints, docs and tests, as a change must pass them
    Ci,
}

/// The command line. A negative number is a value that an option refuses, not an option that nobody
/// knows.
fn parse() -> Result<Cli, clap::Error> {
    let negative = |arg: Arg| {
        let takes_value = arg.get_action().takes_values();
        arg.allow_negative_numbers(takes_value)
    };
    let command = Cli::command().mut_subcommands(|command| command.mut_args(negative));
    Cli::from_arg_matches(&command.try_get_matches()?)
}

fn main() -> ExitCode {
    let cli = match parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    interrupt::catch();
    let result = match &cli.command {
        Command::Reproduce(args) => reproduce::run(args),
        Command::Render(args) => render::run(args),
        Command::View(args) => viewer::view(args),
        Command::Web(args) => viewer::web(args),
        Command::Export(args) => export::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Soak(args) => soak::run(args),
        Command::Effects(args) => effects::run(args),
        Command::List(args) => list::run(args),
        Command::Ci => ci::run(),
    };
    match result {
        Ok(()) if interrupt::requested() => ExitCode::from(interrupt::EXIT_CODE),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if reader_left(&error) => ExitCode::SUCCESS,
        Err(error) => {
            files::remark(&format!("error: {}", one_line(&error)));
            ExitCode::from(if error.is::<CheckFailed>() { 1 } else { 2 })
        }
    }
}

/// Help and version as clap prints them; anything wrong with the command line in one line.
fn usage(error: &clap::Error) -> ExitCode {
    let is_bare = error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
    if is_bare || !error.use_stderr() {
        // A reader that left is no error.
        let _ = error.print();
    } else {
        let text = error.render().to_string();
        let message = text.split("\n\nUsage:").next().unwrap_or_default();
        let message = message.split("\n\nFor more information").next().unwrap_or_default();
        let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
        // The tip alone would be right for an argument without an option only.
        let tip = if line.contains("use '-- ") { ", or --OPTION=VALUE where it is an option's" } else { "" };
        files::remark(&format!("{line}{tip}; see --help"));
    }
    ExitCode::from(error.exit_code().clamp(0, 255) as u8)
}

/// Whether whoever read standard output has gone, as `head` does.
fn reader_left(error: &anyhow::Error) -> bool {
    error.downcast_ref::<io::Error>().is_some_and(|e| e.kind() == io::ErrorKind::BrokenPipe)
}

/// The message with its causes, each said once.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        let cause = cause.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        if !line.contains(&cause) {
            line += if line.is_empty() { "" } else { ": " };
            line += &cause;
        }
    }
    line
}
