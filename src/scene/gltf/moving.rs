//! What a surface that moves is made of, read once.

use glam::DMat4;

use super::Outcome;
use super::accessor::{Accessor, Component};
use super::buffers::Buffers;
use super::json::Document;
use super::reader::{QUANTIZED, Reader, gather};
use super::surface::Surface;
use crate::scene::animation::{Geometry, Skin, Target};

/// What a placement says of how its primitive moves.
#[derive(Clone, Debug)]
pub struct Moving {
    /// Index of the document's skin.
    pub skin: Option<usize>,
    /// Weights of the morph targets, where no animation moves them.
    pub weights: Vec<f64>,
    /// The node whose weights an animation moves.
    pub weights_node: Option<usize>,
    /// The nodes that place it, and `node_from_mesh`.
    pub places: Vec<(usize, DMat4)>,
}

/// Reads what moves of a surface, whose vertices are as in the file.
pub fn geometry(
    document: &Document,
    buffers: &Buffers<'_>,
    surface: &Surface,
    moving: &Moving,
) -> Outcome<Geometry> {
    let shape = &surface.shape;
    let primitive = &document.meshes[shape.mesh].primitives[shape.primitive];
    let reader = Reader::new(document, buffers, shape.mesh, shape.primitive)?;
    let mut targets = Vec::with_capacity(primitive.targets.len());
    for target in &primitive.targets {
        let deltas = |name: &str| -> Outcome<Vec<glam::Vec3>> {
            let Some(accessor) = reader.attribute(target, name, &[3], &QUANTIZED)? else {
                return Ok(Vec::new());
            };
            Ok(gather(&shape.source, |vertex| accessor.get::<3>(vertex).into()))
        };
        let has_tangents = !surface.tangents.is_empty() && primitive.attributes.contains_key("TANGENT");
        targets.push(Target {
            positions: deltas("POSITION")?,
            normals: if shape.flat { Vec::new() } else { deltas("NORMAL")? },
            tangents: if has_tangents { deltas("TANGENT")? } else { Vec::new() },
        });
    }
    let skin = moving.skin.map(|index| -> Outcome<Skin> {
        let (starts, influences) =
            reader.influences(primitive, document.skins[index].joints.len(), &shape.source)?;
        let joints = document.skins[index].joints.iter().map(|joint| joint.0).collect();
        Ok(Skin { joints, bind: bind_matrices(document, buffers, index)?, starts, influences })
    });
    Ok(Geometry {
        positions: shape.positions.clone(),
        normals: shape.normals.clone(),
        tangents: surface.tangents.clone(),
        triangles: shape.triangles.clone(),
        flat: shape.flat,
        targets,
        weights: moving.weights.clone(),
        weights_node: moving.weights_node,
        skin: skin.transpose()?,
    })
}

/// `joint_from_bind` of each joint of a skin.
pub fn bind_matrices(document: &Document, buffers: &Buffers<'_>, index: usize) -> Outcome<Vec<DMat4>> {
    let skin = &document.skins[index];
    let Some(accessor) = skin.inverse_bind_matrices else {
        return Ok(vec![DMat4::IDENTITY; skin.joints.len()]);
    };
    let inverse = Accessor::new(document, buffers, accessor.0)?.expect(
        &format!("inverseBindMatrices of skin {index}"),
        &[16],
        &[Component::F32],
    )?;
    if inverse.count < skin.joints.len() {
        return Err(format!(
            "skin {index} has {} joints but {} inverse bind matrices; export the scene again",
            skin.joints.len(),
            inverse.count
        ));
    }
    Ok((0..skin.joints.len())
        .map(|joint| DMat4::from_cols_array(&inverse.get::<16>(joint).map(f64::from)))
        .collect())
}
