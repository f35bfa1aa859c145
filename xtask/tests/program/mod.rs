//! The program, started as users start it, and something small to run it on.

use std::fmt::Write;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::{fs, io};

use tempfile::TempDir;

/// A process that is killed when a test ends before it.
pub(crate) struct Running(Option<Child>);

impl Running {
    pub(crate) fn new(started: io::Result<Child>) -> Self {
        Self(Some(started.expect("the program starts")))
    }

    pub(crate) fn wait_with_output(mut self) -> io::Result<Output> {
        self.0.take().expect("a process").wait_with_output()
    }
}

impl Deref for Running {
    type Target = Child;

    fn deref(&self) -> &Child {
        self.0.as_ref().expect("a process")
    }
}

impl DerefMut for Running {
    fn deref_mut(&mut self) -> &mut Child {
        self.0.as_mut().expect("a process")
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            // It may have ended already.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn xtask(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let started = command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    Running::new(started).wait_with_output().expect("the end")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// Runs with bad input: exit code 2 and one line that has all of `words`.
pub(crate) fn refused(arguments: &[&str], words: &[&str]) {
    let output = xtask(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    let errors: Vec<_> = message.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{arguments:?}: {message}");
    assert_eq!(message.lines().last(), errors.last().copied(), "{arguments:?}: {message}");
    for word in words {
        assert!(errors[0].contains(word), "{arguments:?}: no {word:?} in {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

pub(crate) fn succeeds(arguments: &[&str]) -> String {
    let output = xtask(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// A folder of key frames: a sheet of 2 x 16 x 16 triangles that folds over and flutters.
fn key_frames(folder: &Path) -> PathBuf {
    const SIDE: u32 = 16;
    let folder = folder.join("sheet");
    fs::create_dir(&folder).expect("a folder");
    for frame in 0..3 {
        let mut ply = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            (SIDE + 1) * (SIDE + 1),
            2 * SIDE * SIDE
        );
        for i in 0..(SIDE + 1) * (SIDE + 1) {
            let (x, z) = ((i % (SIDE + 1)) as f32 - 8.0, (i / (SIDE + 1)) as f32 - 8.0);
            let bend = frame as f32 * 0.9 * x / 8.0;
            let wave = (x * 3.0 + z * 2.0 + frame as f32).sin();
            writeln!(ply, "{} {} {z}", x * bend.cos(), x * bend.sin() + wave).expect("a string");
        }
        for i in 0..SIDE * SIDE {
            let a = i / SIDE * (SIDE + 1) + i % SIDE;
            let (b, c, d) = (a + 1, a + SIDE + 1, a + SIDE + 2);
            writeln!(ply, "3 {a} {c} {b}\n3 {b} {c} {d}").expect("a string");
        }
        fs::write(folder.join(format!("sheet{frame}.ply")), ply).expect("a file");
    }
    folder
}

pub(crate) fn folder() -> (TempDir, PathBuf) {
    let temporary = TempDir::new().expect("a temporary folder");
    let frames = key_frames(temporary.path());
    (temporary, frames)
}

pub(crate) fn str(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// The whole rows of a file but for their times, which no two runs share.
pub(crate) fn rows(file: &Path) -> Vec<String> {
    let text = fs::read_to_string(file).expect("rows");
    let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
    let header: Vec<&str> = whole.lines().next().unwrap_or_default().split(',').collect();
    let untimed = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), header.len(), "a torn row: {line}");
        let kept = fields.iter().zip(&header).filter(|(_, name)| !name.ends_with("_ms"));
        kept.map(|(field, _)| *field).collect::<Vec<_>>().join(",")
    };
    whole.lines().map(untimed).collect()
}
