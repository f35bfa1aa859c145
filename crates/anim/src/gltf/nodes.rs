//! The node hierarchy: which nodes move in the clip, and where each is at a time.

use ::gltf::json::animation::{Animation, Interpolation, Property};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root};
use glam::{Affine3A, DAffine3, DVec3, Mat4, Quat, Vec3};

use super::accessor::{ALL, Accessors};
use super::track::Track;
use crate::error::{Problem, numbered};

/// All nodes of the document, in the scene or not: a skin's joints may lie outside of it.
#[derive(Default)]
pub(super) struct Nodes {
    local: Vec<Local>,
    /// Whether the node or an ancestor is animated.
    pub(super) moves: Vec<bool>,
    pub(super) in_scene: Vec<bool>,
    /// All nodes and their parents, ancestors first.
    order: Vec<(usize, Option<usize>)>,
    /// Node to scene at time 0.
    pub(super) global_at_rest: Vec<Affine3A>,
    /// If it lies elsewhere than the file's, transforms are composed in `f64`, and the origin is
    /// subtracted from those of nodes in the scene before they are rounded: close to it the scene
    /// keeps its details.
    origin: DVec3,
}

/// Transform of a node relative to its parent.
struct Local {
    /// That of a node without tracks. One given by a matrix may shear.
    fixed: Option<Affine3A>,
    /// Scale, rotation and translation where no track says otherwise.
    rest: (Vec3, Quat, Vec3),
    /// The translation with all its digits, if it has no track and they are needed.
    exact_translation: Option<DVec3>,
    /// Of translation, rotation and scale.
    tracks: [Option<Track>; 3],
}

/// The channels of a clip by node and property; of two for the same thing the later counts.
pub(super) struct Channels {
    /// Translation, rotation and scale of each node.
    transforms: Vec<[Option<Track>; 3]>,
    /// Morph target weights of each node.
    pub(super) weights: Vec<Option<Track>>,
    /// Time of the last key in seconds, of all channels that move something.
    pub(super) end: f64,
}

impl Channels {
    pub(super) fn read(clip: Option<&Animation>, accessors: &Accessors<'_>) -> Result<Self, Problem> {
        let (root, count) = (accessors.root, accessors.root.nodes.len());
        let (transforms, weights) = (vec![[None, None, None]; count], vec![None; count]);
        let mut channels = Self { transforms, weights, end: 0.0 };
        let Some(clip) = clip else { return Ok(channels) };
        for (number, channel) in clip.channels.iter().enumerate() {
            let place = format!("clip {:?}, channel {number}", clip.name.as_deref().unwrap_or_default());
            let node = channel.target.node.value();
            numbered(&root.nodes, node, "node", &place)?;
            let Checked::Valid(property) = channel.target.path else {
                accessors.leave_out("animation channels for anything but transforms and weights");
                continue;
            };
            let sampler = numbered(&clip.samplers, channel.sampler.value(), "sampler", &place)?;
            let Checked::Valid(interpolation) = sampler.interpolation else {
                return Err(Problem::new(place, "an unknown interpolation", "STEP, LINEAR or CUBICSPLINE"));
            };
            let times = accessors.read::<f32, 1>(sampler.input, ALL, &format!("{place}, times"))?;
            let times = times.into_flattened();
            check_times(&times, &place)?;
            let (place, output) = (&format!("{place}, values"), sampler.output);
            let vectors = || Ok(accessors.read::<f32, 3>(output, ALL, place)?.into_flattened());
            let [translation, rotation, scale] = &mut channels.transforms[node];
            let (track, width, values) = match property {
                Property::Translation => (translation, 3, vectors()?),
                Property::Scale => (scale, 3, vectors()?),
                Property::Rotation => {
                    (rotation, 4, accessors.read::<f32, 4>(output, ALL, place)?.into_flattened())
                }
                Property::MorphTargetWeights => {
                    let values = accessors.read::<f32, 1>(output, ALL, place)?.into_flattened();
                    (&mut channels.weights[node], target_count(root, node), values)
                }
            };
            if width == 0 {
                // A node without morph targets has no weights to animate.
                continue;
            }
            let per_key = if interpolation == Interpolation::CubicSpline { 3 * width } else { width };
            let count = times.len().saturating_mul(per_key);
            if values.len() != count {
                let expected = format!("{count} ({} keys of {per_key})", times.len());
                return Err(Problem::new(place, format!("{} numbers", values.len()), expected));
            }
            channels.end = channels.end.max(times.last().map_or(0.0, |&last| last.into()));
            *track = Some(Track { times, values, width, interpolation });
        }
        Ok(channels)
    }
}

