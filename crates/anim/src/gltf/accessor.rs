//! Checked reading of glTF accessors: strided, sparse, quantised. Nothing the file says is believed
//! before it has been held against the bytes that are there.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index, Root, buffer};

use super::source::Bytes;
use crate::LoadOptions;
use crate::budget::Budget;
use crate::error::{Problem, numbered};

/// The accessors of one document.
pub(super) struct Accessors<'a> {
    pub(super) root: &'a Root,
    pub(super) buffers: &'a [Bytes],
    /// The file, beside which images lie.
    pub(super) file: &'a Path,
    pub(super) budget: Budget,
    pub(super) options: &'a LoadOptions<'a>,
    /// How many there are of what is left out.
    pub(super) left_out: RefCell<BTreeMap<&'static str, usize>>,
}

/// Those elements of an accessor that are read: all without numbers, which increase. Exporters let
/// the primitives of a mesh share one large vertex array, of which each uses a piece.
pub(super) struct Used {
    pub(super) numbers: Option<Vec<u32>>,
    /// How many elements there must be, where that is known.
    pub(super) of: Option<u64>,
}

pub(super) const ALL: &Used = &Used { numbers: None, of: None };

impl<'a> Accessors<'a> {
    /// Counts `what` for a note.
    pub(super) fn leave_out(&self, what: &'static str) {
        *self.left_out.borrow_mut().entry(what).or_default() += 1;
    }

    /// Elements of `N` components.
    pub(super) fn read<T: Component, const N: usize>(
        &self,
        index: Index<Accessor>,
        used: &Used,
        place: &str,
    ) -> Result<Vec<[T; N]>, Problem> {
        let place = &format!("{place}, accessor {index}");
        let accessor = numbered(&self.root.accessors, index.value(), "accessor", place)?;
        let kind = type_of::<T, N>(accessor, place)?;
        let element = |bytes: &[u8]| {
            let mut element = [T::default(); N];
            for (value, bytes) in element.iter_mut().zip(bytes.chunks_exact(kind.size())) {
                *value = T::decode(bits(bytes), kind, accessor.normalized)?;
            }
            Some(element)
        };
        let unfit = || Problem::new(place, format!("components of type {kind:?}"), T::NAME);

        let (numbers, count) = (used.numbers.as_deref(), accessor.count.0);
        if let Some(expected) = used.of.filter(|&of| of != count) {
            let expected = format!("{expected}, one for each position");
            return Err(Problem::new(place, format!("{count} elements"), expected));
        }
        let read_count = numbers.map_or(count, |numbers| numbers.len() as u64);
        self.budget.spend(read_count.saturating_mul(size_of::<[T; N]>() as u64), place)?;
        let read_count = read_count as usize;
        let size = kind.size() * N;
        let mut elements = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let bytes = self.elements(view, offset, count, size, place)?;
                let read = |at| element(bytes(numbers.map_or(at, |numbers| numbers[at] as usize)));
                (0..read_count).map(read).collect::<Option<Vec<_>>>().ok_or_else(unfit)?
            }
            None => vec![[T::default(); N]; read_count],
        };
        if let Some(sparse) = &accessor.sparse {
            let place = &format!("{place}, sparse");
            let Checked::Valid(index_kind) = sparse.indices.component_type else {
                return Err(Problem::new(place, "an unknown index type", "unsigned integers"));
            };
            let index_kind = index_kind.0;
            let (at, values, few) = (&sparse.indices, &sparse.values, sparse.count.0);
            let at = self.elements(at.buffer_view, at.byte_offset.0, few, index_kind.size(), place)?;
            let values = self.elements(values.buffer_view, values.byte_offset.0, few, size, place)?;
            for few in 0..few as usize {
                let at = u32::decode(bits(at(few)), index_kind, false).ok_or_else(unfit)?;
                if u64::from(at) >= count {
                    let expected = format!("an index below the accessor's count {count}");
                    return Err(Problem::new(place, format!("index {at}"), expected));
                }
                let slot = numbers.map_or(Ok(at as usize), |numbers| numbers.binary_search(&at));
                if let Ok(slot) = slot {
                    elements[slot] = element(values(few)).ok_or_else(unfit)?;
                }
            }
        }
        Ok(elements)
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&self, view: Index<buffer::View>, place: &str) -> Result<&'a [u8], Problem> {
        let view = numbered(&self.root.buffer_views, view.value(), "bufferView", place)?;
        let buffer = numbered(self.buffers, view.buffer.value(), "buffer", place)?;
        let begin = view.byte_offset.unwrap_or_default().0;
        slice(buffer, begin, view.byte_length.0).ok_or_else(|| {
            let expected = format!("a range within the {} bytes of buffer {}", buffer.len(), view.buffer);
            Problem::new(place, format!("bytes {begin} + {}", view.byte_length.0), expected)
        })
    }

    /// The bytes of each of `count` elements of `size` bytes, by its number.
    fn elements(
        &self,
        view: Index<buffer::View>,
        offset: u64,
        count: u64,
        size: usize,
        place: &str,
    ) -> Result<impl Fn(usize) -> &'a [u8] + use<'a>, Problem> {
        let place = &format!("{place}, bufferView {view}");
        let bytes = self.view(view, place)?;
        let stride = self.root.buffer_views[view.value()].byte_stride.map_or(size, |stride| stride.0);
        if stride < size {
            let expected = format!("at least the element size {size}");
            return Err(Problem::new(place, format!("byteStride {stride}"), expected));
        }
        let to_last = count.saturating_sub(1).saturating_mul(stride as u64);
        let length = if count == 0 { 0 } else { to_last.saturating_add(size as u64) };
        let bytes = slice(bytes, offset, length).ok_or_else(|| {
            let found = format!("{count} elements of {size} bytes every {stride} bytes from byte {offset}");
            Problem::new(place, found, format!("at most the {} bytes of the view", bytes.len()))
        })?;
        Ok(move |number| &bytes[number * stride..][..size])
    }
}

