use std::path::Path;

use glam::Vec3;

use super::*;
use crate::{Animation, LoadOptions};

fn parse(name: &str, bytes: &[u8]) -> Result<KeyFrames, LoadError> {
    super::parse(Path::new(name), bytes, DVec3::ZERO)
}

#[track_caller]
fn error(name: &str, bytes: &[u8]) -> String {
    let message = parse(name, bytes).unwrap_err().to_string();
    assert!(message.starts_with(name) && !message.contains('\n'), "{message}");
    message
}

/// A square of two triangles in any encoding; what is not asked for is in the way and has to be
/// skipped.
fn square_ply(format: &str, float: &str, index: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment test\nelement vertex 4\nproperty {float} x\nproperty uchar C2C_(Z)\n\
         property {float} y\nproperty {float} z\nelement edge 1\nproperty int vertex1\nelement face 1\n\
         property uchar flags\nproperty list uchar {index} vertex_index\nend_header\n"
    )
    .into_bytes();
    let corners = [[0.1, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1e10]];
    if format == "ascii" {
        for [x, y, z] in corners {
            bytes.extend(format!("{x} 7 {y} {z}\n").bytes());
        }
        bytes.extend(b"3\n9 4 0 1 2 3\n");
        return bytes;
    }
    let big = format == "binary_big_endian";
    let mut push = |little: &[u8]| {
        if big { bytes.extend(little.iter().rev()) } else { bytes.extend(little) }
    };
    for [x, y, z] in corners {
        let number = |value: f64| match float {
            "float" => (value as f32).to_le_bytes().to_vec(),
            _ => value.to_le_bytes().to_vec(),
        };
        push(&number(x));
        push(&[7]);
        push(&number(y));
        push(&number(z));
    }
    push(&3_i32.to_le_bytes());
    push(&[9]);
    push(&[4]);
    for corner in 0..4_u32 {
        let size = if index == "ushort" { 2 } else { 4 };
        push(&corner.to_le_bytes()[..size]);
    }
    bytes
}

#[test]
fn ply_in_all_encodings() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for float in ["float", "double"] {
            for index in ["int", "uint", "ushort"] {
                let mesh = parse("square.ply", &square_ply(format, float, index))
                    .unwrap_or_else(|error| panic!("{format} {float} {index}: {error}"));
                assert_eq!(mesh.topology().triangles, [[0, 1, 2], [0, 2, 3]]);
                let expected =
                    [Vec3::new(0.1, 0.0, 0.0), Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 1.0, 1e10)];
                assert_eq!(mesh.rest(), expected);
                assert_eq!(mesh.topology().parts[0].name, "square");
                assert_eq!((mesh.duration(), &mesh.topology().moves[..]), (0.0, &[false, false][..]));
            }
        }
    }
}

#[test]
fn ply_that_promises_more_than_it_holds() {
    let header = |format: &str, vertices: &str, faces: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    for format in ["ascii", "binary_little_endian"] {
        for count in ["4000000000", "18446744073709551615", "99999999999999999999999999"] {
            let message = error("huge.ply", header(format, count, "1").as_bytes());
            assert!(message.contains("element vertex") || message.contains("header"), "{message}");
        }
        assert!(error("huge.ply", header(format, "0", "4000000000").as_bytes()).contains("element face"));
    }
    // Elements without properties take no bytes; a list may claim any length.
    let nothing = header("binary_little_endian", "0", "0")
        .replace("element face", "element void 18446744073709551615\nelement face");
    assert!(error("void.ply", nothing.as_bytes()).contains("no triangles"));
    let list = header("binary_little_endian", "0", "1").replace("list uchar", "list uint");
    let mut list = list.into_bytes();
    list.extend([0xff; 8]);
    assert!(error("list.ply", &list).contains("face"));
}

