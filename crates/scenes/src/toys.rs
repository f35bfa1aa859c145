//! A small glTF file with each kind of motion, for examples, tests and first tries:
//! `assets/toys.glb`.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::{DQuat, Vec3, vec3};

use crate::glb::{Glb, Influence};
use crate::rigid::{rotated, rotation};
use crate::shape::{Mesh, sphere, square, turned};

const SECONDS: f32 = 2.0;
/// Height of the stalk, and of each of its joints above the one below.
const HEIGHT: f32 = 1.6;
const JOINTS: usize = 4;
const STEP: f32 = HEIGHT / JOINTS as f32;

/// Returns the bytes of a binary glTF 2.0 file (.glb) with a stalk that sways (skin), a ball that
/// bounces and flattens (morph and rigid), a windmill (rigid), and ground that stands still. Always
/// the same bytes.
#[must_use]
pub fn toys_glb() -> Vec<u8> {
    let mut glb = Glb::new(SECONDS);
    stalk(&mut glb, vec3(-1.4, 0.0, 0.0));
    ball(&mut glb, vec3(0.2, 0.0, 0.8));
    windmill(&mut glb, vec3(1.5, 0.0, -0.4));
    let earth = glb.material([0.32, 0.36, 0.22]);
    glb.mesh("ground", None, &square(7.0, 12), earth);
    glb.camera(vec3(1.2, 2.0, 5.0), vec3(0.0, 0.8, 0.0), 0.7);
    glb.point_light(vec3(3.0, 5.0, 4.0));
    glb.finish()
}

fn stalk(glb: &mut Glb, place: Vec3) {
    let profile = |i: usize| {
        let y = HEIGHT * (1.0 - i as f32 / 41.0);
        (0.05 + 0.08 * (1.0 - y / HEIGHT) + 0.12 * libm::expf(-40.0 * (y - 1.45) * (y - 1.45)), y)
    };
    let mesh = turned(&(0..=41).map(profile).collect::<Vec<_>>(), 28);
    let influence = |p: Vec3| -> Influence {
        let at = (p.y / STEP).clamp(0.0, JOINTS as f32 - 1.001);
        let (joint, part) = (at as u8, at % 1.0);
        ([joint, joint + 1, 0, 0], [1.0 - part, part, 0.0, 0.0])
    };
    let green = glb.material([0.25, 0.6, 0.2]);
    let foot = glb.node("stalk", None, place, DQuat::IDENTITY);
    let mut joints = vec![glb.node("joint", Some(foot), Vec3::ZERO, DQuat::IDENTITY)];
    while joints.len() < JOINTS {
        joints.push(glb.node("joint", joints.last().copied(), STEP * Vec3::Y, DQuat::IDENTITY));
    }
    let places: Vec<Vec3> = (0..JOINTS).map(|joint| joint as f32 * STEP * Vec3::Y).collect();
    glb.skinned("stalk body", &mesh, influence, (&joints, &places), green);
    for (i, &joint) in joints.iter().enumerate() {
        let swing = |k| libm::sinf(TAU * k as f32 / 24.0 - 0.6 * i as f32);
        glb.rotate(joint, (0..=24).map(|k| rotation(Vec3::Z, 0.25 * swing(k))));
    }
}

fn ball(glb: &mut Glb, place: Vec3) {
    let body = sphere(0.35, 40, 20);
    let flat = body.positions.iter().map(|p| vec3(1.25 * p.x, 0.6 * p.y - 0.14, 1.25 * p.z)).collect();
    let red = glb.material([0.8, 0.2, 0.15]);
    let node = glb.morphed("ball", None, &body, &[flat], red);
    let height = |k: usize| libm::fabsf(libm::sinf(PI * k as f32 / 12.0));
    glb.translate(node, (0..=24).map(|k| place + vec3(0.0, 0.35 + 0.9 * height(k), 0.0)));
    glb.morph(node, (0..=24).map(|k| [(1.0 - 3.0 * height(k)).max(0.0)]));
}

fn windmill(glb: &mut Glb, place: Vec3) {
    let [white, brown] = [[0.85, 0.85, 0.8], [0.45, 0.3, 0.2]].map(|color| glb.material(color));
    let tower = turned(&[(0.0, 1.5), (0.16, 1.5), (0.22, 1.0), (0.3, 0.0), (0.0, 0.0)], 24);
    let foot = glb.node("windmill", None, place, DQuat::IDENTITY);
    glb.mesh("tower", Some(foot), &tower, brown);
    let mut sails = Mesh::default();
    for sail in 0..4 {
        let turn = rotation(Vec3::Z, FRAC_PI_2 * sail as f32);
        let at = |x: f32, y: f32| rotated(turn, vec3(x, y, 0.15 * x));
        for row in 0..8 {
            let [y, above] = [row, row + 1].map(|row| 0.1 + 0.1 * row as f32);
            let [a, b, c, d] = [at(0.0, y), at(0.2, y), at(0.2, above), at(0.0, above)];
            sails.add(&[[a, b, c], [a, c, d]]);
        }
    }
    let hub = glb.node("hub", Some(foot), vec3(0.0, 1.3, 0.3), DQuat::IDENTITY);
    glb.mesh("sails", Some(hub), &sails, white);
    glb.rotate(hub, (0..=16).map(|k| rotation(Vec3::Z, TAU * k as f32 / 16.0)));
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use anim::Motion;

    use super::*;

    #[test]
    fn the_asset_is_what_this_writes_and_has_every_kind_of_motion() {
        let bytes = toys_glb();
        let asset = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/toys.glb");
        let written = std::fs::read(asset).unwrap();
        assert!(written == bytes, "run `cargo xtask export toys assets/toys.glb`");
        assert!(bytes.len() < 300_000, "{} bytes", bytes.len());
        let animation = anim::parse(Path::new("toys.glb"), &bytes, &Default::default()).unwrap();
        let motion: Motion = animation.topology().parts.iter().map(|part| part.motion).collect();
        assert_eq!(motion, Motion::SKIN | Motion::MORPH | Motion::RIGID);
        assert!(animation.topology().moves.contains(&false), "the ground stands still");
    }
}
