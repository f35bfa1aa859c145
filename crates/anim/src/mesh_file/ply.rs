//! PLY through `ply-rs-bw`, the maintained fork of `ply-rs`: its allocations grow with what it
//! reads, not with what a header promises.

use std::path::Path;

use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult};

use super::Mesh;
use crate::Material;
use crate::error::Problem;

struct Vertex(DVec3);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(DVec3::ZERO)
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.0.x,
            "y" => &mut self.0.y,
            "z" => &mut self.0.z,
            _ => return PropertyAccessResult::Ignored,
        };
        *slot = match value {
            Property::Char(value) => f64::from(value),
            Property::UChar(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            Property::UShort(value) => f64::from(value),
            Property::Int(value) => f64::from(value),
            Property::UInt(value) => f64::from(value),
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// The corners of a polygon.
#[derive(Default)]
struct Face(Vec<u32>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if !is_corner_list(name) {
            return PropertyAccessResult::Ignored;
        }
        // A list of floats, or with a negative number.
        let Some(corners) = value.to_u32_list() else { return PropertyAccessResult::UnsupportedType };
        self.0 = corners;
        PropertyAccessResult::Set
    }
}

fn is_corner_list(property: &str) -> bool {
    matches!(property, "vertex_indices" | "vertex_index")
}

fn payload<E: PropertyAccess>(
    reader: &mut Reader<&[u8]>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, Problem> {
    Parser::new().read_payload_for_element(reader, element, header).map_err(|error| {
        let place = format!("element {}", element.name);
        Problem::from_parser(&place, &error, "the elements that the header declares")
    })
}

pub(super) fn read(bytes: &[u8], file: &Path, origin: DVec3) -> Result<Mesh, Problem> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Vertex>::new()
        .read_header(&mut reader)
        .map_err(|error| Problem::from_parser("header", &error, "a PLY header"))?;
    check_header(&header)?;

    let (mut positions, mut faces): (Vec<Vertex>, Vec<Face>) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => positions = payload(&mut reader, element, &header)?,
            "face" => faces = payload(&mut reader, element, &header)?,
            // Without properties, in a binary file, it takes no bytes, and any number of them can
            // be declared.
            _ if element.properties.is_empty() && header.encoding != Encoding::Ascii => {}
            // Of no interest, but it must be read to get behind it.
            _ => drop(payload::<Vertex>(&mut reader, element, &header)?),
        }
    }
    let triangles = fans(&faces, positions.len())?;
    let name = file.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let mut mesh = Mesh::with_materials(vec![Material::default()]);
    let positions = positions.iter().map(|vertex| (vertex.0 - origin).as_vec3());
    mesh.add_part(name, &triangles, positions, 0)?;
    Ok(mesh)
}

fn check_header(header: &Header) -> Result<(), Problem> {
    let element = |name: &str| {
        header.elements.get(name).ok_or_else(|| Problem::new("header", format!("no element {name}"), "one"))
    };
    let vertex = element("vertex")?;
    if let Some(missing) = ["x", "y", "z"].into_iter().find(|&axis| !vertex.properties.contains_key(axis)) {
        return Err(Problem::new("header, element vertex", format!("no property {missing}"), "x, y and z"));
    }
    if !element("face")?.properties.keys().any(|property| is_corner_list(property)) {
        let expected = "vertex_indices or vertex_index";
        return Err(Problem::new("header, element face", "no list of vertices", expected));
    }
    Ok(())
}

/// Polygons as fans around their first corner.
fn fans(faces: &[Face], vertex_count: usize) -> Result<Vec<[u32; 3]>, Problem> {
    let mut triangles = Vec::with_capacity(faces.len());
    for (number, Face(corners)) in faces.iter().enumerate() {
        let place = || format!("face {number}");
        if let Some(corner) = corners.iter().find(|&&corner| corner as usize >= vertex_count) {
            let expected = format!("one below {vertex_count}");
            return Err(Problem::new(place(), format!("vertex {corner}"), expected));
        }
        if corners.len() < 3 {
            return Err(Problem::new(place(), format!("{} corners", corners.len()), "at least 3"));
        }
        triangles.extend(corners[1..].windows(2).map(|edge| [corners[0], edge[0], edge[1]]));
    }
    Ok(triangles)
}
