//! glTF 2.0 playback: one clip of a .gltf or .glb file, its nodes, skins and morph targets
//! evaluated on demand.
//!
//! Sections are those of the [glTF 2.0
//! specification](https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html). Read are triangles
//! (lists, strips, fans), normals, base colours and their textures (3.9.2), alpha masks (3.9.4),
//! transforms, skins (3.7.3.3), morph targets (3.7.2.2), clips (3.11), sparse and quantised
//! accessors (3.6.2), the first perspective camera and the first light. Blended surfaces are there
//! where at least half opaque; smooth metals are mirrors, and all other surfaces diffuse, with two
//! sides. Against 3.7.2.1, primitives without normals are shaded smooth where they share vertices.

mod accessor;
mod material;
mod nodes;
mod primitive;
mod seen;
mod source;
#[cfg(test)]
mod tests;
mod track;

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Mesh, Root};
use glam::{Affine3A, DVec3, Mat3A, Vec2, Vec3};

use self::accessor::{ALL, Accessors};
use self::material::{Mapping, add_textures, material_of, materials};
use self::nodes::{Channels, Nodes, affine, node_name, target_count};
use self::primitive::Geometry;
use self::seen::{Camera, LightSource};
use self::track::Track;
use crate::budget::Budget;
use crate::error::{LoadError, NUMBERED, Problem, numbered};
use crate::{Animation, Light, LoadOptions, Model, Motion, Part, PoseStats, View};

/// A clip of a glTF file, ready to be posed at any time.
///
/// A primitive is a [`Part`](crate::Part), once for each node that shows its mesh. Parts that
/// nothing in the clip moves are transformed once, when loading.
#[derive(Default)]
pub(crate) struct GltfAnimation {
    model: Model,
    nodes: Nodes,
    skins: Vec<Skin>,
    /// Those that move.
    instances: Vec<Instance>,
    /// Normals of still parts, zero for vertices without.
    still_normals: Vec<Vec3>,
    camera: Option<Camera>,
    light: Option<LightSource>,
}

/// A primitive placed in the scene.
struct Instance {
    geometry: Arc<Geometry>,
    /// Where its vertices begin.
    first_vertex: usize,
    skin: Option<usize>,
    /// The node whose transform counts, after the skin. With a skin none does (3.7.3.3), unless the
    /// joints are outside of the scene. The specification does not allow that, but such files
    /// exist; such joints have no place in the scene of their own and are taken relative to the
    /// node that shows the mesh.
    node: Option<usize>,
    /// Those of its node's morph targets, if it has any.
    weights: Option<Arc<Track>>,
    /// What of all this changes.
    motion: Motion,
}

struct Skin {
    joints: Vec<usize>,
    inverse_bind: Vec<Affine3A>,
}

/// Reads a clip from the `bytes` of a .gltf or .glb file, by `options`.
pub(crate) fn parse(
    file: &Path,
    bytes: &[u8],
    options: &LoadOptions<'_>,
) -> Result<GltfAnimation, LoadError> {
    let budget = Budget::default();
    budget.allow_for(file, bytes.len());
    let in_file = |problem: Problem| problem.in_file(file);
    let (root, blob) = source::document(bytes).map_err(in_file)?;
    let buffers = source::read_buffers(&root, blob, file, &budget)?;
    let clips: Vec<String> =
        root.animations.iter().map(|clip| clip.name.clone().unwrap_or_default()).collect();
    let number_of = |wanted: &str| {
        let by_number = || wanted.parse().ok().filter(|&number: &usize| number < clips.len());
        let found = clips.iter().position(|name| name == wanted).or_else(by_number);
        found.ok_or_else(|| LoadError::unknown_clip(file, wanted, &clips))
    };
    let clip = options.clip.map_or(Ok(0), number_of)?;
    let accessors =
        Accessors { root: &root, buffers: &buffers, file, budget, options, left_out: RefCell::default() };
    Loader::load(&accessors, bytes, clip).map_err(in_file)
}

/// Puts an animation together.
struct Loader<'a> {
    animation: GltfAnimation,
    accessors: &'a Accessors<'a>,
    channels: Channels,
    /// Primitives by mesh and number, decoded once for all nodes that show them; `None` for those
    /// that are left out.
    decoded: HashMap<(usize, usize), Option<Arc<Geometry>>>,
}

