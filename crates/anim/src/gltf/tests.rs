//! Tiny glTF files written inline, against values computed by hand.

use std::fmt::Write;
use std::path::Path;

use base64::Engine;
use glam::Mat4;

use super::*;
use crate::Material;

mod looks;
mod malformed;

const FLOAT: u32 = 5126;
const U8: u32 = 5121;
const I16: u32 = 5122;
const U16: u32 = 5123;
const U32: u32 = 5125;

/// Accessors in one embedded buffer, a view each; everything else is given as JSON.
#[derive(Default)]
struct Document {
    bytes: Vec<u8>,
    views: String,
    accessors: String,
    accessor_count: usize,
}

impl Document {
    fn view(&mut self, bytes: &[u8], extra: &str) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let comma = if self.views.is_empty() { "" } else { "," };
        let (begin, length) = (self.bytes.len(), bytes.len());
        write!(self.views, r#"{comma}{{"buffer":0,"byteOffset":{begin},"byteLength":{length}{extra}}}"#)
            .unwrap();
        self.bytes.extend(bytes);
        self.views.matches("buffer\"").count() - 1
    }

    fn raw_accessor(&mut self, json: &str) -> usize {
        let comma = if self.accessors.is_empty() { "" } else { "," };
        write!(self.accessors, "{comma}{json}").unwrap();
        self.accessor_count += 1;
        self.accessor_count - 1
    }

    fn accessor(&mut self, shape: &str, kind: u32, count: usize, bytes: &[u8], extra: &str) -> usize {
        let view = self.view(bytes, "");
        self.raw_accessor(&format!(
            r#"{{"bufferView":{view},"componentType":{kind},"count":{count},"type":"{shape}"{extra}}}"#
        ))
    }

    fn floats(&mut self, shape: &str, width: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(shape, FLOAT, values.len() / width, &bytes, "")
    }

    fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor("SCALAR", U16, values.len(), &bytes, "")
    }

    /// The triangle (0,0,0) (1,0,0) (0,1,0).
    fn triangle(&mut self) -> usize {
        self.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    }

    fn json(&self, rest: &str) -> String {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bytes);
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{data}"}}],"bufferViews":[{}],"accessors":[{}],{rest}}}"#,
            self.bytes.len(),
            self.views,
            self.accessors
        )
    }

    fn load_clip(&self, rest: &str, clip: Option<&str>) -> Result<GltfAnimation, LoadError> {
        let options = LoadOptions { clip, ..LoadOptions::default() };
        parse(Path::new("inline.gltf"), self.json(rest).as_bytes(), &options)
    }

    #[track_caller]
    fn load(&self, rest: &str) -> GltfAnimation {
        self.load_clip(rest, None).unwrap_or_else(|error| panic!("{error}"))
    }

    #[track_caller]
    fn error(&self, rest: &str) -> String {
        match self.load_clip(rest, None) {
            Ok(_) => panic!("loaded"),
            Err(error) => {
                let message = error.to_string();
                assert!(message.starts_with("inline.gltf: ") && !message.contains('\n'), "{message}");
                message
            }
        }
    }
}

fn at(animation: &GltfAnimation, time: f64) -> Vec<Vec3> {
    let mut positions = animation.rest();
    animation.pose(time, &mut positions);
    positions
}

#[track_caller]
fn assert_close(found: &[Vec3], expected: &[[f32; 3]]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!(found.abs_diff_eq(Vec3::from_array(*expected), 1e-5), "{found} is not {expected:?}");
    }
}

const TRIANGLE_MESH: &str = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;

