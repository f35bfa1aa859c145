//! STL files, ascii or binary.

use std::io::Cursor;

use glam::Vec3;

use super::Mesh;
use crate::Material;
use crate::error::Problem;

pub(super) fn read(bytes: &[u8]) -> Result<Mesh, Problem> {
    let wrong =
        |error: &dyn std::fmt::Display| Problem::from_parser("STL", error, "triangles, ascii or binary");
    let read = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|error| wrong(&error))?;
    let positions: Vec<Vec3> = read.vertices.iter().map(|&vertex| Vec3::from_array(vertex.into())).collect();
    let triangles: Vec<[u32; 3]> = read.faces.iter().map(|face| face.vertices.map(|v| v as u32)).collect();
    let mut mesh = Mesh::with_materials(vec![Material::default()]);
    let added = mesh.add_part("mesh".to_owned(), &triangles, &positions, 0);
    added.ok_or_else(|| wrong(&"more vertices than 32 bits can number"))?;
    Ok(mesh)
}
