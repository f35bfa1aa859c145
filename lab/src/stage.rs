//! A scene made ready for tracing: triangles in the order of the first tree's leaves, looks,
//! camera, light.

use std::sync::Arc;
use std::time::Instant;

use anim::{Pose, PoseStats, View};
use anyhow::{Context, Result};
use bvh_build::{Builder, build};
use bvh_core::{Bvh, Triangles, Vec3};
use rt_cpu::{
    AmbientOcclusion, Camera, DiffuseBounces, Effects, Filter, Material, Mesh, PointLight, RenderOptions,
    Texture, Wrap,
};
use scenes::{FramePlan, LightEffects, Scene, SceneOptions};

use crate::files;
use crate::progress::Progress;

/// Loads a scene by name or path; simulations are recorded under `target/scenes`.
pub(crate) fn load(name_or_path: &str, clip: Option<&str>, seed: u64) -> Result<Scene> {
    load_at(name_or_path, clip, seed, None)
}

/// The same, with a fraction of the triangles where the scene can be made coarser.
pub(crate) fn load_at(
    name_or_path: &str,
    clip: Option<&str>,
    seed: u64,
    detail: Option<f32>,
) -> Result<Scene> {
    load_with(name_or_path, clip, SceneOptions { seed, detail, ..SceneOptions::default() })
}

/// The same, with options.
pub(crate) fn load_with(name_or_path: &str, clip: Option<&str>, options: SceneOptions<'_>) -> Result<Scene> {
    let progress = Progress::new(format!("preparing {name_or_path}"), 100);
    let report = |done: f32| progress.at((100.0 * done) as u64);
    let options = SceneOptions { cache_dir: Some(files::scene_cache()), progress: Some(&report), ..options };
    Ok(scenes::load(name_or_path, clip, &options)?)
}

/// Loads a source that may not be there or be broken, so that this shows before anything else is
/// done; scenes of the registry, which may take long, only when their turn comes.
pub(crate) fn load_first(source: &str, load: impl FnOnce() -> Result<Scene>) -> Result<Option<Scene>> {
    let is_known = scenes::list().iter().any(|info| info.name == source);
    (!is_known).then(load).transpose()
}

/// A scene at one moment.
///
/// Triangle `i` is the primitive in leaf slot `i` of the first tree, so that updates stream through
/// memory.
pub(crate) struct Stage {
    pub(crate) scene: Scene,
    /// What a frame of it runs.
    pub(crate) plan: FramePlan,
    /// The tree over the first frame, by the sweep builder, one primitive a leaf; still parts are
    /// marked as still.
    pub(crate) first_tree: Bvh,
    /// Time that building it took.
    pub(crate) build_ms: f64,
    triangles: Vec<[u32; 3]>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    material_of: Vec<u32>,
    pose: Pose,
    normals: Vec<Vec3>,
}

impl Stage {
    /// A scene at time 0.
    pub(crate) fn new(scene: Scene) -> Result<Self> {
        let topology = scene.animation.topology();
        let pose = Pose::new(&*scene.animation);
        let start = Instant::now();
        let primitives = Triangles { positions: pose.positions(), indices: &topology.triangles };
        let mut first_tree =
            build(&primitives, Builder::Sweep).with_context(|| format!("{}: no tree", scene.name))?;
        let build_ms = ms(start);
        let order = first_tree.reorder_primitives();
        first_tree.set_dynamic(|slot| topology.moves[order[slot] as usize]);

        let mut material_of = vec![0; topology.triangles.len()];
        for part in &topology.parts {
            material_of[part.triangles.start as usize..part.triangles.end as usize].fill(part.material);
        }
        Ok(Self {
            triangles: order.iter().map(|&p| topology.triangles[p as usize]).collect(),
            materials: topology.materials.iter().map(material).collect(),
            textures: topology.textures.iter().map(texture).collect(),
            material_of: order.iter().map(|&p| material_of[p as usize]).collect(),
            normals: Vec::new(),
            plan: FramePlan::new(&scene.effects),
            scene,
            first_tree,
            build_ms,
            pose,
        })
    }

    /// Time of frame `frame` of a loop of `frames`: the first and the last frame are the loop's
    /// ends.
    pub(crate) fn time_of(&self, frame: usize, frames: usize) -> f64 {
        let last = frames.saturating_sub(1).max(1);
        self.scene.animation.duration() * frame as f64 / last as f64
    }

    /// Moves everything to `time`, in seconds; nothing if it is there already.
    pub(crate) fn pose(&mut self, time: f64) -> PoseStats {
        let stats = self.pose.advance(&*self.scene.animation, time);
        if stats.count() > 0 {
            self.normals.clear();
        }
        stats
    }

