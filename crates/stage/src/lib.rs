//! A scene made ready for tracing: triangles in the order of the first tree's leaves, looks,
//! camera, light. Commands and viewer render from it, so their pictures are the same.

#![forbid(unsafe_code)]

use std::sync::Arc;

use anim::{Pose, PoseStats, View};
use bvh_build::{BuildError, Builder, build};
use bvh_core::{Bvh, Triangles, Vec3};
use bvh_update::{Update, UpdateError, Updater};
use rt_cpu::{
    AmbientOcclusion, Camera, DiffuseBounces, Effects, Filter, Material, Mesh, PointLight, RenderOptions,
    Texture, Wrap,
};
use scenes::{FrameStage, LightEffects, NARROWEST, Scene};

/// Returns the samples of a pixel with such effects, if none are asked for.
#[must_use]
pub fn default_samples(light: LightEffects) -> u32 {
    if light.contains(LightEffects::DIFFUSE_BOUNCES) {
        64
    } else if light.contains(LightEffects::AMBIENT_OCCLUSION) {
        4
    } else {
        1
    }
}

/// Returns the camera of a view, also of one that a file has. An image narrower than [`NARROWEST`]
/// shows as much from side to side as one of that shape, and more above and below.
#[must_use]
pub fn camera(view: View, width: u32, height: u32) -> Camera {
    let View { eye, target, up, mut fov_y } = view;
    let [across, upwards] = NARROWEST.map(u64::from);
    let (found, least) = (upwards * u64::from(width.max(1)), across * u64::from(height));
    if found < least {
        fov_y = 2.0 * libm::atanf(libm::tanf(0.5 * fov_y) * (least as f32 / found as f32));
    }
    Camera::look_at(eye, target, up, fov_y, width, height)
}

/// A scene at one moment.
///
/// Triangle `i` is the primitive in leaf slot `i` of the first tree, so that updates stream through
/// memory. A copy shares all but the positions and normals.
#[derive(Clone)]
pub struct Stage {
    /// What is shown.
    pub scene: Arc<Scene>,
    /// The tree over the first frame, by the sweep builder, one primitive a leaf; still parts are
    /// marked as still.
    pub first_tree: Arc<Bvh>,
    triangles: Arc<[[u32; 3]]>,
    materials: Arc<[Material]>,
    textures: Arc<[Texture]>,
    material_of: Arc<[u32]>,
    pose: Pose,
    normals: Vec<Vec3>,
}

impl Stage {
    /// Makes a stage of a scene at time 0.
    ///
    /// # Errors
    /// If the scene has more triangles than a tree can number.
    pub fn new(scene: Scene) -> Result<Self, BuildError> {
        Self::with_tree(scene, |triangles| build(triangles, Builder::Sweep))
    }

