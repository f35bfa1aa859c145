//! The solid of a winged dragon, about 12 wide, 7 high, and 11 long; it looks along +z and stands
//! on y = 0.

use glam::{Vec3, vec3};

use crate::implicit::{Shape, Solid};

/// The dragon, from blended limbs, with thin wings.
pub(crate) fn solid() -> Solid {
    let mut half = Solid::default();
    legs(&mut half);
    wing(&mut half);
    let horn = [(vec3(0.22, 6.15, 3.35), 0.15), (vec3(0.42, 6.6, 2.8), 0.1), (vec3(0.48, 6.8, 2.1), 0.02)];
    half.limb(0.05, &horn);
    half.limb(0.05, &[(vec3(0.35, 5.85, 3.3), 0.1), (vec3(0.75, 6.0, 2.9), 0.02)]);
    half.ball(0.05, vec3(0.26, 6.12, 3.85), 0.13);

    let mut dragon = Solid::default();
    body(&mut dragon);
    head(&mut dragon);
    dragon.both_sides(&half);
    dragon
}

fn body(dragon: &mut Solid) {
    let trunk = [
        (vec3(0.0, 2.2, -1.6), 0.85),
        (vec3(0.0, 2.1, 0.0), 1.0),
        (vec3(0.0, 2.6, 1.4), 0.95),
        (vec3(0.0, 3.6, 2.2), 0.62),
        (vec3(0.0, 4.7, 2.4), 0.46),
        (vec3(0.0, 5.4, 2.8), 0.38),
        (vec3(0.0, 5.8, 3.4), 0.4),
    ];
    dragon.limb(0.35, &trunk);
    let tail = [
        (vec3(0.0, 2.0, -2.2), 0.7),
        (vec3(0.2, 1.3, -3.5), 0.48),
        (vec3(0.8, 0.75, -4.6), 0.36),
        (vec3(1.7, 0.45, -5.3), 0.27),
        (vec3(2.8, 0.4, -5.4), 0.2),
        (vec3(3.7, 0.7, -4.9), 0.12),
        (vec3(4.1, 1.3, -4.5), 0.08),
    ];
    dragon.limb(0.35, &tail);
    for corner in [vec3(3.75, 1.35, -4.75), vec3(4.35, 1.25, -4.15)] {
        let corners = [vec3(4.05, 1.15, -4.5), corner, vec3(4.3, 2.1, -4.3)];
        dragon.add(0.03, Shape::Triangle { corners, grown: 0.06 });
    }
    // Spikes along the back, from neck to tail.
    let back = [
        (vec3(0.0, 5.75, 2.5), 0.35),
        (vec3(0.0, 5.15, 2.05), 0.4),
        (vec3(0.0, 4.5, 1.75), 0.45),
        (vec3(0.0, 3.85, 1.4), 0.5),
        (vec3(0.0, 3.4, 0.8), 0.5),
        (vec3(0.0, 3.1, 0.1), 0.5),
        (vec3(0.0, 3.0, -0.6), 0.5),
        (vec3(0.0, 3.0, -1.3), 0.5),
        (vec3(0.0, 2.75, -2.0), 0.45),
        (vec3(0.02, 2.3, -2.65), 0.4),
        (vec3(0.1, 1.85, -3.25), 0.36),
        (vec3(0.35, 1.4, -3.85), 0.32),
        (vec3(0.8, 1.05, -4.45), 0.28),
        (vec3(1.4, 0.75, -5.0), 0.24),
        (vec3(2.2, 0.6, -5.35), 0.2),
    ];
    for (at, height) in back {
        dragon.limb(0.08, &[(at, 0.32 * height), (at + vec3(0.0, 0.8 * height, -0.7 * height), 0.015)]);
    }
}