fn check_times(times: &[f32], place: &str) -> Result<(), Problem> {
    let found = if times.is_empty() {
        "no keys".to_owned()
    } else if let Some(time) = times.iter().find(|time| !time.is_finite()) {
        format!("a key at {time} s")
    } else if let Some(pair) = times.windows(2).find(|pair| pair[1] < pair[0]) {
        format!("a key at {} s before one at {} s", pair[0], pair[1])
    } else {
        return Ok(());
    };
    Err(Problem::new(place, found, "at least one key, at finite times in increasing order"))
}

/// Number of morph targets of the mesh at `node`.
pub(super) fn target_count(root: &Root, node: usize) -> usize {
    let mesh = root.nodes[node].mesh.and_then(|mesh| root.meshes.get(mesh.value()));
    let targets =
        mesh.and_then(|mesh| mesh.primitives.first()).and_then(|primitive| primitive.targets.as_ref());
    targets.map_or(0, Vec::len)
}

/// How errors name a node.
pub(super) fn node_name(root: &Root, node: usize) -> String {
    match &root.nodes[node].name {
        Some(name) => format!("node {node} {name:?}"),
        None => format!("node {node}"),
    }
}

impl Nodes {
    /// Reads the hierarchy, which must be a forest, and takes the tracks of `channels` that move
    /// something. `exact` has the translations with all their digits; it is empty if they are not
    /// needed.
    pub(super) fn read(
        accessors: &Accessors<'_>,
        exact: Vec<Option<DVec3>>,
        scene: &[usize],
        channels: &mut Channels,
    ) -> Result<Self, Problem> {
        let (root, origin) = (accessors.root, accessors.options.origin);
        let order = ancestors_first(root)?;
        let exact = exact.into_iter().chain(std::iter::repeat(None));
        let given = root.nodes.iter().zip(channels.transforms.drain(..)).zip(exact);
        let local: Vec<Local> =
            given.map(|((node, tracks), exact)| Local::read(node, tracks, exact)).collect();
        let count = local.len();
        let mut nodes = Self {
            moves: vec![false; count],
            in_scene: vec![false; count],
            order,
            global_at_rest: vec![Affine3A::IDENTITY; count],
            local,
            origin,
        };
        scene.iter().for_each(|&node| nodes.in_scene[node] = true);
        for &(node, parent) in &nodes.order {
            let local = &nodes.local[node];
            nodes.moves[node] = local.moves() || parent.is_some_and(|parent| nodes.moves[parent]);
            let local = local.at(0.0);
            nodes.global_at_rest[node] = parent.map_or(local, |parent| nodes.global_at_rest[parent] * local);
        }
        Ok(nodes)
    }

    /// Node to scene at `time`, of every node.
    pub(super) fn globals(&self, time: f64) -> Vec<Affine3A> {
        if self.origin != DVec3::ZERO {
            return self.globals_from_origin(time);
        }
        let mut globals = self.global_at_rest.clone();
        for &(node, parent) in self.order.iter().filter(|&&(node, _)| self.moves[node]) {
            let local = self.local[node].at(time);
            globals[node] = parent.map_or(local, |parent| globals[parent] * local);
        }
        globals
    }

