//! Simulations stay stable: finite positions, bounded stretch, energy and penetration, from steps
//! that are far too large to 10,000 frames of small ones. The bounds shrink with the step.

use anim::glam::Vec3;
use scenes::{Scene, SceneOptions, load};

/// Key frames in a loop, and simulation steps between two of them: 1, 59, 236, 3776 and 9999 steps
/// in all.
const STEPS: [(usize, usize); 5] = [(2, 1), (60, 1), (60, 4), (60, 64), (10_000, 1)];

fn simulated(name: &str, (key_frames, substeps): (usize, usize)) -> Scene {
    let options = SceneOptions {
        detail: Some(0.01),
        key_frames: Some(key_frames),
        substeps: Some(substeps),
        ..SceneOptions::default()
    };
    load(name, None, &options).unwrap()
}

/// Seconds of one simulation step.
fn step_time(scene: &Scene, (key_frames, substeps): (usize, usize)) -> f32 {
    scene.animation.duration() as f32 / ((key_frames - 1) * substeps) as f32
}

/// Calls `check` with the positions at every key frame.
fn each_frame(scene: &Scene, keys: usize, mut check: impl FnMut(&[Vec3])) {
    let mut positions = scene.animation.rest();
    for frame in 0..keys {
        scene.animation.pose(scene.animation.duration() * frame as f64 / (keys - 1) as f64, &mut positions);
        assert!(positions.iter().all(|p| p.is_finite()), "{} at key frame {frame}", scene.name);
        check(&positions);
    }
}

/// How far a ball is out of the box that the balls are in.
fn out_of_the_box(p: Vec3) -> f32 {
    (p.x.abs() - 5.3).max(p.z.abs() - 5.3).max(-p.y).max(p.y - 10.0)
}

#[test]
fn n_body_keeps_its_energy_and_its_balls_at_every_step_size() {
    let mut drifts = Vec::new();
    // The fourth takes as long as the others together, and the fifth is finer.
    for steps in STEPS.into_iter().filter(|&steps| steps != STEPS[3]) {
        let scene = simulated("n-body", steps);
        let mut out = 0.0f32;
        each_frame(&scene, steps.0, |positions| {
            for p in positions {
                out = out.max(out_of_the_box(*p));
            }
        });
        println!("{steps:?}: drift {:.1e}, {out} out of the box", scene.measures[0].value);
        drifts.push(scene.measures[0].value);
        // A ball may be out by the way of one step.
        assert!(out < 0.01 + 200.0 * step_time(&scene, steps), "{steps:?}: {out} out of the box");
    }
    assert!(drifts.windows(2).all(|w| w[1] < w[0]), "smaller steps, less drift: {drifts:?}");
    assert!(drifts[1] < 0.1 && drifts[2] < 1e-3 && drifts[3] < 1e-6, "{drifts:?}");
}

#[test]
fn cloth_stretches_less_with_smaller_steps_and_never_enters_ball_or_floor() {
    let mut strains = Vec::new();
    for steps in STEPS {
        let scene = simulated("cloth-ball", steps);
        let cloth = &scene.animation.topology().parts[0];
        assert_eq!(cloth.name, "cloth");
        let vertices = cloth.vertices.start as usize..cloth.vertices.end as usize;
        let (mut lowest, mut nearest, mut farthest) = (f32::MAX, f32::MAX, 0.0f32);
        each_frame(&scene, steps.0, |positions| {
            for p in &positions[vertices.clone()] {
                lowest = lowest.min(p.y);
                nearest = nearest.min(p.distance(Vec3::new(0.0, 6.68, 0.0)));
                farthest = farthest.max(p.length());
            }
        });
        println!("{steps:?}: stretch {:?}, {lowest} high, {nearest} from the ball", scene.measures);
        assert!(
            lowest >= 0.0 && nearest >= 5.0 && farthest < 100.0,
            "{steps:?}: {lowest} {nearest} {farthest}"
        );
        strains.push(scene.measures[0].value);
    }
    // In one step the cloth hardly moves at all.
    assert!(strains[1..].windows(2).all(|w| w[1] < w[0]), "smaller steps, less stretch: {strains:?}");
    assert!(strains[1] < 1.0 && strains[4] < 1e-3, "{strains:?}");
}

#[test]
fn shards_stay_rigid_and_sink_no_deeper_than_one_step_falls() {
    for name in ["exploding-dragon", "lion"] {
        for steps in STEPS {
            let scene = simulated(name, steps);
            let topology = scene.animation.topology();
            let rest = scene.animation.rest();
            let (mut depth, mut bent, mut far) = (0.0f32, 0.0f32, 0.0f32);
            each_frame(&scene, steps.0, |positions| {
                for &[a, b, _] in &topology.triangles {
                    let (a, b) = (a as usize, b as usize);
                    bent = bent.max((rest[a].distance(rest[b]) - positions[a].distance(positions[b])).abs());
                }
                depth = positions.iter().map(|p| -p.y).fold(depth, f32::max);
                far = positions.iter().map(|p| p.length()).fold(far, f32::max);
            });
            println!("{name}, {steps:?}: {depth} deep, {bent} bent, {far} away");
            // Nothing falls faster than 25 a second from these heights; 0.1 is what contact gives
            // way.
            assert!(depth < 0.1 + 25.0 * step_time(&scene, steps), "{name}, {steps:?}: {depth} deep");
            // Rounding of coordinates grows with the distance.
            assert!(bent < 1e-3 + 1e-6 * far, "{name}, {steps:?}: bent by {bent}");
            // The corners of the ground are 50 away.
            assert!(far < 60.0, "{name}, {steps:?}: {far} away");
        }
    }
}

