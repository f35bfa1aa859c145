//! Pictures of the viewer beside those of `xtask render`.

use std::path::Path;
use std::process::Command;

use clap::Parser;

#[derive(Parser)]
struct Render {
    #[command(flatten)]
    args: lab::render::Args,
}

fn pixels(path: &Path) -> Vec<u8> {
    image::open(path).expect("a picture").into_rgb8().into_raw()
}

#[test]
fn pictures_are_those_of_render() {
    let folder = tempfile::tempdir().expect("a folder");
    let toys = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/toys.glb");
    let (ours, theirs) = (folder.path().join("viewer.png"), folder.path().join("render.png"));
    let args = ["render", toys, "--frame", "7", "--size", "203x131", "--out"].map(Path::new);
    let render = Render::parse_from(args.into_iter().chain([theirs.as_path()]));
    lab::render::run(&render.args).expect("rendered");
    let viewer = Command::new(env!("CARGO_BIN_EXE_viewer"))
        .args([toys, "--beside", "none", "--overlay", "0", "--frames", "7..8", "--size", "203x131", "--out"])
        .arg(&ours)
        .status();
    assert!(viewer.expect("started").success());
    assert!(pixels(&ours) == pixels(&theirs));
}

#[test]
fn without_a_display_it_says_so() {
    let mut viewer = Command::new(env!("CARGO_BIN_EXE_viewer"));
    let output =
        viewer.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET").output();
    let output = output.expect("started");
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("display") && error.contains("--out"), "{error}");
}

#[test]
fn films_hold_every_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let toys = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/toys.glb");
    let film = folder.path().join("film.gif");
    let viewer = Command::new(env!("CARGO_BIN_EXE_viewer"))
        .args([toys, "--frames", "3..8", "--size", "160x90", "--overlay", "0", "--out"])
        .arg(&film)
        .status();
    assert!(viewer.expect("started").success());
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut film = options.read_info(std::fs::File::open(&film).expect("a film")).expect("a GIF");
    let mut frames = 0;
    while film.read_next_frame().expect("a frame").is_some() {
        frames += 1;
    }
    assert_eq!((film.width(), film.height(), frames), (160, 90, 5));
}
