//! Samples per pixel against closed forms: a white furnace, a lit floor beside a wall, the shadow
//! of a sphere. None of the three references shares code with the renderer.
//!
//! Several seeds tell bias (the error of their mean) from noise (their standard deviation).

use std::f64::consts::{PI, TAU};

use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::glam::{DVec3, vec3};
use bvh_core::{Triangles, Vec3};
use rt_cpu::{
    AmbientOcclusion, Camera, DiffuseBounces, Effects, Image, Material, Mesh, PointLight, RenderOptions,
    render,
};
use scenes::LightEffects;

use super::Point;
use super::bench::Log;
use crate::interrupt;
use crate::stage::timed;

/// A picture whose every pixel is known.
struct Case {
    name: &'static str,
    model: Model,
    camera: Camera,
    light: Option<PointLight>,
    effects: Effects,
    /// Samples of a pixel if none are asked for.
    default: u32,
    /// The colour in a direction from the eye.
    exact: fn(DVec3, DVec3) -> f64,
    /// Places on a side of each pixel over which `exact` is averaged.
    places: u32,
}

/// Positions, and the triangles between them.
type Model = (Vec<Vec3>, Vec<[u32; 3]>);

/// Light from everywhere on ground that faces up, as the renderer documents it.
const AMBIENT: f64 = 0.18;
/// Height of the wall beside the lit floor, which stands at x = 0.
const WALL: f64 = 1.0;
const SUN: DVec3 = DVec3::new(3.0, 5.0, 0.5);
const BALL: DVec3 = DVec3::new(0.0, 1.2, 0.0);
const RADIUS: f64 = 0.5;
const LAMP: DVec3 = DVec3::new(0.4, 4.0, 0.3);

/// Where a ray from above meets the ground.
fn on_ground(eye: DVec3, direction: DVec3) -> DVec3 {
    eye - direction * (eye.y / direction.y)
}

/// Lambert's law on white ground.
fn lambert(point: DVec3, light: DVec3) -> f64 {
    (light - point).normalize().y
}

/// The sky that an endless wall of height h hides at distance d is (1 - 1 / sqrt(1 + (h / d)^2)) /
/// 2: the view factor of an edge.
fn beside_the_wall(eye: DVec3, direction: DVec3) -> f64 {
    let point = on_ground(eye, direction);
    let hidden = 0.5 * (1.0 - 1.0 / (1.0 + (WALL / point.x).powi(2)).sqrt());
    AMBIENT * (1.0 - hidden) + lambert(point, SUN)
}

/// The ground is dark where the way to the lamp passes through the ball.
fn below_the_ball(eye: DVec3, direction: DVec3) -> f64 {
    let point = on_ground(eye, direction);
    let way = (LAMP - point).normalize();
    let nearest = (BALL - point).cross(way).length();
    AMBIENT + if nearest < RADIUS { 0.0 } else { lambert(point, LAMP) }
}

/// Two triangles between each four corners.
fn quads(all: &[[[f32; 3]; 4]]) -> Model {
    let faces =
        (0..all.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|face| face.map(|c| 4 * i + c)));
    (all.iter().flatten().copied().map(Vec3::from).collect(), faces.collect())
}

const GROUND: [[f32; 3]; 4] =
    [[-50.0, 0.0, -50.0], [-50.0, 0.0, 50.0], [50.0, 0.0, 50.0], [50.0, 0.0, -50.0]];

/// Five white walls, open to a white sky: everything is white, however often light bounces.
fn furnace(size: u32) -> Case {
    let [a, b, c, d] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let at = |[x, z]: [f32; 2], y: f32| [x, y, z];
    let sides = [(a, b), (b, c), (c, d), (d, a)];
    let sides = sides.map(|(from, to)| [at(from, 0.0), at(to, 0.0), at(to, 1.0), at(from, 1.0)]);
    let floor = [a, b, c, d].map(|corner| at(corner, 0.0));
    // As many bounces as `stage` follows.
    let diffuse_bounces = Some(DiffuseBounces { most: 16, sky: [1.0; 3] });
    Case {
        name: "white furnace",
        model: quads(&[&[floor][..], &sides].concat()),
        camera: Camera::look_at(vec3(0.5, 1.2, 0.5), vec3(0.5, 0.0, 0.5), Vec3::Z, 0.7, size, size),
        light: None,
        effects: Effects { diffuse_bounces, ..Effects::default() },
        default: ::stage::default_samples(LightEffects::DIFFUSE_BOUNCES),
        exact: |_, _| 1.0,
        places: 1,
    }
}

