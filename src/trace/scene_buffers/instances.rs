//! Shapes that are kept once, behind the world's triangles in the same buffers, and where they are shown.

use glam::{DMat3, Mat4, Vec3};

use super::SceneData;
use super::moved::Moved;
use super::pack::{pack_color, pack_still_material, pack_triangle};
use crate::bvh::wide::{EMPTY, LEAF, WideNode};
use crate::bvh::{Trees, WideBvh};
use crate::error::{Error, Result};
use crate::layout::{self, pack_normal};
use crate::scene::instanced::Instance;
use crate::scene::{Instanced, Mesh, Scene};

/// Numbers of triangles end before what hits have in their place.
const MOST_TRIANGLES: u64 = u32::MAX as u64 - 16;

impl SceneData {
    /// Puts the shapes' trees and vertices behind those of the world.
    pub(super) fn append_shapes(&mut self, scene: &Scene, instanced: &Instanced, trees: &[WideBvh]) {
        assert_eq!(trees.len(), instanced.shapes.len(), "a tree for each shape");
        let first_vertex = scene.mesh.positions.len();
        for (shape, tree) in instanced.shapes.iter().zip(trees) {
            let place = self.triangles.len();
            self.append_nodes(tree);
            let own = &instanced.mesh.triangles[shape.triangles.clone()];
            // Over what leaves have behind their end.
            self.leaves.truncate(place * 9);
            self.leaves.extend(tree.leaf_vertices(&instanced.mesh.positions, own));
            let materials = &instanced.mesh.materials[shape.triangles.clone()];
            self.triangles.extend(tree.order.iter().map(|slot| {
                let index = slot.triangle as usize;
                let vertices = own[index].map(|vertex| vertex + first_vertex as u32);
                pack_triangle(vertices, pack_still_material(scene, materials[index]), slot)
            }));
        }
        self.append_vertices(&scene.mesh, &instanced.mesh);
    }

    /// A tree's nodes, whose links are places in the whole one.
    fn append_nodes(&mut self, tree: &WideBvh) {
        let (node, place) = (self.nodes.len() as u32, self.triangles.len() as u32);
        let moved = |mut from: WideNode| {
            for child in from.children.iter_mut().filter(|child| **child != EMPTY) {
                *child += if *child & LEAF == 0 { node } else { place };
            }
            from
        };
        self.nodes.extend(tree.nodes.iter().copied().map(moved));
    }

    /// What vertices have. A list that only one of both meshes has is filled up for the other.
    fn append_vertices(&mut self, world: &Mesh, shapes: &Mesh) {
        let (before, all) = (world.positions.len(), world.positions.len() + shapes.positions.len());
        self.normals.extend(shapes.normals.iter().map(|n| pack_normal(n.to_array())));
        fill(&mut self.tangents, bytemuck::cast_slice(&shapes.tangents), [1.0, 0.0, 0.0, 1.0], before, all);
        for (list, own) in self.uvs.iter_mut().zip(&shapes.uvs) {
            fill(list, bytemuck::cast_slice(own), [0.0; 2], before, all);
        }
        let own: Vec<[u16; 4]> = shapes.colors.iter().map(pack_color).collect();
        fill(&mut self.colors, &own, pack_color(&glam::Vec4::ONE), before, all);
    }
}

/// Adds a list to one that is wanted.
fn fill<T: Copy>(list: &mut Option<Vec<T>>, own: &[T], empty: T, before: usize, all: usize) {
    if let Some(list) = list {
        list.resize(before, empty);
        list.extend_from_slice(own);
        list.resize(all, empty);
    }
}

/// The world and all instances.
///
/// # Errors
/// [`Error::Setting`] where their triangles cannot be told apart.
pub(in crate::trace) fn instance_records(
    instanced: &Instanced,
    trees: Trees,
    moved: &Moved,
) -> Result<Vec<layout::Instance>> {
    let count = instanced.instances.len() as u32 + 1;
    let rows = Mat4::IDENTITY.to_cols_array_2d();
    let rows = [rows[0], rows[1], rows[2]];
    let world =
        layout::Instance { world_from_shape: rows, shape_from_world: rows, count, ..Default::default() };
    let (firsts, bounds) = (firsts(trees), instanced.shape_bounds());
    let mut list = vec![world];
    let mut first_triangle = trees.world.order.len() as u64;
    for (number, instance) in instanced.instances.iter().enumerate() {
        let shape = instance.shape as usize;
        let mut record = layout::Instance {
            root: firsts[shape].0 as u32,
            first_place: firsts[shape].1 as u32,
            first_triangle: first_triangle as u32,
            count,
            motion: moved.instance(number),
            ..world
        };
        place_record(&mut record, instance, bounds[shape]);
        list.push(record);
        first_triangle += trees.shapes[shape].order.len() as u64;
        if first_triangle > MOST_TRIANGLES {
            return Err(Error::setting(
                "scene",
                "its instances have more than 2^32 triangles together; show less of it",
            ));
        }
    }
    Ok(list)
}

/// Puts an instance of a shape in a box elsewhere.
pub(in crate::trace) fn place_record(
    record: &mut layout::Instance,
    instance: &Instance,
    bounds: (Vec3, Vec3),
) {
    let back = instance.matrix().inverse();
    let row = |axis: usize| back.row(axis).as_vec4().to_array();
    record.world_from_shape = instance.anchor_from_shape;
    record.shape_from_world = [row(0), row(1), row(2)];
    record.reach = reach(instance, bounds);
}

/// Of each shape its root, and the place of its first triangle.
fn firsts(trees: Trees) -> Vec<(usize, usize)> {
    let mut next = (trees.world.nodes.len(), trees.world.order.len());
    let first = |tree: &WideBvh| {
        let first = next;
        next = (first.0 + tree.nodes.len(), first.1 + tree.order.len());
        first
    };
    trees.shapes.iter().map(first).collect()
}

/// What [`layout::Instance::reach`] is of an instance of a shape in a box.
fn reach(instance: &Instance, (low, high): (Vec3, Vec3)) -> [f32; 3] {
    let matrix = instance.matrix();
    let largest = low.abs().max(high.abs()).as_dvec3();
    let world = DMat3::from_mat4(matrix).abs() * largest + matrix.w_axis.truncate().abs();
    (DMat3::from_mat4(matrix.inverse()).abs() * world).as_vec3().to_array()
}
