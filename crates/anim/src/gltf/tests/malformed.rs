//! Files that are broken, or ask for too much: errors with a place, and no panic.

use super::*;

#[test]
fn hierarchies_that_are_not_forests_are_errors() {
    let document = Document::default();
    let message = document.error(r#""nodes":[{"children":[1]},{"children":[0]}]"#);
    assert!(message.contains("node 0") && message.contains("own ancestor"), "{message}");
    let message = document.error(r#""nodes":[{"name":"me","children":[0]}]"#);
    assert!(message.contains(r#"node 0 "me""#), "{message}");
    let message = document.error(r#""nodes":[{"children":[2]},{"children":[2]},{}]"#);
    assert!(message.contains("two parents"), "{message}");
    assert!(document.error(r#""nodes":[{"children":[7]}]"#).contains("no child node 7"));
}

#[test]
fn a_very_deep_hierarchy() {
    let mut document = Document::default();
    document.triangle();
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let depth = 50_000;
    let nodes: String = (1..=depth).map(|child| format!(r#"{{"children":[{child}]}},"#)).collect();
    let animation = document.load(&format!(
        r#"{TRIANGLE_MESH},"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}{{"mesh":0,"camera":0}}],
        "cameras":[{{"type":"perspective","perspective":{{"yfov":1,"znear":1}}}}],"animations":[{{"channels":
        [{{"sampler":0,"target":{{"node":0,"path":"translation"}}}}],"samplers":[{{"input":1,"output":2}}]}}]"#
    ));
    assert_eq!(at(&animation, 0.5)[0], Vec3::new(0.5, 0.0, 0.0));
    assert_eq!(animation.view(0.5).unwrap().eye, Vec3::new(0.5, 0.0, 0.0));
}

#[test]
fn numbers_out_of_range_are_errors() {
    let mut document = Document::default();
    document.triangle(); // 0
    document.floats("SCALAR", 1, &[0.0, 1.0]); // 1
    document.floats("VEC3", 3, &[0.0; 6]); // 2
    document.indices(&[0, 1, 3]); // 3: a vertex too far
    document.indices(&[0, 1]); // 4: no whole triangle
    document.floats("SCALAR", 1, &[1.0, 0.0]); // 5: times that go back
    document.floats("SCALAR", 1, &[0.0, f32::NAN]); // 6
    document.accessor("VEC4", U8, 3, &[0, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0], ""); // 7: a joint too far
    document.floats("VEC4", 4, &[1.0, 0.0, 0.0, 0.0].repeat(3)); // 8
    document.floats("MAT4", 16, &[0.0; 16]); // 9
    document.accessor("VEC3", FLOAT, 4, &[0; 36], ""); // 10: longer than its view
    document.raw_accessor(r#"{"bufferView":99,"componentType":5126,"count":3,"type":"VEC3"}"#); // 11
    document.raw_accessor(
        r#"{"bufferView":0,"byteOffset":18446744073709551615,"componentType":5126,"count":3,"type":"VEC3"}"#,
    ); // 12
    document
        .raw_accessor(r#"{"bufferView":0,"componentType":5126,"count":18446744073709551615,"type":"VEC3"}"#); // 13
    document.raw_accessor(r#"{"componentType":5126,"count":4000000000,"type":"VEC3"}"#); // 14
    document.raw_accessor(r#"{"bufferView":0,"componentType":7,"count":3,"type":"VEC3"}"#); // 15
    document.raw_accessor(r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC9"}"#); // 16

    let mesh = |primitive: &str, others: &str| {
        format!(r#""meshes":[{{"primitives":[{{{primitive}}}]}}],"nodes":[{{"mesh":0{others}}}]"#)
    };
    let position = |accessor: usize| mesh(&format!(r#""attributes":{{"POSITION":{accessor}}}"#), "");
    for (accessor, expected) in [
        (99, "no accessor 99"),
        (1, "SCALAR"),
        (10, "4 elements of 12 bytes"),
        (11, "no bufferView 99"),
        (12, "from byte 18446744073709551615"),
        (13, "at most"),
        (14, "at most"),
        (15, "unknown component type"),
        (16, "unknown element type"),
    ] {
        let message = document.error(&position(accessor));
        assert!(message.contains(expected) && message.contains("POSITION"), "{accessor}: {message}");
    }
    let good = r#""attributes":{"POSITION":0}"#;
    let check = |rest: &str, expected: &str| {
        let message = document.error(rest);
        assert!(message.contains(expected), "{expected:?} is not in: {message}");
    };
    check(&mesh(r#""attributes":{}"#, ""), "without triangles");
    check(&mesh(&format!(r#"{good},"indices":3"#), ""), "index number 2: found 3");
    check(&mesh(&format!(r#"{good},"indices":4"#), ""), "2 vertices");
    check(&mesh(&format!(r#"{good},"indices":0"#), ""), "SCALAR");
    check(&mesh(&format!(r#"{good},"indices":1"#), ""), "unsigned integers");
    check(&mesh(&format!(r#"{good},"indices":4,"mode":5"#), ""), "at least 3");
    check(&mesh(&format!(r#"{good},"mode":9"#), ""), "mode");
    check(&mesh(&format!(r#"{good},"material":1"#), ""), "no material 1");
    check(&mesh(&format!(r#"{good},"targets":[{{"POSITION":2}}]"#), ""), "2 elements");
    check(&mesh(&format!(r#"{good},"targets":[{{"POSITION":0}}]"#), r#","weights":[1,2,3]"#), "3 weights");
    check(&mesh(good, r#","skin":3"#), "no skin 3");
    check(r#""nodes":[{"mesh":4}]"#, "no mesh 4");
    check(r#""nodes":[],"scene":2"#, "no scene 2");
    check(r#""nodes":[],"scenes":[{"nodes":[5]}]"#, "no node 5");
    check(r#""nodes":[{}]"#, "without triangles");

    let skinned = r#""attributes":{"POSITION":0,"JOINTS_0":7,"WEIGHTS_0":8}"#;
    let skin = |skin: &str| format!(r#"{},"skins":[{{{skin}}}]"#, mesh(skinned, r#","skin":0"#));
    check(&skin(r#""joints":[0]"#), "joint 9");
    check(&skin(r#""joints":[8]"#), "joint node 8");
    check(&skin(r#""joints":[0,0],"inverseBindMatrices":9"#), "1 inverse bind matrices");
    check(&skin(r#""joints":[0],"inverseBindMatrices":0"#), "MAT4");

    let clip = |sampler: usize, node: usize, path: &str, input: usize, output: usize| {
        format!(
            r#"{},"animations":[{{"channels":[{{"sampler":{sampler},"target":{{"node":{node},"path":"{path}"}}}}],
            "samplers":[{{"input":{input},"output":{output}}}]}}]"#,
            mesh(good, "")
        )
    };
    check(&clip(1, 0, "translation", 1, 2), "no sampler 1");
    check(&clip(0, 3, "translation", 1, 2), "no node 3");
    check(&clip(0, 0, "translation", 1, 0), "9 numbers");
    check(&clip(0, 0, "rotation", 1, 2), "VEC4");
    check(&clip(0, 0, "translation", 5, 2), "before one");
    check(&clip(0, 0, "translation", 6, 2), "NaN");
}

#[test]
fn broken_containers_and_buffers_are_errors() {
    let parse = |bytes: &[u8]| {
        parse(Path::new("inline.glb"), bytes, &LoadOptions::default()).err().unwrap().to_string()
    };
    assert!(parse(b"").contains("empty file"));
    assert!(parse(b"hello").contains("JSON"));
    assert!(parse(b"{}").contains("JSON"));
    assert!(parse(b"glTF").contains("length of 0"));
    assert!(parse(b"glTF\x02\0\0\0\x01\0\0\0").contains("length of 1"));
    assert!(parse(b"glTF\x02\0\0\0\xff\xff\xff\xff").contains("length of 4294967295"));
    assert!(parse(b"glTF\x02\0\0\0\x14\0\0\0\xff\xff\xff\xffJSON").contains("JSON chunk"));
    assert!(parse(b"glTF\x09\0\0\0\x0c\0\0\0").contains("version"));
    assert!(parse(br#"{"asset":{"version":"1.0"}}"#).contains("1.0"));
    assert!(parse(br#"{"asset":{"version":"2.0","minVersion":"2.1"}}"#).contains("minVersion"));
    let draco = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
    assert!(parse(draco.as_bytes()).contains("KHR_draco_mesh_compression"));
    let buffer =
        |buffer: &str| parse(format!(r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffer}]}}"#).as_bytes());
    assert!(buffer(r#"{"byteLength":4}"#).contains("no BIN chunk"));
    assert!(buffer(r#"{"byteLength":4,"uri":"data:;base64,AA=="}"#).contains("1 bytes"));
    assert!(buffer(r#"{"byteLength":4,"uri":"../x.bin"}"#).contains("below the folder"));
    let missing = buffer(r#"{"byteLength":4,"uri":"no%20such.bin"}"#);
    assert!(missing.starts_with("no such.bin: cannot be read"), "{missing}");
}

#[test]
fn instancing_is_held_to_a_multiple_of_the_file() {
    let mut document = Document::default();
    let vertices = 30_000;
    document.floats("VEC3", 3, &vec![0.5; vertices * 3]);
    let nodes = vec![r#"{"mesh":0}"#; 100_000].join(",");
    let message = document.error(&format!(r#"{TRIANGLE_MESH},"nodes":[{nodes}]"#));
    assert!(message.contains("decoded data"), "{message}");
}

#[test]
fn parts_without_vertices_take_memory_too() {
    let primitives = vec![r#"{"attributes":{"POSITION":0}}"#; 3000].join(",");
    let nodes = vec![r#"{"mesh":0,"name":""}"#; 30_000].join(",");
    let message = Document::default().error(&format!(
        r#""accessors":[{{"componentType":5126,"count":0,"type":"VEC3"}}],
        "meshes":[{{"primitives":[{primitives}]}}],"nodes":[{nodes}]"#
    ));
    assert!(message.contains("decoded data"), "{message}");
}

#[test]
fn a_file_that_many_buffers_name_counts_once() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.bin"), [0; 1000]).unwrap();
    let file = folder.path().join("a.gltf");
    // What the text itself holds counts with the text.
    let embedded = r#"{"byteLength":4,"uri":"data:;base64,AAAAAA=="}"#;
    let buffers = [&[embedded], &[r#"{"byteLength":4,"uri":"a.bin"}"#; 10][..]].concat().join(",");
    let text = format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffers}],{TRIANGLE_MESH},"nodes":[{{"mesh":0}}],
        "accessors":[{{"componentType":5126,"count":4000000000,"type":"VEC3"}}]}}"#
    );
    std::fs::write(&file, &text).unwrap();
    let message = crate::load(&file, &LoadOptions::default()).err().unwrap().to_string();
    let limit = (1 << 30) + 256 * (text.len() + 1000);
    assert!(message.contains(&format!("at most {limit} for files of this size")), "{message}");
}

/// Whatever is done to a file, loading ends with a result, and posing what was loaded does not
/// panic.
#[test]
fn corrupted_files_do_not_panic() {
    let mut document = Document::default();
    document.triangle();
    document.accessor("VEC4", U8, 3, &[0; 12], "");
    document.floats("VEC4", 4, &[1.0; 12]);
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    document.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    document.indices(&[0, 1, 2]);
    document.floats("SCALAR", 1, &[0.0, 1.0]);
    let json = document.json(
        r#""meshes":[{"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2},"indices":5,
        "targets":[{"POSITION":0}]}]}],"nodes":[{"mesh":0,"skin":0},{"children":[2]},{"mesh":0}],"skins":[{"joints":[1,2]}],
        "animations":[{"channels":[{"sampler":0,"target":{"node":1,"path":"translation"}},{"sampler":1,"target":{"node":2,
        "path":"weights"}}],"samplers":[{"input":3,"output":4},{"input":3,"output":6}]}]"#,
    );
    let mut rng = fastrand::Rng::with_seed(1);
    let mut random = |below: usize| rng.usize(..below);
    let mut loaded = 0;
    for round in 0..20_000 {
        let mut bytes = json.clone().into_bytes();
        for _ in 0..=round % 3 {
            let at = random(bytes.len());
            // Mostly digits for digits, so that the JSON stays readable.
            bytes[at] = match bytes[at] {
                b'0'..=b'9' => b'0' + random(10) as u8,
                other if random(4) == 0 => other ^ (1 << random(7)),
                other => other,
            };
        }
        if let Ok(animation) = parse(Path::new("inline.gltf"), &bytes, &LoadOptions::default()) {
            loaded += 1;
            at_all_times(&animation);
        }
    }
    assert!(loaded > 1000, "most corruptions should leave something to load: {loaded}");
}

fn at_all_times(animation: &GltfAnimation) {
    for time in [0.0, 0.4, 1.0, f64::NAN, f64::INFINITY, -1.0] {
        at(animation, time);
        animation.view(time);
        animation.light(time);
    }
}
