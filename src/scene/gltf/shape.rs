//! A primitive's geometry at one instant: triangulated, morphed, skinned, without degenerate triangles.

use glam::{DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};

use super::Outcome;
use super::buffers::Buffers;
use super::json::{Document, Primitive};
use super::moving::Moving;
use super::nodes::Nodes;
use super::placements::Placement;
use super::reader::{QUANTIZED, Reader, gather};
use super::skin::Skin;
use super::vectors::{cross, transform_normal, transform_tangent, unit_normals};
use crate::scene::LeftOut;

/// A primitive in the frame of the nodes that place it.
pub struct Shape {
    /// Index of the document's mesh.
    pub mesh: usize,
    /// Index of the primitive in its mesh.
    pub primitive: usize,
    /// Index of the document's material.
    pub material: Option<usize>,
    /// The file's vertex that each vertex stems from.
    pub source: Vec<u32>,
    /// Positions; those that no triangle uses may not be finite.
    pub positions: Vec<Vec3>,
    /// Unit normals, one each.
    pub normals: Vec<Vec3>,
    /// The file's tangents, if asked for and there.
    pub tangents: Option<Vec<Vec4>>,
    /// Vertex colours, unless all are white.
    pub colors: Option<Vec<Vec4>>,
    /// Triangles with an area.
    pub triangles: Vec<[u32; 3]>,
    /// `world_from_shape` of each instance.
    pub transforms: Vec<DMat4>,
    /// How it moves; then its vertices are as in the file, neither morphed nor skinned.
    pub moving: Option<Moving>,
    /// It is to be kept once, if nothing else speaks against it.
    pub shared: bool,
    /// The file has no normals: each triangle has its own three vertices.
    pub flat: bool,
    /// Triangles that were left out.
    pub dropped: LeftOut,
}

impl Shape {
    /// The box around its triangles.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let corners =
            self.triangles.iter().flatten().map(|&corner| self.positions[corner as usize].as_dvec3());
        corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    /// Reads what `placement` places.
    pub fn read(
        document: &Document,
        buffers: &Buffers<'_>,
        nodes: &Nodes,
        placement: Placement,
        wants_tangents: bool,
    ) -> Outcome<Self> {
        let primitive = &document.meshes[placement.mesh].primitives[placement.primitive];
        let reader = Reader::new(document, buffers, placement.mesh, placement.primitive)?;
        let triangles = reader.triangles(primitive)?;
        let (source, triangles) = compact(triangles);
        let mut shape = Shape {
            mesh: placement.mesh,
            primitive: placement.primitive,
            material: primitive.material.map(|material| material.0),
            source,
            positions: Vec::new(),
            normals: Vec::new(),
            tangents: None,
            colors: None,
            triangles,
            transforms: placement.transforms,
            moving: placement.moving,
            shared: placement.shared,
            flat: false,
            dropped: LeftOut::default(),
        };
        let is_still = shape.moving.is_none();
        let weights = if is_still { &placement.weights[..] } else { &[] };
        shape.read_vectors(&reader, primitive, weights, wants_tangents)?;
        if let Some(skin) = placement.skin.filter(|_| is_still) {
            let skin = Skin::read(document, buffers, nodes, skin)?;
            shape.bend(&reader, primitive, &skin)?;
        }
        match is_still {
            true => shape.dropped.filter(&mut shape.triangles, &shape.positions),
            // What has no area now may have some later.
            false => shape.dropped.filter_finite(&mut shape.triangles, &shape.positions),
        }
        shape.flat = shape.normals.is_empty();
        if shape.flat {
            shape.make_flat();
        }
        shape.normals = unit_normals(&shape.normals, &shape.positions, &shape.triangles);
        shape.colors = reader.colors(primitive, &shape.source)?;
        Ok(shape)
    }