    /// As [`globals`](Self::globals), relative to an origin other than the file's.
    fn globals_from_origin(&self, time: f64) -> Vec<Affine3A> {
        let mut globals = vec![DAffine3::IDENTITY; self.local.len()];
        for &(node, parent) in &self.order {
            let mut local = self.local[node].at(time).as_daffine3();
            local.translation = self.local[node].exact_translation.unwrap_or(local.translation);
            globals[node] = parent.map_or(local, |parent| globals[parent] * local);
        }
        for (global, _) in globals.iter_mut().zip(&self.in_scene).filter(|&(_, &in_scene)| in_scene) {
            global.translation -= self.origin;
        }
        globals.iter().map(DAffine3::as_affine3a).collect()
    }
}

impl Local {
    fn read(node: &::gltf::json::Node, tracks: [Option<Track>; 3], exact: Option<DVec3>) -> Self {
        let matrix = node.matrix.map(|matrix| affine(&matrix));
        let rest = match matrix {
            Some(matrix) => matrix.to_scale_rotation_translation(),
            None => (
                Vec3::from_array(node.scale.unwrap_or([1.0; 3])),
                node.rotation.map_or(Quat::IDENTITY, |rotation| Quat::from_array(rotation.0)),
                Vec3::from_array(node.translation.unwrap_or_default()),
            ),
        };
        // What tracks say, be it the same at all times, takes the place of what the node says.
        let exact_translation = exact.filter(|_| tracks[0].is_none());
        let fixed = matrix.filter(|_| tracks.iter().all(Option::is_none));
        let mut local = Self { fixed, rest, exact_translation, tracks };
        // Exporters like to write keys for everything; a value that stays the same is no motion.
        local.rest = local.parts(0.0);
        for track in &mut local.tracks {
            track.take_if(|track| track.is_constant());
        }
        local.fixed = (!local.moves()).then(|| local.at(0.0));
        local
    }

    fn moves(&self) -> bool {
        self.tracks.iter().any(Option::is_some)
    }

    fn at(&self, time: f64) -> Affine3A {
        self.fixed.unwrap_or_else(|| {
            let (scale, rotation, translation) = self.parts(time);
            Affine3A::from_scale_rotation_translation(scale, rotation, translation)
        })
    }

    /// Scale, rotation and translation.
    fn parts(&self, time: f64) -> (Vec3, Quat, Vec3) {
        let [translation, rotation, scale] = self.tracks.each_ref().map(Option::as_ref);
        (
            scale.map_or(self.rest.0, |track| track.vec3(time)),
            rotation.map_or(self.rest.1, |track| track.rotation(time)),
            translation.map_or(self.rest.2, |track| track.vec3(time)),
        )
    }
}

/// The affine part of a column-major 4 x 4 matrix; the specification allows nothing else.
pub(super) fn affine(matrix: &[f32; 16]) -> Affine3A {
    Affine3A::from_mat4(Mat4::from_cols_array(matrix))
}

/// All nodes with their parents, each behind its parent. What cannot be reached from a node without
/// a parent lies on a cycle.
fn ancestors_first(root: &Root) -> Result<Vec<(usize, Option<usize>)>, Problem> {
    let mut parent = vec![None; root.nodes.len()];
    for (number, node) in root.nodes.iter().enumerate() {
        let name = node_name(root, number);
        for child in node.children.iter().flatten().map(Index::value) {
            numbered(&root.nodes, child, "child node", &name)?;
            if let Some(other) = parent[child].replace(number) {
                let found = format!("two parents, {} and {name}", node_name(root, other));
                return Err(Problem::new(node_name(root, child), found, "at most one"));
            }
        }
    }
    let mut order: Vec<_> = (0..).zip(parent).filter(|(_, parent)| parent.is_none()).collect();
    let mut lost = vec![true; root.nodes.len()];
    let mut next = 0;
    while let Some(&(node, _)) = order.get(next) {
        let children = root.nodes[node].children.iter().flatten().map(Index::value);
        order.extend(children.map(|child| (child, Some(node))));
        lost[node] = false;
        next += 1;
    }
    let Some(lost) = lost.iter().position(|&lost| lost) else { return Ok(order) };
    Err(Problem::new(node_name(root, lost), "a node that is its own ancestor", "a hierarchy without cycles"))
}