/// Contact that undoes overlaps must not turn them into speed: without that, shards leave at 50 a
/// second and more.
#[test]
fn shards_fly_no_faster_than_they_are_kicked_and_fall() {
    // Height and gravity give sqrt(2 * 12 * 10) = 15 a second to what falls; a kick of the dragon's
    // is at most 26.
    for (name, limit) in [("exploding-dragon", 30.0), ("lion", 20.0)] {
        let scene =
            load(name, None, &SceneOptions { detail: Some(0.05), ..SceneOptions::default() }).unwrap();
        let parts: Vec<_> =
            scene.animation.topology().parts.iter().filter(|part| part.name == "shard").collect();
        let centers = |positions: &[Vec3]| -> Vec<Vec3> {
            let center = |vertices: &std::ops::Range<u32>| {
                let all = &positions[vertices.start as usize..vertices.end as usize];
                all.iter().sum::<Vec3>() / all.len() as f32
            };
            parts.iter().map(|part| center(&part.vertices)).collect()
        };
        let seconds = scene.animation.duration() as f32 / (scene.frames - 1) as f32;
        let (mut before, mut fastest) = (centers(&scene.animation.rest()), vec![0.0f32; parts.len()]);
        each_frame(&scene, scene.frames, |positions| {
            let now = centers(positions);
            for ((fastest, now), before) in fastest.iter_mut().zip(&now).zip(&before) {
                *fastest = fastest.max(now.distance(*before) / seconds);
            }
            before = now;
        });
        fastest.sort_by(f32::total_cmp);
        println!("{name}: fastest shards {:?}", &fastest[fastest.len() - 5..]);
        assert!(fastest.iter().all(|&speed| speed < limit), "{name}: a shard at {:?}", fastest.last());
    }
}

#[test]
fn the_smallest_steps_still_make_the_stone_fall() {
    let scene = simulated("lion", (2, 40_000));
    assert!(scene.simulated.fracture > 0, "{:?}", scene.simulated);
}

/// In `f32`, rounding took away what gravity adds in such a step.
#[test]
fn the_smallest_steps_still_make_the_cloth_fall() {
    let steps = (2, 50_000);
    let options = SceneOptions {
        detail: Some(0.001),
        key_frames: Some(steps.0),
        substeps: Some(steps.1),
        ..SceneOptions::default()
    };
    let scene = load("cloth-ball", None, &options).unwrap();
    let mut lowest = f32::MAX;
    each_frame(&scene, steps.0, |x| lowest = x.iter().map(|p| p.y).fold(lowest, f32::min));
    assert!(lowest < 0.2, "{lowest} high");
}

/// 10,000 key frames of every simulation at three step sizes; a few minutes.
#[test]
#[ignore = "simulates 840,000 steps"]
fn ten_thousand_frames_are_finite_and_bounded_at_several_step_sizes() {
    // The most that each scene's first measure may be with one step a frame: drift, stretch,
    // depths.
    for (name, most) in [("n-body", 1e-6), ("cloth-ball", 1e-3), ("exploding-dragon", 0.1), ("lion", 0.1)] {
        for substeps in [1, 4, 16] {
            let scene = simulated(name, (10_000, substeps));
            let cloth = scene.animation.topology().parts[0].vertices.clone();
            let (mut far, mut inside) = (0.0f32, 0.0f32);
            each_frame(&scene, 10_000, |positions| {
                far = positions.iter().map(|p| p.length()).fold(far, f32::max);
                let depth = |p: &Vec3| match name {
                    "n-body" => out_of_the_box(*p),
                    "cloth-ball" => (-p.y).max(5.0 - p.distance(Vec3::new(0.0, 6.68, 0.0))),
                    _ => -p.y,
                };
                let solid = if name == "cloth-ball" { cloth.end as usize } else { positions.len() };
                inside = positions[..solid].iter().map(depth).fold(inside, f32::max);
            });
            let value = scene.measures[0].value;
            let what = &scene.measures[0].name;
            println!("{name}, {substeps} steps a frame: {what} {value:.1e}, {inside} inside, {far} away");
            // As in the tests above: the way of one step, nothing, and what contact gives way.
            let most_inside = match name {
                "n-body" => 0.01 + 200.0 * step_time(&scene, (10_000, substeps)),
                "cloth-ball" => 0.0,
                _ => 0.1 + 25.0 * step_time(&scene, (10_000, substeps)),
            };
            assert!(value <= most && far < 60.0, "{name}, {substeps} steps a frame: {value} and {far} away");
            assert!(inside <= most_inside, "{name}, {substeps} steps a frame: {inside} inside");
        }
    }
}
