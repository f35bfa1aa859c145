//! Symbolic links that lead out of a model's folder: what they name is not read.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;

use anim::{Animation, LoadOptions, load};
use base64::Engine;

/// Writes a model that names `link`, first as a file in its folder and then as a link to one
/// outside, and loads it both times.
fn loaded(model: &str, text: &str, link: &str, content: &[u8]) -> [Result<Box<dyn Animation>, String>; 2] {
    [false, true].map(|is_link| {
        let (home, outside) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let file = home.path().join(model);
        if !model.is_empty() {
            fs::write(&file, text).unwrap();
        }
        if is_link {
            fs::write(outside.path().join("file"), content).unwrap();
            symlink(outside.path().join("file"), home.path().join(link)).unwrap();
        } else {
            fs::write(home.path().join(link), content).unwrap();
        }
        let path = if model.is_empty() { home.path() } else { &file };
        load(path, &LoadOptions::default()).map_err(|error| error.to_string())
    })
}

#[track_caller]
fn is_refused(found: [Result<Box<dyn Animation>, String>; 2], by: &str) {
    let [file, link] = found;
    file.map(|_| ()).expect("a file in the folder is read");
    let error = link.map(|_| ()).expect_err("a link out of the folder is not");
    assert!(error.contains(by), "{error}");
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

#[test]
fn key_frames_are_read_from_their_folder_only() {
    is_refused(loaded("", "", "frame1.obj", TRIANGLE.as_bytes()), "leads out of the folder");
}

#[test]
fn images_are_read_from_the_folder_only() {
    let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let buffer = base64::engine::general_purpose::STANDARD.encode(positions);
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "textures":[{{"source":0}}],"images":[{{"uri":"image.png"}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],
        "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{buffer}"}}]}}"#
    );
    let mut image = std::io::Cursor::new(Vec::new());
    image::RgbaImage::new(1, 1).write_to(&mut image, image::ImageFormat::Png).unwrap();
    let found = loaded("model.gltf", &text, "image.png", &image.into_inner()).map(Result::unwrap);
    assert_eq!(found.each_ref().map(|animation| animation.topology().textures.len()), [1, 0]);
    assert!(found[1].model().notes[0].contains("image.png"), "{:?}", found[1].model().notes);
}

#[test]
fn included_files_are_read_from_the_folder_only() {
    let frame = "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 40\nhither 1\nresolution 8 8\n";
    let found = loaded("a.aff", &format!("{frame}i 0 b.aff\n"), "b.aff", b"p 3\n0 0 0\n1 0 0\n0 1 0\n");
    is_refused(found, "below the folder of the first file");
}

/// A material library is not needed: without it surfaces are grey.
#[test]
fn material_libraries_are_read_from_the_folder_only() {
    let text = format!("mtllib a.mtl\nusemtl red\n{TRIANGLE}");
    let found = loaded("model.obj", &text, "a.mtl", b"newmtl red\nKd 1 0 0\n");
    let [file, link] = found.map(|animation| animation.unwrap().topology().materials[0].base_color);
    assert_eq!(file[1], 0.0);
    assert_ne!(link, file);
}
