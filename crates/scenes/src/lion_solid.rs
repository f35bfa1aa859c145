//! The solid of a lion that sits on a plinth, about 9 high; it looks along +z, and the plinth
//! stands on y = 0.

use std::f32::consts::TAU;

use glam::{Vec3, vec3};

use crate::implicit::{Shape, Solid};

/// The lion with its plinth.
pub(crate) fn solid() -> Solid {
    let mut half = Solid::default();
    legs(&mut half);
    let mut lion = Solid::default();
    plinth(&mut lion);
    body(&mut lion);
    lion.both_sides(&half);
    mane(&mut lion);
    face(&mut lion);
    lion
}

fn plinth(lion: &mut Solid) {
    for (middle, half) in
        [(0.32, vec3(2.75, 0.28, 3.45)), (0.9, vec3(2.4, 0.35, 3.1)), (1.42, vec3(2.6, 0.14, 3.3))]
    {
        lion.add(0.02, Shape::Block { center: vec3(0.0, middle, 0.0), half, grown: 0.04 });
    }
}

fn body(lion: &mut Solid) {
    let trunk = [
        (vec3(0.0, 2.75, -1.5), 1.15),
        (vec3(0.0, 4.1, -0.5), 1.05),
        (vec3(0.0, 5.2, 0.4), 1.1),
        (vec3(0.0, 6.6, 0.9), 0.9),
    ];
    // A short blend, so that the lion stands on the plinth without melting into it.
    lion.limb(0.05, &trunk);
    let tail = [
        (vec3(0.0, 2.05, -2.4), 0.26),
        (vec3(0.9, 1.85, -2.85), 0.23),
        (vec3(1.8, 1.82, -2.5), 0.2),
        (vec3(2.2, 1.8, -1.5), 0.18),
        (vec3(2.2, 1.8, -0.6), 0.16),
    ];
    lion.limb(0.1, &tail);
    lion.ellipsoid(0.1, vec3(2.18, 1.86, -0.1), vec3(0.27, 0.25, 0.55));
}

fn legs(half: &mut Solid) {
    half.ellipsoid(0.3, vec3(1.1, 2.75, -0.95), vec3(0.62, 1.15, 1.15));
    half.limb(0.15, &[(vec3(1.35, 1.95, -1.3), 0.4), (vec3(1.45, 1.85, 0.3), 0.3)]);
    paw(half, vec3(1.45, 1.8, 0.5));
    let foreleg = [
        (vec3(0.7, 5.0, 0.6), 0.75),
        (vec3(0.78, 3.6, 1.2), 0.5),
        (vec3(0.78, 2.7, 1.45), 0.38),
        (vec3(0.78, 2.0, 1.5), 0.38),
    ];
    half.limb(0.25, &foreleg);
    paw(half, vec3(0.78, 1.82, 1.75));
}

fn paw(half: &mut Solid, at: Vec3) {
    half.ellipsoid(0.12, at, vec3(0.46, 0.3, 0.5));
    for k in 0..4 {
        let side = k as f32 - 1.5;
        half.ellipsoid(0.03, at + vec3(0.21 * side, -0.06, 0.5 - 0.05 * side * side), vec3(0.14, 0.17, 0.24));
    }
}