impl<'a> Loader<'a> {
    /// `bytes` are those of the file that `accessors` were read from.
    fn load(accessors: &'a Accessors<'a>, bytes: &[u8], clip: usize) -> Result<GltfAnimation, Problem> {
        let (root, origin) = (accessors.root, accessors.options.origin);
        let exact = if origin == DVec3::ZERO { Vec::new() } else { source::translations(bytes)? };
        let mut channels = Channels::read(root.animations.get(clip), accessors)?;
        let scene = scene_nodes(root)?;
        let nodes = Nodes::read(accessors, exact, &scene, &mut channels)?;
        let skins =
            (0..root.skins.len()).map(|skin| Skin::read(skin, accessors)).collect::<Result<_, _>>()?;
        let model = Model::with_materials(materials(root));
        let animation = GltfAnimation { model, nodes, skins, ..GltfAnimation::default() };
        let mut loader = Self { animation, accessors, channels, decoded: HashMap::new() };
        for &node in &scene {
            loader.add_mesh(node)?;
        }

        let Self { mut animation, channels, .. } = loader;
        if animation.model.topology.triangles.is_empty() {
            let found = format!("{} nodes without triangles", scene.len());
            return Err(Problem::new("scene", found, "at least one triangle"));
        }
        let mut rest = vec![Vec3::ZERO; animation.model.topology.vertex_count];
        let all: Vec<_> = animation.instances.iter().collect();
        animation.write(&all, Motion::all(), 0.0, &mut rest);
        animation.model.rest = rest;
        let is_still = |part: &&Instance| part.motion.is_empty() && part.normals().is_some();
        if animation.instances.iter().any(|part| is_still(&part)) {
            let mut normals = vec![Vec3::ZERO; animation.model.rest.len()];
            let globals = animation.nodes.globals(0.0);
            let still = animation.instances.iter().filter(is_still);
            still.for_each(|part| animation.write_normals(part, &globals, &mut normals));
            animation.still_normals = normals;
        }
        animation.instances.retain(|instance| !instance.motion.is_empty());
        if !animation.model.topology.texcoords.is_empty() {
            animation.model.topology.texcoords.resize(animation.model.topology.vertex_count, Vec2::ZERO);
        }
        let remarks = add_textures(&mut animation.model.topology, accessors)?;
        let emissive = root.materials.iter().filter(|material| material.emissive_factor.0 != [0.0; 3]);
        emissive.for_each(|_| accessors.leave_out("emissive colours"));
        let left_out = accessors.left_out.take().into_iter();
        let left_out = left_out.map(|(what, count)| format!("{count} {what} are left out"));
        let mut notes: Vec<String> = left_out.chain(remarks).collect();
        let unknown = |name: &&str| !source::UNDERSTOOD.contains(name);
        let unknown: Vec<_> = root.extensions_used.iter().map(String::as_str).filter(unknown).collect();
        if !unknown.is_empty() {
            notes.push(format!("what these extensions say is left out: {}", unknown.join(", ")));
        }
        animation.camera = Camera::first(root, &scene);
        animation.model.notes = notes;
        animation.light = LightSource::first(root, &scene, &mut animation.model)?;
        let seen_from = [animation.camera.as_ref().map(|c| c.node), animation.light.as_ref().map(|l| l.node)];
        let any_moves = seen_from.into_iter().flatten().any(|node| animation.nodes.moves[node]);
        if any_moves || !animation.instances.is_empty() {
            animation.model.duration = channels.end;
        }
        Ok(animation)
    }

