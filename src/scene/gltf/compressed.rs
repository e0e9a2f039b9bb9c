//! Geometry that is compressed in the file: buffer views by meshopt, whole primitives by Draco.

mod draco;
mod meshopt;

use std::collections::HashMap;

use rayon::prelude::*;

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::placements::Placement;
use crate::scene::budget::Budget;

/// Decompressed buffer views by their indices (EXT_meshopt_compression, KHR_meshopt_compression).
pub fn views(
    document: &Document,
    buffers: &Buffers<'_>,
    budget: &Budget,
) -> Outcome<HashMap<usize, Vec<u8>>> {
    let compressed = |index: usize| Some((index, document.buffer_views[index].extensions.meshopt()?));
    let views: Vec<_> = (0..document.buffer_views.len()).filter_map(compressed).collect();
    let size = |count: usize, stride: usize| (count as u64).saturating_mul(stride as u64);
    budget.plan_bytes(
        views.iter().map(|(_, v)| size(v.count.0, v.byte_stride.0)).fold(0, u64::saturating_add),
    )?;
    let decode = |&(index, view): &(usize, &super::json::Meshopt)| {
        let what = format!("compressed bufferView {index}");
        let bytes = buffers.bytes(document, view.buffer.0, view.byte_offset.0, view.byte_length.0, &what)?;
        let decoded = meshopt::decode(bytes, view);
        decoded
            .map(|bytes| (index, bytes))
            .map_err(|problem| format!("{what} {problem}; export the scene again"))
    };
    views.par_iter().map(decode).collect()
}

/// The data of accessors whose primitives are compressed by Draco, by the accessors' indices, packed tightly
/// as components of the accessors' types.
pub fn accessors(
    document: &Document,
    buffers: &Buffers<'_>,
    placements: &[Placement],
) -> Outcome<HashMap<usize, Vec<u8>>> {
    let decoded: Vec<Vec<(usize, Vec<u8>)>> =
        placements
            .par_iter()
            .filter_map(|placement| {
                let primitive = &document.meshes[placement.mesh].primitives[placement.primitive];
                let draco = primitive.extensions.draco.as_ref()?;
                let what = format!("primitive {} of mesh {}", placement.primitive, placement.mesh);
                let decoded = buffers
                    .view(document, draco.buffer_view.0)
                    .and_then(|bytes| draco::decode(document, primitive, draco, bytes));
                Some(decoded.map_err(|problem| {
                    format!("{what} is compressed, and {problem}; export the scene again")
                }))
            })
            .collect::<Outcome<_>>()?;
    Ok(decoded.into_iter().flatten().collect())
}
