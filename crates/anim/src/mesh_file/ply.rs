//! PLY files, text or binary. Our own reader: `ply-rs` refuses `nan`, `.5` and `1.`, names of
//! properties with parentheses (CloudCompare writes them) and comments that are not UTF-8.

use std::path::Path;

use glam::DVec3;

use crate::error::Problem;
use crate::{Material, Model};

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// The type of its length, if it is a list.
    list: Option<Kind>,
    kind: Kind,
}

/// Names for the list of a face's vertices.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// A type of numbers: its size in bytes, and the number that the lowest bits stand for.
type Kind = (usize, fn(u64) -> f64);

fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => (1, |bits| f64::from(bits as i8)),
        "uchar" | "uint8" => (1, |bits| f64::from(bits as u8)),
        "short" | "int16" => (2, |bits| f64::from(bits as i16)),
        "ushort" | "uint16" => (2, |bits| f64::from(bits as u16)),
        "int" | "int32" => (4, |bits| f64::from(bits as i32)),
        "uint" | "uint32" => (4, |bits| f64::from(bits as u32)),
        "float" | "float32" => (4, |bits| f64::from(f32::from_bits(bits as u32))),
        "double" | "float64" => (8, f64::from_bits),
        _ => return None,
    })
}

fn property(words: &[&str]) -> Option<Property> {
    let (list, of, name) = match *words {
        ["property", "list", length, of, name] => (Some(kind(length)?), of, name),
        ["property", of, name] => (None, of, name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), list, kind: kind(of)? })
}

/// The elements, the name of the format, and the bytes behind the header.
fn header(bytes: &[u8]) -> Result<(Vec<Element>, String, &[u8]), Problem> {
    let (mut elements, mut format, mut length): (Vec<Element>, _, _) = (Vec::new(), String::new(), 0);
    for (number, line) in (1..).zip(bytes.split_inclusive(|&byte| byte == b'\n')) {
        length += line.len();
        let line = String::from_utf8_lossy(line);
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_known = match words[..] {
            ["ply"] => number == 1,
            _ if number == 1 => false,
            [] | ["comment" | "obj_info", ..] => true,
            ["format", name @ ("ascii" | "binary_little_endian" | "binary_big_endian"), "1.0"] => {
                format = name.to_owned();
                true
            }
            ["element", name, count] => {
                let element = |count| Element { name: name.to_owned(), count, properties: Vec::new() };
                count.parse().map(|count| elements.push(element(count))).is_ok()
            }
            ["end_header"] if !format.is_empty() => return Ok((elements, format, &bytes[length..])),
            _ => elements.last_mut().zip(property(&words)).map(|(e, p)| e.properties.push(p)).is_some(),
        };
        if !is_known {
            let (place, found) = (format!("header, line {number}"), format!("{:?}", line.trim()));
            return Err(Problem::new(place, found, "a line of a PLY header"));
        }
    }
    Err(Problem::new("header", "the end of the file", "end_header"))
}

/// The number of vertices, if vertices and faces have what they need.
fn check_header(elements: &[Element]) -> Result<u64, Problem> {
    let check = |name: &str, properties: &[&str], is_list: bool, what: &str| {
        let missing = || Problem::new("header", format!("no element {name}"), "one");
        let element = elements.iter().find(|element| element.name == name).ok_or_else(missing)?;
        let missing = || Problem::new(format!("header, element {name}"), format!("no {what}"), "one");
        let is_it = |p: &&Property| properties.contains(&&*p.name) && p.list.is_some() == is_list;
        element.properties.iter().find(is_it).map(|_| element.count).ok_or_else(missing)
    };
    check("vertex", &["x"], false, "property x")?;
    check("vertex", &["y"], false, "property y")?;
    check("face", &CORNERS, true, "list of vertices, vertex_indices or vertex_index")?;
    check("vertex", &["z"], false, "property z")
}

pub(super) fn read(bytes: &[u8], file: &Path, origin: DVec3) -> Result<Model, Problem> {
    let (elements, format, mut body) = header(bytes)?;
    let vertex_count = check_header(&elements)?;
    let (is_text, is_big_endian) = (format == "ascii", format == "binary_big_endian");
    let (mut positions, mut triangles, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    for Element { name, count, properties } in &elements {
        // Without properties an element takes no bytes, and any number of them can be declared.
        for number in 0..if properties.is_empty() { 0 } else { *count } {
            let wrong = |found: &str, expected: &str| {
                Problem::new(format!("element {name} {number}"), found, expected)
            };
            // Text has a line for each element.
            let line = if is_text { body.split_inclusive(|&byte| byte == b'\n').next() } else { None };
            let line = line.unwrap_or_default();
            body = &body[line.len()..];
            let line = String::from_utf8_lossy(line);
            let mut words = line.split_ascii_whitespace();
            let mut next = |(size, from_bits): Kind, property: &str| {
                let expected = || format!("a number for {property}");
                if is_text {
                    let word = words.next().unwrap_or("the end of the line");
                    return word.parse().map_err(|_| wrong(word, &expected()));
                }
                let number =
                    body.split_off(..size).ok_or_else(|| wrong("the end of the file", &expected()))?;
                let mut bits = [0; 8];
                bits[..size].copy_from_slice(number);
                if is_big_endian {
                    bits[..size].reverse();
                }
                Ok(from_bits(u64::from_le_bytes(bits)))
            };
            let mut position = DVec3::ZERO;
            corners.clear();
            for Property { name, list, kind } in properties {
                let count = list.map_or(Ok(1.0), |length| next(length, name))?;
                for _ in 0..count as u64 {
                    let number = next(*kind, name)?;
                    match &**name {
                        "x" if list.is_none() => position.x = number,
                        "y" if list.is_none() => position.y = number,
                        "z" if list.is_none() => position.z = number,
                        name if list.is_some() && CORNERS.contains(&name) => corners.push(number),
                        _ => {}
                    }
                }
            }
            if name == "vertex" {
                positions.push((position - origin).as_vec3());
            } else if name == "face" {
                let is_vertex =
                    |corner: f64| corner.fract() == 0.0 && (0.0..vertex_count as f64).contains(&corner);
                if let Some(corner) = corners.iter().find(|&&corner| !is_vertex(corner)) {
                    return Err(wrong(&format!("vertex {corner}"), &format!("one below {vertex_count}")));
                } else if corners.len() < 3 {
                    return Err(wrong(&format!("{} corners", corners.len()), "at least 3"));
                }
                // A fan around the first corner.
                let fan = corners[1..].windows(2).map(|edge| [corners[0], edge[0], edge[1]]);
                triangles.extend(fan.map(|corners| corners.map(|corner| corner as u32)));
            }
        }
    }
    let name = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let mut model = Model::with_materials(vec![Material::default()]);
    model.add_part(name, &triangles, positions.into_iter(), 0)?;
    Ok(model)
}