fn lit_floor(size: u32) -> Case {
    let top = WALL as f32;
    let wall = [[0.0, 0.0, -50.0], [0.0, 0.0, 50.0], [0.0, top, 50.0], [0.0, top, -50.0]];
    let ambient_occlusion = Some(AmbientOcclusion { samples: 16, distance: f32::INFINITY });
    Case {
        name: "lit floor beside a wall",
        model: quads(&[GROUND, wall]),
        camera: Camera::look_at(vec3(0.8, 2.0, 0.0), vec3(0.8, 0.0, 0.0), Vec3::Z, 0.6, size, size),
        light: Some(PointLight { position: SUN.as_vec3(), color: [1.0; 3] }),
        effects: Effects { ambient_occlusion, ..Effects::default() },
        default: ::stage::default_samples(LightEffects::AMBIENT_OCCLUSION),
        exact: beside_the_wall,
        places: 4,
    }
}

fn shadow(size: u32) -> Case {
    let mut model = quads(&[GROUND]);
    ball(&mut model, 96);
    Case {
        name: "shadow of a sphere",
        model,
        // Below the sphere, which is out of the picture.
        camera: Camera::look_at(vec3(0.0, 0.65, 2.2), vec3(-0.15, 0.0, -0.1), Vec3::Y, 0.45, size, size),
        light: Some(PointLight { position: LAMP.as_vec3(), color: [1.0; 3] }),
        effects: Effects::default(),
        default: 1,
        exact: below_the_ball,
        places: 64,
    }
}

/// A sphere of `rings` times twice as many quads.
fn ball((positions, triangles): &mut Model, rings: u32) {
    let (first, around) = (positions.len() as u32, 2 * rings);
    for (ring, i) in (0..=rings).flat_map(|ring| (0..around).map(move |i| (ring, i))) {
        let [polar, angle] = [PI * f64::from(ring), TAU * f64::from(i) / 2.0].map(|x| x / f64::from(rings));
        let way = DVec3::new(polar.sin() * angle.cos(), polar.cos(), polar.sin() * angle.sin());
        positions.push((BALL + RADIUS * way).as_vec3());
        if ring < rings {
            let at = |r: u32, j: u32| first + (ring + r) * around + (i + j) % around;
            triangles.extend([[at(0, 0), at(0, 1), at(1, 0)], [at(0, 1), at(1, 1), at(1, 0)]]);
        }
    }
}

impl Case {
    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.model.0, indices: &self.model.1 }
    }

    /// The mean of the closed form over each pixel.
    fn expected(&self) -> Vec<f64> {
        let [corner, right, down] =
            [self.camera.corner, self.camera.right, self.camera.down].map(Vec3::as_dvec3);
        let (eye, places) = (self.camera.eye.as_dvec3(), self.places);
        let within = |pixel: u32| {
            (0..places).map(move |i| f64::from(pixel) + (f64::from(i) + 0.5) / f64::from(places))
        };
        let value = |(x, y): (u32, u32)| {
            let all = within(y).flat_map(|y| within(x).map(move |x| corner + x * right + y * down));
            all.map(|direction| (self.exact)(eye, direction)).sum::<f64>() / f64::from(places * places)
        };
        let pixels = (0..self.camera.height).flat_map(|y| (0..self.camera.width).map(move |x| (x, y)));
        pixels.map(value).collect()
    }

    /// Means of 1, 4, 16 ... samples, each with the milliseconds so far.
    fn means(&self, tree: &bvh_core::Bvh, most: usize, seed: u64) -> Vec<(Vec<f64>, f64)> {
        let white = [Material { color: [1.0; 3], ..Material::DEFAULT }];
        let material_of = vec![0; self.model.1.len()];
        let mesh = Mesh { materials: &white, material_of: &material_of, ..Mesh::new(self.triangles()) };
        let mut sum = Image::new(self.camera.width, self.camera.height);
        let mut image = sum.clone();
        let (mut means, mut time_ms) = (Vec::new(), 0.0);
        for sample in 0..most as u32 {
            let options = RenderOptions { effects: self.effects, seed, sample, ..RenderOptions::default() };
            time_ms +=
                timed(|| render(tree, &mesh, &self.camera, self.light.as_ref(), &options, &mut image)).1;
            sum.add(&image);
            let count = sample + 1;
            if count.is_power_of_two() && count.trailing_zeros().is_multiple_of(2) {
                let mean = sum.pixels().iter().map(|pixel| f64::from(pixel[0]) / f64::from(count));
                means.push((mean.collect(), time_ms));
            }
        }
        means
    }
}

