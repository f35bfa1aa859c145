//! `cargo xtask export`: a scene that is made as a file, as that file.

use std::path::PathBuf;

use anyhow::{Result, ensure};

use crate::files;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// The scene; fairy-forest is the one that is a file, the others are simulated
    #[arg(value_parser = ["fairy-forest"])]
    scene: String,
    /// The binary glTF file to write
    #[arg(value_name = "FILE.glb")]
    out: PathBuf,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let out = &args.out;
    let is_glb = out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("glb"));
    ensure!(is_glb, "{}: {} is a binary glTF file, name it .glb", out.display(), args.scene);
    files::write_whole(out, &scenes::fairy_forest_glb(args.seed))?;
    files::print(&files::shown(out))
}
