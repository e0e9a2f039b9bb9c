//! Reading accessors: every byte range is checked against its buffer before anything is allocated.

use super::Outcome;
use super::buffers::Buffers;
use super::json::{self, Document};

/// Elements that an accessor without a buffer view, all zeros, may claim to have.
const MAX_ZEROS: usize = 1 << 24;

/// What components are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// From the file's number (glTF 2.0, `accessor.componentType`).
    pub fn new(code: usize) -> Option<Self> {
        Some(match code {
            5120 => Component::I8,
            5121 => Component::U8,
            5122 => Component::I16,
            5123 => Component::U16,
            5125 => Component::U32,
            5126 => Component::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    /// One component as a number; `normalized` as in glTF 2.0, 3.6.2.2 "Accessor data types".
    fn read(self, bytes: &[u8], normalized: bool) -> f32 {
        let scaled = |value: f32, max: f32| if normalized { (value / max).max(-1.0) } else { value };
        match self {
            Component::I8 => scaled(f32::from(bytes[0] as i8), 127.0),
            Component::U8 => scaled(f32::from(bytes[0]), 255.0),
            Component::I16 => scaled(f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            Component::U16 => scaled(f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            Component::U32 => self.read_index(bytes) as f32,
            Component::F32 => f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }

    fn read_index(self, bytes: &[u8]) -> u32 {
        match self {
            Component::I8 | Component::U8 => u32::from(bytes[0]),
            Component::I16 | Component::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Component::U32 | Component::F32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }

    /// The value that restarts a primitive elsewhere and that glTF forbids.
    pub fn restart(self) -> u32 {
        u32::MAX >> (32 - 8 * self.size())
    }
}

/// Components of an element of the file's `accessor.type`.
pub fn width(kind: &str) -> Option<usize> {
    Some(match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => return None,
    })
}

/// Elements at a stride within bytes that hold all of them; `None` for zeros.
struct Elements<'a> {
    bytes: Option<&'a [u8]>,
    stride: usize,
}

impl<'a> Elements<'a> {
    fn get(&self, index: usize) -> Option<&'a [u8]> {
        self.bytes.map(|bytes| &bytes[index * self.stride..])
    }
}

/// The substitutes of a sparse accessor.
struct Sparse<'a> {
    /// Strictly increasing.
    indices: Vec<u32>,
    values: Elements<'a>,
}

/// An accessor whose data is there.
pub struct Accessor<'a> {
    index: usize,
    /// Number of elements.
    pub count: usize,
    /// Components of an element.
    pub width: usize,
    /// What they are made of.
    pub component: Component,
    normalized: bool,
    elements: Elements<'a>,
    sparse: Option<Sparse<'a>>,
}

impl<'a> Accessor<'a> {
    /// Checks that all data that accessor `index` refers to is there.
    pub fn new(document: &'a Document, buffers: &'a Buffers<'_>, index: usize) -> Outcome<Self> {
        let raw = &document.accessors[index];
        let (Some(component), Some(width)) = (Component::new(raw.component_type.0), width(&raw.kind)) else {
            return Err(format!(
                "accessor {index} has the unknown type {:?} or component type {}; export the scene again",
                raw.kind, raw.component_type.0
            ));
        };
        let size = component.size() * width;
        let count = raw.count.0;
        let source = Source { document, buffers, accessor: index };
        if let Some(bytes) = buffers.accessor(index) {
            let elements = Elements { bytes: Some(bytes), stride: size };
            let normalized = raw.normalized;
            return Ok(Accessor { index, count, width, component, normalized, elements, sparse: None });
        }
        let elements = match raw.buffer_view {
            Some(view) => {
                let stride = document.buffer_views[view.0].byte_stride.map_or(size, |stride| stride.0);
                source.elements(view.0, raw.byte_offset.0, stride, size, count)?
            }
            None if count > MAX_ZEROS => {
                return Err(format!(
                    "accessor {index} claims {count} elements without data; export the scene again"
                ));
            }
            None => Elements { bytes: None, stride: size },
        };
        let sparse = raw.sparse.as_ref().map(|sparse| source.sparse(sparse, size, count)).transpose()?;
        Ok(Accessor { index, count, width, component, normalized: raw.normalized, elements, sparse })
    }

    /// The same accessor with integers always taken as fractions, as colours and weights are.
    pub fn always_normalized(self) -> Self {
        Accessor { normalized: true, ..self }
    }

    /// Refuses an accessor of a kind that its use does not allow.
    pub fn expect(self, what: &str, widths: &[usize], components: &[Component]) -> Outcome<Self> {
        if widths.contains(&self.width) && components.contains(&self.component) {
            return Ok(self);
        }
        Err(format!(
            "accessor {} has {} components of type {:?}, which {what} cannot have; export the scene again",
            self.index, self.width, self.component
        ))
    }

    /// Element `index`, which is below `count`; components that it lacks are 1.
    pub fn get<const N: usize>(&self, index: usize) -> [f32; N] {
        let size = self.component.size();
        match self.bytes_of(index) {
            Some(bytes) => std::array::from_fn(|i| {
                if i < self.width { self.component.read(&bytes[i * size..], self.normalized) } else { 1.0 }
            }),
            None => std::array::from_fn(|i| if i < self.width { 0.0 } else { 1.0 }),
        }
    }

    /// Element `index`, which is below `count`, as unsigned integers.
    pub fn get_indices<const N: usize>(&self, index: usize) -> [u32; N] {
        let size = self.component.size();
        let bytes = self.bytes_of(index);
        std::array::from_fn(|i| match bytes {
            Some(bytes) if i < self.width => self.component.read_index(&bytes[i * size..]),
            _ => 0,
        })
    }

    fn bytes_of(&self, index: usize) -> Option<&'a [u8]> {
        if let Some(sparse) = &self.sparse
            && let Ok(at) = sparse.indices.binary_search(&(index as u32))
        {
            return sparse.values.get(at);
        }
        self.elements.get(index)
    }
}