    /// Positions at `count` times, evenly spread over a loop from its start to its end. The stage is
    /// then at time 0.
    pub(crate) fn positions(&mut self, count: usize) -> Vec<Vec<Vec3>> {
        let mut all = Vec::with_capacity(count);
        for i in 0..count {
            self.pose(self.time_of(i, count));
            all.push(self.pose.positions().to_vec());
        }
        self.pose(0.0);
        all
    }

    /// The triangles as they are now.
    pub(crate) fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: self.pose.positions(), indices: &self.triangles }
    }

    /// Makes normals for smooth shading, until the next pose: the source's own where it has some.
    pub(crate) fn smooth(&mut self) {
        anim::vertex_normals(&self.triangles, self.pose.positions(), &mut self.normals);
        self.scene.animation.normals(self.pose.time(), &mut self.normals);
    }

    /// What is rendered now: smooth after [`smooth`](Self::smooth), flat otherwise.
    pub(crate) fn mesh(&self) -> Mesh<'_> {
        Mesh {
            triangles: self.triangles(),
            normals: (!self.normals.is_empty()).then_some(&self.normals),
            texcoords: &self.scene.animation.topology().texcoords,
            textures: &self.textures,
            materials: &self.materials,
            material_of: &self.material_of,
        }
    }

    /// The scene's view now.
    pub(crate) fn camera(&self, width: u32, height: u32) -> Camera {
        let View { eye, target, up, fov_y } =
            self.scene.animation.view(self.pose.time()).unwrap_or(self.scene.view);
        Camera::look_at(eye, target, up, fov_y, width, height)
    }

    /// The scene's light now.
    pub(crate) fn light(&self) -> PointLight {
        let light = self.scene.animation.light(self.pose.time()).unwrap_or(self.scene.light);
        PointLight { position: light.position, color: light.color }
    }

    /// Rendering with what the scene calls for: shadow rays only where it has shadows.
    pub(crate) fn render_options(&self) -> RenderOptions {
        self.options_with(&self.scene.effects.light)
    }

    /// Rendering with the effects of `light`.
    pub(crate) fn options_with(&self, light: &LightEffects) -> RenderOptions {
        let distance = OCCLUSION_DISTANCE * self.first_tree.root().aabb().extent().length();
        let effects = Effects {
            textures: light.textures,
            alpha: light.alpha,
            mirror: light.mirror,
            ambient_occlusion: light
                .ambient_occlusion
                .then_some(AmbientOcclusion { samples: OCCLUSION_RAYS, distance }),
            diffuse_bounces: light.diffuse_bounces.then_some(DiffuseBounces { most: BOUNCES, sky: SKY }),
        };
        RenderOptions { shadows: light.shadows, effects, ..RenderOptions::default() }
    }
}

/// How far ambient occlusion looks, as a part of the diagonal of the scene, and with how many rays
/// a sample.
const OCCLUSION_DISTANCE: f32 = 0.1;
const OCCLUSION_RAYS: u32 = 16;

/// Diffuse bounces that are followed, and what the sky gives.
const BOUNCES: u32 = 16;
const SKY: [f32; 3] = [0.20, 0.22, 0.26];

fn material(material: &anim::Material) -> Material {
    let anim::Material { base_color: color, opacity, texture, cutoff, mirror } = *material;
    Material { color, opacity, texture, cutoff, mirror }
}

fn texture(texture: &anim::Texture) -> Texture {
    let anim::Image { width, height, ref texels } = texture.image;
    let wrap = texture.wrap.map(|mode| match mode {
        anim::Wrap::Repeat => Wrap::Repeat,
        anim::Wrap::MirroredRepeat => Wrap::MirroredRepeat,
        anim::Wrap::ClampToEdge => Wrap::ClampToEdge,
    });
    let filter = match texture.filter {
        anim::Filter::Nearest => Filter::Nearest,
        anim::Filter::Linear => Filter::Linear,
    };
    Texture { texels: Arc::clone(texels), width, height, wrap, filter }
}

/// Milliseconds since `start`.
pub(crate) fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// A short name of a scene for tables: its own, or the file's; a folder's ends in a slash.
pub(crate) fn label(name_or_path: &str) -> String {
    if scenes::list().iter().any(|info| info.name == name_or_path) {
        return name_or_path.to_owned();
    }
    let path = std::path::Path::new(name_or_path);
    let name = path.file_name().map_or_else(|| name_or_path.into(), |name| name.to_string_lossy());
    format!("{name}{}", if path.is_dir() { "/" } else { "" })
}

/// A label as part of a file's name.
pub(crate) fn slug(label: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '-' };
    label.trim_end_matches('/').chars().map(plain).collect()
}
