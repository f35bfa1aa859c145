//! Materials and their base colour textures (glTF 2.0 specification, sections 3.8 and 3.9).

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::mesh::Primitive;
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root};
use glam::Vec2;
use image::{ImageError, ImageFormat, ImageReader, Limits};

use super::accessor::Accessors;
use super::source::{decode_data_uri, is_data, relative_path};
use crate::error::{Problem, numbered, one_line};
use crate::files::read_beside;
use crate::{Filter, Material, Texture, Topology, Wrap};

/// Metals at least this metallic, and no rougher than that, are mirrors. Most are somewhere
/// between, and shown as diffuse.
const MIRROR_METALLIC: f32 = 0.9;
const MIRROR_ROUGHNESS: f32 = 0.1;

/// Opacity from which a blended surface is there.
const BLEND_CUTOFF: f32 = 0.5;

/// The materials of the file, and behind them the one for primitives without. They have no textures
/// yet.
pub(super) fn materials(root: &Root) -> Vec<Material> {
    // The default of the specification is white.
    let fallback = Material { base_color: [1.0; 3], ..Material::default() };
    let component =
        |value: f32, fallback: f32| if value.is_finite() { value.clamp(0.0, 1.0) } else { fallback };
    let read = |material: &::gltf::json::Material| {
        let pbr = &material.pbr_metallic_roughness;
        let factor = pbr.base_color_factor.0;
        let cutoff = match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => Some(material.alpha_cutoff.unwrap_or_default().0),
            Checked::Valid(AlphaMode::Blend) => Some(BLEND_CUTOFF),
            _ => None,
        };
        Material {
            base_color: std::array::from_fn(|i| component(factor[i], fallback.base_color[i])),
            opacity: component(factor[3], fallback.opacity),
            texture: None,
            cutoff,
            mirror: pbr.metallic_factor.0 >= MIRROR_METALLIC
                && pbr.roughness_factor.0 <= MIRROR_ROUGHNESS
                && pbr.metallic_roughness_texture.is_none(),
        }
    };
    root.materials.iter().map(read).chain([fallback]).collect()
}

/// The number of a primitive's material among [`materials`].
pub(super) fn material_of(primitive: &Primitive, root: &Root, place: &str) -> Result<u32, Problem> {
    let Some(material) = primitive.material else { return Ok(root.materials.len() as u32) };
    numbered(&root.materials, material.value(), "material", place).map(|_| material.value() as u32)
}

/// Which set of a primitive's texture coordinates its base colour texture takes, and what becomes
/// of them (extension KHR_texture_transform).
pub(super) struct Mapping {
    pub(super) set: u32,
    transform: Option<TextureTransform>,
}

impl Mapping {
    /// That of a material, if it has a texture.
    pub(super) fn of(root: &Root, material: u32) -> Option<Self> {
        let info = texture_info(root, material)?;
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.clone());
        let set = transform.as_ref().and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
        Some(Self { set, transform })
    }

    pub(super) fn apply(&self, at: Vec2) -> Vec2 {
        let Some(transform) = &self.transform else { return at };
        let (sin, cos) = libm::sincosf(transform.rotation.0);
        let scaled = at * Vec2::from_array(transform.scale.0);
        Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x)
            + Vec2::from_array(transform.offset.0)
    }
}

fn texture_info(root: &Root, material: u32) -> Option<&Info> {
    root.materials.get(material as usize)?.pbr_metallic_roughness.base_color_texture.as_ref()
}

/// Decodes the textures of the materials that parts use, and finds out which cutoffs cut something
/// off. Gives remarks on what is shown otherwise than the file says.
///
/// Surfaces keep the factors of their material where the texture has no image, only one that an
/// extension would supply, or one that cannot be decoded, or whose file cannot be read or lies
/// outside of the folder.
pub(super) fn add_textures(
    topology: &mut Topology,
    accessors: &Accessors<'_>,
) -> Result<Vec<String>, Problem> {
    let used: BTreeSet<u32> = topology.parts.iter().map(|part| part.material).collect();
    let root = accessors.root;
    let mut textures = Textures { accessors, images: HashMap::new(), unreadable: Vec::new() };
    for &number in used.iter().filter(|_| !accessors.options.without_textures) {
        let Some(info) = texture_info(root, number) else { continue };
        let place = format!("material {number}, texture {}", info.index);
        let read = textures.read(info.index, &place)?;
        topology.materials[number as usize].texture = read.as_ref().map(|_| topology.textures.len() as u32);
        topology.textures.extend(read);
    }
    for &number in &used {
        let material = &mut topology.materials[number as usize];
        let texture = material.texture.map(|texture| &topology.textures[texture as usize]);
        let least = texture.map_or(u8::MAX, |texture| texture.least_opacity);
        let opacity = material.opacity * f32::from(least) / 255.0;
        material.cutoff = material.cutoff.filter(|&cutoff| opacity < cutoff);
    }
    if topology.textures.is_empty() {
        topology.texcoords = Vec::new();
    }

    let mut notes = Vec::new();
    let mut materials = used.iter().filter_map(|&number| root.materials.get(number as usize));
    if materials.any(|material| material.alpha_mode == Checked::Valid(AlphaMode::Blend)) {
        notes.push("blended surfaces are not blended: they are there where at least half opaque".to_owned());
    }
    if let [first, ..] = &textures.unreadable[..] {
        let found =
            format!("{} images cannot be read as PNG or JPEG, first {first:?}", textures.unreadable.len());
        notes.push(found + ": surfaces keep their plain colours");
    }
    Ok(notes)
}