    /// Adds the mesh that `node` shows, if any: a part for each primitive with triangles.
    fn add_mesh(&mut self, node: usize) -> Result<(), Problem> {
        let (root, place) = (self.accessors.root, node_name(self.accessors.root, node));
        let Some(mesh_number) = root.nodes[node].mesh.map(|mesh| mesh.value()) else { return Ok(()) };
        let mesh = numbered(&root.meshes, mesh_number, "mesh", &*place)?;
        let skin = root.nodes[node].skin.map(|skin| skin.value());
        if let Some(skin) = skin {
            numbered(&self.animation.skins, skin, "skin", place)?;
        }
        let weights = self.morph_weights(node, mesh)?;
        let name = root.nodes[node].name.as_ref().or(mesh.name.as_ref());
        let name = name.cloned().unwrap_or_else(|| format!("node {node}"));

        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let mesh_name = mesh.name.as_deref().unwrap_or_default();
            let place = format!("mesh {mesh_number} {mesh_name:?}, primitive {number}");
            let material = material_of(primitive, root, &place)?;
            let key = (mesh_number, number);
            if !self.decoded.contains_key(&key) {
                let mapping = Mapping::of(root, material);
                let read = Geometry::read(primitive, mapping.as_ref(), self.accessors, &place)?;
                self.decoded.insert(key, read.map(Arc::new));
            }
            let Some(geometry) = self.decoded[&key].clone() else {
                self.accessors.leave_out("primitives of points or lines, or without positions,");
                continue;
            };
            let colors = Checked::Valid(Semantic::Colors(0));
            if primitive.attributes.contains_key(&colors) {
                self.accessors.leave_out("sets of vertex colours");
            }
            let GltfAnimation { nodes, skins, model, .. } = &self.animation;
            let skin = skin.filter(|_| geometry.influences.is_some());
            let joints = skin.map_or(&[][..], |skin| &skins[skin].joints);
            if let (Some(skin), Some(influences)) = (skin, &geometry.influences) {
                numbered(joints, influences.highest_joint(), "joint", format!("{place}, skin {skin}"))?;
            }
            let instance = Instance {
                geometry,
                first_vertex: model.topology.vertex_count,
                skin,
                node: (!joints.iter().any(|&joint| nodes.in_scene[joint])).then_some(node),
                weights: weights.clone(),
                motion: Motion::empty(),
            };
            self.add(instance, &name, material, &place)?;
        }
        Ok(())
    }

    /// Morph target weights of the `mesh` at `node`, from its channel, else from the node, else
    /// from the mesh, else 0.
    fn morph_weights(&mut self, node: usize, mesh: &Mesh) -> Result<Option<Arc<Track>>, Problem> {
        let Accessors { root, budget, .. } = self.accessors;
        let count = target_count(root, node);
        if count == 0 {
            return Ok(None);
        }
        budget.spend((count * size_of::<f32>()) as u64, "morph target weights")?;
        let given = root.nodes[node].weights.as_ref().or(mesh.weights.as_ref());
        let given = given.cloned().unwrap_or_else(|| vec![0.0; count]);
        if given.len() != count {
            let (found, expected) = (given.len(), format!("{count}, one for each morph target"));
            return Err(Problem::new(node_name(root, node), format!("{found} weights"), expected));
        }
        let track = self.channels.weights[node].take().unwrap_or_else(|| Track::constant(given));
        let track = if track.is_constant() { Track::constant(track.value(0).to_vec()) } else { track };
        Ok(Some(Arc::new(track)))
    }

    /// Adds an instance and its part of the topology, and finds out how it moves.
    fn add(&mut self, mut instance: Instance, name: &str, material: u32, place: &str) -> Result<(), Problem> {
        let animation = &mut self.animation;
        let geometry = Arc::clone(&instance.geometry);
        let is_mirrored = animation.is_mirrored(&instance);
        let vertices = geometry.positions.len();
        // Lists that grow have room for twice as many.
        self.accessors.budget.spend((name.len() + 2 * size_of::<(Part, Instance)>()) as u64, place)?;
        self.accessors.budget.spend_on(vertices, geometry.triangles.len(), place)?;
        let (motion, vertex_moves) = animation.motion_of(&instance);
        instance.motion = motion;
        let too_large = || Problem::new(place, "too many vertices or triangles in all", NUMBERED);
        let topology = &mut animation.model.topology;
        let name = name.to_owned();
        let part = topology.add_part(name, &geometry.triangles, vertices, material).ok_or_else(too_large)?;
        part.motion = motion;
        let first = part.triangles.start as usize;
        for (moves, corners) in topology.moves[first..].iter_mut().zip(&geometry.triangles) {
            *moves = corners.iter().any(|&corner| vertex_moves[corner as usize]);
        }
        if is_mirrored {
            topology.triangles[first..].iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        if let Some(texcoords) = &geometry.texcoords {
            topology.texcoords.resize(instance.first_vertex, Vec2::ZERO);
            topology.texcoords.extend_from_slice(texcoords);
        }
        animation.instances.push(instance);
        Ok(())
    }
}

impl GltfAnimation {
    /// Whether the node of `instance` mirrors it at rest: its triangles are then wound the other
    /// way (3.7.4).
    fn is_mirrored(&self, instance: &Instance) -> bool {
        let mirrors = |node: usize| self.nodes.global_at_rest[node].matrix3.determinant() < 0.0;
        instance.skin.is_none() && instance.node.is_some_and(mirrors)
    }