/// Bias and noise of pixels, each over several seeds: root mean squares over the pixels. What noise
/// the mean over the seeds still has is taken off the bias.
fn bias_and_noise(of_seeds: &[&[f64]], expected: &[f64]) -> [f64; 2] {
    let (seeds, pixels) = (of_seeds.len() as f64, expected.len() as f64);
    let (mut bias, mut variance) = (0.0, 0.0);
    for (i, expected) in expected.iter().enumerate() {
        let mean = of_seeds.iter().map(|pixels| pixels[i]).sum::<f64>() / seeds;
        let squares: f64 = of_seeds.iter().map(|pixels| (pixels[i] - mean).powi(2)).sum();
        let of_pixel = squares / (seeds - 1.0).max(1.0);
        bias += (mean - expected).powi(2) - of_pixel / seeds;
        variance += of_pixel;
    }
    [(bias / pixels).max(0.0).sqrt(), (variance / pixels).sqrt()]
}

/// All three cases.
pub(super) fn measure(log: &mut Log<'_>) -> Result<()> {
    let size = log.size.min(log.pick([16, 32, 64]));
    let (most, seeds) = (log.pick([16, 256, 1024]), log.pick([4, 8, 16]));
    for case in [furnace(size), lit_floor(size), shadow(size)] {
        let tree = build(&case.triangles(), Builder::Sweep).context("no tree")?;
        let expected = case.expected();
        let mut of_seeds = Vec::new();
        for seed in 0..seeds {
            if interrupt::requested() {
                return Ok(());
            }
            of_seeds.push(case.means(&tree, most, log.seed + seed));
        }
        for level in 0..of_seeds[0].len() {
            let samples = 1_u32 << (2 * level);
            let means: Vec<&[f64]> = of_seeds.iter().map(|means| means[level].0.as_slice()).collect();
            let time_ms = of_seeds.iter().map(|means| means[level].1).fold(f64::INFINITY, f64::min);
            let [bias, noise] = bias_and_noise(&means, &expected);
            let (knob, setting) = (format!("samples a pixel at {}", case.name), format!("{samples} a pixel"));
            let note = format!("time of {size} x {size} pixels; {} seeds", means.len());
            let point = Point { note, ..Point::new(&knob, &setting, samples == case.default, time_ms) };
            log.add(point.with("bias, rms over pixels", bias, "linear colour"))?;
            log.add(point.with("standard deviation, rms over pixels", noise, "linear colour"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_and_noise_are_separate() {
        let [bias, noise] = bias_and_noise(&[&[1.0, 5.0], &[3.0, 7.0]], &[2.0, 6.0]);
        assert!(bias == 0.0 && (noise - 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(bias_and_noise(&[&[1.5], &[1.5]], &[1.0]), [0.5, 0.0]);
    }

    #[test]
    fn the_shadow_is_in_the_picture_and_the_ball_is_not() {
        let case = shadow(32);
        let values = case.expected();
        let dark = values.iter().filter(|&&v| v < AMBIENT + 1e-9).count();
        assert!((50..700).contains(&dark), "{dark} dark pixels");
        let away = |x: u32, y: u32| {
            let (eye, way) = (case.camera.eye.as_dvec3(), case.camera.ray(x, y).direction().as_dvec3());
            (BALL - eye).cross(way.normalize()).length() > RADIUS
        };
        assert!((0..32).all(|x| (0..32).all(|y| away(x, y))));
    }

    #[test]
    fn pictures_converge_to_the_closed_forms() {
        let mut endless = furnace(8);
        // What later bounces would bring is what the furnace lacks.
        endless.effects.diffuse_bounces = Some(DiffuseBounces { most: u32::MAX, sky: [1.0; 3] });
        for case in [endless, lit_floor(8), shadow(8)] {
            let tree = build(&case.triangles(), Builder::Sweep).unwrap();
            let runs: Vec<_> = (0..4).map(|seed| case.means(&tree, 64, seed).pop().unwrap().0).collect();
            let [bias, noise] =
                bias_and_noise(&runs.iter().map(Vec::as_slice).collect::<Vec<_>>(), &case.expected());
            assert!(bias < 0.02 && noise < 0.1, "{}: {bias} {noise}", case.name);
        }
    }
}
