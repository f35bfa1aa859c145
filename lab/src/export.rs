//! `cargo xtask export`: a scene that is made as a file, as that file.

use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::files;

/// Arguments of `export`.
#[derive(clap::Args)]
pub struct Args {
    /// The scene; the others are simulated. assets/toys.glb was written by `export toys`
    #[arg(value_parser = ["fairy-forest", "toys"])]
    scene: String,
    /// The binary glTF file to write
    #[arg(value_name = "FILE.glb")]
    out: PathBuf,
    /// Seed of everything random in fairy-forest [default: 0]
    #[arg(long)]
    seed: Option<u64>,
}

/// Runs the command.
///
/// # Errors
///
/// Bad input, or a check that failed.
pub fn run(args: &Args) -> Result<()> {
    let out = &args.out;
    let is_glb = out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb"));
    ensure!(is_glb, "{}: {} is a binary glTF file, name it .glb", out.display(), args.scene);
    let is_toys = args.scene == "toys";
    ensure!(!is_toys || args.seed.is_none(), "--seed: nothing in toys is random; leave it out");
    files::ensure_writable(out)?;
    let bytes =
        if is_toys { scenes::toys_glb() } else { scenes::fairy_forest_glb(args.seed.unwrap_or_default()) };
    files::write_and_name(out, &bytes)
}
