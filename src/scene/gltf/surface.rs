//! A shape with what its finished material reads at each vertex.

use std::sync::Arc;

use glam::{Mat2, Vec2, Vec4};

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::materials::Finished;
use super::moving;
use super::shape::Shape;
use super::tangents::generate;
use crate::scene::animation::Geometry;
use crate::scene::{Material, TextureRef};

/// A shape, its texture coordinates and its tangents.
pub struct Surface {
    /// Geometry, with vertices doubled where tangents demand it.
    pub shape: Shape,
    /// Texture coordinates of the two slots; empty where the material has no use for them.
    pub uvs: [Vec<Vec2>; 2],
    /// Tangents; empty without a normal map. Some may be zero.
    pub tangents: Vec<Vec4>,
    /// The material reads texture coordinates that the primitive lacks; they are zero.
    pub lacks_uvs: bool,
    /// What it is made of, where it moves.
    pub geometry: Option<Arc<Geometry>>,
}

impl Surface {
    /// Reads what `finished`, the shape's material, needs.
    pub fn new(
        document: &Document,
        buffers: &Buffers<'_>,
        mut shape: Shape,
        finished: &Finished,
    ) -> Outcome<Self> {
        let mut uvs = [Vec::new(), Vec::new()];
        let mut lacks_uvs = false;
        for (slot, set) in finished.sets.iter().enumerate().filter_map(|(slot, set)| Some((slot, (*set)?))) {
            let coordinates = shape.texture_coordinates(document, buffers, set)?;
            lacks_uvs |= coordinates.is_none();
            uvs[slot] = coordinates.unwrap_or_else(|| vec![Vec2::ZERO; shape.positions.len()]);
        }
        let given = shape.tangents.take();
        let mut surface = Surface { shape, uvs, tangents: Vec::new(), lacks_uvs, geometry: None };
        match (directed_by(&finished.material), given) {
            (None, _) => {}
            (Some(_), Some(tangents)) => surface.tangents = tangents,
            (Some(texture), None) => {
                let read = |uv: &Vec2| texture.matrix * *uv + texture.offset;
                let uvs: Vec<Vec2> = surface.uvs[texture.uv_slot as usize].iter().map(read).collect();
                if !uvs.is_empty() {
                    surface.make_tangents(&uvs);
                }
            }
        }
        if let Some(moving) = &surface.shape.moving {
            let geometry = moving::geometry(document, buffers, &surface, moving)?;
            surface.geometry = Some(Arc::new(geometry));
        }
        Ok(surface)
    }

    fn make_tangents(&mut self, uvs: &[Vec2]) {
        let shape = &mut self.shape;
        let made = generate(&mut shape.triangles, &shape.positions, &shape.normals, uvs);
        repeat(&mut shape.source, &made.doubles);
        repeat(&mut shape.positions, &made.doubles);
        repeat(&mut shape.normals, &made.doubles);
        shape.colors.iter_mut().for_each(|colors| repeat(colors, &made.doubles));
        self.uvs.iter_mut().filter(|uvs| !uvs.is_empty()).for_each(|uvs| repeat(uvs, &made.doubles));
        self.tangents = made.tangents;
    }
}

/// Whose coordinates say where tangents go: a normal map's, or those of what is anisotropic.
fn directed_by(material: &Material) -> Option<TextureRef> {
    let layers = material.layers.as_ref();
    let whole = || TextureRef { texture: 0, uv_slot: 0, matrix: Mat2::IDENTITY, offset: Vec2::ZERO };
    let anisotropic = layers.filter(|layers| layers.anisotropy > 0.0);
    material
        .normal_texture
        .or(layers.and_then(|layers| layers.coat_normal_texture))
        .or(anisotropic.map(|layers| layers.anisotropy_texture.unwrap_or_else(whole)))
}

fn repeat<T: Copy>(values: &mut Vec<T>, doubles: &[u32]) {
    values.reserve(doubles.len());
    for &double in doubles {
        values.push(values[double as usize]);
    }
}
