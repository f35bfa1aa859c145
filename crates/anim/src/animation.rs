//! What every source of animated triangles gives: a fixed topology, and positions per time.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::error::{NUMBERED, Problem};
use crate::{PoseStats, Texture};

/// The part of an animated mesh that never changes.
#[derive(Clone, Debug, Default)]
pub struct Topology {
    /// Vertex numbers of each triangle, each below `vertex_count`.
    pub triangles: Vec<[u32; 3]>,
    /// Number of vertices, and so of the positions of every pose.
    pub vertex_count: usize,
    /// For each triangle, whether any of its vertices can ever move.
    pub moves: Vec<bool>,
    /// The parts, in order; their triangle ranges cover `triangles` without gap or overlap.
    pub parts: Vec<Part>,
    /// Materials, named by [`Part::material`]; never empty.
    pub materials: Vec<Material>,
    /// Textures, named by [`Material::texture`].
    pub textures: Vec<Texture>,
    /// Where in its texture each vertex lies: (0, 0) is the upper left corner of the image, (1, 1)
    /// the lower right one. Empty if there are no textures; of no meaning for vertices without.
    pub texcoords: Vec<Vec2>,
}

impl Topology {
    /// Adds a part of as many `vertices`, whose `triangles` number its own from 0, and gives it. It
    /// is marked as still.
    ///
    /// `None` if a triangle names a vertex that the part does not have, or there are more vertices or
    /// triangles in all than 32 bits can number. O(triangles).
    pub fn add_part(
        &mut self,
        name: String,
        triangles: &[[u32; 3]],
        vertices: usize,
        material: u32,
    ) -> Option<&mut Part> {
        let range = |begin: usize, count: usize| {
            Some(u32::try_from(begin).ok()?..u32::try_from(begin.checked_add(count)?).ok()?)
        };
        let is_own = |&corner: &u32| (corner as usize) < vertices;
        let vertices =
            range(self.vertex_count, vertices).filter(|_| triangles.as_flattened().iter().all(is_own))?;
        let numbers = range(self.triangles.len(), triangles.len())?;
        self.triangles.extend(triangles.iter().map(|corners| corners.map(|corner| vertices.start + corner)));
        self.moves.resize(self.triangles.len(), false);
        self.vertex_count = vertices.end as usize;
        self.parts.push(Part { name, triangles: numbers, vertices, motion: Motion::empty(), material });
        self.parts.last_mut()
    }
}

/// A run of triangles that share a material and a kind of motion.
#[derive(Clone, Debug)]
pub struct Part {
    /// Name from the file or the simulation; for messages, not unique.
    pub name: String,
    /// The part's triangles, a range of [`Topology::triangles`].
    pub triangles: Range<u32>,
    /// The part's vertices: no other part uses them.
    pub vertices: Range<u32>,
    /// How the part can move.
    pub motion: Motion,
    /// Index into [`Topology::materials`].
    pub material: u32,
}

bitflags::bitflags! {
    /// The kinds of motion that a part calls for; none for a part that stands still.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub struct Motion: u8 {
        /// Linear blend skinning.
        const SKIN = 1;
        /// Morph targets.
        const MORPH = 1 << 1;
        /// Whole part moved by an animated node transform.
        const RIGID = 1 << 2;
        /// Positions interpolated between key frames (of a sequence or of a cached simulation).
        const KEY_FRAMES = 1 << 3;
    }
}

/// How the surface of a part looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Linear diffuse colour (red, green, blue), each 0 to 1; times that of the texture, if there
    /// is one.
    pub base_color: [f32; 3],
    /// Opacity, 0 to 1; times that of the texture, if there is one. It counts only with a cutoff.
    pub opacity: f32,
    /// Index into [`Topology::textures`].
    pub texture: Option<u32>,
    /// Where the opacity is below this there is no surface. `None`: there is everywhere.
    pub cutoff: Option<f32>,
    /// Whether it reflects like a mirror of the base colour, rather than diffusely.
    pub mirror: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self { base_color: [0.8; 3], opacity: 1.0, texture: None, cutoff: None, mirror: false }
    }
}

/// A pinhole view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the eye.
    pub eye: Vec3,
    /// Point looked at, the centre of the image.
    pub target: Vec3,
    /// Direction that is up in the image; need not be perpendicular to the line of sight.
    pub up: Vec3,
    /// Full vertical opening angle in radians.
    pub fov_y: f32,
}

/// A point light that casts hard shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Position.
    pub position: Vec3,
    /// Linear colour; 1 lights a facing white surface fully, whatever its distance.
    pub color: [f32; 3],
}

/// What of an animation does not depend on time.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// Triangles, parts and materials.
    pub topology: Topology,
    /// Positions of all vertices at time 0. Still vertices have these positions at all times.
    pub rest: Vec<Vec3>,
    /// Length in seconds of one loop; 0 if nothing moves.
    pub duration: f64,
    /// Number of frames that the source says it is to be shown in, first and last included, if it
    /// does.
    pub frames: Option<usize>,
    /// What of the source is shown otherwise than it says, or not at all: remarks of one line each.
    pub notes: Vec<String>,
}

