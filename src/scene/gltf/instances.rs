//! Node instances (EXT_mesh_gpu_instancing): one mesh at many places.

use glam::{DMat4, DQuat, DVec3};

use super::Outcome;
use super::accessor::{Accessor, Component};
use super::buffers::Buffers;
use super::json::{Document, Instances};

/// Number of instances that a node asks for.
pub fn count(document: &Document, instances: &Instances) -> usize {
    instances.attributes.values().map(|accessor| document.accessors[accessor.0].count.0).min().unwrap_or(0)
}

/// `node_from_instance` of each instance; attributes of other names do not place anything.
pub fn transforms(
    document: &Document,
    buffers: &Buffers<'_>,
    node: usize,
    instances: &Instances,
) -> Outcome<Vec<DMat4>> {
    let signed = [Component::F32, Component::I8, Component::I16];
    let read = |name: &str, width: usize, components: &[Component]| {
        let Some(accessor) = instances.attributes.get(name) else { return Ok(None) };
        let what = format!("{name} of the instances of node {node}");
        Accessor::new(document, buffers, accessor.0)?.expect(&what, &[width], components).map(Some)
    };
    let translation = read("TRANSLATION", 3, &signed[..1])?;
    let rotation = read("ROTATION", 4, &signed)?.map(Accessor::always_normalized);
    let scale = read("SCALE", 3, &signed[..1])?;
    let place = |i: usize| {
        let vector = |accessor: &Option<Accessor<'_>>, default: DVec3| {
            accessor.as_ref().map_or(default, |a| DVec3::from_array(a.get::<3>(i).map(f64::from)))
        };
        let rotation = rotation
            .as_ref()
            .map_or(DQuat::IDENTITY, |accessor| DQuat::from_array(accessor.get::<4>(i).map(f64::from)));
        let length = rotation.length();
        let rotation =
            if length > 0.0 && length.is_finite() { rotation * (1.0 / length) } else { DQuat::IDENTITY };
        DMat4::from_scale_rotation_translation(
            vector(&scale, DVec3::ONE),
            rotation,
            vector(&translation, DVec3::ZERO),
        )
    };
    Ok((0..count(document, instances)).map(place).collect())
}
