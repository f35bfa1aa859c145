//! Models at the earth's radius with details of a metre and a centimetre: relative to an origin
//! nearby their shape is kept to less than a millimetre, as it stands in the file it is not.

use std::path::Path;

use anim::glam::{DVec3, Vec3, dvec3};
use anim::{Animation, LoadOptions, center, load};
use base64::Engine;

/// A place on the earth, in metres from its centre.
const PLACE: DVec3 = dvec3(4_201_234.567_8, 172_345.678_9, 4_780_123.456_7);
/// What lies there: a triangle of a metre, and a centimetre beside it one of a centimetre.
const DETAILS: [DVec3; 6] = [
    dvec3(0.0, 0.0, 0.0),
    dvec3(1.0, 0.0, 0.0),
    dvec3(0.0, 1.0, 0.0),
    dvec3(1.01, 0.0, 0.0),
    dvec3(1.02, 0.0, 0.0),
    dvec3(1.01, 0.01, 0.0),
];

/// The greatest distance of a vertex at `time` from where it should be, `origin` subtracted.
fn error(animation: &dyn Animation, time: f64, expected: &[DVec3], origin: DVec3) -> f64 {
    let mut positions = animation.rest();
    animation.pose(time, &mut positions);
    assert_eq!(positions.len(), expected.len());
    let error = |(p, e): (&Vec3, &DVec3)| (p.as_dvec3() + origin).distance(*e);
    positions.iter().zip(expected).map(error).fold(0.0, f64::max)
}

/// Loads `text` both ways and checks them at every time.
#[track_caller]
fn check(name: &str, text: &str, expected: &[(f64, Vec<DVec3>)]) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(&file, text).unwrap();
    check_path(&file, expected);
}

#[track_caller]
fn check_path(path: &Path, expected: &[(f64, Vec<DVec3>)]) {
    let far = load(path, &LoadOptions::default()).unwrap();
    let origin = center(&*far);
    assert!(origin.distance(PLACE) < 100.0, "{origin}");
    let near = load(path, &LoadOptions { origin, ..LoadOptions::default() }).unwrap();
    assert_eq!(far.topology().triangles, near.topology().triangles);
    for (time, expected) in expected {
        let [far, near] =
            [(&far, DVec3::ZERO), (&near, origin)].map(|(a, o)| error(&**a, *time, expected, o));
        println!("{}, {time} s: {far:.4} m, {near:.1e} m", path.display());
        assert!(far > 0.01, "{far} m as it stands: the file is no test");
        assert!(near < 1e-6, "{near} m near the origin");
    }
    let view = near.view(0.0).map(|view| view.eye);
    assert!(view.is_none_or(|eye| eye.length() < 100.0), "{view:?}");
    let light = near.light(0.0).map(|light| light.position);
    assert!(light.is_none_or(|at| at.length() < 100.0), "{light:?}");
}

fn moved(by: DVec3) -> Vec<DVec3> {
    DETAILS.map(|p| PLACE + by + p).to_vec()
}

fn lines(prefix: &str, points: &[DVec3]) -> String {
    points.iter().map(|p| format!("{prefix}{} {} {}\n", p.x, p.y, p.z)).collect()
}

#[test]
fn text_and_ply_files_keep_centimetres() {
    let points = moved(DVec3::ZERO);
    let expected = [(0.0, points.clone())];
    check("a.obj", &format!("{}f 1 2 3\nf 4 5 6\n", lines("v ", &points)), &expected);
    let properties = ["x", "y", "z"].map(|axis| format!("property double {axis}\n")).concat();
    let header = format!(
        "ply\nformat ascii 1.0\nelement vertex 6\n{properties}element face 2\n\
         property list uchar int vertex_index\nend_header\n"
    );
    check("a.ply", &format!("{header}{}3 0 1 2\n3 3 4 5\n", lines("", &points)), &expected);
    let [eye, target] = [5.0, 0.0].map(|z| PLACE + DVec3::Z * z).map(|p| lines("", &[p]));
    let view = format!("v from {eye} at {target} up 0 1 0 angle 60 hither 1 resolution 4 4\nl {eye}");
    check(
        "a.aff",
        &format!("{view}p 3 {}p 3 {}", lines("", &points[..3]), lines("", &points[3..])),
        &expected,
    );
}

