//! This project's side of an outside program that times refits and rotations beside its own.
//!
//! Triangles are put into the order of the leaves once, after the build, as that program does with
//! its own. Rotations are limited to AVX2 where that program limits its own (variant `blksse`).
use bvh_build::{Builder, build};
use bvh_core::{Bvh, SimdLevel, Triangles, Vec3, sah_cost};
use bvh_update::{Rotate, Strategy, Updater};

pub struct Pivot {
    bvh: Bvh,
    updater: Updater,
    strategy: Strategy,
    indices: Vec<[u32; 3]>,
}

fn vectors(positions: &[[f32; 3]]) -> &[Vec3] {
    // SAFETY: a `Vec3` is `repr(C)`, three `f32`, as an array of three is.
    unsafe { std::slice::from_raw_parts(positions.as_ptr().cast(), positions.len()) }
}

impl Pivot {
    /// A binned tree over the triangles, which are then put into its order.
    pub fn new(positions: &[[f32; 3]], indices: &[[u32; 3]], rotate: bool) -> Self {
        let strategy = if rotate { Strategy::RefitRotate(Rotate::default()) } else { Strategy::Refit };
        let triangles = Triangles { positions: vectors(positions), indices };
        let mut bvh = build(&triangles, Builder::BinnedParallel).unwrap();
        let indices = bvh.reorder_primitives().into_iter().map(|p| indices[p as usize]).collect();
        let held = std::env::args().any(|argument| argument.contains("blksse"));
        let level = if held { SimdLevel::Avx2 } else { SimdLevel::best() };
        Self { bvh, updater: Updater::with_level(Strategy::default(), level), strategy, indices }
    }

    /// Called in a rayon pool; this is what is timed.
    pub fn update(&mut self, positions: &[[f32; 3]]) {
        let triangles = Triangles { positions: vectors(positions), indices: &self.indices };
        self.updater.set_strategy(self.strategy).update(&mut self.bvh, &triangles).unwrap();
    }

    pub fn sah_cost(&self) -> f64 {
        sah_cost(&self.bvh)
    }
}
