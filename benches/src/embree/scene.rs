//! A scene of one triangle mesh that Embree builds, and rays through it.
#![expect(unsafe_code, reason = "calls of a C library")]

use std::ffi::c_int;
use std::sync::Arc;

use bvh_core::{Triangles, Vec3};
use bytemuck::Zeroable;
use rt_cpu::Hit;

use super::api::{
    self, BUFFER_INDEX, BUFFER_VERTEX, DeviceHandle, Extra, FORMAT_FLOAT3, FORMAT_UINT3, Handle, INVALID_ID,
    Query1, QueryN, RayHit,
};
use crate::{Contestant, Failure, Hits, RAYS, Rays};

/// How trees are made, by the numbers of `RTCBuildQuality`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quality {
    /// In Morton order.
    Low = 0,
    /// Binned SAH.
    Medium = 1,
    /// SAH with spatial splits.
    High = 2,
    /// Built once by SAH, then refitted.
    Refit = 3,
}

/// Rays at a time.
#[derive(Clone, Copy, Debug)]
pub(super) enum Width {
    One,
    Eight,
    Sixteen,
}

/// How a scene is made and traced.
#[derive(Clone, Copy, Debug)]
pub(super) struct Config {
    pub(super) quality: Quality,
    pub(super) width: Width,
    /// Says that the scene will change.
    pub(super) dynamic: bool,
    /// Conservative box tests and a watertight triangle test.
    pub(super) robust: bool,
    /// Says that rays go much the same way.
    pub(super) coherent: bool,
}

/// Vertices behind the last one, so that 16 bytes can be read from there, as Embree asks for.
const PADDING: usize = 2;

pub(super) struct Scene {
    device: Arc<DeviceHandle>,
    scene: Handle,
    geometry: Handle,
    config: Config,
    /// Shared with Embree: neither is ever moved or resized.
    positions: Box<[Vec3]>,
    indices: Box<[[u32; 3]]>,
}

// SAFETY: Embree's scenes may be moved between threads.
unsafe impl Send for Scene {}
// SAFETY: through a shared reference a scene is only queried, which Embree allows from several
// threads.
unsafe impl Sync for Scene {}

impl Scene {
    pub(super) fn new(
        device: &Arc<DeviceHandle>,
        config: Config,
        triangles: &Triangles<'_>,
    ) -> Result<Self, Failure> {
        let quality = config.quality;
        // Only scenes of low quality build geometry by geometry, which refitting needs.
        let scene_quality = if quality == Quality::Refit { Quality::Low } else { quality };
        let flags: c_int = if config.dynamic { api::SCENE_DYNAMIC } else { 0 }
            | if config.robust { api::SCENE_ROBUST } else { 0 };
        let mut positions = triangles.positions.to_vec();
        positions.resize(positions.len() + PADDING, Vec3::ZERO);
        let (positions, indices) = (positions.into_boxed_slice(), Box::from(triangles.indices));
        let api = &device.api;
        // SAFETY: handles are used as Embree gave them. Both buffers live in boxes that are dropped
        // after the scene is released and have the number of items that is passed; vertices have
        // readable padding behind them.
        let scene = unsafe {
            let scene = (api.new_scene)(device.handle);
            let geometry = (api.new_geometry)(device.handle, api::GEOMETRY_TRIANGLE);
            let device = Arc::clone(device);
            let scene = Self { device, scene, geometry, config, positions, indices };
            scene.device.check()?;
            (api.set_scene_flags)(scene.scene, flags);
            (api.set_scene_quality)(scene.scene, scene_quality as c_int);
            (api.set_geometry_quality)(geometry, quality as c_int);
            let (vertices, triangles) = (scene.positions.as_ptr(), scene.indices.as_ptr());
            let count = scene.positions.len() - PADDING;
            (api.set_shared_buffer)(geometry, BUFFER_VERTEX, 0, FORMAT_FLOAT3, vertices.cast(), 0, 12, count);
            let count = scene.indices.len();
            (api.set_shared_buffer)(geometry, BUFFER_INDEX, 0, FORMAT_UINT3, triangles.cast(), 0, 12, count);
            (api.commit_geometry)(geometry);
            (api.attach_geometry)(scene.scene, geometry);
            scene
        };
        scene.device.check()?;
        Ok(scene)
    }

    /// Packets of N; whatever is behind the last ray is masked out.
    fn closest_packets<const N: usize>(&self, query: QueryN, rays: &Rays, hits: &mut Hits) {
        let mut extra = Extra::new(self.device.version, self.config.coherent);
        let mut packet = RayHit::<N>::new();
        for first in (0..rays.len()).step_by(N) {
            let valid = packet.load(rays, first);
            packet.geometry = [INVALID_ID; N];
            let (a, b) = extra.with(&mut packet);
            // SAFETY: the scene is committed; the mask has N entries and an alignment of 64; ray
            // and context are laid out as the headers say and in the order of the loaded version.
            unsafe { query(valid.0.as_ptr(), self.scene, a, b) }
            let run = first..first + N;
            let missed = packet.geometry.map(|g| if g == INVALID_ID { Hits::NONE } else { 0 });
            hits.t[run.clone()].copy_from_slice(&packet.t_far);
            hits.u[run.clone()].copy_from_slice(&packet.u);
            hits.v[run.clone()].copy_from_slice(&packet.v);
            for axis in 0..3 {
                hits.normal[axis][run.clone()].copy_from_slice(&packet.normal[axis]);
            }
            let primitives = packet.primitive.iter().zip(missed).map(|(&p, missed)| p | missed);
            hits.primitive[run].iter_mut().zip(primitives).for_each(|(to, p)| *to = p);
        }
    }

