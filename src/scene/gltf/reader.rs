//! Reading a primitive's attributes through its accessors.

use std::collections::BTreeMap;

use glam::{DMat4, Vec3, Vec4};
use rayon::prelude::*;

use super::Outcome;
use super::accessor::{Accessor, Component};
use super::buffers::Buffers;
use super::json::{Document, Int, Primitive};
use super::skin::Skin;
use super::triangulate::{INDEX_TYPES, Mode, triangulate};
use crate::scene::animation::blended;

/// Component types that KHR_mesh_quantization allows for positions, normals, tangents and texture
/// coordinates, besides floats.
pub const QUANTIZED: [Component; 5] =
    [Component::F32, Component::I8, Component::U8, Component::I16, Component::U16];

/// Vertex colours are held to this, the largest that half floats have.
const MAX_COLOR: f32 = 65504.0;

/// Looks up the accessors of one primitive.
pub struct Reader<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    what: String,
    vertices: usize,
}

impl<'a> Reader<'a> {
    /// A reader for a primitive that has positions; their data is checked to be there.
    pub fn new(
        document: &'a Document,
        buffers: &'a Buffers<'a>,
        mesh: usize,
        primitive: usize,
    ) -> Outcome<Self> {
        let attributes = &document.meshes[mesh].primitives[primitive].attributes;
        let vertices =
            attributes.get("POSITION").map_or(0, |positions| document.accessors[positions.0].count.0);
        let what = format!("primitive {primitive} of mesh {mesh}");
        if vertices > u32::MAX as usize {
            return Err(format!("{what} claims {vertices} vertices; export the scene again"));
        }
        let reader = Reader { document, buffers, what, vertices };
        reader.attribute(attributes, "POSITION", &[3], &QUANTIZED)?;
        Ok(reader)
    }

