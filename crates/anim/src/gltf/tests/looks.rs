//! Materials, textures, normals and lights.

use std::io::Cursor;

use base64::Engine;
use image::{ImageFormat, RgbaImage};

use super::*;
use crate::{Filter, Texture, Wrap};

/// Two texels side by side: opaque red, and blue at a quarter of full opacity.
const TEXELS: [[u8; 4]; 2] = [[255, 0, 0, 255], [0, 0, 255, 64]];

fn png() -> Vec<u8> {
    let image = RgbaImage::from_raw(2, 1, TEXELS.concat()).unwrap();
    let mut bytes = Vec::new();
    image.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
    bytes
}

fn data_uri(bytes: &[u8]) -> String {
    format!(r#""uri":"data:image/png;base64,{}""#, base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// A triangle with texture coordinates in accessor 1.
fn textured_triangle() -> Document {
    let mut document = Document::default();
    document.triangle();
    document.floats("VEC2", 2, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    document
}

/// The JSON of a mesh with material 0, whose base colour texture is image 0 as `image` says.
fn textured(material: &str, image: &str, info: &str, sampler: &str) -> String {
    format!(
        r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0{info}}}}}{material}}}],
        "textures":[{{"source":0{sampler}}}],"images":[{{{image}}}],"nodes":[{{"mesh":0}}]"#
    )
}

fn only_texture(animation: &dyn Animation) -> &Texture {
    let topology = animation.topology();
    let material = topology.materials[topology.parts[0].material as usize];
    assert_eq!(topology.textures.len(), 1);
    &topology.textures[material.texture.unwrap() as usize]
}

