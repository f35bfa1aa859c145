//! What key frames cost in accuracy: a scene with few against the same simulation with many.

use scenes::{Distance, Scene, SceneOptions, distance, load};

/// A scene with that number of spaces between key frames and 960 simulation steps in all.
fn scene(name: &str, spaces: usize) -> Scene {
    let options = SceneOptions {
        key_frames: Some(spaces + 1),
        substeps: Some(960 / spaces),
        detail: Some(0.01),
        ..SceneOptions::default()
    };
    load(name, None, &options).unwrap()
}

#[test]
fn more_key_frames_are_nearer_to_the_finely_sampled_motion() {
    for name in ["n-body", "cloth-ball", "exploding-dragon"] {
        let fine = scene(name, 480);
        let times = (0..97).map(|time| f64::from(time) / 96.0);
        let of = |spaces| distance(&*scene(name, spaces).animation, &*fine.animation, times.clone()).unwrap();
        let [few, more, many] = [12, 48, 240].map(of);
        println!("{name}: {few:?}, {more:?}, {many:?}");
        assert!(few.rms > 2.0 * more.rms && more.rms > 2.0 * many.rms, "{name}");
        assert!(few.max < 1.0 && few.rms < few.max && many.max < few.max, "{name}");
        let itself = distance(&*fine.animation, &*fine.animation, times.clone()).unwrap();
        assert_eq!((itself.rms, itself.max), (0.0, 0.0));
        assert!(itself.extent > 1.0);
    }
}

#[test]
fn distance_is_in_units_of_the_extent_and_none_where_nothing_can_be_compared() {
    let keys = |places: &[(f32, f32)]| {
        let dir = tempfile::tempdir().unwrap();
        for (i, (x, z)) in places.iter().enumerate() {
            let [x1, z1] = [x + 1e-3, z + 1e-3];
            let text = format!("v {x} 0 {z}\nv {x1} 0 {z}\nv {x} 0 {z1}\nf 1 2 3\n");
            std::fs::write(dir.path().join(format!("key{i}.obj")), text).unwrap();
        }
        load(dir.path().to_str().unwrap(), None, &SceneOptions::default()).unwrap().animation
    };
    // Both of three key frames, from 0 to 30; in the middle the second is 40 aside of the first.
    let straight = keys(&[(0.0, 0.0), (15.0, 0.0), (30.0, 0.0)]);
    let aside = keys(&[(0.0, 0.0), (15.0, 40.0), (30.0, 0.0)]);
    let Distance { rms, max, extent } = distance(&*straight, &*aside, [0.0, 0.5, 1.0]).unwrap();
    assert!((extent - 50.0).abs() < 0.01, "{extent}");
    assert!((max - 0.8).abs() < 1e-3 && (rms - 0.8 / 3_f64.sqrt()).abs() < 1e-3, "{max} {rms}");
    let still = keys(&[(0.0, 0.0)]);
    assert_eq!(distance(&*straight, &*still, [0.0, 0.5, 1.0]), None, "nothing moves");
    assert_eq!(
        distance(
            &*load(
                "cloth-ball",
                None,
                &SceneOptions {
                    detail: Some(0.001),
                    key_frames: Some(2),
                    substeps: Some(1),
                    ..SceneOptions::default()
                }
            )
            .unwrap()
            .animation,
            &*straight,
            [0.0, 0.5, 1.0]
        ),
        None,
        "other vertices"
    );
}