#[test]
fn malformed_ply_is_refused() {
    let ascii = String::from_utf8(square_ply("ascii", "float", "int")).unwrap();
    for (from, to, expected) in [
        ("9 4 0 1 2 3", "9 4 0 1 2 4", "vertex 4"),
        ("9 4 0 1 2 3", "9 4 0 1 2 -3", "face"),
        ("9 4 0 1 2 3", "9 2 0 1", "2 corners"),
        ("9 4 0 1 2 3", "9 4 0 1", "face"),
        ("property float z", "property float w", "no property z"),
        ("vertex_index", "something", "no list of vertices"),
        ("element vertex", "element point", "no element vertex"),
        ("end_header", "", "header"),
        ("ply\n", "plx\n", "header"),
        ("1.0", "x.0", "header"),
    ] {
        let message = error("bad.ply", ascii.replacen(from, to, 1).as_bytes());
        assert!(message.contains(expected), "{message}");
    }
    let message = error("bad.ply", ascii.replacen("\n1 7 0 0", "\n1 7 0 O", 1).as_bytes());
    assert!(message.ends_with("element vertex 1: found O, expected a number for z"), "{message}");
    let message = error("bad.ply", ascii.replacen("uchar flags", "uchar", 1).as_bytes());
    assert!(message.contains("header, line 12: found \"property uchar\""), "{message}");
    assert!(error("empty.ply", b"").contains("empty file"));
}

#[test]
fn ply_text_takes_every_number_and_any_comment() {
    let ascii = String::from_utf8(square_ply("ascii", "float", "int")).unwrap();
    // The second number is of a property that is ignored.
    let numbers = ascii.replacen("0.1 7 0 0", "-nan nan inf .5", 1).replacen("1 7 0 0", "1. 7 0 0", 1);
    let mut bytes = numbers.into_bytes();
    let comment = bytes.windows(4).position(|window| window == b"test").unwrap();
    bytes[comment] = 0xe9;
    let rest = parse("a.ply", &bytes).unwrap().rest();
    assert!(rest[0].x.is_nan() && rest[0].y == f32::INFINITY && rest[0].z == 0.5, "{}", rest[0]);
    assert_eq!(rest[1], Vec3::X);
}

#[test]
fn ply_points_that_are_not_finite_are_passed_on() {
    let mut bytes = square_ply("binary_little_endian", "float", "int");
    let first = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    bytes[first..first + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(parse("nan.ply", &bytes).unwrap().rest()[0].x.is_nan());
}

#[test]
fn a_byte_order_mark_belongs_to_no_word() {
    let obj = "\u{feff}v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let stl = "\u{feff}solid\nvertex 9 9 9\nvertex 0 0 0\nvertex 1 0 0\n";
    for (name, text) in [("a.obj", obj), ("a.stl", stl)] {
        let mesh = parse(name, text.as_bytes()).unwrap();
        assert_eq!(mesh.rest()[..2], [Vec3::splat(9.0), Vec3::ZERO], "{name}");
    }
}

#[test]
fn obj_faces_polygons_and_relative_indices() {
    let text = "# comment\nmtllib none.mtl\no first\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n\
                f 1/1/1 2/1 3//1 4\nf -4/1 \\\n-3 -2\nl 1 2\np 1\no empty\no second\nv 5 5 5\nf 1 2 5\nf 1/7 5/8 3/9\n";
    let mesh = parse("some.obj", text.as_bytes()).unwrap();
    let topology = mesh.topology();
    // The parts do not share vertices.
    assert_eq!(topology.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [4, 5, 6], [4, 6, 7]]);
    let names: Vec<_> = topology.parts.iter().map(|part| (&*part.name, part.triangles.clone())).collect();
    assert_eq!(names, [("first", 0..3), ("second", 3..5)]);
    assert_eq!((topology.parts[1].vertices.clone(), topology.vertex_count), (4..8, 8));
    assert_eq!(mesh.rest()[6], Vec3::splat(5.0));
}

#[test]
fn obj_materials_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.obj");
    let mtl = "newmtl broken\nKd 0.5 1\nnewmtl red\nKd 1 0.25 0\nKs 1\n";
    std::fs::write(folder.path().join("my colours.mtl"), mtl).unwrap();
    let obj = "mtllib\tmy colours.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl\tred\nf 3 2 1\nusemtl broken\nf 1 2 3\nusemtl \nf 2 3 1\n";
    std::fs::write(&file, obj).unwrap();
    let mesh = crate::load(&file, &LoadOptions::default()).unwrap();
    let topology = mesh.topology();
    let colors: Vec<_> =
        topology.parts.iter().map(|p| topology.materials[p.material as usize].base_color).collect();
    assert_eq!(colors, [[0.8; 3], [1.0, 0.25, 0.0], [0.8; 3], [0.8; 3]]);
}

