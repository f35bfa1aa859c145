//! The window on a display without a screen (Xvfb), with keys and a mouse (xdotool). Skipped, and
//! it says so, where these are not installed.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// Longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(60);

/// A display with a viewer on it.
struct Display {
    name: String,
    folder: TempDir,
    xvfb: Child,
    viewer: Child,
    said: BufReader<ChildStdout>,
    window: String,
}

impl Drop for Display {
    fn drop(&mut self) {
        for child in [&mut self.viewer, &mut self.xvfb] {
            // What has ended cannot be ended.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Pixels of a picture or a screen with its width and height.
#[derive(PartialEq)]
struct Pixels(u32, u32, Vec<u8>);

impl Display {
    /// Starts a viewer of a scene; `None` without the programs it takes.
    fn start(scene: &str) -> Option<Self> {
        let is_there = |name: &str| Command::new(name).arg("-version").output().is_ok();
        if !is_there("Xvfb") || !is_there("xdotool") {
            println!("skipped: Xvfb and xdotool are not installed");
            return None;
        }
        let folder = tempfile::tempdir().expect("a folder");
        // Servers that look for a free number at the same time may find the same.
        static NUMBERS: Mutex<()> = Mutex::new(());
        let turn = NUMBERS.lock().unwrap_or_else(PoisonError::into_inner);
        let mut xvfb = Command::new("Xvfb")
            // Without a client for a moment, as between two of xdotool's, it would start again and
            // refuse the viewer.
            .args(["-noreset", "-displayfd", "1", "-screen", "0", "640x480x24", "-fbdir"])
            .arg(folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        BufReader::new(xvfb.stdout.take().expect("piped")).read_line(&mut number).expect("a number");
        drop(turn);
        let name = format!(":{}", number.trim());
        let mut viewer = Command::new(env!("CARGO_BIN_EXE_viewer"))
            .args([scene, "--beside", "none", "--overlay", "0", "--size", "640x480", "--folder"])
            .arg(folder.path())
            .env("DISPLAY", &name)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the viewer starts");
        let said = BufReader::new(viewer.stdout.take().expect("piped"));
        let mut display = Self { name, folder, xvfb, viewer, said, window: String::new() };
        until("a window", || {
            display.window =
                display.xdotool("search --name Pivot").lines().next().unwrap_or_default().to_owned();
            !display.window.is_empty()
        });
        // Nobody manages windows here.
        display.xdotool(&format!("windowfocus --sync {}", display.window));
        display.xdotool("mousemove 320 200");
        Some(display)
    }

    fn xdotool(&self, command: &str) -> String {
        let output = Command::new("xdotool").args(command.split(' ')).env("DISPLAY", &self.name).output();
        String::from_utf8_lossy(&output.expect("xdotool runs").stdout).into_owned()
    }

    /// The picture as the viewer saves it.
    fn saved(&mut self) -> Pixels {
        self.xdotool("key p");
        let mut line = String::new();
        self.said.read_line(&mut line).expect("a line");
        let path = line.trim().strip_prefix("saved ").unwrap_or_else(|| panic!("{line}"));
        let picture = image::open(Path::new(path)).expect("a picture").into_rgb8();
        Pixels(picture.width(), picture.height(), picture.into_raw())
    }

    /// The upper left part of the screen, from the file that Xvfb keeps it in, in the format of
    /// xwd.
    fn screen(&self, width: u32, height: u32) -> Pixels {
        let bytes = fs::read(self.folder.path().join("Xvfb_screen0")).expect("a screen");
        let word =
            |i: usize| u32::from_be_bytes(bytes[4 * i..4 * i + 4].try_into().expect("four bytes")) as usize;
        let (start, line) = (word(0) + 12 * word(19), word(12));
        let row = |y: usize| bytes[start + y * line..].chunks_exact(4).take(width as usize);
        let rgb =
            (0..height as usize).flat_map(row).flat_map(|pixel| [pixel[2], pixel[1], pixel[0]]).collect();
        Pixels(width, height, rgb)
    }

    /// Waits until the screen shows what the viewer saves, and that is something `wanted`.
    fn shows(&mut self, what: &str, wanted: impl Fn(&Pixels) -> bool) -> Pixels {
        let mut found = None;
        until(what, || {
            let saved = self.saved();
            let is_shown = wanted(&saved) && self.screen(saved.0, saved.1) == saved;
            found = Some(saved).filter(|_| is_shown);
            is_shown
        });
        found.expect("found")
    }

    /// Ends the viewer with the escape key and gives its exit code.
    fn end(&mut self) -> Option<i32> {
        self.xdotool("key Escape");
        let mut code = None;
        until("the end", || {
            code = self.viewer.try_wait().expect("a child").map(|status| status.code());
            code.is_some()
        });
        code.flatten()
    }
}

fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < PATIENCE, "no {what} within {PATIENCE:?}");
        sleep(Duration::from_millis(50));
    }
}

fn toys() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/toys.glb")
}

#[test]
fn the_window_shows_what_the_core_draws() {
    let Some(mut display) = Display::start(&toys().to_string_lossy()) else { return };
    let colors = |pixels: &Pixels| {
        let mut colors: Vec<_> = pixels.2.chunks(3).collect();
        colors.sort_unstable();
        colors.dedup();
        colors.len()
    };
    until("the scene", || colors(&display.saved()) > 200);
    display.xdotool("key space");
    let scene = display.shows("a picture at rest", |_| true);
    display.xdotool("key h");
    let heat = display.shows("heat", |pixels| *pixels != scene);
    display.xdotool("key h");
    display.shows("the scene again", |pixels| *pixels == scene);
    display.xdotool("mousedown 1 mousemove 380 230 mouseup 1");
    let turned = display.shows("a turned scene", |pixels| *pixels != scene);
    assert!(turned != heat);
    display.xdotool(&format!("windowsize {} 400 300", display.window));
    display.shows("another size", |pixels| (pixels.0, pixels.1) == (400, 300));
    assert_eq!(display.end(), Some(0));
}

#[test]
fn a_window_that_is_closed_while_a_scene_is_built_ends_cleanly() {
    let Some(mut display) = Display::start("exploding-dragon") else { return };
    assert_eq!(display.end(), Some(0));
    let mut rest = String::new();
    display.said.read_to_string(&mut rest).expect("text");
    assert!(rest.is_empty(), "{rest}");
}

#[test]
fn a_scene_that_cannot_be_loaded_leaves_a_window_with_its_panel() {
    let Some(mut display) = Display::start("no-such-scene") else { return };
    display.xdotool("key u");
    display.shows("the panel", |pixels| pixels.2.contains(&255));
    assert_eq!(display.end(), Some(0));
}