fn head(dragon: &mut Solid) {
    dragon.ellipsoid(0.2, vec3(0.0, 5.9, 3.55), vec3(0.42, 0.38, 0.6));
    dragon.limb(0.2, &[(vec3(0.0, 5.85, 3.9), 0.32), (vec3(0.0, 5.78, 4.85), 0.22)]);
    let jaw = [(vec3(0.0, 5.6, 3.6), 0.26), (vec3(0.0, 5.2, 4.2), 0.19), (vec3(0.0, 5.08, 4.65), 0.13)];
    dragon.limb(0.06, &jaw);
    for side in [-1.0, 1.0] {
        dragon.ball(0.06, vec3(side * 0.12, 5.96, 4.9), 0.1);
        for k in 0..4 {
            let z = 4.1 + 0.22 * k as f32;
            let upper = vec3(side * 0.18, 5.62, z);
            dragon.limb(0.06, &[(upper, 0.05), (upper - Vec3::Y * 0.17, 0.01)]);
        }
    }
}

fn legs(half: &mut Solid) {
    let front = [
        (vec3(0.7, 2.4, 1.5), 0.52),
        (vec3(1.05, 1.35, 1.0), 0.34),
        (vec3(1.05, 0.45, 1.5), 0.23),
        (vec3(1.05, 0.24, 1.85), 0.24),
    ];
    let hind = [
        (vec3(0.65, 2.1, -1.6), 0.75),
        (vec3(1.15, 1.35, -0.8), 0.48),
        (vec3(1.15, 0.6, -1.7), 0.26),
        (vec3(1.15, 0.25, -1.15), 0.25),
    ];
    for (leg, foot) in [(front, vec3(1.05, 0.16, 2.0)), (hind, vec3(1.15, 0.16, -1.0))] {
        half.limb(0.25, &leg);
        claws(half, foot);
    }
}

fn claws(half: &mut Solid, foot: Vec3) {
    for k in -1..=1 {
        let side = 0.17 * k as f32;
        let claw = [
            (foot + vec3(side, 0.0, 0.0), 0.13),
            (foot + vec3(1.6 * side, 0.03, 0.32), 0.1),
            (foot + vec3(2.0 * side, -0.1, 0.6), 0.02),
        ];
        half.limb(0.06, &claw);
    }
}

fn wing(half: &mut Solid) {
    const MEMBRANE: f32 = 0.06;
    let (shoulder, elbow, wrist) = (vec3(0.55, 3.2, 0.9), vec3(1.9, 4.7, 0.2), vec3(3.1, 6.3, 0.4));
    let root = vec3(0.5, 2.9, -1.4);
    let tips = [vec3(6.1, 6.9, -0.6), vec3(5.9, 5.1, -1.6), vec3(4.7, 3.7, -2.2), vec3(2.8, 2.9, -2.4)];
    half.limb(0.08, &[(shoulder, 0.34), (elbow, 0.19), (wrist, 0.14)]);
    half.limb(0.08, &[(wrist, 0.1), (wrist + vec3(0.1, 0.5, 0.3), 0.02)]);
    for tip in tips {
        half.limb(0.08, &[(wrist, 0.12), (wrist.lerp(tip, 0.5) + Vec3::Y * 0.15, 0.09), (tip, 0.05)]);
    }
    let mut panel = |corners| {
        half.add(0.04, Shape::Triangle { corners, grown: MEMBRANE });
    };
    // Between fingers the edge hangs in, as skin does.
    for pair in tips.windows(2) {
        let inner = pair[0].lerp(pair[1], 0.5).lerp(wrist, 0.22);
        panel([wrist, pair[0].lerp(wrist, 0.03), inner]);
        panel([wrist, inner, pair[1].lerp(wrist, 0.03)]);
    }
    let inner = tips[3].lerp(root, 0.5).lerp(elbow, 0.25);
    panel([elbow, wrist, tips[3]]);
    panel([elbow, tips[3], inner]);
    panel([elbow, inner, root]);
    panel([elbow, shoulder, root]);
}
