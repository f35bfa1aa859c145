//! The camera and the light of a glTF scene: the first of each (extension KHR_lights_punctual).

use ::gltf::json::Root;
use ::gltf::json::extensions::scene::khr_lights_punctual::Type as LightType;
use ::gltf::json::validation::Checked;
use glam::{Affine3A, Vec3};

use super::nodes::node_name;
use crate::error::{Problem, numbered};
use crate::{Light, Model, View};

/// A perspective camera at a node.
pub(super) struct Camera {
    pub(super) node: usize,
    fov_y: f32,
}

impl Camera {
    /// The first perspective camera among the nodes of the scene.
    pub(super) fn first(root: &Root, scene: &[usize]) -> Option<Self> {
        scene.iter().find_map(|&node| {
            let camera = root.cameras.get(root.nodes[node].camera?.value())?;
            let fov_y = camera.perspective.as_ref()?.yfov;
            (fov_y > 0.0 && fov_y < std::f32::consts::PI).then_some(Self { node, fov_y })
        })
    }

    /// What it sees where `to_scene` puts its node: it looks along its negative z axis.
    pub(super) fn view(&self, to_scene: &Affine3A) -> Option<View> {
        let eye = Vec3::from(to_scene.translation);
        let forward = to_scene.transform_vector3(Vec3::NEG_Z).try_normalize()?;
        let up = to_scene.transform_vector3(Vec3::Y).try_normalize()?;
        // Far enough for the sum to keep the direction, wherever the eye is.
        let target = eye + forward * eye.length().max(1.0);
        target.is_finite().then_some(View { eye, target, up, fov_y: self.fov_y })
    }
}

/// A light at a node. Intensity would need an exposure and is not kept, nor are range and a spot
/// light's cone.
pub(super) struct LightSource {
    pub(super) node: usize,
    color: [f32; 3],
    /// For a directional light, from where in the scene and how far to stand back.
    directional: Option<(Vec3, f32)>,
}

impl LightSource {
    /// The first light among the nodes of the scene, a directional one far from the rest positions
    /// of `model`, which gets notes on what is not shown as the file has it.
    pub(super) fn first(root: &Root, scene: &[usize], model: &mut Model) -> Result<Option<Self>, Problem> {
        let of_node =
            |node: usize| Some(root.nodes[node].extensions.as_ref()?.khr_lights_punctual.as_ref()?.light);
        let mut of_scene = scene.iter().filter_map(|&node| Some((node, of_node(node)?)));
        let Some((node, number)) = of_scene.next() else { return Ok(None) };
        let lights = root.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let lights = lights.map_or(&[][..], |lights| &lights.lights);
        let light = numbered(lights, number.value(), "light", node_name(root, node))?;
        let is = |kind| matches!(light.type_, Checked::Valid(found) if found == kind);
        let far_from = |(low, high): (Vec3, Vec3)| {
            let extent = (high.as_dvec3() - low.as_dvec3()).length();
            (0.5 * low + 0.5 * high, (100.0 * extent).min(f64::from(f32::MAX / 4.0)) as f32)
        };
        let directional =
            is(LightType::Directional).then(|| model.bounds().map_or((Vec3::ZERO, 1.0), far_from));
        let spot = || "the spot light shines all round, without its cone".to_owned();
        let spot = is(LightType::Spot).then(spot);
        let others = of_scene.count();
        let others = (others > 0).then(|| format!("of {} lights only the first shines", others + 1));
        model.notes.extend(spot.into_iter().chain(others));
        let color = light.color.map(|x| if x.is_finite() { x.max(0.0) } else { 1.0 });
        Ok(Some(Self { node, color, directional }))
    }

    /// Where it shines from when `to_scene` puts its node; a directional light from so far away,
    /// against its direction, that its rays are all but parallel.
    pub(super) fn at(&self, to_scene: &Affine3A) -> Option<Light> {
        let position = match self.directional {
            None => Vec3::from(to_scene.translation),
            Some((center, distance)) => {
                center + to_scene.transform_vector3(Vec3::Z).try_normalize()? * distance
            }
        };
        position.is_finite().then_some(Light { position, color: self.color })
    }
}
