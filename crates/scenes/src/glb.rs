//! Writes binary glTF 2.0 files: meshes with skins and morph targets, nodes, one clip, a camera and
//! a light.
//!
//! The document is written as JSON text: with the types of `gltf-json`, which want every optional
//! field of every object, this file was longer.

use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};

use crate::shape::Mesh;

/// Types of components, section 3.6.2.2 of the glTF 2.0 specification.
const U8: u32 = 5121;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// A file under construction. Things are named by their number in the order of their making.
#[derive(Default)]
pub(crate) struct Glb {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    skins: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
    /// Whether each node has a parent.
    children: Vec<bool>,
    triangles: usize,
    cameras: Vec<Value>,
    lights: Vec<Value>,
}

/// Joints and weights of a vertex: up to four, weights that add up to 1.
pub(crate) type Influence = ([u8; 4], [f32; 4]);

impl Glb {
    pub(crate) fn material(&mut self, color: [f32; 3]) -> usize {
        let [r, g, b] = color;
        push(
            &mut self.materials,
            json!({"pbrMetallicRoughness": {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0}}),
        )
    }

    pub(crate) fn mesh(&mut self, mesh: &Mesh, material: usize) -> usize {
        let primitive = self.primitive(mesh, material);
        push(&mut self.meshes, json!({"primitives": [primitive]}))
    }

    /// A mesh whose vertices follow joints.
    pub(crate) fn skinned_mesh(&mut self, mesh: &Mesh, influences: &[Influence], material: usize) -> usize {
        let mut primitive = self.primitive(mesh, material);
        let joints: Vec<u8> = influences.iter().flat_map(|i| i.0).collect();
        let weights: Vec<f32> = influences.iter().flat_map(|i| i.1).collect();
        let joints = self.accessor(&joints, U8, "VEC4", influences.len());
        let weights = self.accessor(bytemuck::cast_slice(&weights), F32, "VEC4", influences.len());
        primitive["attributes"]["JOINTS_0"] = json!(joints);
        primitive["attributes"]["WEIGHTS_0"] = json!(weights);
        push(&mut self.meshes, json!({"primitives": [primitive]}))
    }

    /// A mesh with morph targets, each the positions of all vertices at full weight.
    pub(crate) fn morphed_mesh(&mut self, mesh: &Mesh, targets: &[Vec<Vec3>], material: usize) -> usize {
        let mut primitive = self.primitive(mesh, material);
        let target = |target: &Vec<Vec3>| -> Value {
            let moves: Vec<Vec3> = target.iter().zip(&mesh.positions).map(|(t, p)| *t - *p).collect();
            json!({"POSITION": self.positions(&moves)})
        };
        primitive["targets"] = targets.iter().map(target).collect();
        push(&mut self.meshes, json!({"primitives": [primitive], "weights": vec![0.0; targets.len()]}))
    }

    fn primitive(&mut self, mesh: &Mesh, material: usize) -> Value {
        let positions = self.positions(&mesh.positions);
        self.triangles += mesh.triangles.len();
        let indices: &[u32] = mesh.triangles.as_flattened();
        let indices = self.accessor(bytemuck::cast_slice(indices), U32, "SCALAR", indices.len());
        json!({"attributes": {"POSITION": positions}, "indices": indices, "material": material})
    }

    fn positions(&mut self, positions: &[Vec3]) -> usize {
        let number = self.accessor(bytemuck::cast_slice(positions), F32, "VEC3", positions.len());
        let low = positions.iter().fold(Vec3::MAX, |a, &b| a.min(b)).to_array();
        let high = positions.iter().fold(Vec3::MIN, |a, &b| a.max(b)).to_array();
        self.accessors[number]["min"] = json!(low);
        self.accessors[number]["max"] = json!(high);
        number
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = push(&mut self.views, view);
        push(
            &mut self.accessors,
            json!({"bufferView": view, "componentType": component, "type": kind, "count": count}),
        )
    }

    /// Number of triangles of all meshes so far.
    pub(crate) fn triangle_count(&self) -> usize {
        self.triangles
    }

    /// A node below `parent`, or at the root.
    pub(crate) fn node(&mut self, name: &str, parent: Option<usize>, at: Vec3, turn: Quat) -> usize {
        let node = json!({"name": name, "translation": at.to_array(), "rotation": turn.to_array()});
        let number = push(&mut self.nodes, node);
        self.children.push(parent.is_some());
        if let Some(parent) = parent {
            match self.nodes[parent]["children"].as_array_mut() {
                Some(children) => children.push(json!(number)),
                None => self.nodes[parent]["children"] = json!([number]),
            }
        }
        number
    }

    /// A node at the root or below `parent`, with a mesh and no transform of its own.
    pub(crate) fn show(&mut self, name: &str, parent: Option<usize>, mesh: usize) -> usize {
        let node = self.node(name, parent, Vec3::ZERO, Quat::IDENTITY);
        self.nodes[node]["mesh"] = json!(mesh);
        node
    }