    /// Makes a stage of a scene at time 0, with a tree of the caller's making over its triangles.
    ///
    /// # Errors
    /// Those of `build`.
    pub fn with_tree(
        scene: Scene,
        build: impl FnOnce(&Triangles<'_>) -> Result<Bvh, BuildError>,
    ) -> Result<Self, BuildError> {
        let topology = scene.animation.topology();
        let pose = Pose::new(scene.effects.motion, &*scene.animation);
        let mut first_tree = build(&Triangles { positions: pose.positions(), indices: &topology.triangles })?;
        let order = first_tree.reorder_primitives();
        let (mut moves, mut material_of) = (topology.moves.clone(), vec![0; topology.triangles.len()]);
        for part in &topology.parts {
            let triangles = part.triangles.start as usize..part.triangles.end as usize;
            material_of[triangles.clone()].fill(part.material);
            if !part.motion.intersects(scene.effects.motion) {
                moves[triangles].fill(false);
            }
        }
        first_tree.set_dynamic(|slot| moves[order[slot] as usize]);
        Ok(Self {
            triangles: order.iter().map(|&p| topology.triangles[p as usize]).collect(),
            materials: topology.materials.iter().map(material).collect(),
            textures: topology.textures.iter().map(texture).collect(),
            material_of: order.iter().map(|&p| material_of[p as usize]).collect(),
            normals: Vec::new(),
            scene: Arc::new(scene),
            first_tree: Arc::new(first_tree),
            pose,
        })
    }

    /// Returns the time of frame `frame` of a loop of `frames`: the first and the last frame are
    /// the loop's ends.
    #[must_use]
    pub fn time_of(&self, frame: usize, frames: usize) -> f64 {
        let last = frames.saturating_sub(1).max(1);
        self.scene.animation.duration() * frame as f64 / last as f64
    }

    /// Moves everything to `time`, in seconds; nothing if it is there already.
    pub fn pose(&mut self, time: f64) -> PoseStats {
        let before = self.pose.time();
        let stats = self.pose.advance(&*self.scene.animation, time);
        // Back at rest nothing is counted, and yet all may have moved.
        if self.pose.time() != before && self.scene.effects.calls_for(FrameStage::Update) {
            self.normals.clear();
        }
        stats
    }

    /// Brings a tree over the triangles up to date, if a frame has updates: where nothing moves,
    /// no strategy runs, not even one that rebuilds.
    ///
    /// # Errors
    /// Those of [`Updater::update`].
    pub fn update(&self, tree: &mut Bvh, updater: &mut Updater) -> Result<Update, UpdateError> {
        if self.scene.effects.calls_for(FrameStage::Update) {
            return updater.update(tree, &self.triangles());
        }
        let mut nothing = Update::default();
        nothing.height = tree.height();
        Ok(nothing)
    }

    /// Returns positions at `count` times, evenly spread over a loop from its start to its end. The
    /// stage is then at time 0.
    pub fn positions(&mut self, count: usize) -> Vec<Vec<Vec3>> {
        let mut all = Vec::with_capacity(count);
        for i in 0..count {
            self.pose(self.time_of(i, count));
            all.push(self.pose.positions().to_vec());
        }
        self.pose(0.0);
        all
    }

    /// Returns the triangles as they are now.
    #[must_use]
    pub fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: self.pose.positions(), indices: &self.triangles }
    }

    /// Makes normals for smooth shading, until the next pose: the source's own where it has some
    /// and the effects leave out none of its motion.
    pub fn smooth(&mut self) {
        self.normals = anim::vertex_normals(&self.triangles, self.pose.positions());
        let motion = self.scene.effects.motion;
        if self.scene.animation.topology().parts.iter().all(|part| motion.contains(part.motion)) {
            self.scene.animation.normals(self.pose.time(), &mut self.normals);
        }
    }

    /// Returns what is rendered now: smooth after [`smooth`](Self::smooth), flat otherwise.
    #[must_use]
    pub fn mesh(&self) -> Mesh<'_> {
        Mesh {
            triangles: self.triangles(),
            normals: (!self.normals.is_empty()).then_some(&self.normals),
            texcoords: &self.scene.animation.topology().texcoords,
            textures: &self.textures,
            materials: &self.materials,
            material_of: &self.material_of,
        }
    }

    /// Returns the scene's view now.
    #[must_use]
    pub fn view(&self) -> View {
        self.scene.animation.view(self.pose.time()).unwrap_or(self.scene.view)
    }

    /// Returns the camera of the scene's view now.
    #[must_use]
    pub fn camera(&self, width: u32, height: u32) -> Camera {
        camera(self.view(), width, height)
    }

    /// Returns the scene's light now.
    #[must_use]
    pub fn light(&self) -> PointLight {
        let light = self.scene.animation.light(self.pose.time()).unwrap_or(self.scene.light);
        PointLight { position: light.position, color: light.color }
    }

    /// Returns options to render as the scene calls for: shadow rays only where it has shadows.
    #[must_use]
    pub fn render_options(&self) -> RenderOptions {
        self.options_with(self.scene.effects.light)
    }

    /// Returns options to render with the effects of `light` in place of the scene's.
    #[must_use]
    pub fn options_with(&self, light: LightEffects) -> RenderOptions {
        let distance = OCCLUSION_DISTANCE * self.first_tree.root().aabb().extent().length();
        let effects = Effects {
            textures: light.contains(LightEffects::TEXTURES),
            alpha: light.contains(LightEffects::ALPHA),
            mirror: light.contains(LightEffects::MIRROR),
            ambient_occlusion: light
                .contains(LightEffects::AMBIENT_OCCLUSION)
                .then_some(AmbientOcclusion { samples: OCCLUSION_RAYS, distance }),
            diffuse_bounces: light
                .contains(LightEffects::DIFFUSE_BOUNCES)
                .then_some(DiffuseBounces { most: BOUNCES, sky: SKY }),
        };
        RenderOptions { shadows: light.contains(LightEffects::SHADOWS), effects, ..RenderOptions::default() }
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
    let anim::Texture { width, height, ref texels, .. } = *texture;
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