impl Model {
    /// A model without triangles yet.
    pub(crate) fn with_materials(materials: Vec<Material>) -> Self {
        Self { topology: Topology { materials, ..Topology::default() }, ..Self::default() }
    }

    /// Adds a part whose `triangles` number its own `positions`, of a file that is one mesh.
    pub(crate) fn add_part(
        &mut self,
        name: String,
        triangles: &[[u32; 3]],
        positions: impl ExactSizeIterator<Item = Vec3>,
        material: usize,
    ) -> Result<(), Problem> {
        let wrong = || Problem::new("whole file", "too many vertices or triangles", NUMBERED);
        self.topology.add_part(name, triangles, positions.len(), material as u32).ok_or_else(wrong)?;
        self.rest.extend(positions);
        Ok(())
    }

    /// The lowest and the highest corner of the box around all finite rest positions, if there are
    /// any.
    pub(crate) fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let finite = self.rest.iter().filter(|position| position.is_finite()).map(|&p| (p, p));
        finite.reduce(|(low, high), (p, _)| (low.min(p), high.max(p)))
    }

    /// Returns the nearest time of the loop; 0 for a time that is not a number.
    #[must_use]
    pub fn clamp(&self, time: f64) -> f64 {
        // In this order a time that is not a number becomes 0.
        time.max(0.0).min(self.duration)
    }
}

/// A triangle mesh of fixed topology whose vertices move.
pub trait Animation: Send + Sync {
    /// What of it does not depend on time.
    fn model(&self) -> &Model;

    /// [`Model::topology`].
    fn topology(&self) -> &Topology {
        &self.model().topology
    }

    /// [`Model::rest`].
    fn rest(&self) -> Vec<Vec3> {
        self.model().rest.clone()
    }

    /// [`Model::duration`].
    fn duration(&self) -> f64 {
        self.model().duration
    }

    /// Moves `positions`, which came from [`rest`](Self::rest), to `time` (seconds; clamped to 0
    /// ..= duration) by the given kinds of motion; by all others they stay at time 0.
    ///
    /// The result depends on `time` and `kinds` only, as long as all calls for the same positions
    /// have the same kinds. Vertices of parts that none of these kinds moves are not written. Gives
    /// what was done; [`Pose::advance`](crate::Pose::advance) does nothing at all where the time is
    /// the same as before.
    ///
    /// # Panics
    /// If `positions` is not as long as `topology().vertex_count`.
    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats;

    /// Moves `positions` to `time` by all kinds of motion.
    ///
    /// # Panics
    /// If `positions` is not as long as `topology().vertex_count`.
    fn pose(&self, time: f64, positions: &mut [Vec3]) -> PoseStats {
        self.pose_by(Motion::all(), time, positions)
    }

    /// The view the source suggests at `time`, if any.
    fn view(&self, _time: f64) -> Option<View> {
        None
    }

    /// The light the source brings at `time`, if any.
    fn light(&self, _time: f64) -> Option<Light> {
        None
    }

    /// Overwrites the entries of `normals` for which the source has better ones than
    /// [`vertex_normals`](crate::vertex_normals) makes, such as a file's own or those of pieces
    /// that were one surface, with unit vectors as they are at `time`. The others are left as they
    /// are.
    ///
    /// # Panics
    /// If `normals` is not as long as `topology().vertex_count`.
    fn normals(&self, _time: f64, normals: &mut [Vec3]) {
        assert_eq!(normals.len(), self.topology().vertex_count, "normals are those of another animation");
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::path::Path;

    use super::*;
    use crate::{LoadOptions, Pose, load};

    #[test]
    fn positions_and_normals_of_another_number_of_vertices_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [mesh, aff] = ["a.obj", "a.aff"].map(|name| folder.path().join(name));
        std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        std::fs::write(&aff, "p 3  0 0 0  1 0 0  0 1 0\n").unwrap();
        let toys = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/toys.glb");
        let [mesh, aff, toys] = [mesh, aff, toys].map(|path| load(&path, &LoadOptions::default()).unwrap());
        let panics = |call: &dyn Fn()| catch_unwind(AssertUnwindSafe(call)).is_err();
        for animation in [&mesh, &aff, &toys] {
            for count in [-1, 1].map(|more| animation.topology().vertex_count.saturating_add_signed(more)) {
                let vectors = || vec![Vec3::ZERO; count];
                assert!(panics(&|| _ = animation.pose(0.5, &mut vectors())));
                assert!(panics(&|| animation.normals(0.5, &mut vectors())));
            }
        }
        for time in [0.0, 0.5] {
            assert!(panics(&|| _ = Pose::new(Motion::all(), &*mesh).advance(&*toys, time)), "at {time}");
        }
    }
}