#[test]
fn rigid_nodes_move_and_still_ones_are_baked() {
    let mut document = Document::default();
    document.triangle();
    let times = document.floats("SCALAR", 1, &[0.0, 2.0]);
    let values = document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    // Node 0 moves and carries node 1, which is scaled by 2; node 2 stands still at y = 5 with the
    // same mesh.
    let animation = document.load(&format!(
        r#"{TRIANGLE_MESH},"scenes":[{{"nodes":[0,2]}}],
        "nodes":[{{"children":[1]}},{{"mesh":0,"scale":[2,2,2],"name":"Mover"}},{{"mesh":0,"translation":[0,5,0]}}],
        "animations":[{{"channels":[{{"sampler":0,"target":{{"node":0,"path":"translation"}}}}],
        "samplers":[{{"input":{times},"output":{values}}}]}}]"#
    ));
    let topology = animation.topology();
    assert_eq!(topology.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(topology.moves, [true, false]);
    assert_eq!(topology.parts[0].name, "Mover");
    assert_eq!(topology.parts[0].motion, Motion::RIGID);
    assert_eq!((&topology.parts[1].triangles, &topology.parts[1].vertices), (&(1..2), &(3..6)));
    assert!(topology.parts[1].motion.is_empty());
    assert_eq!(animation.duration(), 2.0);
    let still = [[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [0.0, 6.0, 0.0]];
    assert_close(&at(&animation, 0.5)[..3], &[[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [1.0, 2.0, 0.0]]);
    assert_close(&at(&animation, 99.0)[..3], &[[4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [4.0, 2.0, 0.0]]);
    assert_close(&animation.rest()[3..], &still);
    assert_eq!(animation.rest(), at(&animation, 0.0));
    assert_eq!(animation.rest(), at(&animation, f64::NAN));

    let mut positions = vec![Vec3::NAN; 6];
    animation.pose(1.0, &mut positions);
    assert!(positions[..3].iter().all(|p| p.is_finite()) && positions[3..].iter().all(|p| p.is_nan()));
}

#[test]
fn constant_keys_are_no_motion() {
    let mut document = Document::default();
    document.triangle();
    let times = document.floats("SCALAR", 1, &[0.0, 2.0]);
    let values = document.floats("VEC3", 3, &[7.0, 0.0, 0.0, 7.0, 0.0, 0.0]);
    let animation = document.load(&format!(
        r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],"animations":[{{"channels":[{{"sampler":0,
        "target":{{"node":0,"path":"translation"}}}}],"samplers":[{{"input":{times},"output":{values}}}]}}]"#
    ));
    assert_eq!(animation.topology().moves, [false]);
    assert_eq!(animation.duration(), 0.0);
    assert_close(&animation.rest(), &[[7.0, 0.0, 0.0], [8.0, 0.0, 0.0], [7.0, 1.0, 0.0]]);
}

/// Two joints along x at 0 and 1 (inverse bind: back by 1), the second turned by 90 degrees about z
/// in one second.
fn two_joints(weights: &[f32], joints: &[u8], scene: &str, mesh_node: &str) -> GltfAnimation {
    let mut document = Document::default();
    // Vertices at x = 0, 1 and 2.
    document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
    document.accessor("VEC4", U8, 3, joints, "");
    document.floats("VEC4", 4, weights);
    let identity = Mat4::IDENTITY.to_cols_array();
    let back = Mat4::from_translation(Vec3::NEG_X).to_cols_array();
    document.floats("MAT4", 16, &[identity, back].concat());
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    let (cos, sin) = (std::f32::consts::FRAC_PI_4.cos(), std::f32::consts::FRAC_PI_4.sin());
    document.floats("VEC4", 4, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, sin, cos]);
    document.load(&format!(
        r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}}}]}}],
        "nodes":[{{"mesh":0,"skin":0{mesh_node}}},{{"children":[2]}},{{"translation":[1,0,0]}}],
        "skins":[{{"joints":[1,2],"inverseBindMatrices":3}}],"scenes":[{{"nodes":{scene}}}],
        "animations":[{{"channels":[{{"sampler":0,"target":{{"node":2,"path":"rotation"}}}}],
        "samplers":[{{"input":4,"output":5}}]}}]"#
    ))
}

