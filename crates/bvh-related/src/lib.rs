//! Update methods that Pivot is compared with: each system in a file of its own, in plain safe
//! code.
//!
//! The papers could not be read whole. Each file says what was followed from abstracts and from
//! memory, and where it departs. `docs/PAPER.md` lists the same.
//!
//! ```
//! use bvh_build::{Builder, build};
//! use bvh_core::{Triangles, Vec3};
//! use bvh_related::{Keeper, System};
//!
//! let indices: Vec<[u32; 3]> = (0..60).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
//! let at = |time: f32| -> Vec<Vec3> {
//!     let corner = |i: usize| Vec3::new((i / 3) as f32, (i % 3) as f32, (i / 3 * 7 % 5) as f32 * time);
//!     (0..180).map(corner).collect()
//! };
//! let [first, last] = [at(0.0), at(9.0)];
//! let [first, last] = [&first, &last].map(|positions| Triangles { positions, indices: &indices });
//! let mut bvh = build(&first, Builder::Sweep)?;
//! let mut keeper = Keeper::new(System::Restructure, &mut bvh, &[first])?;
//! keeper.update(&mut bvh, &last)?;
//! assert!(bvh.validate(&last).is_ok());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod clusters;
mod decomposition;
mod divergent;
mod part;
mod restructure;
mod rigid;

use bvh_build::{BuildError, Reinsert, build_over_poses};
use bvh_core::{Bvh, Triangles};
use bvh_update::{Decision, Strategy, Update, UpdateError, Updater};

use crate::decomposition::Decomposition;
use crate::divergent::Divergent;
use crate::restructure::Restructure;

/// A published method of keeping a tree good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum System {
    /// Selective restructuring (Yoon, Curtis, Manocha 2007).
    Restructure,
    /// Reinsertion and rebuilding of clusters whose motion diverges (Garanzha 2008).
    Divergent,
    /// Motion decomposition (Günther et al. 2006), for an animation known in advance.
    Decomposition,
    /// One tree for all poses, T-SAH (Bittner and Meister 2015), for an animation known in advance.
    TSah,
}

impl System {
    /// All systems.
    pub const ALL: [Self; 4] = [Self::Restructure, Self::Divergent, Self::Decomposition, Self::TSah];

    /// Returns the name as the command line and results have it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Restructure => "restructure",
            Self::Divergent => "divergent",
            Self::Decomposition => "decomposition",
            Self::TSah => "t-sah",
        }
    }

    /// Returns whether the system has to know the animation in advance.
    #[must_use]
    pub const fn knows_animation(self) -> bool {
        matches!(self, Self::Decomposition | Self::TSah)
    }
}

/// Keeps one tree good by one system.
#[derive(Debug)]
pub struct Keeper {
    state: State,
    refit: Updater,
}

#[derive(Debug)]
enum State {
    Restructure(Restructure),
    Divergent(Divergent),
    Decomposition(Decomposition),
    TSah,
}

impl Keeper {
    /// Prepares a system for `bvh`. A system that knows the animation puts a tree of its own in the
    /// place of `bvh`, over `poses` of the animation, with the boxes of the first pose; the same
    /// primitives stay dynamic. Others look at no pose.
    ///
    /// # Errors
    /// If a system that knows the animation is given no poses, or poses of different sizes.
    pub fn new(system: System, bvh: &mut Bvh, poses: &[Triangles<'_>]) -> Result<Self, BuildError> {
        let own_tree = |bvh: &mut Bvh, new: Bvh| {
            let mut dynamic = Vec::new();
            let has_static = bvh.note_dynamic(&mut dynamic);
            *bvh = new;
            if has_static {
                bvh.set_dynamic(|p| dynamic.get(p) != Some(&false));
            }
        };
        let state = match system {
            System::Restructure => State::Restructure(Restructure::default()),
            System::Divergent => State::Divergent(Divergent::default()),
            System::Decomposition => {
                let (decomposition, new) = Decomposition::new(poses)?;
                own_tree(bvh, new);
                State::Decomposition(decomposition)
            }
            System::TSah => {
                let poses: Vec<_> = poses.iter().collect();
                own_tree(bvh, build_over_poses(&poses, &Reinsert::default())?);
                State::TSah
            }
        };
        Ok(Self { state, refit: Updater::new(Strategy::Refit) })
    }

    /// Brings `bvh` up to date with triangles that have moved: refits it, then does what the system
    /// does. It has to be the tree that this was made with: another one may only be refitted.
    /// Refits and builds run in the current rayon pool, all else on one thread. The tree that
    /// results does not depend on the number of threads.
    ///
    /// # Errors
    /// If the number of triangles is not that of the tree.
    pub fn update(&mut self, bvh: &mut Bvh, triangles: &Triangles<'_>) -> Result<Update, UpdateError> {
        let mut update = self.refit.update(bvh, triangles)?;
        let subtrees = match &mut self.state {
            State::Restructure(system) => system.update(bvh),
            State::Divergent(system) => system.update(bvh)?,
            State::Decomposition(system) => system.update(bvh)?,
            State::TSah => 0,
        };
        if subtrees > 0 {
            update.decision = Decision::PartialRebuild { subtrees };
        }
        (update.sah_cost, update.height) = (None, bvh.height());
        Ok(update)
    }
}

#[cfg(test)]
mod tests {
    use bvh_build::{Builder, build};
    use bvh_core::{Aabb, Node, Vec3};

