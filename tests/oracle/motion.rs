//! Triangle soups, and the kinds of motion that updates have to live with.

use bvh_core::glam::Vec3;

/// A point of the unit cube that depends on `seed` and `i` only. From the ray tracer's generator,
/// which needs no state: tests ask for points in any order.
#[must_use]
pub fn noise(seed: u64, i: usize) -> Vec3 {
    let coordinate = |axis: u64| rt_cpu::uniform(seed, i as u64 * 3 + axis);
    Vec3::new(coordinate(0), coordinate(1), coordinate(2))
}

/// How the triangles of a soup move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// Neighbours move alike.
    Smooth,
    /// Each triangle drifts its own way.
    Divergent,
    /// Half of the triangles change places every frame.
    Teleporting,
    /// All fall into a point, and come out of it again.
    Collapsing,
    /// Smooth, but some triangles are not finite in some frames.
    PartlyNonFinite,
}

impl Motion {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Smooth, Self::Divergent, Self::Teleporting, Self::Collapsing, Self::PartlyNonFinite];
}

/// Small triangles at random in a cube of side 10, three vertices each.
#[derive(Clone, Debug)]
pub struct Soup {
    /// Vertex numbers.
    pub triangles: Vec<[u32; 3]>,
    seed: u64,
}

impl Soup {
    /// `n` triangles.
    #[must_use]
    pub fn new(n: usize, seed: u64) -> Self {
        Self { triangles: (0..n as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(), seed }
    }

    /// Positions in a frame; frame 0 is undisturbed.
    #[must_use]
    pub fn pose(&self, motion: Motion, frame: usize) -> Vec<Vec3> {
        let n = self.triangles.len();
        let time = frame as f32;
        let vertex = |i: usize| {
            let (triangle, corner) = (i / 3, i % 3);
            let placed = match motion {
                Motion::Teleporting if frame % 2 == 1 && triangle % 2 == 0 => n - 1 - triangle,
                _ => triangle,
            };
            let center = noise(self.seed, placed) * 10.0;
            let p = center + noise(self.seed ^ 1, 3 * triangle + corner) - 0.5;
            match motion {
                Motion::Smooth => {
                    p + Vec3::new((p.y + time * 0.3).sin(), (p.z - time * 0.2).cos(), 0.0) * time
                }
                Motion::Divergent => p + (noise(self.seed ^ 2, triangle) - 0.5) * (2.0 * time),
                Motion::Teleporting => p,
                Motion::Collapsing => p * [1.0, 0.1, 0.0, 0.1][frame % 4],
                Motion::PartlyNonFinite if (triangle + frame) % 17 == 3 => {
                    let mut p = p;
                    p[triangle % 3] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][frame % 3];
                    p
                }
                Motion::PartlyNonFinite => p + Vec3::X * time.sin(),
            }
        };
        (0..3 * n).map(vertex).collect()
    }
}