#[test]
fn obj_names_several_material_libraries() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.obj");
    std::fs::write(folder.path().join("a.mtl"), "newmtl grey\nKd 0.5\n").unwrap();
    std::fs::write(folder.path().join("b.mtl"), "newmtl red\nKd 1 0 0\n").unwrap();
    for (libraries, notes) in [
        ("mtllib a.mtl b.mtl", &[][..]),
        ("mtllib a.mtl\nmtllib b.mtl", &[]),
        (
            "mtllib ./x/../a.mtl gone.mtl b.mtl\nmtllib ../my c.mtl\nmtllib ../my c.mtl",
            &["\"../my c.mtl\"", "\"gone.mtl\""],
        ),
    ] {
        let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl grey\nf 1 2 3\nusemtl red\nf 3 2 1\n";
        std::fs::write(&file, format!("{libraries}\n{faces}")).unwrap();
        let mesh = crate::load(&file, &LoadOptions::default()).unwrap();
        let topology = mesh.topology();
        let color = |part: &crate::Part| topology.materials[part.material as usize].base_color;
        let colors: Vec<_> = topology.parts.iter().map(color).collect();
        assert_eq!(colors, [[0.5; 3], [1.0, 0.0, 0.0]], "{libraries}");
        let noted = |name: &&str| format!("the material library {name} cannot be read");
        assert_eq!(mesh.model().notes, notes.iter().map(noted).collect::<Vec<_>>(), "{libraries}");
    }
}

/// Each time that `tobj` loads a library it adds its materials again.
#[test]
fn obj_libraries_named_again_add_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.obj");
    let (materials, libraries) = ("newmtl a\n".repeat(2000), "mtllib model.obj\n".repeat(2000));
    std::fs::write(&file, format!("{materials}{libraries}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")).unwrap();
    let mesh = crate::load(&file, &LoadOptions::default()).unwrap();
    assert_eq!(mesh.topology().materials.len(), 2001);
}

#[test]
fn obj_comments_end_lines_of_numbers_but_not_names() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.obj");
    std::fs::write(folder.path().join("a #1.mtl"), "newmtl red #1\nKd 1 0 0 # red\n").unwrap();
    let obj = "mtllib a #1.mtl\no first #1\nv 0 0 0 # origin\nv 1 0 0 #x\nv 0 1 0 1 0 0# 1\nvt 0 0 # corner\n\
               vn 0 0 1 # up\nusemtl red #1\nf 1/1/1 2/1/1 3/1/1 # 1 2 3\nf 3 2 1# 2\n";
    std::fs::write(&file, obj).unwrap();
    let mesh = crate::load(&file, &LoadOptions::default()).unwrap();
    let topology = mesh.topology();
    assert_eq!(topology.triangles, [[0, 1, 2], [2, 1, 0]]);
    assert_eq!(mesh.rest(), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    let part = &topology.parts[0];
    let color = topology.materials[part.material as usize].base_color;
    assert_eq!((&*part.name, color), ("first #1", [1.0, 0.0, 0.0]));
}

#[test]
fn malformed_obj_is_refused() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for faces in [
        "f 1 2 4",
        "f 0 1 2",
        "f 1 2 -4",
        "f",
        "f 1 2 x",
        "f 1 2 3 /4",
        "f 1 2 99999999999999999999",
        "v 1 2\nf 1 2 3",
        "v a b c",
    ] {
        error("bad.obj", format!("{triangle}{faces}\n").as_bytes());
    }
    // Texture coordinates that do not exist do not matter.
    assert!(
        parse("fine.obj", format!("{triangle}vt 0 0\nf 1/-5/-5 2/9223372036854775807 3\n").as_bytes())
            .is_ok()
    );
    assert!(error("empty.obj", b"").contains("empty file"));
    assert!(error("no faces.obj", triangle.as_bytes()).contains("no triangles"));
    assert!(error("model.off", b"solid").contains("found another kind of mesh, expected .glb"));
}

