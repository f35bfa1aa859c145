//! OBJ through `tobj`, fed with only those lines that matter here.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;

use crate::error::Problem;
use crate::files::{below_folder, read_beside, unmarked};
use crate::{Material, Model};

pub(super) fn read(bytes: &[u8], file: &Path, origin: DVec3) -> Result<Model, Problem> {
    let text = String::from_utf8_lossy(unmarked(bytes));
    let options = tobj::LoadOptions { single_index: false, ..tobj::GPU_LOAD_OPTIONS };
    let seen = RefCell::new(BTreeSet::new());
    let library = |name: &str| {
        let path = below_folder(name)?;
        // Of several namings the first counts: for each, `tobj` would add all materials again.
        if seen.borrow().contains(&path) {
            return Some(String::new());
        }
        let bytes = read_beside(file, &path).ok()?;
        seen.borrow_mut().insert(path);
        Some(diffuse_colors(&String::from_utf8_lossy(unmarked(&bytes))))
    };
    let missing = RefCell::new(BTreeSet::new());
    let load_mtl = |names: &Path| {
        let names = names.to_str().unwrap_or_default();
        // One name with spaces, or several names. A missing library costs the colours only.
        let colors = library(names).unwrap_or_else(|| {
            let each = names.split_whitespace().map(|name| library(name).ok_or(name));
            let (found, mut lacking): (Vec<_>, Vec<_>) = each.partition(Result::is_ok);
            if found.is_empty() {
                lacking = vec![Err(names)];
            }
            missing.borrow_mut().extend(lacking.into_iter().filter_map(Result::err).map(str::to_owned));
            found.into_iter().flatten().collect()
        });
        tobj::load_mtl_buf(&mut colors.as_bytes())
    };
    let (shapes, materials) =
        tobj::load_obj_buf(&mut positions_and_faces(&text).as_bytes(), &options, load_mtl)
            .map_err(|error| Problem::new("OBJ text", error, "faces of at least 3 vertices that exist"))?;

    // Behind the materials of the library, the one for faces without.
    let materials = materials.unwrap_or_default();
    let colors = materials.iter().map(|material| {
        let channel = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) as f32 } else { 0.8 };
        let base_color = material.diffuse.unwrap_or([0.8; 3]).map(channel);
        Material { base_color, ..Material::default() }
    });
    let mut model = Model::with_materials(colors.chain([Material::default()]).collect());
    let missing = missing.take().into_iter();
    model.notes.extend(missing.map(|name| format!("the material library {name:?} cannot be read")));
    for tobj::Model { mesh: shape, name } in shapes {
        let triangles = shape.indices.as_chunks().0;
        if triangles.is_empty() {
            continue;
        }
        let positions = shape.positions.as_chunks().0;
        let positions = positions.iter().map(|&p| (DVec3::from_array(p) - origin).as_vec3());
        let material =
            shape.material_id.filter(|&material| material < materials.len()).unwrap_or(materials.len());
        model.add_part(name, triangles, positions, material)?;
    }
    Ok(model)
}

/// The lines that say where triangles are, with nothing on them but that.
///
/// `tobj` numbers positions apart from texture coordinates and normals, so these split no vertices.
/// They go because it refuses a file, or overflows, where one is malformed or does not exist.
/// Vertex colours go because it counts them apart from positions, and refuses a face with a vertex
/// beyond the last colour.
fn positions_and_faces(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    // A backslash at the end of a line continues it.
    let joined = text.replace("\\\r\n", " ").replace("\\\n", " ");
    for line in joined.lines().map(str::trim) {
        match line.split_whitespace().next() {
            Some("v") => {
                let kept_numbers = if numbers(line).count() > 4 { 3 } else { 4 };
                push_words(&mut kept, "v", numbers(line).take(kept_numbers));
            }
            Some("f") => {
                // `tobj` refuses a `/`, while an empty word would vanish.
                let positions = numbers(line).map(|word| {
                    word.split('/').next().filter(|position| !position.is_empty()).unwrap_or("/")
                });
                push_words(&mut kept, "f", positions);
            }
            // A space behind the word, which may have been a tab; names may have spaces in them.
            Some(word @ ("o" | "g" | "usemtl" | "mtllib")) => {
                let name = line[word.len()..].trim_start();
                // Blender writes an empty name for no material. `tobj` refuses it, so it becomes a
                // name that no library has.
                let nameless = word == "usemtl" && name.is_empty();
                push_words(&mut kept, word, [if nameless { "\0" } else { name }]);
            }
            _ => {}
        }
    }
    kept
}

/// The words of a line of numbers, without the first word and the comment at the end. (A name may
/// contain a `#`, so lines with names have no comments.)
fn numbers(line: &str) -> impl Iterator<Item = &str> {
    line.split('#').next().unwrap_or_default().split_whitespace().skip(1)
}

/// The names and diffuse colours of a material library; `tobj` takes incomplete colours badly.
fn diffuse_colors(text: &str) -> String {
    let mut kept = String::new();
    for line in text.lines().map(str::trim) {
        match line.split_whitespace().next() {
            Some("newmtl") => push_words(&mut kept, line, []),
            Some("Kd") if numbers(line).all(|word| word.parse::<f32>().is_ok()) => {
                let words: Vec<_> = numbers(line).collect();
                match words[..] {
                    [grey] => push_words(&mut kept, "Kd", [grey; 3]),
                    [r, g, b, ..] => push_words(&mut kept, "Kd", [r, g, b]),
                    _ => {}
                }
            }
            _ => {}
        }
    }
    kept
}

fn push_words<'a>(out: &mut String, first: &str, others: impl IntoIterator<Item = &'a str>) {
    out.push_str(first);
    for word in others {
        out.push(' ');
        out.push_str(word);
    }
    out.push('\n');
}
