//! Things that hands can seize: nodes of a file that say so, and where they are.

use std::collections::HashMap;

use glam::{DMat4, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Instanced;
use super::animation::{Motion, Pose};

/// Which nodes hands can seize.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Grab {
    /// Those whose extras in the file are `{"grab": true}`, with all below them.
    Marked,
    /// None.
    #[default]
    None,
}

/// A node that hands can seize.
#[derive(Clone, Debug, PartialEq)]
pub struct Grabbable {
    /// The node.
    pub node: usize,
    /// The boxes around what hangs on it, and on no other such node between.
    pub boxes: Vec<HungBox>,
}

/// A box that a node places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HungBox {
    /// The node.
    pub node: usize,
    /// `node_from_box`.
    pub local: DMat4,
    /// Its least and its greatest corner.
    pub bounds: (DVec3, DVec3),
}

impl Grabbable {
    /// Metres from a point of the world to the nearest of the boxes in a pose, 0 inside, and how large that box is from
    /// corner to corner; `None` where nothing is there.
    pub fn reach(&self, pose: &Pose, point: DVec3) -> Option<(f64, f64)> {
        let reach = |hung: &HungBox| {
            let world = pose.world[hung.node] * hung.local;
            let (low, high) = hung.bounds;
            let own = world.inverse().transform_point3(point);
            // Not of a box that is flat: its matrix has no inverse.
            let nearest = own.is_finite().then(|| world.transform_point3(own.clamp(low, high)))?;
            Some((nearest.distance(point), world.transform_vector3(high - low).length()))
        };
        let least = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
        self.boxes.iter().filter_map(reach).filter(|(distance, _)| distance.is_finite()).min_by(least)
    }
}

impl Motion {
    /// Has hands seize these nodes, whose instances of shapes that are kept once are `instanced`'s. What hangs on joints
    /// is not felt.
    pub fn let_seize(&mut self, nodes: &[usize], instanced: Option<&Instanced>) {
        let mut list: Vec<Grabbable> =
            nodes.iter().map(|&node| Grabbable { node, boxes: Vec::new() }).collect();
        let owners: HashMap<usize, usize> = nodes.iter().copied().zip(0..).collect();
        let shapes = instanced.map(Instanced::shape_bounds).unwrap_or_default();
        let parts = self.parts.iter().filter(|part| part.geometry.skin.is_none());
        let parts = parts.map(|part| (part.node, part.local, bounds(&part.geometry.positions)));
        let rigid = self.rigid.iter().map(|rigid| (rigid.node, rigid.local, shapes[rigid.shape as usize]));
        for (node, local, (low, high)) in parts.chain(rigid) {
            let mut above = std::iter::successors(Some(node), |&node| self.skeleton.parent(node));
            let owner = above.find_map(|node| owners.get(&node).copied());
            let bounds = (low.as_dvec3(), high.as_dvec3());
            if let Some(owner) = owner.filter(|_| low.cmple(high).all()) {
                list[owner].boxes.push(HungBox { node, local, bounds });
            }
        }
        list.retain(|thing| !thing.boxes.is_empty());
        self.grabbable = list;
    }
}

fn bounds(positions: &[Vec3]) -> (Vec3, Vec3) {
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    positions.iter().fold(none, |(low, high), &p| (low.min(p), high.max(p)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_measured_in_the_world_whatever_places_a_box() {
        let local = DMat4::from_scale(DVec3::new(0.5, 1.0, 2.0));
        let hung = HungBox { node: 0, local, bounds: (DVec3::NEG_ONE, DVec3::ONE) };
        let thing = Grabbable { node: 0, boxes: vec![hung] };
        let turn = DMat4::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let pose = Pose { world: vec![DMat4::from_translation(DVec3::X * 10.0) * turn], ..Pose::default() };
        // 1 m to either side along X now, 0.5 m along Y, 2 m along Z.
        for (point, distance) in [
            (DVec3::new(10.9, 0.4, 1.9), 0.0),
            (DVec3::new(11.25, 0.0, 0.0), 0.25),
            (DVec3::new(10.0, 0.75, 0.0), 0.25),
            (DVec3::new(11.3, 0.0, 2.4), 0.5),
        ] {
            let (found, size) = thing.reach(&pose, point).unwrap();
            assert!((found - distance).abs() < 1e-12, "{point}: {found}");
            assert!((size - DVec3::new(1.0, 2.0, 4.0).length()).abs() < 1e-12);
        }
        let flat = Pose { world: vec![DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0))], ..Pose::default() };
        assert_eq!(thing.reach(&flat, DVec3::ZERO), None);
    }
}