    /// What of `instance` moves, and for each of its vertices whether anything in the clip moves
    /// it.
    fn motion_of(&self, instance: &Instance) -> (Motion, Vec<bool>) {
        let (geometry, node_moves) = (&*instance.geometry, &self.nodes.moves);
        let rigid = instance.node.is_some_and(|node| node_moves[node]);
        let mut moves = vec![rigid; geometry.positions.len()];
        let joints = instance.skin.map_or(&[][..], |skin| &self.skins[skin].joints);
        if let (Some(_), Some(influences)) = (instance.skin, &geometry.influences) {
            for (vertex, moves) in moves.iter_mut().enumerate() {
                *moves |= influences.of(vertex).iter().any(|&(joint, _)| node_moves[joints[joint as usize]]);
            }
        }
        let weights_vary = instance.weights.as_ref().is_some_and(|weights| !weights.is_constant());
        let displaced = geometry.targets.iter().flatten().filter(|_| weights_vary);
        displaced.clone().for_each(|&(vertex, _)| moves[vertex as usize] = true);
        // What no vertex notices is no motion.
        let noticed = moves.contains(&true);
        let mut motion = Motion::empty();
        motion.set(Motion::RIGID, noticed && rigid);
        motion.set(Motion::SKIN, noticed && joints.iter().any(|&joint| node_moves[joint]));
        motion.set(Motion::MORPH, noticed && displaced.count() > 0);
        (motion, moves)
    }

    /// Writes the positions of `instances`, where the given kinds of motion are at `time` and all
    /// others at 0.
    fn write(&self, instances: &[&Instance], kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        let mut stats = PoseStats::default();
        let at = |on: bool| if on { time } else { 0.0 };
        let [skin, rigid] = [Motion::SKIN, Motion::RIGID].map(|kind| kinds.contains(kind));
        let joint_globals = self.nodes.globals(at(skin));
        let other_time = (rigid != skin).then(|| self.nodes.globals(at(rigid)));
        let node_globals = other_time.as_ref().unwrap_or(&joint_globals);
        let mut joint_matrices: Vec<Option<Vec<Affine3A>>> = vec![None; self.skins.len()];
        let mut weights = Vec::new();
        for instance in instances {
            let (geometry, motion) = (&*instance.geometry, instance.motion & kinds);
            let positions = &mut positions[instance.first_vertex..][..geometry.positions.len()];
            positions.copy_from_slice(&geometry.positions);
            if let Some(track) = &instance.weights {
                weights.resize(track.width, 0.0);
                track.sample(at(kinds.contains(Motion::MORPH)), &mut weights);
                stats.morph.add_if(motion.contains(Motion::MORPH), || geometry.morph(&weights, positions));
            }
            if let (Some(skin), Some(influences)) = (instance.skin, &geometry.influences) {
                let matrices =
                    joint_matrices[skin].get_or_insert_with(|| self.skins[skin].matrices(&joint_globals));
                stats.skin.add_if(motion.contains(Motion::SKIN), || {
                    influences.skin(positions, |joint, bound| matrices[joint].transform_point3a(bound));
                    positions.len()
                });
            }
            if let Some(node) = instance.node {
                let to_scene = &node_globals[node];
                stats.rigid.add_if(motion.contains(Motion::RIGID), || {
                    positions.iter_mut().for_each(|p| *p = to_scene.transform_point3(*p));
                    positions.len()
                });
            }
        }
        stats
    }

    /// Writes the normals of one instance that have a direction, where `globals` puts the nodes.
    fn write_normals(&self, instance: &Instance, globals: &[Affine3A], out: &mut [Vec3]) {
        let Some(mut normals) = instance.normals().map(<[Vec3]>::to_vec) else { return };
        if let (Some(skin), Some(influences)) = (instance.skin, &instance.geometry.influences) {
            let matrices: Vec<Mat3A> =
                self.skins[skin].matrices(globals).iter().map(|m| cofactors(m.matrix3)).collect();
            influences.skin(&mut normals, |joint, bound| matrices[joint] * bound);
        }
        if let Some(node) = instance.node {
            let Mat3A { x_axis, y_axis, z_axis } = globals[node].matrix3;
            let greatest = x_axis.abs().max(y_axis.abs()).max(z_axis.abs()).max_element();
            // Squares of very small and very large scales leave the range of `f32`. Divided by a
            // power of two, the matrix keeps its digits.
            let power = f32::from_bits(greatest.max(f32::MIN_POSITIVE).to_bits() & 0x7f80_0000);
            let to_scene = cofactors(globals[node].matrix3 * power.recip());
            let to_scene = if self.is_mirrored(instance) { -to_scene } else { to_scene };
            normals.iter_mut().for_each(|normal| *normal = to_scene * *normal);
        }
        for (out, normal) in out[instance.first_vertex..].iter_mut().zip(normals) {
            *out = normal.normalize_or(*out);
        }
    }
}

