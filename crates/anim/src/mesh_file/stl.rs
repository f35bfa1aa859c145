//! STL files, ascii or binary.

use std::io::Cursor;

use glam::{DVec3, Vec3};

use super::Mesh;
use crate::Material;
use crate::error::Problem;

pub(super) fn read(bytes: &[u8], origin: DVec3) -> Result<Mesh, Problem> {
    let read = stl_io::read_stl(&mut Cursor::new(bytes))
        .map_err(|error| Problem::from_parser("STL", &error, "triangles, ascii or binary"))?;
    let relative = |&vertex: &stl_io::Vertex| (Vec3::from_array(vertex.into()).as_dvec3() - origin).as_vec3();
    let positions = read.vertices.iter().map(relative);
    let triangles: Vec<[u32; 3]> = read.faces.iter().map(|face| face.vertices.map(|v| v as u32)).collect();
    let mut mesh = Mesh::with_materials(vec![Material::default()]);
    mesh.add_part("mesh".to_owned(), &triangles, positions, 0)?;
    Ok(mesh)
}
