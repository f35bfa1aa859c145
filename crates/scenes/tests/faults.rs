//! What can go wrong with the cache: damage, a full disk, a process killed while it writes. The
//! scene is the same all the same, and nothing half-written is ever taken for whole.

use std::fs;
use std::path::{Path, PathBuf};

use scenes::{Scene, SceneOptions, load};
use tempfile::{TempDir, tempdir};

/// Names of the files in a folder that end so.
fn files(folder: &TempDir, end: &str) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.to_str().unwrap().ends_with(end)).collect()
}

/// A scene that takes a moment to simulate and 15 KB to keep.
fn scene(cache: &Path) -> Scene {
    let (cache_dir, key_frames, substeps) = (Some(cache.to_owned()), Some(2), Some(1));
    load("n-body", None, &SceneOptions { cache_dir, key_frames, substeps, ..SceneOptions::default() })
        .unwrap()
}

fn positions(scene: &Scene) -> Vec<[u32; 3]> {
    let mut positions = scene.animation.rest();
    scene.animation.pose(0.7 * scene.animation.duration(), &mut positions);
    positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_damaged_cache_is_made_again() {
    let folder = tempdir().unwrap();
    let good = positions(&scene(folder.path()));
    let [file] = &files(&folder, ".keys")[..] else { panic!("one cache") };
    let whole = fs::read(file).unwrap();
    let heal = |damaged: &[u8], how: &str| {
        fs::write(file, damaged).unwrap();
        let scene = scene(folder.path());
        assert!(positions(&scene) == good && scene.notes.is_empty(), "{how}");
        assert!(fs::read(file).unwrap() == whole, "{how}: not made again");
    };
    for cut in (0..whole.len()).step_by(whole.len() / 24).chain([8, whole.len() - 1]) {
        heal(&whole[..cut], &format!("cut at {cut}"));
    }
    for at in (0..whole.len()).step_by(whole.len() / 24) {
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (at % 8);
        heal(&flipped, &format!("byte {at} flipped"));
    }
    heal(&[&whole[..], &whole].concat(), "twice");
    heal(&vec![0; whole.len()], "zeros, as a power cut may leave");
}

#[test]
fn a_folder_in_place_of_the_cache_is_noted() {
    let folder = tempdir().unwrap();
    let good = positions(&scene(folder.path()));
    let [file] = &files(&folder, ".keys")[..] else { panic!("one cache") };
    fs::remove_file(file).unwrap();
    fs::create_dir(file).unwrap();
    let scene = scene(folder.path());
    assert!(positions(&scene) == good);
    assert!(scene.notes.len() == 1 && scene.notes[0].contains(file.to_str().unwrap()), "{:?}", scene.notes);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing half-written is left");
}

#[cfg(target_os = "linux")]
mod linux {
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Output};
    use std::time::{Duration, SystemTime};

    use super::*;

    /// Names the folder for [`child`].
    const CHILD: &str = "PIVOT_TEST_CACHE";

    /// Writes a cache, and prints what was noted.
    #[test]
    #[ignore = "run by the tests below, in a process of its own"]
    fn child() {
        let Some(folder) = std::env::var_os(CHILD) else { return println!("skipped: no {CHILD}") };
        println!("{:?}", scene(Path::new(&folder)).notes);
    }

    /// Runs [`child`] with a limit of 4 KiB on the files that it writes.
    fn limited_child(folder: &TempDir, before: &str) -> Output {
        let mut command = Command::new("sh");
        let line = format!("{before} ulimit -c 0; ulimit -f 8; exec \"$0\" \"$@\"");
        command.args(["-c", &line]).arg(std::env::current_exe().unwrap()).env(CHILD, folder.path());
        command.args(["--exact", "linux::child", "--ignored", "--nocapture"]);
        command.output().unwrap()
    }

    #[test]
    fn a_write_that_fails_half_way_is_noted() {
        let folder = tempdir().unwrap();
        // With the signal ignored, the write fails as on a full disk.
        let output = limited_child(&folder, "trap '' XFSZ;");
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && printed.contains("File too large"), "{output:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "what could not be written is removed");
    }

    #[test]
    fn a_process_killed_while_it_writes_leaves_no_cache() {
        let folder = tempdir().unwrap();
        // The system kills who writes a file longer than the limit.
        let output = limited_child(&folder, "");
        assert!(output.status.signal().is_some(), "{:?}", output.status);
        assert_eq!(files(&folder, ".keys"), [] as [PathBuf; 0]);
        let left = files(&folder, "");
        assert!(left.len() == 1 && fs::metadata(&left[0]).unwrap().len() == 4096, "killed half way");
        let made = scene(folder.path());
        assert!(made.notes.is_empty() && files(&folder, ".keys").len() == 1);
        assert_eq!(files(&folder, "").len(), 2, "what may belong to a process that writes stays");
        let two_days_ago = SystemTime::now() - Duration::from_secs(48 * 3600);
        fs::File::options().write(true).open(&left[0]).unwrap().set_modified(two_days_ago).unwrap();
        fs::remove_file(&files(&folder, ".keys")[0]).unwrap();
        scene(folder.path());
        assert_eq!(files(&folder, ""), files(&folder, ".keys"), "what a killed process left is removed");
        let other = tempdir().unwrap();
        assert!(positions(&made) == positions(&scene(other.path())));
    }
}

#[test]
fn a_file_has_a_million_frames_at_most() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("long.aff");
    fs::write(&path, "p 3  0 0 0  1 0 0  0 1 0\na 0 1 4000000000\n").unwrap();
    let scene = load(path.to_str().unwrap(), None, &SceneOptions::default()).unwrap();
    assert_eq!(scene.frames, 1_000_001);
}
