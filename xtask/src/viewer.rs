//! `cargo xtask view` and `cargo xtask web`: the viewer in a window, and as a page for a browser.
//!
//! Both are built when they are asked for, so that the other commands do not wait for libraries of
//! windows.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, exit};

use anyhow::{Context, Result, ensure};
use flate2::Compression;
use flate2::write::GzEncoder;
use lab::process::{output, program};
use lab::{files, interrupt};
use scenes::SceneOptions;

/// Arguments of `view`.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct View {
    /// A scene's name or a file, and options; --help shows them
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "SCENE|FILE|OPTION")]
    args: Vec<String>,
}

/// Arguments of `web`.
#[derive(clap::Args)]
pub(crate) struct Web {
    /// Folder for the page, made if it does not exist [default: target/web]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Builds the viewer and starts it; ends as it ends.
pub(crate) fn view(args: &View) -> Result<()> {
    let status = program("cargo")
        .args(["run", "--release", "--package", "viewer", "--manifest-path"])
        .arg(files::workspace().join("Cargo.toml"))
        .arg("--")
        .args(&args.args)
        .status()
        .context("cargo: cannot be started")?;
    if status.success() || interrupt::requested() { Ok(()) } else { exit(status.code().unwrap_or(1)) }
}

/// Threads and a clock in WebAssembly, in stable Rust. `worker.js` answers what such a module asks
/// of its system.
const TARGET: &str = "wasm32-wasip1-threads";

/// What a page of today has: SIMD, and memory that threads share, in bytes at first and at most.
/// `worker.js` has the same.
const FLAGS: [&str; 3] =
    ["target-feature=+simd128", "link-arg=--initial-memory=67108864", "link-arg=--max-memory=2147483648"];

/// The file of the dragon's key frames beside the page.
const KEYS: &str = "exploding-dragon.keys.gz";

fn pack(content: &[u8]) -> Result<Vec<u8>> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(content)?;
    Ok(packed.finish()?)
}

/// Simulates the page's dragon and gives its record. The page would take seconds for that.
fn key_frames(root: &Path) -> Result<Vec<u8>> {
    let folder = root.join("target/web-scenes");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let options = SceneOptions { cache_dir: Some(folder.clone()), ..SceneOptions::for_page() };
    scenes::load("exploding-dragon", None, &options)?;
    let record = fs::read_dir(&folder)?.next().context("no key frames were written")??;
    Ok(fs::read(record.path())?)
}

/// Writes the page: a few files that any file server shows.
pub(crate) fn web(args: &Web) -> Result<()> {
    let root = files::workspace();
    let out = args.out.clone().unwrap_or_else(|| root.join("target/web"));
    // A folder of its own: flags are part of what is built.
    let target = root.join("target/wasm+simd128");
    let mut cargo: Command = program("cargo");
    cargo.args(["build", "--release", "--package", "viewer-web", "--target", TARGET, "--target-dir"]);
    cargo.arg(&target).current_dir(root);
    for setting in ["strip=\"symbols\"", "lto=\"fat\"", "codegen-units=1"] {
        cargo.args(["--config", &format!("profile.release.{setting}")]);
    }
    // A library has no beginning of its own: this one sets up memory and threads once.
    let libraries = output("rustc", &["--print", "target-libdir", "--target", TARGET])?;
    ensure!(
        Path::new(&libraries).exists(),
        "no libraries for {TARGET}; `rustup target add {TARGET}` installs them"
    );
    let start = format!("link-arg={libraries}/self-contained/crt1-reactor.o");
    let flags: Vec<_> =
        FLAGS.into_iter().chain([start.as_str()]).map(|flag| format!("\"-C\",\"{flag}\"")).collect();
    let flags = flags.join(",");
    cargo.args(["--config", &format!("target.{TARGET}.rustflags=[{flags}]")]);
    let status = cargo.status().context("cargo: cannot be started")?;
    if interrupt::requested() {
        return Ok(());
    }
    ensure!(status.success(), "the page cannot be built, as cargo says above");
    let module = files::read(&target.join(TARGET).join("release/viewer_web.wasm"))?;
    let mut page = vec![("viewer.wasm.gz", pack(&module)?), (KEYS, pack(&key_frames(root)?)?)];
    for name in ["index.html", "worker.js", "isolate.js"] {
        page.push((name, files::read(&root.join("viewer/web").join(name))?));
    }
    files::make_folder(&out)?;
    for (name, content) in &page {
        let path = out.join(name);
        fs::write(&path, content).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    let bytes: usize = page.iter().map(|(_, content)| content.len()).sum();
    files::remark(&format!(
        "{}: {:.2} MB in all; any file server shows it",
        out.display(),
        bytes as f64 / 1e6
    ));
    Ok(())
}