    use super::*;

    const TRIANGLES: usize = 3000;

    /// A number from -0.5 to 0.5 that depends on `i` and `j` only. Not from a crate: multiples of a
    /// prime keep bodies apart, and random numbers do not.
    pub(crate) fn random(i: usize, j: usize) -> f32 {
        ((i * 7919 + j * 104_729) % 1009) as f32 / 1009.0 - 0.5
    }

    /// Bodies of 30 triangles that fly about and spin; the first third of them stands still.
    fn pose(time: f32) -> Vec<Vec3> {
        let place = |i: usize| {
            let body = i / 90;
            let time = if i < TRIANGLES { 0.0 } else { time };
            let p = Vec3::new(random(i, 1), random(i, 2), random(i, 3));
            let home = Vec3::new(random(body, 4), random(body, 5), random(body, 6)) * 20.0;
            let speed = Vec3::new(random(body, 7), random(body, 8), random(body, 9)) * 60.0;
            let (sin, cos) = (5.0 * random(body, 10) * time).sin_cos();
            home + speed * time + Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z)
        };
        (0..3 * TRIANGLES).map(place).collect()
    }

    /// Over all poses that are known, the tree costs less than one that is made for the first.
    #[test]
    fn t_sah_knows_all_poses() {
        let indices: Vec<[u32; 3]> = (0..TRIANGLES as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let known: Vec<_> = [0.0, 0.5, 1.0].map(pose).into();
        let poses: Vec<_> = known.iter().map(|p| Triangles { positions: p, indices: &indices }).collect();
        let cost = |poses_known: &[Triangles<'_>]| {
            let mut bvh = build(&poses[0], Builder::Sweep).expect("few");
            let mut keeper = Keeper::new(System::TSah, &mut bvh, poses_known).expect("poses");
            let costs = poses.iter().map(|now| {
                keeper.update(&mut bvh, now).expect("as many");
                bvh_core::sah_cost(&bvh)
            });
            costs.sum::<f64>()
        };
        let [all, first] = [cost(&poses), cost(&poses[..1])];
        assert!(all < 0.8 * first, "{all} knowing all poses, {first} knowing the first");
    }

    /// Plays 12 frames, each a step that changes much; the fingerprint of the last tree.
    fn play(system: System, threads: usize) -> u64 {
        let indices: Vec<[u32; 3]> = (0..TRIANGLES as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let known: Vec<_> = [0.0, 0.5, 1.0].map(pose).into();
        let poses: Vec<_> = known.iter().map(|p| Triangles { positions: p, indices: &indices }).collect();
        let pool = pool_of(threads);
        pool.install(|| {
            let mut bvh = build(&poses[0], Builder::Sweep).expect("few");
            bvh.set_dynamic(|p| 3 * p >= TRIANGLES);
            let mut keeper = Keeper::new(system, &mut bvh, &poses).expect("poses");
            for frame in 0..12 {
                let positions = pose(frame as f32 / 11.0);
                let now = Triangles { positions: &positions, indices: &indices };
                let update = keeper.update(&mut bvh, &now).expect("as many");
                bvh.validate(&now).unwrap_or_else(|e| panic!("{}, frame {frame}: {e}", system.name()));
                assert_eq!(update.height, bvh.height());
                let mut again = bvh.clone();
                again.sum_static_area();
                assert!((again.static_area() - bvh.static_area()).abs() <= 1e-6 * again.static_area());
            }
            bvh.fingerprint()
        })
    }

    fn pool_of(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
    }

    #[test]
    fn trees_are_valid_in_each_frame_and_the_same_for_all_numbers_of_threads() {
        for system in System::ALL {
            assert_eq!(play(system, 1), play(system, 3), "{}", system.name());
        }
    }

    #[test]
    fn another_tree_of_as_many_triangles_is_valid_too() {
        let indices: Vec<[u32; 3]> = (0..TRIANGLES as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let (first, last) = (pose(0.0), pose(1.0));
        let [first, last] = [&first, &last].map(|p| Triangles { positions: p, indices: &indices });
        let leaf = [Node::leaf(Aabb::EMPTY, 0, TRIANGLES as u32), Node::NOTHING];
        for system in System::ALL {
            let mut bvh = build(&first, Builder::Sweep).expect("few");
            let mut keeper = Keeper::new(system, &mut bvh, &[first, last]).expect("poses");
            let mut bvh = Bvh::new(&leaf, (0..TRIANGLES as u32).collect()).expect("one leaf");
            keeper.update(&mut bvh, &last).expect("as many");
            bvh.validate(&last).unwrap_or_else(|e| panic!("{}: {e}", system.name()));
        }
    }

    #[test]
    fn poses_are_asked_for_where_they_are_needed() {
        let mut bvh = Bvh::default();
        for system in System::ALL {
            assert_eq!(
                Keeper::new(system, &mut bvh, &[]).is_err(),
                system.knows_animation(),
                "{}",
                system.name()
            );
        }
        let (two, one) = ([Vec3::ZERO, Vec3::X, Vec3::Y], [[0, 1, 2], [2, 1, 0]]);
        let pose = |indices| Triangles { positions: &two, indices };
        for system in [System::Decomposition, System::TSah] {
            let uneven = [pose(&one[..]), pose(&one[..1])];
            assert!(matches!(Keeper::new(system, &mut bvh, &uneven), Err(BuildError::PoseLength { .. })));
        }
    }
}