/// The type of an accessor's components, of which each element must have `N`.
fn type_of<T: Component, const N: usize>(accessor: &Accessor, place: &str) -> Result<ComponentType, Problem> {
    // Of the two shapes with four components, MAT2 is never called for.
    let shapes = [Type::Scalar, Type::Vec2, Type::Vec3, Type::Vec4, Type::Mat4];
    let shape = shapes.into_iter().find(|shape| shape.multiplicity() == N);
    let name = |shape| format!("{shape:?}").to_uppercase();
    let found = match (accessor.type_, accessor.component_type) {
        (Checked::Valid(found), Checked::Valid(kind)) if Some(found) == shape => return Ok(kind.0),
        (Checked::Valid(found), _) if Some(found) != shape => format!("elements of {}", name(found)),
        (Checked::Valid(_), _) => "an unknown component type".to_owned(),
        (Checked::Invalid, _) => "an unknown element type".to_owned(),
    };
    let expected = format!("{} in elements of {}", T::NAME, shape.map_or_else(String::new, name));
    Err(Problem::new(place, found, expected))
}

fn slice(bytes: &[u8], begin: u64, length: u64) -> Option<&[u8]> {
    let begin = usize::try_from(begin).ok()?;
    bytes.get(begin..begin.checked_add(usize::try_from(length).ok()?)?)
}

/// What the components of elements are read as.
pub(super) trait Component: Copy + Default {
    /// How errors name them.
    const NAME: &'static str;

    /// From the bits of a component, with zeros above them. `None` where components of this type
    /// cannot be read so.
    fn decode(bits: u32, kind: ComponentType, normalized: bool) -> Option<Self>;
}

/// Integers are converted, and scaled to [-1, 1] or [0, 1] if declared normalised (glTF 2.0
/// specification, section 3.11).
impl Component for f32 {
    const NAME: &'static str = "numbers";

    fn decode(bits: u32, kind: ComponentType, normalized: bool) -> Option<Self> {
        let (value, largest) = match kind {
            ComponentType::I8 => (f32::from(bits as i8), 127.0),
            ComponentType::U8 => (bits as f32, 255.0),
            ComponentType::I16 => (f32::from(bits as i16), 32767.0),
            ComponentType::U16 => (bits as f32, 65535.0),
            ComponentType::U32 => (bits as f32, u32::MAX as f32),
            ComponentType::F32 => return Some(f32::from_bits(bits)),
        };
        Some(if normalized { (value / largest).max(-1.0) } else { value })
    }
}

impl Component for u32 {
    const NAME: &'static str = "unsigned integers";

    fn decode(bits: u32, kind: ComponentType, _: bool) -> Option<Self> {
        matches!(kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32).then_some(bits)
    }
}

/// Up to four bytes as a number, the lowest first.
fn bits(bytes: &[u8]) -> u32 {
    bytes.iter().rfold(0, |bits, &byte| bits << 8 | u32::from(byte))
}
