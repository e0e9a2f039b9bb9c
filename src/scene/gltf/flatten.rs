//! All instances of all surfaces in one mesh, relative to the anchor.

use glam::{DMat3, DMat4, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::surface::Surface;
use super::vectors::{transform_normal, transform_tangent, unit_normals, usable_tangent};
use crate::scene::animation::{Part, Pose, Vertices};
use crate::scene::{LeftOut, Mesh};

/// The centre of the world bounds of all instances in a pose; the origin when there is nothing. Of shapes that are kept once
/// the boxes' corners are asked.
pub fn anchor(surfaces: &[Surface], pose: &Pose) -> DVec3 {
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let around = |points: &mut dyn Iterator<Item = DVec3>| {
        points.filter(|p| p.is_finite()).fold(nothing, |(low, high), p| (low.min(p), high.max(p)))
    };
    let boxes: Vec<Option<[DVec3; 8]>> =
        surfaces.par_iter().map(|surface| surface.shape.shared.then(|| box_corners(surface))).collect();
    let (low, high) = instances(surfaces)
        .par_iter()
        .map(|&(index, instance)| {
            let (surface, shape) = (&surfaces[index], &surfaces[index].shape);
            let corners = shape.triangles.iter().flatten().map(|&corner| corner as usize);
            match (&surface.geometry, &shape.moving) {
                (Some(geometry), Some(moving)) => {
                    let (node, local) = &moving.places[instance];
                    let places = geometry.places(pose, *node, local);
                    around(&mut corners.map(|i| places[i]))
                }
                _ => {
                    let world = &shape.transforms[instance];
                    if let Some(corners) = &boxes[index] {
                        return around(&mut corners.iter().map(|&p| world.transform_point3(p)));
                    }
                    around(&mut corners.map(|i| world.transform_point3(shape.positions[i].as_dvec3())))
                }
            }
        })
        .reduce(|| nothing, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let centre = low * 0.5 + high * 0.5;
    if centre.is_finite() { centre } else { DVec3::ZERO }
}

/// The corners of the box around a surface's triangles.
fn box_corners(surface: &Surface) -> [DVec3; 8] {
    let (low, high) = surface.shape.bounds();
    std::array::from_fn(|i| DVec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), high, low))
}

/// All instances: the numbers of their surfaces, and theirs among the surface's.
fn instances(surfaces: &[Surface]) -> Vec<(usize, usize)> {
    let of = |(index, surface): (usize, &Surface)| {
        (0..surface.shape.transforms.len()).map(move |instance| (index, instance))
    };
    surfaces.iter().enumerate().flat_map(of).collect()
}

/// A surface of one instance.
pub(super) struct Placed<'a> {
    surface: &'a Surface,
    material: u32,
    /// Relative to the anchor.
    pub(super) positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    tangents: Vec<Vec4>,
    /// With an area.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Those without.
    pub(super) dropped: LeftOut,
    /// What it is as a part of the scene's motion.
    part: Option<Part>,
}

impl<'a> Placed<'a> {
    fn new(surface: &'a Surface, material: u32, instance: usize, pose: &Pose, anchor: DVec3) -> Self {
        match (&surface.geometry, &surface.shape.moving) {
            (Some(geometry), Some(moving)) => {
                let (node, local) = moving.places[instance];
                let part = Part { geometry: geometry.clone(), node, local, vertices: 0..0, triangles: 0..0 };
                Self::moving(surface, material, part, pose, anchor)
            }
            _ => Self::still(surface, material, &surface.shape.transforms[instance], anchor),
        }
    }

    fn moving(surface: &'a Surface, material: u32, part: Part, pose: &Pose, anchor: DVec3) -> Self {
        let geometry = &part.geometry;
        let mut triangles = geometry.wound(pose, part.node, &part.local);
        let (vertices, mut dropped) = (part.at(pose, anchor, &triangles), LeftOut::default());
        if vertices.is_none() {
            dropped.not_finite += triangles.len();
            triangles.clear();
        }
        let Vertices { positions, normals, tangents } = vertices.unwrap_or_default();
        Placed { surface, material, positions, normals, tangents, triangles, dropped, part: Some(part) }
    }

