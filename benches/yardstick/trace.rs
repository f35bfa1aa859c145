//! This project as the yardstick of tracing calls it.
use bvh_build::{BuildOptions, Builder, build_with};
use bvh_core::{Bvh, Triangles, Vec3};
use rt_cpu::{Camera, Pixel, PointLight, RenderOptions, TriangleTest, cast};

pub struct Pivot {
    bvh: Bvh,
    indices: Vec<[u32; 3]>,
    positions: Vec<Vec3>,
    camera: Camera,
    light: PointLight,
    options: RenderOptions,
    pixels: Vec<Pixel>,
}

impl Pivot {
    /// A full sweep tree, triangles in leaf order.
    pub fn new(
        positions: &[[f32; 3]],
        indices: &[[u32; 3]],
        max_leaf_size: u32,
        fast: bool,
        [eye, target, light]: [[f32; 3]; 3],
        size: u32,
    ) -> Self {
        let positions: Vec<Vec3> = positions.iter().map(|&p| Vec3::from(p)).collect();
        let options = BuildOptions::default().with_max_leaf_size(max_leaf_size);
        let mut bvh =
            build_with(&Triangles { positions: &positions, indices }, Builder::Sweep, &options).unwrap();
        let indices = bvh.reorder_primitives().iter().map(|&p| indices[p as usize]).collect();
        let camera = Camera::look_at(eye.into(), target.into(), Vec3::Y, 45f32.to_radians(), size, size);
        let light = PointLight { position: light.into(), color: [1.0; 3] };
        let mut options = RenderOptions::default();
        if fast {
            options.triangle_test = TriangleTest::MollerTrumbore;
        }
        let pixels = vec![Pixel::default(); (size * size) as usize];
        Self { bvh, indices, positions, camera, light, options, pixels }
    }

    /// Primary rays, and shadow rays if asked for. Called in a rayon pool; this is what is timed.
    pub fn cast(&mut self, shadows: bool) {
        let Self { bvh, indices, positions, camera, light, options, pixels } = self;
        let light = shadows.then_some(&*light);
        cast(bvh, &Triangles { positions, indices }, camera, light, options, pixels);
    }

    /// Pixels that hit something, and those of them in shadow or facing away.
    pub fn counts(&self) -> (u64, u64) {
        let hit = || self.pixels.iter().filter(|p| p.hit().is_some());
        (hit().count() as u64, hit().filter(|p| !p.is_lit()).count() as u64)
    }
}