impl Animation for GltfAnimation {
    fn model(&self) -> &Model {
        &self.model
    }

    fn pose_by(&self, kinds: Motion, time: f64, positions: &mut [Vec3]) -> PoseStats {
        assert_eq!(positions.len(), self.topology().vertex_count, "positions are those of another animation");
        let moving = self.instances.iter().filter(|part| part.motion.intersects(kinds));
        let moving: Vec<_> = moving.collect();
        if moving.is_empty() {
            return PoseStats::default();
        }
        self.write(&moving, kinds, self.model.clamp(time), positions)
    }

    /// The first perspective camera of the scene.
    fn view(&self, time: f64) -> Option<View> {
        let camera = self.camera.as_ref()?;
        camera.view(&self.nodes.globals(self.model.clamp(time))[camera.node])
    }

    /// The first light of the scene, with its colour but not its intensity, which would need an
    /// exposure.
    ///
    /// A directional light is put far away; a spot light shines all round.
    fn light(&self, time: f64) -> Option<Light> {
        let light = self.light.as_ref()?;
        light.at(&self.nodes.globals(self.model.clamp(time))[light.node])
    }

    /// The normals of the file, but not those of parts with morph targets.
    fn normals(&self, time: f64, normals: &mut [Vec3]) {
        assert_eq!(normals.len(), self.model.topology.vertex_count, "normals are those of another animation");
        for (normal, &still) in
            normals.iter_mut().zip(&self.still_normals).filter(|(_, still)| **still != Vec3::ZERO)
        {
            *normal = still;
        }
        let globals = self.nodes.globals(self.model.clamp(time));
        self.instances.iter().for_each(|instance| self.write_normals(instance, &globals, normals));
    }
}

/// What transforms normals when `m` transforms points: the inverse transpose times the determinant,
/// which exists for every matrix.
fn cofactors(m: Mat3A) -> Mat3A {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    Mat3A::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

impl Instance {
    /// Normals before node and skin, if the file has them and no morph target changes them.
    fn normals(&self) -> Option<&[Vec3]> {
        self.geometry.normals.as_deref().filter(|_| self.geometry.targets.is_empty())
    }
}

impl Skin {
    fn read(number: usize, accessors: &Accessors<'_>) -> Result<Self, Problem> {
        let (skin, nodes) = (&accessors.root.skins[number], &accessors.root.nodes);
        let place = format!("skin {number} {:?}", skin.name.as_deref().unwrap_or_default());
        let joints: Vec<usize> = skin.joints.iter().map(Index::value).collect();
        for &joint in &joints {
            numbered(nodes, joint, "joint node", &place)?;
        }
        let inverse_bind = match skin.inverse_bind_matrices {
            None => vec![Affine3A::IDENTITY; joints.len()],
            Some(matrices) => {
                let matrices = accessors.read(matrices, ALL, &format!("{place}, inverseBindMatrices"))?;
                if matrices.len() < joints.len() {
                    let found = format!("{} inverse bind matrices", matrices.len());
                    return Err(Problem::new(place, found, format!("{}, one for each joint", joints.len())));
                }
                matrices[..joints.len()].iter().map(affine).collect()
            }
        };
        Ok(Self { joints, inverse_bind })
    }

    /// From the bind pose to the scene, for each joint.
    fn matrices(&self, globals: &[Affine3A]) -> Vec<Affine3A> {
        let joints = self.joints.iter().zip(&self.inverse_bind);
        joints.map(|(&joint, inverse_bind)| globals[joint] * *inverse_bind).collect()
    }
}

/// The nodes of the default scene, else of the first, else all; each once, parents before their
/// children.
fn scene_nodes(root: &Root) -> Result<Vec<usize>, Problem> {
    let scene = match root.scene {
        Some(scene) => Some(numbered(&root.scenes, scene.value(), "scene", "scene")?),
        None => root.scenes.first(),
    };
    let Some(scene) = scene else { return Ok((0..root.nodes.len()).collect()) };
    let mut seen = vec![false; root.nodes.len()];
    let mut order = Vec::new();
    let mut waiting: Vec<usize> = scene.nodes.iter().rev().map(Index::value).collect();
    while let Some(node) = waiting.pop() {
        numbered(&root.nodes, node, "node", "scene")?;
        if !std::mem::replace(&mut seen[node], true) {
            order.push(node);
            waiting.extend(root.nodes[node].children.iter().flatten().rev().map(Index::value));
        }
    }
    Ok(order)
}