    /// Of a surface that does not move, by `world_from_shape`.
    pub(super) fn still(surface: &'a Surface, material: u32, world: &DMat4, anchor: DVec3) -> Self {
        let shape = &surface.shape;
        let mut anchor_from_shape = *world;
        anchor_from_shape.w_axis -= anchor.extend(0.0);
        let linear = DMat3::from_mat4(*world);
        let mut positions: Vec<Vec3> = shape
            .positions
            .iter()
            .map(|p| anchor_from_shape.transform_point3(p.as_dvec3()).as_vec3())
            .collect();
        let mut triangles = shape.triangles.clone();
        if linear.determinant() < 0.0 {
            // Mirroring turns the winding (glTF 2.0, 3.7.4).
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let mut dropped = LeftOut::default();
        dropped.filter(&mut triangles, &positions);
        let normals: Vec<Vec3> = shape.normals.iter().map(|&n| transform_normal(&linear, n)).collect();
        let normals = unit_normals(&normals, &positions, &triangles);
        let tangents = surface.tangents.iter().map(|&t| transform_tangent(&linear, t)).zip(&normals);
        let tangents = tangents.map(|(tangent, &normal)| usable_tangent(tangent, normal)).collect();
        // No triangle uses these any more.
        positions.iter_mut().filter(|p| !p.is_finite()).for_each(|p| *p = Vec3::ZERO);
        Placed { surface, material, positions, normals, tangents, triangles, dropped, part: None }
    }
}

/// Places all instances in a pose; `materials` has the material of each surface.
///
/// Returns the mesh, those of its parts that move, the number of instances in it, and the triangles that
/// have no area or are not finite in single precision relative to the anchor. What moves comes last.
pub fn flatten(
    surfaces: &[Surface],
    materials: &[u32],
    pose: &Pose,
    anchor: DVec3,
) -> (Mesh, Vec<Part>, usize, LeftOut) {
    let place = |&(index, instance): &(usize, usize)| {
        Placed::new(&surfaces[index], materials[index], instance, pose, anchor)
    };
    let mut dropped = LeftOut::default();
    let placed: Vec<Placed<'_>> = instances(surfaces).par_iter().map(place).collect();
    placed.iter().for_each(|instance| dropped.add(instance.dropped, 1));
    let mut placed: Vec<Placed<'_>> =
        placed.into_iter().filter(|instance| !instance.triangles.is_empty()).collect();
    placed.sort_by_key(|instance| instance.part.is_some());
    let count = placed.len();
    let (mesh, parts) = join(placed);
    (mesh, parts, count, dropped)
}

/// All in one mesh, one after the other, and those that move.
pub(super) fn join(placed: Vec<Placed<'_>>) -> (Mesh, Vec<Part>) {
    let vertices = placed.iter().map(|p| p.positions.len()).sum();
    let triangles = placed.iter().map(|p| p.triangles.len()).sum();
    let has_uvs = [0, 1].map(|slot| placed.iter().any(|p| !p.surface.uvs[slot].is_empty()));
    let has_tangents = placed.iter().any(|p| !p.tangents.is_empty());
    let has_colors = placed.iter().any(|p| p.surface.shape.colors.is_some());
    let room = |wanted: bool| if wanted { vertices } else { 0 };
    let mut mesh = Mesh {
        positions: Vec::with_capacity(vertices),
        normals: Vec::with_capacity(vertices),
        tangents: Vec::with_capacity(room(has_tangents)),
        uvs: has_uvs.map(|wanted| Vec::with_capacity(room(wanted))),
        colors: Vec::with_capacity(room(has_colors)),
        triangles: Vec::with_capacity(triangles),
        materials: Vec::with_capacity(triangles),
    };
    let mut parts = Vec::new();
    for instance in placed {
        let first = mesh.triangles.len();
        let base = mesh.positions.len() as u32;
        mesh.positions.extend(instance.positions);
        mesh.normals.extend(instance.normals);
        let vertices = mesh.positions.len();
        if has_tangents {
            mesh.tangents.extend(instance.tangents);
            mesh.tangents.resize(vertices, Vec4::new(1.0, 0.0, 0.0, 1.0));
        }
        for slot in [0, 1].into_iter().filter(|&slot| has_uvs[slot]) {
            mesh.uvs[slot].extend_from_slice(&instance.surface.uvs[slot]);
            mesh.uvs[slot].resize(vertices, Default::default());
        }
        if has_colors {
            mesh.colors.extend(instance.surface.shape.colors.iter().flatten());
            mesh.colors.resize(vertices, Vec4::ONE);
        }
        mesh.materials.resize(mesh.materials.len() + instance.triangles.len(), instance.material);
        mesh.triangles.extend(instance.triangles.iter().map(|triangle| triangle.map(|i| base + i)));
        parts.extend(instance.part.map(|part| Part {
            vertices: base as usize..mesh.positions.len(),
            triangles: first..mesh.triangles.len(),
            ..part
        }));
    }
    (mesh, parts)
}
