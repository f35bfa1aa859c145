//! A small test scene: triangles that drift apart, each its own way.

use bvh_core::{Triangles, Vec3};
use rt_cpu::{Camera, uniform};

use pivot_benches::View;

/// Unconnected triangles in a cube of side 10.
#[derive(Clone, Debug)]
pub(crate) struct Soup {
    centers: Vec<Vec3>,
    drifts: Vec<Vec3>,
    corners: Vec<[Vec3; 3]>,
    indices: Vec<[u32; 3]>,
}

impl Soup {
    /// `n` triangles, of a size that covers most of the view.
    pub(crate) fn new(n: usize) -> Self {
        let size = 10.0 / (n.max(1) as f32).sqrt();
        let noise = |seed: u64| move |i: usize| noise(seed, i);
        let (place, drift) = (noise(1), noise(2));
        let corner = |k: u64| move |i: usize| (self::noise(3 + k, i) - 0.5) * 4.0 * size;
        Self {
            centers: (0..n).map(|i| place(i) * 10.0).collect(),
            drifts: (0..n).map(|i| drift(i) - 0.5).collect(),
            corners: (0..n).map(|i| [corner(0)(i), corner(1)(i), corner(2)(i)]).collect(),
            indices: (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        }
    }

    /// Positions of the vertices at a time; at 10, triangles are half a cube from where they were.
    pub(crate) fn positions(&self, time: f32) -> Vec<Vec3> {
        let parts = self.centers.iter().zip(&self.drifts).zip(&self.corners);
        parts.flat_map(|((&c, &d), corners)| corners.map(|p| c + d * time + p)).collect()
    }

    /// A view of all of it in `size` x `size` pixels, with a light beside the camera.
    pub(crate) fn view(size: u32) -> View {
        let (eye, center) = (Vec3::new(14.0, 12.0, 22.0), Vec3::splat(5.0));
        let camera = Camera::look_at(eye, center, Vec3::Y, 0.8, size, size);
        View { camera, light: Some(Vec3::new(-8.0, 25.0, 16.0)) }
    }

    /// The triangles with positions from [`positions`](Self::positions).
    pub(crate) fn triangles<'a>(&'a self, positions: &'a [Vec3]) -> Triangles<'a> {
        Triangles { positions, indices: &self.indices }
    }
}

/// A point in the unit cube. Bounds on rivals' trees (`agree.rs`) hold for this noise.
fn noise(seed: u64, i: usize) -> Vec3 {
    let coordinate = |axis: u64| uniform(seed << 40, i as u64 * 3 + axis);
    Vec3::new(coordinate(0), coordinate(1), coordinate(2))
}
