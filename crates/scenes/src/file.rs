//! Animations from files, framed by a default view and lit by a default light where the file has
//! none.
//!
//! The view shows what moves, or all of it where nothing does; of a room it shows the inside.

use std::path::Path;

use anim::{Animation, Light, LoadError, LoadOptions, View};
use glam::{Vec3, vec3};

use crate::room;
use crate::{Effects, LightEffects, Scene, SceneOptions, Simulated, SimulationStats};

/// Times at which the bounds of an animation are taken.
const BOUND_SAMPLES: usize = 32;
/// The eye of a default view stands this many times as far off as it must for the box to fit.
const MARGIN: f32 = 1.04;
/// Width and height of the narrowest image that a default view fits: half of a window of 16 to 9,
/// which shows two trees.
pub const NARROWEST: [u32; 2] = [8, 9];
/// Frames per second of animations that do not come with a number of frames.
const FRAME_RATE: f64 = 24.0;
/// Frames of an animation that lasts longer are further apart.
const MOST_FRAMES: usize = 1_000_000;

pub(crate) fn scene(path: &Path, clip: Option<&str>, options: &SceneOptions<'_>) -> Result<Scene, LoadError> {
    let without_textures =
        options.light.is_some_and(|light| !light.intersects(LightEffects::TEXTURES | LightEffects::ALPHA));
    let mut load = LoadOptions { clip, without_textures, ..LoadOptions::default() };
    let mut animation = anim::load(path, &load)?;
    if options.local_origin {
        load.origin = anim::center(&*animation);
        animation = anim::load(path, &load)?;
    }
    let mut scene = scene_of(path, animation);
    if options.local_origin {
        let [x, y, z] = load.origin.to_array();
        scene.notes.push(format!("{}: coordinates are relative to ({x}, {y}, {z})", path.display()));
    }
    Ok(scene)
}

/// Makes a scene of an animation that was loaded from `path`, with a default view and a default
/// light where it has none.
#[must_use]
pub fn scene_of(path: &Path, animation: Box<dyn Animation>) -> Scene {
    let (view, light) = default_view(&*animation);
    let model = animation.model();
    let remark = |note: &String| format!("{}: {note}", path.display());
    let mut notes: Vec<String> = model.notes.iter().map(remark).collect();
    let topology = &model.topology;
    let frames_by_rate = ((model.duration * FRAME_RATE).round() as usize).saturating_add(1);
    let mut light_effects = LightEffects::of(topology) | LightEffects::SHADOWS;
    if animation.view(0.0).is_none() {
        notes.push(format!("{} has no camera; the view is a default", path.display()));
    }
    if animation.light(0.0).is_none() {
        // Mesh files cannot say what lights there are; of what can and names none, none casts a
        // shadow.
        let shadows = path.is_dir() || anim::is_mesh_file(path);
        light_effects.set(LightEffects::SHADOWS, shadows);
        let cast = if shadows { "" } else { " that casts no shadow" };
        notes.push(format!("{} has no light; the light is a default{cast}", path.display()));
    }
    Scene {
        name: path.display().to_string(),
        about: "an animation from a file",
        view,
        light,
        effects: Effects {
            simulated: Simulated::empty(),
            motion: topology.parts.iter().map(|part| part.motion).collect(),
            light: light_effects,
        },
        frames: model.frames.unwrap_or(frames_by_rate).min(MOST_FRAMES + 1),
        measures: Vec::new(),
        simulated: SimulationStats::default(),
        key_bytes: 0,
        notes,
        animation,
    }
}

fn default_view(animation: &dyn Animation) -> (View, Light) {
    let (low, high) = bounds(animation);
    if !low.cmple(high).all() {
        return framing(Vec3::ZERO, Vec3::ONE);
    }
    let (center, half) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
    if half == Vec3::ZERO {
        return framing(center, Vec3::ONE);
    }
    room::inside(animation, low, high).unwrap_or_else(|| framing(center, half))
}

/// The corners of the box around all finite positions of what moves, or of all if nothing does, at
/// times that sample the animation.
fn bounds(animation: &dyn Animation) -> (Vec3, Vec3) {
    let mut positions = animation.rest();
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    let topology = animation.topology();
    let mut shown = vec![!topology.moves.contains(&true); positions.len()];
    for (corners, _) in topology.triangles.iter().zip(&topology.moves).filter(|&(_, &moves)| moves) {
        corners.iter().for_each(|&corner| shown[corner as usize] = true);
    }
    let samples = if animation.duration() > 0.0 { BOUND_SAMPLES } else { 1 };
    for sample in 0..samples {
        animation.pose(animation.duration() * sample as f64 / samples.max(2) as f64, &mut positions);
        for (&p, _) in positions.iter().zip(&shown).filter(|&(p, &shown)| shown && p.is_finite()) {
            (low, high) = (low.min(p), high.max(p));
        }
    }
    (low, high)
}

