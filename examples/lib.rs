//! Three programs, each short enough to read at once:
//!
//! * `cast_rays`: build a tree over triangles and find what rays hit,
//! * `animate`: keep a tree good while its triangles move, by refitting and rotating,
//! * `broad_phase`: overlapping boxes, for the collision loop of a physics engine.
//!
//! Run one with `cargo run --release -p pivot-examples --example cast_rays`. This library holds the
//! meshes they share.
#![forbid(unsafe_code)]

use pivot_bvh::Vec3;

/// A sphere of radius 1 around the origin: positions, and `2 * rings * rings` triangles, seen from
/// outside.
#[must_use]
pub fn sphere(rings: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let around = 2 * rings;
    let point = |ring: u32, i: u32| {
        let (polar, angle) = (
            std::f32::consts::PI * ring as f32 / rings as f32,
            std::f32::consts::TAU * i as f32 / around as f32,
        );
        Vec3::new(polar.sin() * angle.cos(), polar.cos(), polar.sin() * angle.sin())
    };
    let positions = (0..=rings).flat_map(|r| (0..around).map(move |i| point(r, i))).collect();
    let corner = |ring: u32, i: u32| ring * around + i % around;
    let quads = (0..rings).flat_map(|r| (0..around).map(move |i| (r, i)));
    // At the poles one of the two triangles has no area: keep the other.
    let triangles = quads
        .flat_map(|(r, i)| {
            let [a, b, c, d] = [corner(r, i), corner(r, i + 1), corner(r + 1, i), corner(r + 1, i + 1)];
            [(r > 0).then_some([a, b, c]), (r + 1 < rings).then_some([b, d, c])]
        })
        .flatten()
        .collect();
    (positions, triangles)
}
