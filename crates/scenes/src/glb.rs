//! Writes binary glTF 2.0 files: meshes with skins and morph targets, nodes, one clip, a camera and
//! a light.
//!
//! The document is written as JSON text: with the types of `gltf-json`, which want every optional
//! field of every object, this file was longer.

use bytemuck::NoUninit;
use glam::{DQuat, Mat4, Vec3};
use serde_json::{Value, json};

use crate::shape::Mesh;

/// Types of components, section 3.6.2.2 of the glTF 2.0 specification.
const U8: u32 = 5121;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// A file under construction. Things are named by their number in the order of their making.
pub(crate) struct Glb {
    /// Length of the clip.
    seconds: f32,
    bytes: Vec<u8>,
    document: Value,
    /// Number of triangles of all meshes so far.
    pub(crate) triangles: usize,
}

/// Joints and weights of a vertex: up to four, weights that add up to 1.
pub(crate) type Influence = ([u8; 4], [f32; 4]);

impl Glb {
    /// Makes an empty file whose clip takes `seconds`.
    pub(crate) fn new(seconds: f32) -> Self {
        let generator = concat!("Pivot scenes ", env!("CARGO_PKG_VERSION"));
        let document = json!({
            "asset": {"version": "2.0", "generator": generator},
            "extensionsUsed": ["KHR_lights_punctual"],
            "scene": 0,
            "scenes": [{}],
            "animations": [{"name": "dance"}],
        });
        Self { seconds, bytes: Vec::new(), document, triangles: 0 }
    }

    pub(crate) fn material(&mut self, [r, g, b]: [f32; 3]) -> usize {
        let pbr = json!({"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0});
        append(&mut self.document["materials"], json!({"pbrMetallicRoughness": pbr}))
    }

    /// A node below `parent`, or at the root.
    pub(crate) fn node(&mut self, name: &str, parent: Option<usize>, at: Vec3, turn: DQuat) -> usize {
        let node = json!({"name": name, "translation": at.to_array(), "rotation": turn.as_quat().to_array()});
        let node = append(&mut self.document["nodes"], node);
        let siblings = match parent {
            None => &mut self.document["scenes"][0]["nodes"],
            Some(parent) => &mut self.document["nodes"][parent]["children"],
        };
        append(siblings, json!(node));
        node
    }

    /// A node at the root or below `parent`, with a mesh and no transform of its own.
    pub(crate) fn mesh(&mut self, name: &str, parent: Option<usize>, mesh: &Mesh, material: usize) -> usize {
        let primitive = self.primitive(mesh, material);
        self.show(name, parent, json!({"primitives": [primitive]}))
    }

    /// A node with a mesh whose vertices follow `joints`, which now stand as they do where the mesh
    /// is undeformed.
    ///
    /// `places` are the joints' positions in the space of the mesh; joints are not turned there.
    pub(crate) fn skinned(
        &mut self,
        name: &str,
        mesh: &Mesh,
        influence: impl Fn(Vec3) -> Influence,
        (joints, places): (&[usize], &[Vec3]),
        material: usize,
    ) {
        let mut primitive = self.primitive(mesh, material);
        let (numbers, weights): (Vec<_>, Vec<_>) = mesh.positions.iter().map(|&p| influence(p)).unzip();
        primitive["attributes"]["JOINTS_0"] = json!(self.accessor(&numbers, U8, "VEC4"));
        primitive["attributes"]["WEIGHTS_0"] = json!(self.accessor(&weights, F32, "VEC4"));
        let node = self.show(name, None, json!({"primitives": [primitive]}));
        let inverse: Vec<[f32; 16]> =
            places.iter().map(|&p| Mat4::from_translation(-p).to_cols_array()).collect();
        let matrices = self.accessor(&inverse, F32, "MAT4");
        let skin = json!({"joints": joints, "inverseBindMatrices": matrices});
        self.document["nodes"][node]["skin"] = json!(append(&mut self.document["skins"], skin));
    }

    /// A node with a mesh with morph targets, each the positions of all vertices at full weight.
    pub(crate) fn morphed(
        &mut self,
        name: &str,
        parent: Option<usize>,
        mesh: &Mesh,
        targets: &[Vec<Vec3>],
        material: usize,
    ) -> usize {
        let mut primitive = self.primitive(mesh, material);
        let target = |target: &Vec<Vec3>| -> Value {
            let moves: Vec<Vec3> = target.iter().zip(&mesh.positions).map(|(t, p)| *t - *p).collect();
            json!({"POSITION": self.positions(&moves)})
        };
        primitive["targets"] = targets.iter().map(target).collect();
        self.show(name, parent, json!({"primitives": [primitive], "weights": vec![0.0; targets.len()]}))
    }

    fn show(&mut self, name: &str, parent: Option<usize>, mesh: Value) -> usize {
        let node = self.node(name, parent, Vec3::ZERO, DQuat::IDENTITY);
        self.document["nodes"][node]["mesh"] = json!(append(&mut self.document["meshes"], mesh));
        node
    }

    fn primitive(&mut self, mesh: &Mesh, material: usize) -> Value {
        let positions = self.positions(&mesh.positions);
        self.triangles += mesh.triangles.len();
        let indices = self.accessor(mesh.triangles.as_flattened(), U32, "SCALAR");
        json!({"attributes": {"POSITION": positions}, "indices": indices, "material": material})
    }

    fn positions(&mut self, positions: &[Vec3]) -> usize {
        let number = self.accessor(positions, F32, "VEC3");
        let low = positions.iter().fold(Vec3::MAX, |a, &b| a.min(b)).to_array();
        let high = positions.iter().fold(Vec3::MIN, |a, &b| a.max(b)).to_array();
        self.document["accessors"][number]["min"] = json!(low);
        self.document["accessors"][number]["max"] = json!(high);
        number
    }

    fn accessor<T: NoUninit>(&mut self, values: &[T], component: u32, kind: &str) -> usize {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = append(&mut self.document["bufferViews"], view);
        let count = values.len();
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count});
        append(&mut self.document["accessors"], accessor)
    }

