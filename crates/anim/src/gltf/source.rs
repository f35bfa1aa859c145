//! From the bytes of a .glb or .gltf file to its JSON document and its buffers.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ::gltf::Glb;
use ::gltf::json::Root;
use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use glam::DVec3;
use serde_json::{Value, json};

use crate::budget::Budget;
use crate::error::{LoadError, Problem};
use crate::files::{below_folder, read_beside};

/// Extensions that are understood, or change nothing that is seen.
pub(super) const UNDERSTOOD: [&str; 4] =
    ["KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform", "KHR_xmp_json_ld"];

/// How extensions begin that only change looks: they, too, may be required.
const LOOKS: [&str; 3] = ["KHR_materials_", "KHR_texture_", "EXT_texture_"];

/// The content of a buffer.
pub(super) type Bytes = Arc<Vec<u8>>;

/// The BIN chunk of a GLB container.
type Blob<'a> = Option<Cow<'a, [u8]>>;

/// The document, and the BIN chunk if there is one.
pub(super) fn document(bytes: &[u8]) -> Result<(Root, Blob<'_>), Problem> {
    if bytes.is_empty() {
        return Err(Problem::new("start of file", "an empty file", "glTF 2.0"));
    }
    let (json, blob) = chunks(bytes)?;
    let root = Root::from_slice(&json)
        .or_else(|error| as_the_parser_wants(&json).ok_or(error))
        .map_err(|error| Problem::new("JSON", error, "a glTF 2.0 document in JSON"))?;
    if !root.asset.version.starts_with("2.") {
        return Err(Problem::new("asset.version", format!("{:?}", root.asset.version), "2.0"));
    }
    if let Some(least) = root.asset.min_version.as_ref().filter(|least| *least != "2.0") {
        return Err(Problem::new("asset.minVersion", format!("{least:?}"), "2.0"));
    }
    let is_supported =
        |name: &str| UNDERSTOOD.contains(&name) || LOOKS.iter().any(|prefix| name.starts_with(prefix));
    if let Some(unknown) = root.extensions_required.iter().find(|extension| !is_supported(extension)) {
        let expected = "a file that can be read without it (no compressed meshes, no instancing extension)";
        return Err(Problem::new("extensionsRequired", format!("{unknown:?}"), expected));
    }
    Ok((root, blob))
}

/// The document with what the parser asks for beyond the specification: a list of nodes in each
/// scene, and a channel for an unknown property in place of each animation channel without a node.
/// Both kinds of channels are to be ignored (3.11). A note counts those for unknown properties.
fn as_the_parser_wants(json: &[u8]) -> Option<Root> {
    let mut document: Value = serde_json::from_slice(json).ok()?;
    let scenes = document.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten();
    for scene in scenes.filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| json!([]));
    }
    let animations = document.get_mut("animations").and_then(Value::as_array_mut).into_iter().flatten();
    let channels = animations.filter_map(|animation| animation.get_mut("channels")?.as_array_mut());
    for channel in channels.flatten().filter(|channel| channel["target"].get("node").is_none()) {
        *channel = json!({"sampler": 0, "target": {"node": 0, "path": "pointer"}});
    }
    serde_json::from_value(document).ok()
}

/// The translation of each node that has one, with all the digits that stand in the JSON text;
/// [`Root`] rounds them to `f32`.
pub(super) fn translations(bytes: &[u8]) -> Result<Vec<Option<DVec3>>, Problem> {
    let document: Value = serde_json::from_slice(&chunks(bytes)?.0)
        .map_err(|error| Problem::new("JSON", error, "nodes of a glTF 2.0 document"))?;
    let three_from = |first: usize, numbers: &Value| {
        let number = |i: usize| numbers.get(first + i)?.as_f64();
        Some(DVec3::new(number(0)?, number(1)?, number(2)?))
    };
    let of = |node: &Value| three_from(12, &node["matrix"]).or_else(|| three_from(0, &node["translation"]));
    Ok(document["nodes"].as_array().into_iter().flatten().map(of).collect())
}

/// The JSON text, and the BIN chunk if there is one.
fn chunks(bytes: &[u8]) -> Result<(Cow<'_, [u8]>, Blob<'_>), Problem> {
    const HEADER: usize = 12;
    if !bytes.starts_with(b"glTF") {
        return Ok((Cow::Borrowed(bytes), None));
    }
    // The parser subtracts the header's length from the declared one without looking.
    let declared =
        bytes.get(8..).and_then(<[u8]>::first_chunk).map_or(0, |&b| u32::from_le_bytes(b)) as usize;
    if !(HEADER..=bytes.len()).contains(&declared) {
        let expected = format!("the file's {} bytes, and at least {HEADER}", bytes.len());
        return Err(Problem::new("GLB header", format!("a length of {declared} bytes"), expected));
    }
    let glb = Glb::from_slice(&bytes[..declared])
        .map_err(|error| Problem::new("GLB container", error, "a JSON and a BIN chunk within the file"))?;
    Ok((glb.json, glb.bin))
}

