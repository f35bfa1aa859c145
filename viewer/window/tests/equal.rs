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

#[test]
fn pictures_in_a_folder_have_the_numbers_of_their_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let toys = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/toys.glb");
    let (pictures, picture) = (folder.path().join("new/pictures"), folder.path().join("other/picture.png"));
    let draw = |args: &[&str], out: &Path| {
        let mut viewer = Command::new(env!("CARGO_BIN_EXE_viewer"));
        viewer.args([toys, "--size", "64x36", "--overlay", "0"]).args(args).arg("--out").arg(out);
        viewer.output().expect("started")
    };
    assert!(draw(&["--frames", "3..8", "--every", "2", "--clip", "0"], &pictures).status.success());
    let files = std::fs::read_dir(&pictures).expect("a folder");
    let mut names: Vec<_> = files.map(|file| file.expect("a file").file_name()).collect();
    names.sort();
    assert_eq!(names, ["frame-0003.png", "frame-0005.png", "frame-0007.png"]);
    assert!(draw(&[], &picture).status.success() && picture.exists());
    let error = draw(&["--clip", "no such"], &picture).stderr;
    assert!(String::from_utf8_lossy(&error).contains("no such"));
}