/// Whatever is done to a file, loading ends with a result.
#[test]
fn corrupted_files_do_not_panic() {
    let obj = b"mtllib a\no b\nv 0 0 0\nv 1 0 0\nv 0 1 0 1\nvt 0 1\nf 1/1/1 2/2 3\nusemtl c\nf -1 -2 -3\ng d\nf 1 2 3\n";
    let mut files = vec![("x.obj", obj.to_vec())];
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        files.push(("x.ply", square_ply(format, "float", "int")));
    }
    files.extend(square_stl().map(|bytes| ("x.stl", bytes)));
    let mut rng = fastrand::Rng::with_seed(2);
    let mut random = |below: usize| rng.usize(..below);
    let mut loaded = 0;
    for round in 0..10_000 {
        for (name, bytes) in &files {
            let mut bytes = bytes.clone();
            for _ in 0..=round % 3 {
                let at = random(bytes.len());
                bytes[at] = if random(2) == 0 { random(256) as u8 } else { bytes[at] ^ (1 << random(8)) };
            }
            if random(4) == 0 {
                bytes.truncate(random(bytes.len()));
            }
            loaded += usize::from(parse(name, &bytes).is_ok());
        }
    }
    assert!(loaded > 1000, "some corruptions should leave something to load: {loaded}");
}

/// A square of two facets, as text and in binary.
fn square_stl() -> [Vec<u8>; 2] {
    let text = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n";
    let mut binary = vec![0; 80];
    binary.extend(2_u32.to_le_bytes());
    for corners in [[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0_f32]]] {
        let floats = [0.0, 0.0, 1.0].into_iter().chain(corners.into_iter().flat_map(|[x, y]| [x, y, 0.0]));
        binary.extend(floats.flat_map(f32::to_le_bytes));
        binary.extend([0, 0]);
    }
    [text.into(), binary]
}

#[test]
fn stl_in_both_forms_welds_corners() {
    let [text, binary] = square_stl();
    for bytes in [&text, &binary] {
        let mesh = parse("a.stl", bytes).unwrap();
        assert_eq!((mesh.topology().triangles.len(), mesh.topology().vertex_count), (2, 4));
    }
    assert!(error("a.stl", &binary[..100]).contains("2 facets in 100 bytes"));
    // A header like that of text, with bytes behind the facets; solids without names, and several
    // of them; names in Latin-1.
    let mut header = [&binary[..], b"trailing"].concat();
    header[..12].copy_from_slice(b"solid text\n ");
    let text = String::from_utf8(text).unwrap();
    let nameless: String = text
        .lines()
        .map(|line| if line.starts_with("solid") { "solid\n" } else { line }.to_owned() + "\n")
        .collect();
    let two = (format!("\r\n{nameless}") + &text).into();
    let latin = [text.trim_end().as_bytes(), b"\xe9"].concat();
    for (bytes, parts) in [(header, 1), (nameless.into(), 1), (two, 2), (latin, 1)] {
        let mesh = parse("a.stl", &bytes).unwrap();
        assert_eq!(mesh.topology().parts.len(), parts);
        assert_eq!(mesh.topology().triangles.len(), parts * 2);
    }
    assert!(parse("a.stl", b"solid").is_err());
}

#[test]
fn stl_numbers_that_are_not_finite_are_passed_on() {
    let [text, mut binary] = square_stl();
    let text = String::from_utf8(text).unwrap();
    let text = text.replacen("normal 0 0 1", "normal nan nan nan", 1).replacen("1 0 0", "-nan inf 0", 1);
    binary[84 + 24..84 + 28].copy_from_slice(&f32::NAN.to_le_bytes());
    binary[84 + 28..84 + 32].copy_from_slice(&f32::INFINITY.to_le_bytes());
    for bytes in [text.as_bytes(), &binary] {
        let corner = parse("nan.stl", bytes).unwrap().rest()[1];
        assert!(corner.x.is_nan() && corner.y == f32::INFINITY, "{corner}");
    }
}

#[test]
fn malformed_stl_is_refused() {
    let [text, _] = square_stl();
    let text = String::from_utf8(text).unwrap();
    for (from, to, expected) in [
        ("vertex 1 0 0", "vertex 1 0 x", "line 5"),
        ("vertex 1 0 0", "vertex 1 0", "3 numbers"),
        ("vertex 1 0 0\n", "", "line 6: found \"endloop\""),
        ("vertex 1 0 0\n", "vertex 1 0 0\nvertex 1 0 0\n", "line 8"),
        ("solid s", "volume s", "header"),
    ] {
        let message = error("bad.stl", text.replacen(from, to, 1).as_bytes());
        assert!(message.contains(expected), "{message}");
    }
    let end = text.find("endloop").unwrap() - 1;
    assert!(error("cut.stl", &text.as_bytes()[..end - 13]).contains("end of file"));
}
