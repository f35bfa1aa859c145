//! STL files, ascii or binary.

use std::borrow::Cow;
use std::io::Cursor;

use glam::{DVec3, Vec3};

use super::Mesh;
use crate::Material;
use crate::error::Problem;

pub(super) fn read(bytes: &[u8], origin: DVec3) -> Result<Mesh, Problem> {
    let relative = |&vertex: &stl_io::Vertex| (Vec3::from_array(vertex.into()).as_dvec3() - origin).as_vec3();
    let mut mesh = Mesh::with_materials(vec![Material::default()]);
    for solid in solids(bytes) {
        let read = stl_io::read_stl(&mut Cursor::new(solid))
            .map_err(|error| Problem::from_parser("STL", &error, "triangles, ascii or binary"))?;
        let positions = read.vertices.iter().map(relative);
        let triangles: Vec<[u32; 3]> =
            read.faces.iter().map(|face| face.vertices.map(|v| v as u32)).collect();
        mesh.add_part("mesh".to_owned(), &triangles, positions, 0)?;
    }
    Ok(mesh)
}

/// The file in pieces that `stl_io` reads: it takes one solid, that must have a name, and takes a
/// binary file for text if its header begins like one.
fn solids(bytes: &[u8]) -> Vec<Cow<'_, [u8]>> {
    let is_solid = |line: &[u8]| {
        let rest = line.trim_ascii_start().strip_prefix(b"solid");
        rest.is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
    };
    if !is_solid(bytes) {
        return vec![bytes.into()];
    }
    let count = bytes.get(80..84).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
    if count.is_some_and(|count| 84 + 50 * u64::from(count) == bytes.len() as u64) {
        return vec![[&[0; 80], &bytes[80..]].concat().into()];
    }
    let mut solids: Vec<Vec<u8>> = Vec::new();
    for line in bytes.trim_ascii_start().split_inclusive(|&byte| byte == b'\n') {
        match solids.last_mut() {
            Some(solid) if !is_solid(line) => solid.extend(line),
            _ => solids.push(b"solid mesh\n".to_vec()),
        }
    }
    solids.into_iter().map(Cow::from).collect()
}
