//! Primitives that are kept once and shown at many places, or moved as a whole: what of a document's surfaces becomes
//! [`Instanced`].

use glam::{DMat4, DVec3};

use super::flatten::{Placed, join};
use super::surface::Surface;
use crate::scene::LeftOut;
use crate::scene::animation::Rigid;
use crate::scene::instanced::{Instance, Instanced, InstancedShape, is_usable};

/// Where a surface is shown.
struct Place {
    /// `world_from_mesh`.
    world: DMat4,
    /// The node that moves it, and `node_from_mesh`.
    moved: Option<(usize, DMat4)>,
}

/// A surface at places that are all mirrored, or none of them.
struct Group {
    surface: usize,
    /// What mirrors the shape.
    flip: DMat4,
    /// What is the shape's origin, in the mesh.
    centre: DVec3,
    places: Vec<Place>,
}

/// Shapes and instances in the making.
#[derive(Default)]
struct Taken<'a> {
    placed: Vec<Placed<'a>>,
    shapes: Vec<InstancedShape>,
    instances: Vec<Instance>,
    rigid: Vec<Rigid>,
    left_out: LeftOut,
}

/// Takes from surfaces that are `kept` once the places that need no copies; what is left of a surface's places is to be
/// flattened. `materials` has the material of each surface. Returns the instances, those that move last, how these do,
/// and what was left out.
pub fn take(
    surfaces: &mut [Surface],
    materials: &[u32],
    kept: &[bool],
    anchor: DVec3,
) -> (Option<Instanced>, Vec<Rigid>, LeftOut) {
    let kept = surfaces.iter_mut().enumerate().zip(kept).filter(|(_, kept)| **kept);
    let mut groups: Vec<Group> =
        kept.flat_map(|((index, surface), _)| groups(index, surface, anchor)).collect();
    // What moves comes last.
    groups.sort_by_key(|group| group.places.iter().any(|place| place.moved.is_some()));
    let mut taken = Taken::default();
    for group in groups {
        taken.add(&surfaces[group.surface], materials[group.surface], &group, anchor);
    }
    let Taken { placed, shapes, instances, rigid, left_out } = taken;
    let instanced = Instanced { mesh: join(placed).0, shapes, instances };
    ((!instanced.instances.is_empty()).then_some(instanced), rigid, left_out)
}

/// Takes a surface's places that an instance can show.
fn groups(index: usize, surface: &mut Surface, anchor: DVec3) -> Vec<Group> {
    let (shape, mut groups) = (&mut surface.shape, [Vec::new(), Vec::new()]);
    let bounds = shape.bounds();
    let moved = shape.moving.as_mut().map(|moving| std::mem::take(&mut moving.places));
    for (at, world) in std::mem::take(&mut shape.transforms).into_iter().enumerate() {
        let own = moved.as_ref().map(|moved| moved[at]);
        if is_usable(&(DMat4::from_translation(-anchor) * world), bounds) {
            groups[usize::from(world.determinant() < 0.0)].push(Place { world, moved: own });
        } else {
            shape.transforms.push(world);
            shape.moving.iter_mut().for_each(|moving| moving.places.extend(own));
        }
    }
    let (centre, [plain, mirrored]) = ((bounds.0 + bounds.1) * 0.5, groups);
    let group = |side: f64, places| Group {
        surface: index,
        // A shape that is shown mirrored is mirrored itself, so that no instance has to turn its winding.
        flip: DMat4::from_scale(DVec3::new(side, 1.0, 1.0)),
        centre,
        places,
    };
    let both = [group(1.0, plain), group(-1.0, mirrored)];
    both.into_iter().filter(|group| !group.places.is_empty()).collect()
}

impl<'a> Taken<'a> {
    fn add(&mut self, surface: &'a Surface, material: u32, group: &Group, anchor: DVec3) {
        let origin = group.flip.transform_point3(group.centre);
        let shape = Placed::still(surface, material, &group.flip, origin);
        self.left_out.add(shape.dropped, group.places.len());
        if shape.triangles.is_empty() {
            return;
        }
        let number = self.shapes.len() as u32;
        let (triangles, vertices) =
            self.shapes.last().map_or((0, 0), |last| (last.triangles.end, last.vertices.end));
        self.shapes.push(InstancedShape {
            triangles: triangles..triangles + shape.triangles.len(),
            vertices: vertices..vertices + shape.positions.len(),
        });
        self.placed.push(shape);
        let own = group.flip * DMat4::from_translation(origin);
        for place in &group.places {
            let matrix = DMat4::from_translation(-anchor) * place.world * own;
            self.instances.push(Instance::new(number, &matrix));
            let rigid = place.moved.map(|(node, local)| Rigid { shape: number, node, local: local * own });
            self.rigid.extend(rigid);
        }
    }
}