    fn occluded_packets<const N: usize>(&self, query: QueryN, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let mut extra = Extra::new(self.device.version, self.config.coherent);
        let mut packet = RayHit::<N>::new();
        for first in (0..rays.len()).step_by(N) {
            let valid = packet.load(rays, first);
            let (a, b) = extra.with(&mut packet);
            // SAFETY: as above; a ray without hit is the beginning of one with.
            unsafe { query(valid.0.as_ptr(), self.scene, a, b) }
            let arrived = packet.t_far.map(|t| t == f32::NEG_INFINITY);
            blocked[first..first + N].copy_from_slice(&arrived);
        }
    }

    fn closest_one_by_one(&self, query: Query1, rays: &Rays, hits: &mut Hits) {
        let mut extra = Extra::new(self.device.version, false);
        let mut ray = RayHit::<1>::new();
        for i in 0..rays.len() {
            ray.load(rays, i);
            ray.geometry = [INVALID_ID];
            let (a, b) = extra.with(&mut ray);
            // SAFETY: as above.
            unsafe { query(self.scene, a, b) }
            let hit = Hit { t: ray.t_far[0], u: ray.u[0], v: ray.v[0], primitive: ray.primitive[0] };
            for axis in 0..3 {
                hits.normal[axis][i] = ray.normal[axis][0];
            }
            hits.set(i, (ray.geometry[0] != INVALID_ID).then_some(hit));
        }
    }

    fn occluded_one_by_one(&self, query: Query1, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let mut extra = Extra::new(self.device.version, false);
        let mut ray = RayHit::<1>::new();
        for (i, blocked) in blocked[..rays.len()].iter_mut().enumerate() {
            ray.load(rays, i);
            let (a, b) = extra.with(&mut ray);
            // SAFETY: as above.
            unsafe { query(self.scene, a, b) }
            *blocked = ray.t_far[0] == f32::NEG_INFINITY;
        }
    }
}

/// Which rays of a packet count: -1 those that do.
#[repr(C, align(64))]
struct Valid<const N: usize>([i32; N]);

impl<const N: usize> RayHit<N> {
    fn new() -> Self {
        let [primitive, geometry, instance, instance_primitive] = [[INVALID_ID; N]; 4];
        let mask = [u32::MAX; N];
        Self { mask, primitive, geometry, instance, instance_primitive, ..Self::zeroed() }
    }

    /// Takes the rays from number `first` on.
    #[inline]
    fn load(&mut self, rays: &Rays, first: usize) -> Valid<N> {
        for axis in 0..3 {
            self.origin[axis].copy_from_slice(&rays.origin[axis][first..first + N]);
            self.direction[axis].copy_from_slice(&rays.direction[axis][first..first + N]);
        }
        self.t_far.copy_from_slice(&rays.t_max[first..first + N]);
        if first + N <= rays.len() {
            return Valid([-1; N]);
        }
        Valid(std::array::from_fn(|i| -i32::from(first + i < rays.len())))
    }
}

impl Contestant for Scene {
    fn gives_normals(&self) -> bool {
        true
    }

    fn pose(&mut self, positions: &[Vec3]) {
        let count = self.positions.len() - PADDING;
        self.positions[..count].copy_from_slice(positions);
    }

    fn update(&mut self) -> Result<(), Failure> {
        let api = &self.device.api;
        // SAFETY: nobody queries the scene, since it is borrowed for writing.
        unsafe {
            (api.update_buffer)(self.geometry, BUFFER_VERTEX, 0);
            (api.commit_geometry)(self.geometry);
            (api.commit_scene)(self.scene);
        }
        self.device.check()
    }

    fn closest(&self, rays: &Rays, hits: &mut Hits) {
        let api = &self.device.api;
        match self.config.width {
            Width::One => self.closest_one_by_one(api.intersect1, rays, hits),
            Width::Eight => self.closest_packets::<8>(api.intersect8, rays, hits),
            Width::Sixteen => self.closest_packets::<16>(api.intersect16, rays, hits),
        }
    }

    fn occluded(&self, rays: &Rays, blocked: &mut [bool; RAYS]) {
        let api = &self.device.api;
        match self.config.width {
            Width::One => self.occluded_one_by_one(api.occluded1, rays, blocked),
            Width::Eight => self.occluded_packets::<8>(api.occluded8, rays, blocked),
            Width::Sixteen => self.occluded_packets::<16>(api.occluded16, rays, blocked),
        }
    }

    fn triangles(&self) -> Triangles<'_> {
        let count = self.positions.len() - PADDING;
        Triangles { positions: &self.positions[..count], indices: &self.indices }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        let api = &self.device.api;
        // SAFETY: both handles came from Embree and are released once; it ignores none that is
        // null, so that is left out.
        unsafe {
            if !self.geometry.is_null() {
                (api.release_geometry)(self.geometry);
            }
            if !self.scene.is_null() {
                (api.release_scene)(self.scene);
            }
        }
    }
}