#[test]
fn skin_of_two_joints() {
    // The vertices follow joint 0, both by halves, and joint 1; the mesh node's own transform does
    // not count.
    let weights = [[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]].concat();
    let joints = [[0, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]].concat();
    let animation = two_joints(&weights, &joints, "[0,1]", r#","translation":[0,0,9]"#);
    assert_eq!(animation.topology().parts[0].motion, Motion::SKIN);
    assert_close(&animation.rest(), &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    // Joint 1 turns about (1, 0, 0): the last vertex goes to (1, 1, 0).
    assert_close(&at(&animation, 1.0), &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]);

    // With joints outside of the scene it does count.
    let animation = two_joints(&weights, &joints, "[0]", r#","translation":[0,0,9]"#);
    assert_close(&at(&animation, 1.0), &[[0.0, 0.0, 9.0], [1.0, 0.0, 9.0], [1.0, 1.0, 9.0]]);
}

#[test]
fn linear_blend_and_odd_weights() {
    // Vertex 0: weights 1 and 3, to be scaled to 1/4 and 3/4. Vertex 1: none, so its first joint,
    // 1. Vertex 2: 1/2 each.
    let weights = [[1.0, 3.0, 0.0, 0.0], [0.0; 4], [0.5, 0.5, 0.0, 0.0]].concat();
    let animation = two_joints(&weights, &[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], "[0,1]", "");
    // Joint 1 takes (0,0,0) to (1,-1,0), (1,0,0) to itself, (2,0,0) to (1,1,0).
    assert_close(&at(&animation, 1.0), &[[0.75, -0.75, 0.0], [1.0, 0.0, 0.0], [1.5, 0.5, 0.0]]);
}

#[test]
fn triangles_whose_joints_stand_still_do_not_move() {
    let weights = [1.0, 0.0, 0.0, 0.0].repeat(3);
    let animation = two_joints(&weights, &[0; 12], "[0,1]", "");
    assert_eq!(animation.topology().moves, [false]);
    assert!(animation.topology().parts[0].motion.is_empty());
}

fn morph(extra_mesh: &str, extra_node: &str, animations: &str) -> GltfAnimation {
    let mut document = Document::default();
    document.triangle();
    document.floats("VEC3", 3, &[0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0]);
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    document.floats("SCALAR", 1, &[0.0, 0.5, 1.0, 0.5]);
    document.floats("SCALAR", 1, &[0.0, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0]);
    document.load(&format!(
        r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"targets":[{{"POSITION":1}},{{"POSITION":2}}]}}]{extra_mesh}}}],
        "nodes":[{{"mesh":0{extra_node}}}]{animations}"#
    ))
}