/// Tufts of hair that lie on a mass of hair around the face and down the chest.
fn mane(lion: &mut Solid) {
    let masses = [
        (vec3(0.0, 7.0, 0.75), vec3(1.4, 1.5, 1.05)),
        (vec3(0.0, 5.5, 0.75), vec3(1.25, 1.35, 1.0)),
        (vec3(0.0, 5.9, 0.0), vec3(1.15, 1.5, 0.9)),
    ];
    for (center, radii) in masses {
        lion.ellipsoid(0.3, center, radii);
    }
    // Rings about the axis of the face; hair flows away from it and down.
    let axis = vec3(0.0, 7.1, 0.0);
    for ring in 0..6 {
        let back = ring as f32 / 5.0;
        let (spread, z) = (1.02 + 0.42 * back, 1.65 - 1.9 * back);
        let count = 17 + ring;
        for k in 0..count {
            let (sin, cos) = libm::sincosf(TAU * (k as f32 + 0.5 * (ring % 2) as f32) / count as f32);
            let from = axis + vec3(spread * sin, spread * cos, z);
            let length = 0.65 + 0.15 * libm::sinf(7.0 * (k * 3 + ring) as f32);
            let along = vec3(0.75 * sin, 0.75 * cos - 0.35, -0.35).normalize() * length;
            let tuft =
                [(from, 0.22), (from + 0.6 * along, 0.17), (from + along + vec3(0.0, -0.1, 0.05), 0.07)];
            lion.limb(0.05, &tuft);
        }
    }
    // The chest, hanging down in rows.
    for row in 0..6 {
        let y = 6.1 - 0.42 * row as f32;
        let count = 7 - row % 2;
        for k in 0..count {
            let across = k as f32 - 0.5 * (count - 1) as f32;
            let x = 0.33 * across * (1.0 - 0.06 * row as f32);
            let from = vec3(x, y, 1.55 - 0.1 * across * across + 0.12 * (5 - row) as f32 * 0.3);
            let tip = from + vec3(0.12 * x, -0.62, 0.1);
            lion.limb(0.05, &[(from, 0.21), (from.lerp(tip, 0.6) + 0.06 * Vec3::Z, 0.15), (tip, 0.06)]);
        }
    }
}

fn face(lion: &mut Solid) {
    lion.ellipsoid(0.12, vec3(0.0, 7.25, 1.45), vec3(0.86, 0.88, 0.8));
    lion.limb(0.12, &[(vec3(0.0, 7.65, 1.95), 0.34), (vec3(0.0, 7.2, 2.6), 0.23)]);
    lion.ellipsoid(0.12, vec3(0.0, 6.62, 2.15), vec3(0.42, 0.26, 0.45));
    for side in [-1.0, 1.0] {
        let at = |x: f32, y: f32, z: f32| vec3(side * x, y, z);
        lion.ellipsoid(0.1, at(0.24, 6.93, 2.38), vec3(0.36, 0.3, 0.42));
        lion.ellipsoid(0.1, at(0.5, 7.0, 1.85), vec3(0.36, 0.4, 0.4));
        lion.limb(0.1, &[(at(0.14, 7.72, 2.1), 0.14), (at(0.55, 7.66, 1.9), 0.13)]);
        // Ears stand out of the mane.
        lion.ellipsoid(0.05, at(0.82, 8.15, 1.35), vec3(0.32, 0.34, 0.17));
        lion.carve(0.05, Shape::Ellipsoid { center: at(0.84, 8.15, 1.55), radii: vec3(0.18, 0.2, 0.16) });
        let eye = at(0.36, 7.45, 2.06);
        lion.carve(0.05, Shape::Ellipsoid { center: eye + 0.1 * Vec3::Z, radii: vec3(0.19, 0.12, 0.16) });
        lion.ball(0.01, eye, 0.12);
        // The mouth, from below the nose outwards, and whisker pits.
        let line = [at(0.0, 6.78, 2.82), at(0.16, 6.7, 2.76), at(0.42, 6.68, 2.5), at(0.6, 6.78, 2.2)];
        for pair in line.windows(2) {
            lion.carve(0.03, Shape::Cone { from: pair[0], to: pair[1], radius: (0.045, 0.045) });
        }
    }
    let groove = Shape::Cone { from: vec3(0.0, 7.0, 2.86), to: vec3(0.0, 6.78, 2.84), radius: (0.04, 0.04) };
    lion.carve(0.03, groove);
    lion.ellipsoid(0.03, vec3(0.0, 7.14, 2.72), vec3(0.24, 0.15, 0.15));
}
