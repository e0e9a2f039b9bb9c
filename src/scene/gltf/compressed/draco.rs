//! Primitives compressed by Draco (KHR_draco_mesh_compression).

use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};

use super::super::accessor::{Component, width};
use super::super::json::{Accessor, Document, Draco, Primitive};

/// The data of the primitive's accessors, each by its index, or a clause about what is wrong.
pub fn decode(
    document: &Document,
    primitive: &Primitive,
    draco: &Draco,
    bytes: &[u8],
) -> Result<Vec<(usize, Vec<u8>)>, String> {
    let points = primitive.attributes.get("POSITION").map_or(0, |at| document.accessors[at.0].count.0);
    let corners = primitive.indices.map_or(0, |at| document.accessors[at.0].count.0);
    // What the document promises was planned for; more than that is not made.
    let limits = DecodeLimits::default().with_max_points(points as u64).with_max_faces(corners as u64 / 3);
    let mut mesh = Mesh::new();
    MeshDecoder::new()
        .decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh)
        .map_err(|error| format!("its Draco data is damaged ({error})"))?;
    if mesh.num_points() != points || mesh.num_faces() * 3 != corners {
        return Err(format!(
            "its Draco data has {} vertices and {} triangles, but the scene says {points} and {}",
            mesh.num_points(),
            mesh.num_faces(),
            corners / 3
        ));
    }
    let mut decoded = Vec::new();
    if let Some(at) = primitive.indices {
        decoded.push((at.0, indices(&mesh, &document.accessors[at.0])?));
    }
    for (name, id) in &draco.attributes {
        let Some(at) = primitive.attributes.get(name) else { continue };
        decoded.push((at.0, attribute(&mesh, name, id.0, &document.accessors[at.0])?));
    }
    Ok(decoded)
}

fn indices(mesh: &Mesh, accessor: &Accessor) -> Result<Vec<u8>, String> {
    let most = Component::new(accessor.component_type.0).map_or(0, Component::restart);
    if mesh.num_points() as u64 > u64::from(most) {
        return Err("its indices do not fit their type".into());
    }
    let all = mesh.faces().iter().flatten().map(|point| point.0);
    Ok(match accessor.component_type.0 {
        5121 => all.map(|index| index as u8).collect(),
        5123 => all.flat_map(|index| (index as u16).to_le_bytes()).collect(),
        _ => all.flat_map(u32::to_le_bytes).collect(),
    })
}

fn attribute(mesh: &Mesh, name: &str, id: usize, accessor: &Accessor) -> Result<Vec<u8>, String> {
    let attribute = u32::try_from(id)
        .ok()
        .and_then(|id| mesh.attribute_by_unique_id(id))
        .ok_or_else(|| format!("its Draco data has no attribute {id} for {name}"))?;
    let (Some(component), Some(width)) = (Component::new(accessor.component_type.0), width(&accessor.kind))
    else {
        return Err(format!("its {name} is of an unknown type"));
    };
    if usize::from(attribute.num_components()) != width || accessor.count.0 != mesh.num_points() {
        return Err(format!("its {name} is not what its Draco data holds"));
    }
    // Integers of the types that glTF's attributes have are exact in single precision.
    let values = attribute.read_f32s(mesh.num_points(), width).into_iter();
    Ok(match component {
        Component::I8 => values.map(|value| value as i8 as u8).collect(),
        Component::U8 => values.map(|value| value as u8).collect(),
        Component::I16 => values.flat_map(|value| (value as i16).to_le_bytes()).collect(),
        Component::U16 => values.flat_map(|value| (value as u16).to_le_bytes()).collect(),
        Component::U32 => values.flat_map(|value| (value as u32).to_le_bytes()).collect(),
        Component::F32 => values.flat_map(f32::to_le_bytes).collect(),
    })
}