    /// Keys of a node's translation, evenly spaced over the clip.
    pub(crate) fn translate(&mut self, node: usize, keys: impl Iterator<Item = Vec3>) {
        let keys: Vec<Vec3> = keys.collect();
        self.channel(node, "translation", "VEC3", keys.len(), &keys);
    }

    /// Keys of a node's rotation.
    pub(crate) fn rotate(&mut self, node: usize, keys: impl Iterator<Item = DQuat>) {
        let keys: Vec<[f32; 4]> = keys.map(|key| key.as_quat().to_array()).collect();
        self.channel(node, "rotation", "VEC4", keys.len(), &keys);
    }

    /// Keys of the weights of a node's `N` morph targets.
    pub(crate) fn morph<const N: usize>(&mut self, node: usize, keys: impl Iterator<Item = [f32; N]>) {
        let keys: Vec<[f32; N]> = keys.collect();
        self.channel(node, "weights", "SCALAR", keys.len(), keys.as_flattened());
    }

    fn channel<T: NoUninit>(&mut self, node: usize, path: &str, kind: &str, keys: usize, values: &[T]) {
        let times: Vec<f32> = (0..keys).map(|k| self.seconds * k as f32 / (keys - 1) as f32).collect();
        let input = self.accessor(&times, F32, "SCALAR");
        self.document["accessors"][input]["min"] = json!([0.0]);
        self.document["accessors"][input]["max"] = json!([self.seconds]);
        let output = self.accessor(values, F32, kind);
        let clip = &mut self.document["animations"][0];
        let sampler = append(&mut clip["samplers"], json!({"input": input, "output": output}));
        let channel = json!({"sampler": sampler, "target": {"node": node, "path": path}});
        append(&mut clip["channels"], channel);
    }

    pub(crate) fn camera(&mut self, eye: Vec3, target: Vec3, fov_y: f32) {
        let camera = json!({"type": "perspective", "perspective": {"yfov": fov_y, "znear": 0.01}});
        let back = (eye - target).normalize();
        let right = Vec3::Y.cross(back).normalize();
        let turn = DQuat::from_mat3(&glam::Mat3::from_cols(right, back.cross(right), back).as_dmat3());
        let node = self.node("camera", None, eye, turn);
        self.document["nodes"][node]["camera"] = json!(append(&mut self.document["cameras"], camera));
    }

    /// A white point light.
    pub(crate) fn point_light(&mut self, at: Vec3) {
        let lights = &mut self.document["extensions"]["KHR_lights_punctual"]["lights"];
        let light = append(lights, json!({"type": "point", "color": [1.0, 1.0, 1.0]}));
        let node = self.node("light", None, at, DQuat::IDENTITY);
        self.document["nodes"][node]["extensions"] = json!({"KHR_lights_punctual": {"light": light}});
    }

    /// The bytes of the .glb file.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.document["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        let mut text = self.document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let chunk = |kind: &[u8], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), kind, bytes].concat();
        let chunks = [chunk(b"JSON", &text), chunk(b"BIN\0", &self.bytes)].concat();
        let length = chunks.len() as u32 + 12;
        [&b"glTF"[..], &2_u32.to_le_bytes(), &length.to_le_bytes(), &chunks].concat()
    }
}

/// Appends to a list of the document, which begins with its first value, and gives the number of
/// what was appended.
fn append(list: &mut Value, value: Value) -> usize {
    if list.is_null() {
        *list = json!([]);
    }
    let list = list.as_array_mut().expect("only lists are appended to");
    list.push(value);
    list.len() - 1
}
