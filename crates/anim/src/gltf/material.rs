//! Materials and their base colour textures (glTF 2.0 specification, sections 3.8 and 3.9).

use std::collections::HashMap;
use std::io::Cursor;

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::AlphaMode;
use ::gltf::json::mesh::Primitive;
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Root};
use glam::Vec2;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};

use super::accessor::Accessors;
use super::source::{decode_data_uri, relative_path};
use crate::error::{LoadError, Problem, numbered, read_beside};
use crate::{Filter, Image, Material, Texture, Topology, Wrap};

/// Metals at least this metallic, and no rougher than that, are mirrors. Most are somewhere
/// between, and shown as diffuse.
const MIRROR_METALLIC: f32 = 0.9;
const MIRROR_ROUGHNESS: f32 = 0.1;

/// Opacity from which a blended surface is there.
const BLEND_CUTOFF: f32 = 0.5;

/// The materials of the file, and behind them the one for primitives without. They have no textures
/// yet.
pub(super) fn materials(root: &Root) -> Vec<Material> {
    let fallback = Material::default();
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

/// Whether a material is to be blended with what is behind it.
pub(super) fn is_blended(root: &Root, material: u32) -> bool {
    let material = root.materials.get(material as usize);
    material.is_some_and(|m| matches!(m.alpha_mode, Checked::Valid(AlphaMode::Blend)))
}

/// The number of a primitive's material among [`materials`].
pub(super) fn material_of(primitive: &Primitive, root: &Root, place: &str) -> Result<u32, Problem> {
    let Some(number) = primitive.material.map(|material| material.value()) else {
        return Ok(root.materials.len() as u32);
    };
    numbered(&root.materials, number, "material", place).map(|_| number as u32)
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
/// off.
///
/// Gives the number of textures left out because they have no image, only one that an extension
/// would supply, and the files of images that cannot be read. Surfaces without their texture keep
/// the factors of their material.
pub(super) fn add_textures(
    topology: &mut Topology,
    accessors: &Accessors<'_>,
) -> Result<(usize, Vec<String>), Problem> {
    let mut used: Vec<u32> = topology.parts.iter().map(|part| part.material).collect();
    used.sort_unstable();
    used.dedup();
    let (mut numbers, mut images) = (HashMap::new(), Images::default());
    let mut opacities = Opacities::default();
    for number in used {
        if let Some(info) = texture_info(accessors.root, number).filter(|_| accessors.textures) {
            let texture = match numbers.get(&info.index.value()) {
                Some(&known) => known,
                None => {
                    let place = format!("material {number}, texture {}", info.index);
                    let texture = read_texture(info.index, accessors, &mut images, &place)?;
                    let added = texture.map(|texture| {
                        topology.textures.push(texture);
                        (topology.textures.len() - 1) as u32
                    });
                    *numbers.entry(info.index.value()).or_insert(added)
                }
            };
            topology.materials[number as usize].texture = texture;
        }
        let material = &mut topology.materials[number as usize];
        let Some(cutoff) = material.cutoff else { continue };
        let least =
            material.texture.map_or(u8::MAX, |t| opacities.least(&topology.textures[t as usize].image));
        material.cutoff = (material.opacity * f32::from(least) / 255.0 < cutoff).then_some(cutoff);
    }
    if topology.textures.is_empty() {
        topology.texcoords = Vec::new();
    }
    Ok((images.without, images.missing))
}

/// The least opacity of each image, by where its texels are: a large image may have many textures and
/// materials, and is searched once.
#[derive(Default)]
struct Opacities(HashMap<*const [u8; 4], u8>);

impl Opacities {
    fn least(&mut self, Image { texels, .. }: &Image) -> u8 {
        let search = || texels.iter().map(|texel| texel[3]).min().unwrap_or(u8::MAX);
        *self.0.entry(texels.as_ptr()).or_insert_with(search)
    }
}

/// Images by number, the files of those that cannot be read, and how many textures name none.
#[derive(Default)]
struct Images {
    known: HashMap<usize, Option<Image>>,
    missing: Vec<String>,
    without: usize,
}

/// `None` if it names no image, or one whose file cannot be read.
fn read_texture(
    index: Index<::gltf::json::Texture>,
    accessors: &Accessors<'_>,
    images: &mut Images,
    place: &str,
) -> Result<Option<Texture>, Problem> {
    let root = accessors.root;
    let texture = numbered(&root.textures, index.value(), "texture", place)?;
    let source = texture.source.value();
    if source == u32::MAX as usize {
        images.without += 1;
        return Ok(None);
    }
    let image = match images.known.get(&source) {
        Some(known) => known.clone(),
        None => {
            let image = numbered(&root.images, source, "image", place)?;
            let image = read_image(image, accessors, &format!("image {source}"), &mut images.missing)?;
            images.known.insert(source, image.clone());
            image
        }
    };
    let Some(image) = image else { return Ok(None) };
    let Some(sampler) = texture.sampler else {
        return Ok(Some(Texture { image, wrap: Default::default(), filter: Filter::default() }));
    };
    let sampler = numbered(&root.samplers, sampler.value(), "sampler", place)?;
    let wrap = |mode: Checked<WrappingMode>| match mode {
        Checked::Valid(WrappingMode::ClampToEdge) => Wrap::ClampToEdge,
        Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::MirroredRepeat,
        _ => Wrap::Repeat,
    };
    let filter = match sampler.mag_filter {
        Some(Checked::Valid(MagFilter::Nearest)) => Filter::Nearest,
        _ => Filter::Linear,
    };
    Ok(Some(Texture { image, wrap: [wrap(sampler.wrap_s), wrap(sampler.wrap_t)], filter }))
}

/// `None` if the image's file cannot be read; its name is then added to `missing`.
fn read_image(
    image: &::gltf::json::Image,
    accessors: &Accessors<'_>,
    place: &str,
    missing: &mut Vec<String>,
) -> Result<Option<Image>, Problem> {
    let image = match (&image.uri, image.buffer_view) {
        (Some(uri), _) if uri.starts_with("data:") => decode(&decode_data_uri(uri, place)?, accessors, place),
        (Some(uri), _) => {
            let bytes = match read_beside(accessors.folder, &relative_path(uri, place)?) {
                Ok(bytes) => bytes,
                Err(LoadError::Io { .. }) => {
                    missing.push(uri.clone());
                    return Ok(None);
                }
                Err(error) => return Err(Problem::from_parser(place, &error, "a PNG or JPEG file")),
            };
            accessors.budget.allow_for(bytes.len() as u64);
            decode(&bytes, accessors, place)
        }
        (None, Some(view)) => decode(accessors.view(view, place)?, accessors, place),
        (None, None) => Err(Problem::new(place, "neither a uri nor a bufferView", "one of them")),
    };
    image.map(Some)
}

fn decode(bytes: &[u8], accessors: &Accessors<'_>, place: &str) -> Result<Image, Problem> {
    let wrong = |error: &dyn std::fmt::Display| Problem::from_parser(place, error, "a PNG or JPEG image");
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| wrong(&e))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(accessors.budget.left());
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| wrong(&e))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(wrong(&format!("an image of {width} x {height} texels")));
    }
    let texels = u64::from(width) * u64::from(height);
    accessors.budget.spend(decoder.total_bytes().max(4 * texels), place)?;
    let texels = DynamicImage::from_decoder(decoder).map_err(|e| wrong(&e))?.into_rgba8().into_raw();
    Ok(Image { width, height, texels: texels.as_chunks().0.into() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_searched_once_for_all_its_textures_and_materials() {
        let image =
            |opacity: u8| Image { width: 2, height: 1, texels: [[0, 0, 0, 255], [9, 9, 9, opacity]].into() };
        let (a, b) = (image(7), image(8));
        let mut opacities = Opacities::default();
        for _ in 0..3 {
            assert_eq!((opacities.least(&a.clone()), opacities.least(&b)), (7, 8));
        }
        assert_eq!(opacities.0.len(), 2);
        // What is known is not searched for again.
        opacities.0.insert(a.texels.as_ptr(), 1);
        assert_eq!(opacities.least(&a), 1);
    }
}
