use super::*;
use crate::Animation;
use crate::glam::Vec3;
use std::fs;

fn ascii_ply(top: f32) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 {top}\n0 1 0\n4 0 1 2 3\n"
    )
}

#[test]
fn natural_order_of_names() {
    let mut names =
        ["frame10", "frame2", "frame02", "frame1", "a", "frame", "frame2b", "frame99999999999999999999999"];
    names.sort_by_key(|name| natural_order(name));
    let expected =
        ["a", "frame", "frame1", "frame2", "frame02", "frame2b", "frame10", "frame99999999999999999999999"];
    assert_eq!(names, expected);
}

#[test]
fn frames_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    for number in [10, 2, 1] {
        fs::write(folder.path().join(format!("frame{number}.ply")), ascii_ply(number as f32)).unwrap();
    }
    fs::write(folder.path().join("notes.txt"), "not a frame").unwrap();
    fs::write(folder.path().join("print.stl"), "not a frame").unwrap();
    let animation = load(folder.path(), DVec3::ZERO).unwrap();
    assert_eq!(animation.topology().moves, [true, true]);
    assert!((animation.duration() - 2.0 / 24.0).abs() < 1e-12);
    let mut positions = animation.rest();
    for (key, top) in [(0.0, 1.0), (0.5, 1.5), (1.0, 2.0), (2.0, 10.0)] {
        let written = animation.pose(key / 24.0, &mut positions).key_frames.count;
        assert_eq!((written, positions[2]), (1, Vec3::new(1.0, 1.0, top)));
    }
}

#[test]
fn two_frames_go_back_and_forth() {
    let folder = tempfile::tempdir().unwrap();
    for number in [0, 1] {
        fs::write(folder.path().join(format!("{number}.ply")), ascii_ply(number as f32)).unwrap();
    }
    let animation = load(folder.path(), DVec3::ZERO).unwrap();
    assert_eq!(animation.duration(), 2.0 / 24.0);
    let mut positions = animation.rest();
    for (key, top) in [(1.0, 1.0), (1.5, 0.5), (2.0, 0.0)] {
        animation.pose(key / 24.0, &mut positions);
        assert_eq!(positions[2].z, top);
    }
}

#[test]
fn differing_frames_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("f1.ply"), ascii_ply(0.0)).unwrap();
    let message = |other: String| {
        fs::write(path("f2.ply"), other).unwrap();
        let message = load(folder.path(), DVec3::ZERO).unwrap_err().to_string();
        assert!(message.starts_with(&path("f2.ply").display().to_string()), "{message}");
        assert!(message.contains(&path("f1.ply").display().to_string()), "{message}");
        message
    };
    assert!(message(ascii_ply(0.0).replace("4 0 1 2 3", "3 0 1 2")).contains("1 triangles, not 2"));
    let turned = message(ascii_ply(0.0).replace("4 0 1 2 3", "4 1 2 3 0"));
    assert!(turned.contains("triangle 0 joins vertices [1, 2, 3], not [0, 1, 2]"), "{turned}");
    let more = ascii_ply(0.0).replace("vertex 4", "vertex 5").replace("4 0 1 2 3", "9 9 9\n4 0 1 2 3");
    assert!(message(more).contains("5 vertices, not 4"));
}

#[test]
fn directories_without_a_sequence() {
    let folder = tempfile::tempdir().unwrap();
    assert!(load(folder.path(), DVec3::ZERO).unwrap_err().to_string().contains("without .ply or .obj"));
    fs::write(folder.path().join("a.ply"), ascii_ply(0.0)).unwrap();
    fs::write(folder.path().join("b.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert!(load(folder.path(), DVec3::ZERO).unwrap_err().to_string().contains("both .ply and .obj"));
    assert!(matches!(load(&folder.path().join("missing"), DVec3::ZERO), Err(LoadError::Io { .. })));
}
