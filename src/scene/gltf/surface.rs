//! A shape with what its finished material reads at each vertex.

use glam::{Vec2, Vec4};

use super::Outcome;
use super::buffers::Buffers;
use super::json::Document;
use super::materials::Finished;
use super::shape::Shape;
use super::tangents::generate;

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
        let mut surface = Surface { shape, uvs, tangents: Vec::new(), lacks_uvs };
        if let Some(normal) = &finished.material.normal_texture {
            match given {
                Some(tangents) => surface.tangents = tangents,
                None => {
                    let read = |uv: &Vec2| normal.matrix * *uv + normal.offset;
                    let uvs: Vec<Vec2> = surface.uvs[normal.uv_slot as usize].iter().map(read).collect();
                    surface.make_tangents(&uvs);
                }
            }
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

fn repeat<T: Copy>(values: &mut Vec<T>, doubles: &[u32]) {
    values.reserve(doubles.len());
    for &double in doubles {
        values.push(values[double as usize]);
    }
}