    fn read_vectors(
        &mut self,
        reader: &Reader<'_>,
        primitive: &Primitive,
        weights: &[f64],
        tangents: bool,
    ) -> Outcome<()> {
        self.positions = reader.morphed(primitive, "POSITION", weights, &self.source)?.unwrap_or_default();
        self.normals = reader.morphed(primitive, "NORMAL", weights, &self.source)?.unwrap_or_default();
        // Tangents without normals are to be ignored (glTF 2.0, 3.7.2.1).
        if !tangents || self.normals.is_empty() {
            return Ok(());
        }
        self.tangents = reader.tangents(primitive, weights, &self.source)?;
        Ok(())
    }

    /// Applies a skin in its rest pose: the vertices leave the node's frame for the world's.
    fn bend(&mut self, reader: &Reader<'_>, primitive: &Primitive, skin: &Skin) -> Outcome<()> {
        let matrices = reader.blend(primitive, skin, &self.source)?;
        let world: Vec<DVec3> =
            self.positions.iter().zip(&matrices).map(|(p, m)| m.transform_point3(p.as_dvec3())).collect();
        let origin = world.iter().copied().find(|p| p.is_finite()).unwrap_or(DVec3::ZERO);
        self.positions = world.iter().map(|&p| (p - origin).as_vec3()).collect();
        for (normal, matrix) in self.normals.iter_mut().zip(&matrices) {
            *normal = transform_normal(&DMat3::from_mat4(*matrix), *normal);
        }
        for (tangent, matrix) in self.tangents.iter_mut().flatten().zip(&matrices) {
            *tangent = transform_tangent(&DMat3::from_mat4(*matrix), *tangent);
        }
        for triangle in &mut self.triangles {
            if matrices[triangle[0] as usize].determinant() < 0.0 {
                triangle.swap(1, 2);
            }
        }
        self.transforms = vec![DMat4::from_translation(origin)];
        Ok(())
    }

    /// Gives each triangle vertices of its own, with its own normal (glTF 2.0, 3.7.2.1 "flat normals").
    fn make_flat(&mut self) {
        let normals = self.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            cross(a, b, c).normalize_or_zero().as_vec3()
        });
        self.normals = normals.flat_map(|normal| [normal; 3]).collect();
        let corners: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        self.source = corners.iter().map(|&i| self.source[i as usize]).collect();
        self.positions = corners.iter().map(|&i| self.positions[i as usize]).collect();
        self.triangles = (0..self.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    }

    /// Coordinates of TEXCOORD set `set`; `None` when the primitive lacks it.
    pub fn texture_coordinates(
        &self,
        document: &Document,
        buffers: &Buffers<'_>,
        set: usize,
    ) -> Outcome<Option<Vec<Vec2>>> {
        let attributes = &document.meshes[self.mesh].primitives[self.primitive].attributes;
        let reader = Reader::new(document, buffers, self.mesh, self.primitive)?;
        let accessor = reader.attribute(attributes, &format!("TEXCOORD_{set}"), &[2], &QUANTIZED)?;
        Ok(accessor.map(|accessor| {
            gather(&self.source, |vertex| {
                let uv = Vec2::from(accessor.get::<2>(vertex));
                if uv.is_finite() { uv } else { Vec2::ZERO }
            })
        }))
    }

    /// The least alpha of the vertex colours.
    pub fn least_alpha(&self) -> f32 {
        self.colors.iter().flatten().fold(1.0, |least, color| color.w.min(least))
    }
}

/// The vertices that the triangles use, in ascending order, and the triangles in terms of them.
fn compact(mut triangles: Vec<[u32; 3]>) -> (Vec<u32>, Vec<[u32; 3]>) {
    let corners = || triangles.iter().flatten().copied();
    let (Some(first), Some(last)) = (corners().min(), corners().max()) else {
        return (Vec::new(), triangles);
    };
    let mut numbers = vec![u32::MAX; (last - first) as usize + 1];
    corners().for_each(|corner| numbers[(corner - first) as usize] = 0);
    let mut source = Vec::new();
    for (offset, number) in numbers.iter_mut().enumerate().filter(|(_, number)| **number == 0) {
        *number = source.len() as u32;
        source.push(first + offset as u32);
    }
    for corner in triangles.iter_mut().flatten() {
        *corner = numbers[(*corner - first) as usize];
    }
    (source, triangles)
}