#[test]
fn morph_weights_from_mesh_node_and_channel() {
    let still = morph("", "", "");
    assert_close(&still.rest(), &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let mesh = morph(r#","weights":[1,0.5]"#, "", "");
    assert_close(&mesh.rest(), &[[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 0.0]]);
    assert!(mesh.topology().parts[0].motion.is_empty());
    let node = morph(r#","weights":[1,0.5]"#, r#","weights":[0.5,0]"#, "");
    assert_close(&node.rest(), &[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);

    let clip = |output: usize, interpolation: &str| {
        let animation = morph(
            "",
            "",
            &format!(
                r#","animations":[{{"channels":[{{"sampler":0,"target":{{"node":0,"path":"weights"}}}}],
            "samplers":[{{"input":3,"output":{output},"interpolation":"{interpolation}"}}]}}]"#
            ),
        );
        assert_eq!(animation.topology().parts[0].motion, Motion::MORPH);
        animation
    };
    let linear = clip(4, "LINEAR");
    assert_close(&at(&linear, 0.25), &[[0.0, 0.0, 0.5], [1.0, 0.0, 2.0], [0.0, 1.0, 0.0]]);
    // Keys (0, 0) with out-tangents (1, 0.5) and (1, 0.5) with tangents 0; halfway 1/2 of the way
    // and 1/8 of the tangent.
    let cubic = clip(5, "CUBICSPLINE");
    assert_close(&at(&cubic, 0.5), &[[0.0, 0.0, 2.0 * 0.625], [1.0, 0.0, 4.0 * 0.3125], [0.0, 1.0, 0.0]]);
}

#[test]
fn sparse_accessors() {
    let mut document = Document::default();
    let base: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let base = document.view(&base, "");
    let at = document.view(&[2], "");
    let value: Vec<u8> = [5.0_f32, 6.0, 7.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let value = document.view(&value, "");
    let sparse = format!(
        r#""sparse":{{"count":1,"indices":{{"bufferView":{at},"componentType":{U8}}},"values":{{"bufferView":{value}}}}}"#
    );
    document.raw_accessor(&format!(
        r#"{{"bufferView":{base},"componentType":{FLOAT},"count":3,"type":"VEC3",{sparse}}}"#
    ));
    // Without a view the rest is zero.
    document.raw_accessor(&format!(r#"{{"componentType":{FLOAT},"count":3,"type":"VEC3",{sparse}}}"#));
    let with_view = document.load(&format!(r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}]"#));
    assert_close(&with_view.rest(), &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 6.0, 7.0]]);
    let without =
        document.load(r#""meshes":[{"primitives":[{"attributes":{"POSITION":1}}]}],"nodes":[{"mesh":0}]"#);
    assert_close(&without.rest(), &[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [5.0, 6.0, 7.0]]);

    let mut document = Document { bytes: document.bytes, views: document.views, ..Document::default() };
    document.raw_accessor(&format!(r#"{{"componentType":{FLOAT},"count":2,"type":"VEC3",{sparse}}}"#));
    let message = document.error(&format!(r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}]"#));
    assert!(message.contains("index 2") && message.contains("count 2"), "{message}");
}

#[test]
fn of_a_shared_vertex_array_only_used_elements_are_decoded() {
    let mut document = Document::default();
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let at = document.view(&words(&[6, 7, 99_999_999]), "");
    let values = document.view(&words(&[1.0_f32, 2.0, 3.0].map(|x| [x.to_bits(); 3]).concat()), "");
    // 1.2 GB if they were all decoded.
    document.raw_accessor(&format!(
        r#"{{"componentType":{FLOAT},"count":100000000,"type":"VEC3","sparse":{{"count":3,
        "indices":{{"bufferView":{at},"componentType":{U32}}},"values":{{"bufferView":{values}}}}}}}"#
    ));
    document.accessor("SCALAR", U32, 3, &words(&[99_999_999, 5, 7]), "");
    let animation = document.load(
        r#""meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],"nodes":[{"mesh":0}]"#,
    );
    assert_eq!(animation.topology().triangles, [[2, 0, 1]]);
    assert_close(&animation.rest(), &[[0.0; 3], [2.0; 3], [3.0; 3]]);
}

#[test]
fn quantised_positions_with_stride_and_every_index_type() {
    for (kind, size) in [(U8, 1), (U16, 2), (U32, 4)] {
        let mut document = Document::default();
        // i16, normalised, padded to 8 bytes; and the same not normalised.
        let padded: Vec<u8> = [[0_i16, 0, 0, 99], [32767, -32768, 0, 99], [0, 16384, 0, 99]]
            .concat()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let view = document.view(&padded, r#","byteStride":8"#);
        for normalized in ["true", "false"] {
            document.raw_accessor(&format!(
                r#"{{"bufferView":{view},"componentType":{I16},"normalized":{normalized},"count":3,"type":"VEC3"}}"#
            ));
        }
        let indices: Vec<u8> = [0_u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()[..size].to_vec()).collect();
        document.accessor("SCALAR", kind, 3, &indices, "");
        let load = |position: usize| {
            document.load(&format!(
                r#""extensionsUsed":["KHR_mesh_quantization"],"extensionsRequired":["KHR_mesh_quantization"],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":{position}}},"indices":2}}]}}],"nodes":[{{"mesh":0}}]"#
            ))
        };
        assert_close(&load(0).rest(), &[[0.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.500_015_3, 0.0]]);
        assert_close(&load(1).rest(), &[[0.0, 0.0, 0.0], [32767.0, -32768.0, 0.0], [0.0, 16384.0, 0.0]]);
    }
}

#[test]
fn normalised_rotation_keys() {
    let mut document = Document::default();
    document.triangle();
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    // From the identity to a half turn about z.
    document.accessor("VEC4", 5120, 2, &[0, 0, 0, 127, 0, 0, 127, 0], r#","normalized":true"#);
    let animation = document.load(&format!(
        r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],"animations":[{{"channels":[{{"sampler":0,
        "target":{{"node":0,"path":"rotation"}}}}],"samplers":[{{"input":1,"output":2}}]}}]"#
    ));
    assert_close(&at(&animation, 0.5), &[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]);
    assert_close(&at(&animation, 1.0), &[[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
}

#[test]
fn channels_for_something_else_are_left_out() {
    let load = |target: &str| {
        let mut document = Document::default();
        document.triangle();
        document.floats("SCALAR", 1, &[0.0, 1.0]);
        document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
        document.load(&format!(
            r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],"animations":[{{"channels":[
            {{"sampler":0,"target":{{{target}}}}},{{"sampler":0,"target":{{"node":0,"path":"translation"}}}}],
            "samplers":[{{"input":1,"output":2}}]}}]"#
        ))
    };
    let aimless = load(r#""path":"pointer","extensions":{"KHR_animation_pointer":{"pointer":"/"}}"#);
    let unknown = load(r#""node":0,"path":"color""#);
    for animation in [&aimless, &unknown] {
        assert_eq!(at(animation, 1.0)[0] - animation.rest()[0], Vec3::X * 2.0);
        let note = "1 animation channels for anything but transforms and weights are left out";
        assert_eq!(animation.model().notes, [note]);
    }
}

#[test]
fn what_the_parser_asks_for_beyond_the_specification_is_given_to_it() {
    let mut document = Document::default();
    document.triangle();
    let scenes = r#""scenes":[{"nodes":[0]},{"name":"empty"}],"scene":0"#;
    for extras in ["{}", r#""text""#, "5", "[1,2]", "null", "true"] {
        let nodes = format!(r#""nodes":[{{"mesh":0,"extras":{extras}}}],"extras":{extras}"#);
        let animation = document.load(&format!("{TRIANGLE_MESH},{nodes},{scenes}"));
        assert_eq!((animation.rest().len(), animation.model().notes.len()), (3, 0), "{extras}");
    }
    let version = r#""asset":{"version":"2.0"}"#;
    let wrong = [r#""scenes":7"#, r#""scenes":{}"#, r#""animations":{}"#, r#""animations":[7]"#];
    let documents = wrong.map(|member| format!("{{{version},{member}}}"));
    for json in ["[]", "5", r#""x""#, "true", "null"].into_iter().chain(documents.iter().map(String::as_str))
    {
        let parsed = crate::parse(Path::new("a.gltf"), json.as_bytes(), &LoadOptions::default());
        assert!(parsed.is_err(), "{json}");
    }
}

#[test]
fn weights_for_a_node_without_morph_targets_are_nothing() {
    let mut document = Document::default();
    document.triangle();
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    let animation = document.load(&format!(
        r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],"animations":[{{"channels":[{{"sampler":0,
        "target":{{"node":0,"path":"weights"}}}}],"samplers":[{{"input":1,"output":1}}]}}]"#
    ));
    assert_eq!(at(&animation, 1.0), animation.rest());
}

#[test]
fn what_is_not_understood_is_noted() {
    let mut document = Document::default();
    document.triangle();
    let animation = document.load(
        r#""extensionsUsed":["KHR_materials_unlit","KHR_mesh_quantization","EXT_mesh_gpu_instancing"],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"nodes":[{"mesh":0}],
        "materials":[{"emissiveFactor":[1,0,0]}]"#,
    );
    let unknown = "what these extensions say is left out: KHR_materials_unlit, EXT_mesh_gpu_instancing";
    assert_eq!(animation.model().notes, ["1 emissive colours are left out", unknown]);
}

#[test]
fn strips_fans_points_and_unused_vertices() {
    let mut document = Document::default();
    let corners: Vec<f32> = (0..15).map(|i| i as f32).collect();
    document.floats("VEC3", 3, &corners);
    document.indices(&[4, 1, 2]);
    let animation = document.load(
        r#""meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":5},{"attributes":{"POSITION":0,"COLOR_0":0},"mode":6},
        {"attributes":{"POSITION":0},"mode":0},{"attributes":{"POSITION":0},"mode":3},{"attributes":{}},
        {"attributes":{"POSITION":0},"indices":1}]}],"nodes":[{"mesh":0}]"#,
    );
    let notes = ["3 primitives of points or lines, or without positions,", "1 sets of vertex colours"];
    assert_eq!(animation.model().notes, notes.map(|what| format!("{what} are left out")));
    let strip = [[0, 1, 2], [1, 3, 2], [2, 3, 4]];
    let fan = [[6, 7, 5], [7, 8, 5], [8, 9, 5]];
    assert_eq!(animation.topology().triangles, [&strip[..], &fan[..], &[[12, 10, 11]]].concat());
    assert_eq!(animation.topology().vertex_count, 13);
    assert_close(&animation.rest()[10..], &[[3.0, 4.0, 5.0], [6.0, 7.0, 8.0], [12.0, 13.0, 14.0]]);
}

#[test]
fn clips_by_name_and_number() {
    let mut document = Document::default();
    document.triangle();
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    document.floats("SCALAR", 1, &[0.0, 3.0]);
    document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let clip = |name: &str, input: usize| {
        format!(
            r#"{{"name":"{name}","channels":[{{"sampler":0,"target":{{"node":0,"path":"translation"}}}}],
            "samplers":[{{"input":{input},"output":3}}]}}"#
        )
    };
    let rest = format!(
        r#"{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],"animations":[{},{}]"#,
        clip("Walk", 1),
        clip("Run", 2)
    );
    let duration = |clip| document.load_clip(&rest, clip).unwrap().duration();
    assert_eq!(
        [None, Some("0"), Some("Walk"), Some("1"), Some("Run")].map(duration),
        [1.0, 1.0, 1.0, 3.0, 3.0]
    );
    let message = document.load_clip(&rest, Some("2")).err().unwrap().to_string();
    assert_eq!(message, r#"inline.gltf: clips: found no clip "2", expected one of 0 "Walk", 1 "Run""#);
}

#[test]
fn materials_camera_and_lights() {
    let mut document = Document::default();
    document.triangle();
    let rest = |kind: &str| {
        format!(
            r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}},{{"attributes":{{"POSITION":0}}}}]}}],
            "materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.25,7,1]}}}}],
            "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"{kind}","color":[1,0.5,0],"spot":{{}}}}]}}}},
            "cameras":[{{"type":"perspective","perspective":{{"yfov":0.7,"znear":0.1}}}}],
            "nodes":[{{"mesh":0}},{{"camera":0,"translation":[0,0,5]}},
            {{"translation":[1,2,3],"rotation":[-0.70710678,0,0,0.70710678],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}]"#
        )
    };
    let animation = document.load(&rest("point"));
    let materials = &animation.topology().materials;
    let colors: Vec<_> =
        animation.topology().parts.iter().map(|part| materials[part.material as usize]).collect();
    let expected =
        [[0.5, 0.25, 1.0], [1.0; 3]].map(|base_color| Material { base_color, ..Material::default() });
    assert_eq!(colors, expected);
    let view = animation.view(0.0).unwrap();
    assert_eq!((view.eye, view.up, view.fov_y), (Vec3::new(0.0, 0.0, 5.0), Vec3::Y, 0.7));
    assert!((view.target - view.eye).normalize().abs_diff_eq(Vec3::NEG_Z, 1e-6));
    let expected = Light { position: Vec3::new(1.0, 2.0, 3.0), color: [1.0, 0.5, 0.0] };
    assert_eq!(animation.light(0.0), Some(expected));
    // Turned by -90 degrees about x it shines straight down, so it stands straight above.
    let position = document.load(&rest("directional")).light(0.0).unwrap().position;
    assert!(position.y > 100.0 && position.x.abs() < 1.0 && position.z.abs() < 1.0, "{position}");
    let dark = document.load(&rest("point").replace("[1,0.5,0]", "[1e39,-1,0.5]")).light(0.0).unwrap();
    assert_eq!(dark.color, [1.0, 0.0, 0.5], "infinite is full, negative none");
    let far = |distance: &str| {
        let rest = rest("point").replace("[0,0,5]", &format!("[0,0,{distance}]"));
        document.load(&rest.replace("[1,2,3]", &format!("[{distance},2,3]")))
    };
    assert_eq!(far("1e19").view(0.0).unwrap().target, Vec3::ZERO);
    // Beyond `f32`: the square of the distance, and the distance itself.
    assert_eq!((far("1e20").view(0.0), far("1e39").view(0.0)), (None, None));
    assert_eq!(far("1e38").light(0.0).unwrap().position.x, 1e38);
    assert_eq!(far("1e39").light(0.0), None);
    for scale in ["1e25", "1e37"] {
        let large =
            rest("directional").replace(r#"{"mesh":0}"#, &format!(r#"{{"mesh":0,"scale":[{scale},1,1]}}"#));
        let position = document.load(&large).light(0.0).unwrap().position;
        assert!(position.is_finite() && position.y > 1e26, "{scale}: {position}");
    }
}

#[test]
fn a_file_beside_and_a_binary_chunk_give_the_same() {
    let mut document = Document::default();
    document.triangle();
    let rest = |buffer: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":36{buffer}}}],"bufferViews":[{}],"accessors":[{}],
            {TRIANGLE_MESH},"nodes":[{{"mesh":0}}]}}"#,
            document.views, document.accessors
        )
    };
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.bin"), &document.bytes).unwrap();
    let file = folder.path().join("model.gltf");
    std::fs::write(&file, rest(r#","uri":"a%20b.bin""#)).unwrap();
    let beside = crate::load(&file, &LoadOptions::default()).unwrap();

    let mut json = rest("").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((12 + 8 + json.len() as u32 + 8 + 36).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(&json);
    glb.extend(36_u32.to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(&document.bytes);
    let binary = parse(Path::new("model.glb"), &glb, &LoadOptions::default()).unwrap();
    assert_eq!(beside.rest(), binary.rest());
    assert_close(&binary.rest(), &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);

    // What lies behind the declared length is nobody's.
    glb.extend(b"more, and no chunk");
    let longer = parse(Path::new("model.glb"), &glb, &LoadOptions::default()).unwrap();
    assert_eq!(longer.rest(), binary.rest());
}
