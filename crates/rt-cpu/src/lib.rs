//! A ray tracer over the binary trees of [`bvh_core`], on the processor.
//!
//! Single rays ([`closest_hit`], [`any_hit`]), many rays without anything in common ([`Bvh8`], a
//! view of the tree made for them) and whole frames ([`render`]): a pinhole [`Camera`], one
//! [`PointLight`] with hard shadows, flat or smooth shading, PNG and EXR files ([`Image`]).
//! Textures, holes, mirrors, ambient occlusion and diffuse bounces are [`Effects`] to be asked for.
//! Coordinates are right-handed with y up where it matters (the camera); the queries take any
//! convention.
//!
//! # What a hit is
//!
//! Every way of traversing a tree gives the same hits bit for bit, and so does testing every
//! triangle ([`closest_hit_brute`]), because a hit is defined without the tree. The exceptions are
//! hits at a distance below 1.2e-38, the least normal `f32`: tiles may miss them. A ray hits a
//! triangle at `t` if
//!
//! 1. the triangle test ([`TriangleTest`]) says so, at some `t >= 0`,
//! 2. the ray enters the triangle's own bounding box, not after `t_max`; `t` is raised to where it does, and
//! 3. `t <= t_max`, and `t` is finite.
//!
//! Of several triangles the one with the least `t` is hit, of equals the one with the lowest
//! number. Rounded subtraction and multiplication are monotonic and every box above a triangle
//! contains the triangle's own, so a ray that enters the latter enters all the others, no later.
//! Triangles with a NaN or an infinite coordinate have an empty box and are never hit.
//!
//! The tree has to be up to date, with the smallest boxes around what is below them, as builders
//! and updates leave it ([`Bvh::validate`](bvh_core::Bvh::validate)): [`Traversal::Tile`] takes the
//! box of a leaf with one triangle for the triangle's own.

#![forbid(unsafe_code)]

mod bvh8;
mod camera;
mod cast;
mod frustum;
mod image;
mod mesh;
mod options;
mod packet;
mod pixel;
mod random;
mod render;
mod scene;
mod shade;
mod simd;
mod sink;
mod sort;
mod surface;
mod texture;
mod tile;
mod times;
mod wave;
mod wavefront;
mod wide;

#[cfg(test)]
mod tests;

pub use bvh_core::glam::Vec2;
pub use bvh_core::{
    Bvh, Hit, Ray, SimdLevel, TriangleTest, Triangles, UnknownName, Vec3, any_hit, closest_hit,
    closest_hit_brute,
};
pub use bvh8::Bvh8;
pub use camera::Camera;
pub use image::{Image, ImageError, srgb};
pub use mesh::{Material, Mesh};
pub use options::{AmbientOcclusion, DiffuseBounces, Effects, Output, RenderOptions, Traversal};
pub use pixel::Pixel;
pub use random::uniform;
pub use render::{cast, render, render_with};
pub use shade::PointLight;
pub use texture::{Filter, Texture, Wrap};
pub use times::{RenderStats, StageTimes};