    /// Makes the mesh of a node follow `joints`, which now stand as they do where the mesh is
    /// undeformed.
    ///
    /// `places` are the joints' positions in the space of the mesh; joints are not turned there.
    pub(crate) fn skin(&mut self, node: usize, joints: &[usize], places: &[Vec3]) {
        let inverse: Vec<f32> =
            places.iter().flat_map(|&p| Mat4::from_translation(-p).to_cols_array()).collect();
        let matrices = self.accessor(bytemuck::cast_slice(&inverse), F32, "MAT4", places.len());
        let skin = push(&mut self.skins, json!({"joints": joints, "inverseBindMatrices": matrices}));
        self.nodes[node]["skin"] = json!(skin);
    }

    /// Keys of a node's translation, evenly spaced from 0 to `seconds`.
    pub(crate) fn translate(&mut self, node: usize, seconds: f32, keys: &[Vec3]) {
        self.channel(node, "translation", "VEC3", seconds, keys.len(), bytemuck::cast_slice(keys));
    }

    /// Keys of a node's rotation.
    pub(crate) fn rotate(&mut self, node: usize, seconds: f32, keys: &[Quat]) {
        let floats: Vec<f32> = keys.iter().flat_map(Quat::to_array).collect();
        self.channel(node, "rotation", "VEC4", seconds, keys.len(), &floats);
    }

    /// Keys of the weights of a node's `targets` morph targets.
    pub(crate) fn morph(&mut self, node: usize, seconds: f32, targets: usize, keys: &[f32]) {
        self.channel(node, "weights", "SCALAR", seconds, keys.len() / targets, keys);
    }

    fn channel(&mut self, node: usize, path: &str, kind: &str, seconds: f32, keys: usize, values: &[f32]) {
        let times: Vec<f32> = (0..keys).map(|k| seconds * k as f32 / (keys - 1) as f32).collect();
        let input = self.accessor(bytemuck::cast_slice(&times), F32, "SCALAR", keys);
        self.accessors[input]["min"] = json!([0.0]);
        self.accessors[input]["max"] = json!([seconds]);
        let components = if path == "weights" { values.len() } else { keys };
        let output = self.accessor(bytemuck::cast_slice(values), F32, kind, components);
        let sampler = push(&mut self.samplers, json!({"input": input, "output": output}));
        self.channels.push(json!({"sampler": sampler, "target": {"node": node, "path": path}}));
    }

    pub(crate) fn camera(&mut self, eye: Vec3, target: Vec3, fov_y: f32) {
        let camera = json!({"type": "perspective", "perspective": {"yfov": fov_y, "znear": 0.01}});
        let camera = push(&mut self.cameras, camera);
        let back = (eye - target).normalize();
        let right = Vec3::Y.cross(back).normalize();
        let turn = Quat::from_mat3(&glam::Mat3::from_cols(right, back.cross(right), back));
        let node = self.node("camera", None, eye, turn);
        self.nodes[node]["camera"] = json!(camera);
    }

    pub(crate) fn point_light(&mut self, at: Vec3, color: [f32; 3]) {
        let light = push(&mut self.lights, json!({"type": "point", "color": color}));
        let node = self.node("light", None, at, Quat::IDENTITY);
        self.nodes[node]["extensions"] = json!({"KHR_lights_punctual": {"light": light}});
    }

    /// The bytes of the .glb file, whose number is a multiple of four.
    pub(crate) fn finish(self) -> Vec<u8> {
        let roots: Vec<usize> = (0..self.nodes.len()).filter(|&n| !self.children[n]).collect();
        let document = json!({
            "asset": {"version": "2.0", "generator": concat!("Pivot scenes ", env!("CARGO_PKG_VERSION"))},
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": self.lights}},
            "buffers": [{"byteLength": self.bytes.len()}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "materials": self.materials,
            "meshes": self.meshes,
            "cameras": self.cameras,
            "skins": self.skins,
            "nodes": self.nodes,
            "scenes": [{"nodes": roots}],
            "scene": 0,
            "animations": [{"name": "dance", "samplers": self.samplers, "channels": self.channels}],
        });
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut file = Vec::with_capacity(text.len() + self.bytes.len() + 28);
        let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
        file.extend(b"glTF");
        file.extend(2_u32.to_le_bytes());
        file.extend((28 + (text.len() + self.bytes.len()) as u32).to_le_bytes());
        file.extend(length(&text));
        file.extend(b"JSON");
        file.extend(&text);
        file.extend(length(&self.bytes));
        file.extend(b"BIN\0");
        file.extend(&self.bytes);
        file
    }
}

/// Appends and gives the number of what was appended.
fn push(list: &mut Vec<Value>, value: Value) -> usize {
    list.push(value);
    list.len() - 1
}
