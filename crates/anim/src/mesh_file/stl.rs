//! STL files, text or binary. Our own reader: `stl_io` refuses numbers that are not finite, names
//! that are not UTF-8, and several solids in a file.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::error::Problem;
use crate::files::unmarked;
use crate::{Material, Model};

/// Bytes before the first facet of a binary file, and of each facet.
const HEADER: usize = 84;
const FACET: usize = 50;

pub(super) fn read(bytes: &[u8], origin: DVec3) -> Result<Model, Problem> {
    let count = bytes.get(HEADER - 4..HEADER).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    // Binary files may begin with `solid` too. In text the four bytes would count 2^27 facets.
    let solids = if bytes.len() >= HEADER && (bytes.len() - HEADER) / FACET >= count as usize {
        let facets = bytes[HEADER..].chunks_exact(FACET).take(count as usize);
        let numbers = facets.flat_map(|facet| facet[12..48].as_chunks().0).map(|&b| f32::from_le_bytes(b));
        vec![numbers.collect::<Vec<_>>()]
    } else if unmarked(bytes).trim_ascii_start().starts_with(b"solid") {
        text(&String::from_utf8_lossy(unmarked(bytes)))?
    } else {
        let found = format!("{count} facets in {} bytes", bytes.len());
        return Err(Problem::new("header", found, "`solid`, or 84 bytes and 50 for each facet"));
    };
    let mut model = Model::with_materials(vec![Material::default()]);
    for numbers in solids {
        let (mut known, mut positions) = (HashMap::new(), Vec::new());
        let mut weld = |corner: [f32; 3]| {
            *known.entry(corner.map(f32::to_bits)).or_insert_with(|| {
                positions.push((Vec3::from_array(corner).as_dvec3() - origin).as_vec3());
                positions.len() as u32 - 1
            })
        };
        let corners: Vec<u32> = numbers.as_chunks().0.iter().map(|&corner| weld(corner)).collect();
        model.add_part("mesh".to_owned(), corners.as_chunks().0, positions.into_iter(), 0)?;
    }
    Ok(model)
}

/// The coordinates of each solid's corners.
fn text(text: &str) -> Result<Vec<Vec<f32>>, Problem> {
    let mut solids: Vec<Vec<f32>> = Vec::new();
    for (number, line) in (1..).zip(text.lines().chain(["end of file"])) {
        let wrong = |expected| Err(Problem::new(format!("line {number}"), format!("{line:?}"), expected));
        let mut words = line.split_whitespace();
        match (words.next(), solids.last_mut()) {
            (Some("vertex"), Some(solid)) => {
                let expected = solid.len() + 3;
                solid.extend(words.map_while(|word| word.parse::<f32>().ok()));
                if solid.len() != expected {
                    return wrong("3 numbers");
                }
            }
            (Some(_), Some(solid)) if !solid.len().is_multiple_of(9) => {
                return wrong("a vertex: a facet has 3");
            }
            (Some("solid"), _) => solids.push(Vec::new()),
            _ => {}
        }
    }
    Ok(solids)
}