/// Where an accessor's parts are looked up, and its index for messages.
struct Source<'a, 'b> {
    document: &'a Document,
    buffers: &'a Buffers<'b>,
    accessor: usize,
}

impl<'a> Source<'a, '_> {
    fn elements(
        &self,
        view: usize,
        offset: usize,
        stride: usize,
        size: usize,
        count: usize,
    ) -> Outcome<Elements<'a>> {
        if stride < size {
            return Err(format!(
                "accessor {} has elements of {size} bytes, but bufferView {view} has a stride of {stride}; export the scene again",
                self.accessor
            ));
        }
        let bytes = self.buffers.view(self.document, view)?;
        let needed = match count {
            0 => Some(0),
            _ => (count - 1).checked_mul(stride).and_then(|n| n.checked_add(size)),
        };
        let end = needed.and_then(|needed| needed.checked_add(offset)).filter(|&end| end <= bytes.len());
        match end {
            Some(end) => Ok(Elements { bytes: Some(&bytes[offset.min(end)..end]), stride }),
            None => Err(format!(
                "accessor {} claims {count} elements at offset {offset}, more than bufferView {view} holds; export the scene again",
                self.accessor
            )),
        }
    }

    fn sparse(&self, sparse: &json::Sparse, size: usize, count: usize) -> Outcome<Sparse<'a>> {
        let component = Component::new(sparse.indices.component_type.0)
            .filter(|c| matches!(c, Component::U8 | Component::U16 | Component::U32))
            .ok_or_else(|| {
                format!(
                    "accessor {} has sparse indices of an unknown type; export the scene again",
                    self.accessor
                )
            })?;
        let (n, isize) = (sparse.count.0, component.size());
        let raw =
            self.elements(sparse.indices.buffer_view.0, sparse.indices.byte_offset.0, isize, isize, n)?;
        let values =
            self.elements(sparse.values.buffer_view.0, sparse.values.byte_offset.0, size, size, n)?;
        let indices: Vec<u32> =
            (0..n).filter_map(|i| raw.get(i)).map(|bytes| component.read_index(bytes)).collect();
        let ordered = indices.windows(2).all(|pair| pair[0] < pair[1]);
        if !ordered || indices.last().is_some_and(|&last| last as usize >= count) {
            return Err(format!(
                "accessor {} has sparse indices that do not increase or exceed its {count} elements; export the scene again",
                self.accessor
            ));
        }
        Ok(Sparse { indices, values })
    }
}