#[test]
fn images_from_a_data_uri_a_buffer_view_and_a_file() {
    let mut document = textured_triangle();
    let image = data_uri(&png());
    let animation = document.load(&textured("", &image, "", ""));
    assert_eq!(animation.topology().texcoords, [Vec2::ZERO, Vec2::X, Vec2::Y]);
    let texture = only_texture(&animation);
    assert_eq!((texture.width, texture.height), (2, 1));
    assert_eq!(*texture.texels, TEXELS);
    assert_eq!((texture.wrap, texture.filter), ([Wrap::Repeat; 2], Filter::Linear));

    let view = document.view(&png(), "");
    let in_view = format!(r#""bufferView":{view},"mimeType":"image/png""#);
    assert_eq!(only_texture(&document.load(&textured("", &in_view, "", ""))), texture);

    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a b.png"), png()).unwrap();
    let file = folder.path().join("model.gltf");
    std::fs::write(&file, document.json(&textured("", r#""uri":"a%20b.png""#, "", ""))).unwrap();
    let beside = crate::load(&file, &LoadOptions::default()).unwrap();
    assert_eq!(only_texture(&*beside), texture);
}

#[test]
fn textures_and_materials_share_the_texels_of_their_image() {
    let document = textured_triangle();
    let primitive =
        |material| format!(r#"{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":{material}}}"#);
    let material = |texture| {
        format!(
            r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":{texture}}}}},"alphaMode":"MASK","alphaCutoff":0.5}}"#
        )
    };
    let animation = document.load(&format!(
        r#""meshes":[{{"primitives":[{},{},{}]}}],"materials":[{},{},{}],
        "textures":[{{"source":0}},{{"source":0}}],"images":[{{{}}}],"nodes":[{{"mesh":0}}]"#,
        primitive(0),
        primitive(1),
        primitive(2),
        material(0),
        material(1),
        material(1),
        data_uri(&png())
    ));
    let topology = animation.topology();
    let [a, others @ ..] = &topology.textures[..] else { panic!("no textures") };
    // Decoded once, so searched once for its least opacity.
    assert_eq!(others.iter().map(|b| Arc::ptr_eq(&a.texels, &b.texels)).collect::<Vec<_>>(), [true; 2]);
    let cutoffs: Vec<_> = topology.materials.iter().filter_map(|m| m.cutoff).collect();
    assert_eq!(cutoffs, [0.5; 3], "each has a texel below it");
}

#[test]
fn samplers_set_wrap_and_filter() {
    let document = textured_triangle();
    let json = textured("", &data_uri(&png()), "", r#","sampler":0"#)
        + r#","samplers":[{"magFilter":9728,"wrapS":33071,"wrapT":33648}]"#;
    let animation = document.load(&json);
    let texture = only_texture(&animation);
    assert_eq!((texture.wrap, texture.filter), ([Wrap::ClampToEdge, Wrap::MirroredRepeat], Filter::Nearest));
}

#[test]
fn texture_transforms_are_applied() {
    let document = textured_triangle();
    let info =
        r#","extensions":{"KHR_texture_transform":{"offset":[0.5,2],"rotation":1.57079632,"scale":[3,4]}}"#;
    let animation = document.load(&textured("", &data_uri(&png()), info, ""));
    // Scaled, then turned by 90 degrees so that u goes to -v and v to u, then moved.
    let expected = [Vec2::new(0.5, 2.0), Vec2::new(0.5, -1.0), Vec2::new(4.5, 2.0)];
    for (found, expected) in animation.topology().texcoords.iter().zip(expected) {
        assert!(found.abs_diff_eq(expected, 1e-5), "{found} is not {expected}");
    }
}

/// As where the file of an image is missing.
#[test]
fn surfaces_keep_their_factors_where_an_image_cannot_be_read() {
    let mut document = textured_triangle();
    let mut truncated = png();
    truncated.truncate(truncated.len() - 20);
    let webp = b"RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f\0\0\0\x10\x07\x10\x11\x11\x88\x88\xfe\x07\0";
    let view = document.view(webp, "");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.gltf");
    std::fs::write(folder.path().join("image.png"), "not an image").unwrap();
    let embedded = r#""uri":"data:image/png,text""#.to_owned();
    let images = [data_uri(&truncated), data_uri(b"BM no image"), data_uri(b""), embedded]
        .into_iter()
        .chain([format!(r#""bufferView":{view},"mimeType":"image/webp""#)])
        .map(|image| (image, "image 0"));
    let uris = ["image.png", "no%20such.png", "../up.png", "https://example.com/a.png"];
    for (image, name) in images.chain(uris.map(|uri| (format!(r#""uri":"{uri}""#), uri))) {
        std::fs::write(&file, document.json(&textured(r#","alphaMode":"MASK""#, &image, "", ""))).unwrap();
        let found = crate::load(&file, &LoadOptions::default()).unwrap();
        let material = found.topology().materials[0];
        assert_eq!(
            (material.base_color, material.texture, material.cutoff),
            ([1.0; 3], None, None),
            "{name}"
        );
        let [note] = &found.model().notes[..] else { panic!("{:?}", found.model().notes) };
        assert!(note.contains(name) && note.contains("cannot be read as PNG or JPEG"), "{note}");
    }
}

#[test]
fn what_is_wrong_in_the_document_about_an_image_is_said() {
    let document = textured_triangle();
    let error = |image: &str| document.error(&textured("", image, "", ""));
    assert!(error(r#""bufferView":77"#).contains("no bufferView 77"));
    assert!(error(r#""name":"nowhere""#).contains("neither a uri nor a bufferView"));
    let json = textured("", &data_uri(&png()), "", r#","sampler":3"#);
    assert!(document.error(&json).contains("no sampler 3"));
    let json = textured("", &data_uri(&png()), "", "").replace(r#""source":0"#, r#""source":4"#);
    assert!(document.error(&json).contains("no image 4"));
    let json = textured("", &data_uri(&png()), "", "").replace(r#"{"index":0}"#, r#"{"index":2}"#);
    assert!(document.error(&json).contains("no texture 2"));
    // A texture that only an extension has an image for.
    let json = textured("", &data_uri(&png()), "", "").replace(r#""source":0"#, r#""name":"x""#);
    let animation = document.load(&json);
    assert_eq!(animation.topology().parts[0].material, 0);
    assert_eq!((animation.topology().materials[0].texture, animation.model().notes.len()), (None, 1));
}

/// The header of a PNG of 60,000 x 60,000 texels, in 45 bytes.
#[test]
fn an_image_larger_than_the_file_allows_is_refused() {
    let mut bytes = png();
    // Behind the signature come a length, "IHDR", width and height; the checksum covers the latter.
    bytes[16..24].copy_from_slice(&[0, 0, 0xea, 0x60, 0, 0, 0xea, 0x60]);
    let mut crc = !0_u32;
    for &byte in &bytes[12..29] {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
    let message = textured_triangle().error(&textured("", &data_uri(&bytes), "", ""));
    assert!(message.contains("image 0") && message.contains("smaller image"), "{message}");
}

#[test]
fn alpha_modes_set_the_cutoff() {
    let document = textured_triangle();
    let image = data_uri(&png());
    let cutoff = |material: &str| {
        let animation = document.load(&textured(material, &image, "", ""));
        (animation.topology().materials[0].cutoff, animation.model().notes.len())
    };
    assert_eq!(cutoff(""), (None, 0));
    assert_eq!(cutoff(r#","alphaMode":"OPAQUE","alphaCutoff":0.9"#), (None, 0));
    assert_eq!(cutoff(r#","alphaMode":"MASK""#), (Some(0.5), 0));
    assert_eq!(cutoff(r#","alphaMode":"MASK","alphaCutoff":0.75"#), (Some(0.75), 0));
    assert_eq!(cutoff(r#","alphaMode":"BLEND""#), (Some(0.5), 1));
    // No texel is cut off here: the least opacity is a quarter.
    assert_eq!(cutoff(r#","alphaMode":"MASK","alphaCutoff":0.25"#), (None, 0));
}

#[test]
fn mirrors_are_smooth_metals() {
    let mut document = Document::default();
    document.triangle();
    let mirror = |pbr: &str| {
        let animation = document.load(&format!(
            r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
            "materials":[{{"pbrMetallicRoughness":{{{pbr}}}}}],"nodes":[{{"mesh":0}}]"#
        ));
        animation.topology().materials[0].mirror
    };
    assert!(mirror(r#""roughnessFactor":0"#), "metallic is 1 where nothing else is said");
    assert!(mirror(r#""roughnessFactor":0.1,"metallicFactor":0.9"#));
    assert!(!mirror(r#""roughnessFactor":0.1,"metallicFactor":0.8"#));
    assert!(!mirror(r#""roughnessFactor":0.2"#));
    assert!(!mirror(""));
    assert!(!mirror(r#""roughnessFactor":0,"metallicRoughnessTexture":{"index":0}"#));
}

#[test]
fn normals_follow_nodes_and_joints() {
    let mut document = Document::default();
    document.triangle();
    document.floats("VEC3", 3, &[0.0, 0.6, 0.8].repeat(3));
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    document.floats("VEC4", 4, &[0.0, 0.0, 0.0, 1.0, half, 0.0, 0.0, half]);
    document.accessor("VEC4", U8, 3, &[0; 12], "");
    document.floats("VEC4", 4, &[1.0, 0.0, 0.0, 0.0].repeat(3));
    // Node 0 stands still, scaled along z; node 1 turns by 90 degrees about x; the skin of node 2
    // follows node 1; node 4 mirrors.
    let animation = document.load(
        r#""meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1}}]},
        {"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"JOINTS_0":4,"WEIGHTS_0":5}}]},
        {"primitives":[{"attributes":{"POSITION":0}}]}],
        "nodes":[{"mesh":0,"scale":[1,1,2]},{"mesh":0},{"mesh":1,"skin":0},{"mesh":2},{"mesh":0,"scale":[-1,1,1]}],"skins":[{"joints":[1]}],
        "animations":[{"channels":[{"sampler":0,"target":{"node":1,"path":"rotation"}}],
        "samplers":[{"input":2,"output":3}]}]"#,
    );
    assert_eq!(animation.topology().triangles[4], [12, 14, 13], "its front is still in front");
    let mut normals = vec![Vec3::X; 15];
    animation.normals(1.0, &mut normals);
    let scaled = Vec3::new(0.0, 0.6, 0.4).normalize();
    let turned = Vec3::new(0.0, -0.8, 0.6);
    for (vertex, expected) in
        [(0, scaled), (3, turned), (6, turned), (9, Vec3::X), (12, Vec3::new(0.0, 0.6, 0.8))]
    {
        assert!(normals[vertex].abs_diff_eq(expected, 1e-5), "{vertex}: {}", normals[vertex]);
    }
}

#[test]
fn normals_survive_scales_whose_squares_are_out_of_range() {
    let mut document = Document::default();
    document.triangle();
    document.floats("VEC3", 3, &[0.0, 0.6, 0.8].repeat(3));
    for scale in [1e-38_f32, 1e-25, 1e25, 1e38] {
        let animation = document.load(&format!(
            r#""meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1}}}}]}}],
            "nodes":[{{"mesh":0,"scale":[{scale},{scale},{}]}}]"#,
            2.0 * scale
        ));
        let mut normals = vec![Vec3::X; 3];
        animation.normals(0.0, &mut normals);
        assert!(
            normals[0].abs_diff_eq(Vec3::new(0.0, 0.6, 0.4).normalize(), 1e-5),
            "{scale}: {}",
            normals[0]
        );
    }
}

#[test]
fn lights_that_are_not_shown_as_they_are_are_noted() {
    let mut document = Document::default();
    document.triangle();
    let notes = |kind: &str, nodes: &str| {
        document
            .load(&format!(
                r#"{TRIANGLE_MESH},"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"{kind}","spot":{{}}}}]}}}},
                "nodes":[{{"mesh":0}}{nodes}]"#
            ))
            .model()
            .notes
            .clone()
    };
    let light = r#",{"extensions":{"KHR_lights_punctual":{"light":0}}}"#;
    assert!(notes("point", light).is_empty());
    assert!(notes("spot", light)[0].contains("cone"));
    assert!(notes("point", &light.repeat(3))[0].contains("of 3 lights only the first"));
}