/// Reads textures, and each of their images once.
struct Textures<'a> {
    accessors: &'a Accessors<'a>,
    /// Images by number, as textures without a sampler; `None` for those that cannot be read.
    images: HashMap<usize, Option<Texture>>,
    /// The images that cannot be read: their uri, or their number.
    unreadable: Vec<String>,
}

impl Textures<'_> {
    /// `None` without an image.
    fn read(&mut self, index: Index<::gltf::json::Texture>, place: &str) -> Result<Option<Texture>, Problem> {
        let root = self.accessors.root;
        let texture = numbered(&root.textures, index.value(), "texture", place)?;
        let source = texture.source.value();
        if source == u32::MAX as usize {
            self.accessors.leave_out("uses of textures that are neither PNG nor JPEG");
            return Ok(None);
        }
        if !self.images.contains_key(&source) {
            let image =
                self.image(numbered(&root.images, source, "image", place)?, &format!("image {source}"))?;
            self.images.insert(source, image);
        }
        let Some(mut found) = self.images[&source].clone() else { return Ok(None) };
        if let Some(sampler) = texture.sampler {
            let sampler = numbered(&root.samplers, sampler.value(), "sampler", place)?;
            found.wrap = [sampler.wrap_s, sampler.wrap_t].map(|mode| match mode {
                Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
                Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
                _ => Wrap::Repeat,
            });
            if let Some(Checked::Valid(MagFilter::Nearest)) = sampler.mag_filter {
                found.filter = Filter::Nearest;
            }
        }
        Ok(Some(found))
    }

    /// `None` if the image cannot be read or decoded, which is then `unreadable`.
    fn image(&mut self, image: &::gltf::json::Image, place: &str) -> Result<Option<Texture>, Problem> {
        let accessors = self.accessors;
        let mut name = place.to_owned();
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) if is_data(uri) => decode_data_uri(uri, place).ok().map(Cow::Owned),
            (Some(uri), _) => {
                name = one_line(uri);
                let read = |path: PathBuf| {
                    let bytes = read_beside(accessors.file, &path).ok()?;
                    accessors.budget.allow_for(&path, bytes.len());
                    Some(Cow::Owned(bytes))
                };
                relative_path(uri, place).ok().and_then(read)
            }
            (None, Some(view)) => Some(Cow::Borrowed(accessors.view(view, place)?)),
            (None, None) => return Err(Problem::new(place, "neither a uri nor a bufferView", "one of them")),
        };
        let texture = bytes.map_or(Ok(None), |bytes| decode(&bytes, accessors, place))?;
        if texture.is_none() {
            self.unreadable.push(name);
        }
        Ok(texture)
    }
}

/// `None` if the bytes are no image that can be decoded. An error if memory does not suffice.
fn decode(bytes: &[u8], accessors: &Accessors<'_>, place: &str) -> Result<Option<Texture>, Problem> {
    let Ok(mut reader) = ImageReader::new(Cursor::new(bytes)).with_guessed_format() else { return Ok(None) };
    let mut limits = Limits::default();
    // A progressive JPEG takes three times as much as the image while it is decoded.
    let part = if reader.format() == Some(ImageFormat::Jpeg) { 3 } else { 1 };
    limits.max_alloc = Some(accessors.budget.left() / part);
    reader.limits(limits);
    let image = match reader.decode() {
        Ok(image) if image.width() > 0 && image.height() > 0 => image,
        Err(ImageError::Limits(error)) => return Err(Problem::new(place, error, "a smaller image")),
        _ => return Ok(None),
    };
    let (width, height) = (image.width(), image.height());
    let texels = u64::from(width) * u64::from(height);
    // What is kept is held twice for a moment.
    accessors.budget.check(texels.saturating_mul(8), place)?;
    accessors.budget.spend(texels.saturating_mul(4), place)?;
    let texels: Arc<[[u8; 4]]> = image.into_rgba8().as_chunks().0.into();
    let least_opacity = texels.iter().map(|texel| texel[3]).min().unwrap_or(u8::MAX);
    let (wrap, filter) = ([Wrap::Repeat; 2], Filter::Linear);
    Ok(Some(Texture { width, height, texels, least_opacity, wrap, filter }))
}