/// The bytes of all buffers, each as long as declared. `budget` then allows for the files they are
/// in.
pub(super) fn read_buffers(
    root: &Root,
    mut blob: Blob<'_>,
    file: &Path,
    budget: &Budget,
) -> Result<Vec<Bytes>, LoadError> {
    // Several buffers may name one file; it is read once.
    let mut external: HashMap<PathBuf, Bytes> = HashMap::new();
    let mut buffers = Vec::with_capacity(root.buffers.len());
    for (number, buffer) in root.buffers.iter().enumerate() {
        let place = format!("buffer {number}");
        let in_file = |problem: Problem| problem.in_file(file);
        let bytes = match (&buffer.uri, blob.take()) {
            // Buffer 0.
            (None, Some(blob)) => Arc::new(blob.into_owned()),
            (None, None) => {
                let expected = "a uri (only buffer 0 can be the BIN chunk)";
                return Err(in_file(Problem::new(place, "no uri and no BIN chunk", expected)));
            }
            (Some(uri), _) if is_data(uri) => Arc::new(decode_data_uri(uri, &place).map_err(in_file)?),
            (Some(uri), _) => {
                let path = relative_path(uri, &place).map_err(in_file)?;
                if !external.contains_key(&path) {
                    let bytes = read_beside(file, &path)?;
                    budget.allow_for(&path, bytes.len());
                    external.insert(path.clone(), Arc::new(bytes));
                }
                Arc::clone(&external[&path])
            }
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            let expected = format!("the declared byteLength of {}", buffer.byte_length.0);
            return Err(in_file(Problem::new(place, format!("{} bytes", bytes.len()), expected)));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// Whether a uri holds its data itself. Case does not matter in schemes (RFC 3986, 3.1).
pub(super) fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

pub(super) fn decode_data_uri(uri: &str, place: &str) -> Result<Vec<u8>, Problem> {
    let lenient = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    let engine = GeneralPurpose::new(&base64::alphabet::STANDARD, lenient);
    let expected = "data:<media type>;base64,<bytes>";
    let (media_type, text) = uri.split_once(',').unwrap_or_default();
    if !media_type.to_ascii_lowercase().ends_with(";base64") {
        return Err(Problem::new(place, "a data uri that is not base64", expected));
    }
    engine.decode(text).map_err(|error| Problem::new(place, error, expected))
}

/// The path that a relative uri stands for, which must stay below the folder of the file.
pub(super) fn relative_path(uri: &str, place: &str) -> Result<PathBuf, Problem> {
    let wrong = |why: &str| {
        let expected = "a relative path below the folder of the glTF file";
        Problem::new(place, format!("the uri {uri:?}{why}"), expected)
    };
    if uri.contains("://") {
        return Err(wrong(""));
    }
    let decoded = percent_encoding::percent_decode_str(uri).decode_utf8();
    below_folder(&decoded.map_err(|_| wrong(", not UTF-8 when decoded"))?).ok_or_else(|| wrong(""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_are_decoded_and_kept_below_the_folder() {
        assert_eq!(relative_path("a%20b/./c.bin", "").unwrap(), PathBuf::from("a b/c.bin"));
        assert_eq!(relative_path("a/../b/c.bin", "").unwrap(), PathBuf::from("b/c.bin"));
        for uri in
            ["../c.bin", "a/../../c.bin", "a/..", "/etc/passwd", "http://x/y.bin", "%2e%2e/c.bin", "", "%ff"]
        {
            assert!(relative_path(uri, "").is_err(), "{uri}");
        }
    }

    #[test]
    fn data_uris() {
        assert_eq!(decode_data_uri("data:application/octet-stream;base64,AQID", "").unwrap(), [1, 2, 3]);
        assert_eq!(decode_data_uri("data:;base64,AQ", "").unwrap(), [1]);
        assert_eq!(decode_data_uri("DATA:text/plain;BASE64,AQ", "").unwrap(), [1]);
        assert!(is_data("Data:,") && !is_data("data") && !is_data("dáta:"));
        let long = relative_path(&("../".to_owned() + &"é".repeat(3000)), "").unwrap_err();
        assert!(long.to_string().chars().count() < 300, "{long}");
        assert!(decode_data_uri("data:text/plain,abc", "").is_err());
        assert!(decode_data_uri("data:;base64,A~", "").is_err());
    }
}
