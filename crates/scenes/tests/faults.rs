//! What can go wrong with the cache: damage, a full disk, a process killed while it writes. The
//! scene is the same all the same, and nothing half-written is ever taken for whole.

use std::fs;
use std::path::{Path, PathBuf};

use scenes::{Scene, SceneOptions, load};

/// A folder that is gone when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("pivot-scenes-{name}-{}", std::process::id()));
        fs::create_dir(&path).unwrap();
        Self(path)
    }

    /// Names of the files in it that end so.
    fn files(&self, end: &str) -> Vec<PathBuf> {
        let paths = fs::read_dir(&self.0).unwrap().map(|entry| entry.unwrap().path());
        paths.filter(|path| path.to_str().unwrap().ends_with(end)).collect()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).unwrap();
    }
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
    let folder = Folder::new("damage");
    let good = positions(&scene(&folder.0));
    let [file] = &folder.files(".keys")[..] else { panic!("one cache") };
    let whole = fs::read(file).unwrap();
    let heal = |damaged: &[u8], how: &str| {
        fs::write(file, damaged).unwrap();
        let scene = scene(&folder.0);
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
    let folder = Folder::new("folder");
    let good = positions(&scene(&folder.0));
    let [file] = &folder.files(".keys")[..] else { panic!("one cache") };
    fs::remove_file(file).unwrap();
    fs::create_dir(file).unwrap();
    let scene = scene(&folder.0);
    assert!(positions(&scene) == good);
    assert!(scene.notes.len() == 1 && scene.notes[0].contains(file.to_str().unwrap()), "{:?}", scene.notes);
    assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 1, "nothing half-written is left");
}

#[cfg(target_os = "linux")]
mod linux {
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Output};

    use super::*;

    /// Names the folder for [`child`]; without it that does nothing.
    const CHILD: &str = "PIVOT_TEST_CACHE";

    /// Writes a cache, and prints what was noted.
    #[test]
    fn child() {
        if let Some(folder) = std::env::var_os(CHILD) {
            println!("{:?}", scene(Path::new(&folder)).notes);
        }
    }

    /// Runs [`child`] with a limit of 4 KiB on the files that it writes.
    fn limited_child(folder: &Folder, before: &str) -> Output {
        let mut command = Command::new("sh");
        let line = format!("{before} ulimit -c 0; ulimit -f 8; exec \"$0\" --exact linux::child --nocapture");
        command.args(["-c", &line]).arg(std::env::current_exe().unwrap()).env(CHILD, &folder.0);
        command.output().unwrap()
    }

    #[test]
    fn a_write_that_fails_half_way_is_noted() {
        let folder = Folder::new("full");
        // With the signal ignored, the write fails as on a full disk.
        let output = limited_child(&folder, "trap '' XFSZ;");
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && printed.contains("File too large"), "{output:?}");
        assert_eq!(fs::read_dir(&folder.0).unwrap().count(), 0, "what could not be written is removed");
    }

    #[test]
    fn a_process_killed_while_it_writes_leaves_no_cache() {
        let folder = Folder::new("killed");
        // The system kills who writes a file longer than the limit.
        let output = limited_child(&folder, "");
        assert!(output.status.signal().is_some(), "{:?}", output.status);
        assert_eq!(folder.files(".keys"), [] as [PathBuf; 0]);
        let left = folder.files("");
        assert!(left.len() == 1 && fs::metadata(&left[0]).unwrap().len() == 4096, "killed half way");
        let made = scene(&folder.0);
        assert!(made.notes.is_empty() && folder.files(".keys").len() == 1);
        let other = Folder::new("not-killed");
        assert!(positions(&made) == positions(&scene(&other.0)));
    }
}

#[test]
fn a_file_has_a_million_frames_at_most() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("long.aff");
    fs::write(&path, "p 3  0 0 0  1 0 0  0 1 0\na 0 1 4000000000\n").expect("a folder for tests");
    let scene = load(path.to_str().expect("UTF-8"), None, &SceneOptions::default()).expect("a scene");
    assert_eq!(scene.frames, 1_000_001);
}