    /// The accessor of an attribute, if it is there; its count must be the primitive's.
    pub fn attribute(
        &self,
        attributes: &BTreeMap<String, Int>,
        name: &str,
        widths: &[usize],
        components: &[Component],
    ) -> Outcome<Option<Accessor<'a>>> {
        let Some(index) = attributes.get(name) else { return Ok(None) };
        let accessor = Accessor::new(self.document, self.buffers, index.0)?;
        let accessor = accessor.expect(&format!("{name} of {}", self.what), widths, components)?;
        if accessor.count != self.vertices {
            return Err(format!(
                "{} has {} vertices but its {name} has {}; export the scene again",
                self.what, self.vertices, accessor.count
            ));
        }
        Ok(Some(accessor))
    }

    /// A vector attribute and its morph targets, summed, for each of `source`.
    pub fn morphed(
        &self,
        primitive: &Primitive,
        name: &str,
        weights: &[f64],
        source: &[u32],
    ) -> Outcome<Option<Vec<Vec3>>> {
        let width = if name == "TANGENT" { 4 } else { 3 };
        let Some(base) = self.attribute(&primitive.attributes, name, &[width], &QUANTIZED)? else {
            return Ok(None);
        };
        let mut values = gather(source, |vertex| Vec3::from(base.get::<3>(vertex)));
        for (target, &weight) in primitive.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            if let Some(delta) = self.attribute(target, name, &[3], &QUANTIZED)? {
                let weight = weight as f32;
                values.par_iter_mut().zip(source).with_min_len(4096).for_each(|(value, &vertex)| {
                    *value += weight * Vec3::from(delta.get::<3>(vertex as usize))
                });
            }
        }
        Ok(Some(values))
    }

    /// TANGENT with its morph targets; the sign is -1 or 1.
    pub fn tangents(
        &self,
        primitive: &Primitive,
        weights: &[f64],
        source: &[u32],
    ) -> Outcome<Option<Vec<Vec4>>> {
        let Some(vectors) = self.morphed(primitive, "TANGENT", weights, source)? else { return Ok(None) };
        let Some(base) = self.attribute(&primitive.attributes, "TANGENT", &[4], &QUANTIZED)? else {
            return Ok(None);
        };
        let signs = gather(source, |vertex| if base.get::<4>(vertex)[3] < 0.0 { -1.0 } else { 1.0 });
        Ok(Some(vectors.iter().zip(signs).map(|(vector, sign)| vector.extend(sign)).collect()))
    }

    /// The triangles that the primitive draws.
    pub fn triangles(&self, primitive: &Primitive) -> Outcome<Vec<[u32; 3]>> {
        let mode =
            primitive.mode.map_or(Some(Mode::Triangles), |mode| Mode::new(mode.0)).unwrap_or(Mode::Thin);
        let indices = primitive
            .indices
            .map(|index| {
                Accessor::new(self.document, self.buffers, index.0)?.expect(
                    &format!("indices of {}", self.what),
                    &[1],
                    &INDEX_TYPES,
                )
            })
            .transpose()?;
        triangulate(mode, indices.as_ref(), self.vertices, &self.what)
    }

    /// COLOR_0, unless all are white.
    pub fn colors(&self, primitive: &Primitive, source: &[u32]) -> Outcome<Option<Vec<Vec4>>> {
        let types = [Component::F32, Component::U8, Component::U16];
        let Some(accessor) = self.attribute(&primitive.attributes, "COLOR_0", &[3, 4], &types)? else {
            return Ok(None);
        };
        let accessor = accessor.always_normalized();
        let sane = |c: f32| if c.is_nan() { 1.0 } else { c.clamp(0.0, MAX_COLOR) };
        let colors = gather(source, |vertex| {
            let color = Vec4::from(accessor.get::<4>(vertex).map(sane));
            color.with_w(color.w.min(1.0))
        });
        Ok(colors.iter().any(|&color| color != Vec4::ONE).then_some(colors))
    }

    /// The skin's matrix at each vertex: the mean of its joints' by weight.
    pub fn blend(&self, primitive: &Primitive, skin: &Skin, source: &[u32]) -> Outcome<Vec<DMat4>> {
        let (starts, influences) = self.influences(primitive, skin.matrices.len(), source)?;
        let blend =
            |range: &[u32]| blended(&skin.matrices, &influences[range[0] as usize..range[1] as usize]);
        Ok(starts.windows(2).map(blend).collect())
    }

    /// The joints that each vertex of `source` follows, of so many: where each one's begin in the list and where the
    /// last one's end, and joints with their shares, which sum to 1. Vertices without any follow the first joint.
    pub fn influences(&self, primitive: &Primitive, joints: usize, source: &[u32]) -> Outcome<Influences> {
        let mut sets = Vec::new();
        for set in 0.. {
            let (joints, weights) = (format!("JOINTS_{set}"), format!("WEIGHTS_{set}"));
            let unsigned = [Component::U8, Component::U16];
            let Some(joints) = self.attribute(&primitive.attributes, &joints, &[4], &unsigned)? else {
                break;
            };
            let float = [Component::F32, Component::U8, Component::U16];
            let Some(weights) = self.attribute(&primitive.attributes, &weights, &[4], &float)? else { break };
            sets.push((joints, weights.always_normalized()));
        }
        let (mut starts, mut list) = (Vec::with_capacity(source.len() + 1), Vec::new());
        for &vertex in source {
            let first = list.len();
            starts.push(first as u32);
            for (joints, weights) in &sets {
                let pairs = joints
                    .get_indices::<4>(vertex as usize)
                    .into_iter()
                    .zip(weights.get::<4>(vertex as usize));
                let counting = pairs.filter(|&(_, weight)| weight > 0.0 && weight.is_finite());
                list.extend(counting.map(|(joint, weight)| (joint, f64::from(weight))));
            }
            if let Some((joint, _)) = list[first..].iter().find(|(joint, _)| *joint as usize >= joints) {
                return Err(format!(
                    "{} refers to joint {joint}, but its skin has only {joints}; export the scene again",
                    self.what
                ));
            }
            let total: f64 = list[first..].iter().map(|(_, weight)| weight).sum();
            list[first..].iter_mut().for_each(|(_, weight)| *weight /= total);
            if list.len() == first && joints > 0 {
                list.push((0, 1.0));
            }
        }
        starts.push(list.len() as u32);
        Ok((starts, list))
    }
}

/// Where each vertex's influences begin, and the influences: joints and shares.
pub type Influences = (Vec<u32>, Vec<(u32, f64)>);

/// One value per vertex of `source`, in parallel.
pub fn gather<T: Send>(source: &[u32], read: impl Fn(usize) -> T + Sync) -> Vec<T> {
    source.par_iter().with_min_len(4096).map(|&vertex| read(vertex as usize)).collect()
}