#[test]
fn key_frames_share_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let key = |by: DVec3| format!("{}f 1 2 3\nf 4 5 6\n", lines("v ", &moved(by)));
    std::fs::write(folder.path().join("0.obj"), key(DVec3::ZERO)).unwrap();
    std::fs::write(folder.path().join("1.obj"), key(DVec3::Y)).unwrap();
    let key_time = anim::DEFAULT_SECONDS_PER_FRAME;
    check_path(folder.path(), &[(0.0, moved(DVec3::ZERO)), (key_time, moved(DVec3::Y))]);
}

/// Meshes are small; their nodes lie far away: one below the other, and one that a joint moves.
#[test]
fn gltf_nodes_are_composed_relative_to_the_origin() {
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let corners =
        |all: &[DVec3]| floats(&all.iter().flat_map(|p| p.as_vec3().to_array()).collect::<Vec<_>>());
    let bytes = [
        corners(&DETAILS[..3]),
        corners(&DETAILS[3..].iter().map(|p| *p - DVec3::X).collect::<Vec<_>>()),
        floats(&[0.0, 2.0]),
        floats(&[0.0, 0.0, 0.0, 0.0, 0.0, 3.0]),
        vec![0; 12],
        floats(&[1.0, 0.0, 0.0, 0.0].repeat(3)),
    ]
    .concat();
    let buffer = base64::engine::general_purpose::STANDARD.encode(&bytes);
    let accessor = |offset: usize, kind: &str, component: u32, count: usize| {
        format!(
            r#"{{"bufferView":0,"byteOffset":{offset},"type":"{kind}","componentType":{component},"count":{count}}}"#
        )
    };
    let accessors = [
        accessor(0, "VEC3", 5126, 3),
        accessor(36, "VEC3", 5126, 3),
        accessor(72, "SCALAR", 5126, 2),
        accessor(80, "VEC3", 5126, 2),
        accessor(104, "VEC4", 5121, 3),
        accessor(116, "VEC4", 5126, 3),
    ]
    .join(",");
    let DVec3 { x, y, z } = PLACE;
    // The first triangle lies below the site, on a node that slides. The second follows a joint
    // whose own translation is that of the site and a metre more, as a matrix.
    let matrix = format!("[1,0,0,0, 0,1,0,0, 0,0,1,0, {},{y},{z},1]", x + 1.0);
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0,3,4]}}],
        "extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point"}}]}}}},
        "nodes":[
            {{"children":[1]}},
            {{"translation":[{x},{y},{z}],"children":[2,5]}},
            {{"mesh":0}},
            {{"matrix":{matrix}}},
            {{"mesh":1,"skin":0}},
            {{"camera":0,"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}}],
        "cameras":[{{"type":"perspective","perspective":{{"yfov":1,"znear":0.1}}}}],
        "skins":[{{"joints":[3]}}],
        "meshes":[
            {{"primitives":[{{"attributes":{{"POSITION":0}}}}]}},
            {{"primitives":[{{"attributes":{{"POSITION":1,"JOINTS_0":4,"WEIGHTS_0":5}}}}]}}],
        "animations":[{{"samplers":[{{"input":2,"output":3}}],
            "channels":[{{"sampler":0,"target":{{"node":2,"path":"translation"}}}}]}}],
        "accessors":[{accessors}],
        "bufferViews":[{{"buffer":0,"byteLength":{length}}}],
        "buffers":[{{"byteLength":{length},"uri":"data:;base64,{buffer}"}}]}}"#,
        length = bytes.len()
    );
    let slid = |by: f64| {
        let mut points = moved(DVec3::ZERO);
        points[..3].iter_mut().for_each(|p| p.z += by);
        points
    };
    check("a.gltf", &text, &[(0.0, slid(0.0)), (1.0, slid(1.5)), (2.0, slid(3.0))]);
}
