//! Primitives that are kept once and shown at many places: what of a document's surfaces becomes [`Instanced`].

use glam::{DMat3, DMat4, DVec3};

use super::flatten::{Placed, join};
use super::surface::Surface;
use crate::scene::LeftOut;
use crate::scene::instanced::{Instance, Instanced, InstancedShape};

/// A matrix whose determinant is less of its columns' lengths flattens what it places.
const FLATTENS: f64 = 1e-6;

/// Takes from surfaces that are `kept` once the places that need no copies; what is left of a surface's places is to be
/// flattened. `materials` has the material of each surface. Also tells what was left out.
pub fn take(
    surfaces: &mut [Surface],
    materials: &[u32],
    kept: &[bool],
    anchor: DVec3,
) -> (Option<Instanced>, LeftOut) {
    let (mut placed, mut shapes, mut instances) = (Vec::new(), Vec::new(), Vec::new());
    let (mut left_out, mut vertices, mut triangles) = (LeftOut::default(), 0, 0);
    let mut places = Vec::new();
    for ((index, surface), _) in surfaces.iter_mut().enumerate().zip(kept).filter(|(_, kept)| **kept) {
        let bounds = surface.shape.bounds();
        let (usable, others) = std::mem::take(&mut surface.shape.transforms)
            .into_iter()
            .partition::<Vec<_>, _>(|world| is_usable(world, bounds, anchor));
        surface.shape.transforms = others;
        let (mirrored, plain) = usable.into_iter().partition::<Vec<_>, _>(|world| world.determinant() < 0.0);
        let centre = (bounds.0 + bounds.1) * 0.5;
        places.extend([(index, 1.0, centre, plain), (index, -1.0, centre, mirrored)]);
    }
    for (index, side, centre, worlds) in places.into_iter().filter(|(.., worlds)| !worlds.is_empty()) {
        // A shape that is shown mirrored is mirrored itself, so that no instance has to turn its winding.
        let flip = DMat4::from_scale(DVec3::new(side, 1.0, 1.0));
        let origin = flip.transform_point3(centre);
        let shape = Placed::still(&surfaces[index], materials[index], &flip, origin);
        left_out.add(shape.dropped, worlds.len());
        if shape.triangles.is_empty() {
            continue;
        }
        let number = shapes.len() as u32;
        shapes.push(InstancedShape {
            triangles: triangles..triangles + shape.triangles.len(),
            vertices: vertices..vertices + shape.positions.len(),
        });
        (triangles, vertices) = (triangles + shape.triangles.len(), vertices + shape.positions.len());
        placed.push(shape);
        let own = flip * DMat4::from_translation(origin);
        instances.extend(worlds.into_iter().map(|world| {
            let matrix = DMat4::from_translation(-anchor) * world * own;
            let row = |axis: usize| matrix.row(axis).as_vec4().to_array();
            Instance { shape: number, anchor_from_shape: [row(0), row(1), row(2)] }
        }));
    }
    let instanced = Instanced { mesh: join(placed).0, shapes, instances };
    ((!instanced.instances.is_empty()).then_some(instanced), left_out)
}

/// Whether an instance at a place is what the flattened shape would be.
fn is_usable(world: &DMat4, (low, high): (DVec3, DVec3), anchor: DVec3) -> bool {
    let linear = DMat3::from_mat4(*world);
    let lengths = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
    let is_solid = linear.determinant().abs() > FLATTENS * lengths && lengths.is_finite();
    let reach = linear.abs() * low.abs().max(high.abs()) + (world.w_axis.truncate() - anchor).abs();
    // Half of the largest float: sums of a few terms stay finite.
    is_solid && reach.max_element() < f64::from(f32::MAX) * 0.25 && lengths > f64::from(f32::MIN_POSITIVE)
}