/// A three-quarter view from slightly above in which a box fits every image that is at least
/// [`NARROWEST`], and a light above the eye and beside it.
fn framing(center: Vec3, half: Vec3) -> (View, Light) {
    let fov_y = 40_f32.to_radians();
    let back = vec3(0.62, 0.38, 0.69).normalize();
    let right = Vec3::Y.cross(back).normalize();
    let (up, slope) = (back.cross(right), libm::tanf(0.5 * fov_y));
    // Relative to the size of the box: squares of what is very large or small leave the range of
    // f32.
    let size = half.max_element();
    let (shape, narrowest) = (half / size, NARROWEST[0] as f32 / NARROWEST[1] as f32);
    // A corner is in the image if it is no further aside, nor up or down, than its depth allows.
    let distance = |corner: Vec3| {
        let aside = (right.dot(corner).abs() / narrowest).max(up.dot(corner).abs());
        back.dot(corner) + aside / slope
    };
    let sign = |set: i32| if set == 0 { 1.0 } else { -1.0 };
    let corners = (0..8).map(|i| shape * vec3(sign(i & 1), sign(i & 2), sign(i & 4)));
    let eye = center + back * (MARGIN * corners.map(distance).fold(0.0, f32::max)) * size;
    let light = eye + (0.6 * Vec3::Y - 0.6 * right) * (3.0 * shape.length()) * size;
    (View { eye, target: center, up: Vec3::Y, fov_y }, Light { position: light, color: [1.0; 3] })
}

#[cfg(test)]
mod tests {
    use anim::{KeyFrames, Model, Topology};

    use super::*;

    #[test]
    fn a_default_view_holds_all_corners_and_little_else() {
        let shapes = [vec3(1.0, 1.0, 1.0), vec3(5.0, 0.1, 2.0), vec3(0.0, 0.0, 1.0), vec3(1.0, 1e6, 1.0)];
        for (shape, size) in shapes.into_iter().flat_map(|s| [1e-37, 1.0, 1e30].map(|size| (s, size))) {
            let center = vec3(3.0, -2.0, 1.0) * size;
            let (View { eye, target, up, fov_y }, light) = framing(center, shape * size);
            let [eye, target, light] = [eye, target, light.position].map(|p| (p - center) / size);
            let ahead = (target - eye).normalize();
            let right = ahead.cross(up).normalize();
            let corners =
                [-1.0, 1.0].map(|x| [-1.0, 1.0].map(|y| [-1.0, 1.0].map(|z| vec3(x, y, z) * shape)));
            // 1 at the edge of the narrowest image.
            let places = corners.as_flattened().as_flattened().iter().map(|corner| {
                let seen = *corner - eye;
                let aside = (right.dot(seen).abs() / 8.0 * 9.0).max(right.cross(ahead).dot(seen).abs());
                assert!(ahead.dot(seen) > 0.0, "{shape}: {corner} lies behind the eye");
                aside / ahead.dot(seen) / (0.5 * fov_y).tan()
            });
            let outermost = places.fold(0.0, f32::max);
            assert!((0.9..0.99).contains(&outermost), "{shape}, {size}: {outermost}");
            assert!(light.is_finite() && light.y > eye.y, "{shape}, {size}: {light}");
        }
    }

    #[test]
    fn an_animation_of_any_length_has_a_number_of_frames() {
        for (seconds, frames) in [(2.0, 49), (1e17, 1_000_001), (8e17, 1_000_001), (1e300, 1_000_001)] {
            let topology = Topology {
                triangles: vec![[0, 1, 2]],
                vertex_count: 3,
                parts: vec![anim::Part {
                    name: String::new(),
                    triangles: 0..1,
                    vertices: 0..3,
                    motion: anim::Motion::empty(),
                    material: 0,
                }],
                materials: vec![anim::Material::default()],
                ..Topology::default()
            };
            let [rest, next] = [0.0, 1.0].map(|y| vec![Vec3::ZERO, Vec3::X, vec3(0.0, y, 1.0)]);
            let model = Model { topology, rest, ..Model::default() };
            let animation = KeyFrames::new(model, vec![next], seconds).unwrap();
            assert_eq!(scene_of(Path::new("a.glb"), Box::new(animation)).frames, frames, "{seconds} s");
        }
    }
}
