//! What moves as a whole, by numbers that a pixel's record can hold: so that light is carried along with it.

use glam::DMat4;

use super::{Motion, Part, Pose};
use crate::layout::MAX_MOVERS;

/// The nodes by which things move as a whole, and the numbers of these, from 1 on; 0 is what bends, or has no number any
/// more.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Movers {
    nodes: Vec<usize>,
    parts: Vec<u32>,
    rigid: Vec<u32>,
}

impl Movers {
    /// Of what moves. What is given a place from outside is numbered first, and then as much of the rest as there are
    /// numbers.
    pub fn of(motion: &Motion) -> Movers {
        let seized: Vec<usize> = motion.grabbable.iter().map(|thing| thing.node).collect();
        let roots = motion.skeleton.roots_of_motion(&seized);
        // A node beyond the skeleton's moves by itself.
        let root = |node: usize| roots.get(node).copied().unwrap_or(Some(node));
        let mut movers = Movers::default();
        let given = motion.parts.len() - motion.given.len();
        let last: Vec<u32> =
            motion.parts[given..].iter().map(|part| movers.number(root(part.node))).collect();
        let whole = |part: &Part| part.geometry.skin.is_none() && part.geometry.weights_node.is_none();
        for part in &motion.parts[..given] {
            let number = movers.number(if whole(part) { root(part.node) } else { None });
            movers.parts.push(number);
        }
        movers.parts.extend(last);
        movers.rigid = motion.rigid.iter().map(|rigid| movers.number(root(rigid.node))).collect();
        movers
    }

    fn number(&mut self, node: Option<usize>) -> u32 {
        let Some(node) = node else { return 0 };
        if let Some(index) = self.nodes.iter().position(|own| *own == node) {
            return index as u32 + 1;
        }
        if self.nodes.len() == MAX_MOVERS {
            return 0;
        }
        self.nodes.push(node);
        self.nodes.len() as u32
    }

    /// The number of a part of the mesh.
    pub fn of_part(&self, part: usize) -> u32 {
        self.parts[part]
    }

    /// The number of an instance that moves.
    pub fn of_rigid(&self, rigid: usize) -> u32 {
        self.rigid[rigid]
    }

    /// Of each number, the first one's first: `world_from_part` in a pose, in metres, for some frame of the part that stays
    /// with it; `None` where the part is flattened or nowhere.
    pub fn places(&self, pose: &Pose) -> Vec<Option<DMat4>> {
        let place = |&node: &usize| {
            let world = pose.world[node];
            (world.is_finite() && world.inverse().is_finite()).then_some(world)
        };
        self.nodes.iter().map(place).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::scene::animation::{
        Channel, Clip, Curve, Geometry, Interpolation, Local, Property, Rigid, Skeleton, Skin,
    };

    /// Nodes 0 and 2 are turned by a clip, 1 hangs on 0, 2 on 1 and 3 on 2; 4 rests; 5 is given a place.
    fn motion() -> Motion {
        let rest = Local::Parts { translation: DVec3::X, rotation: Default::default(), scale: DVec3::ONE };
        let turn = |node| {
            let curve = Curve::new(
                vec![0.0, 1.0],
                vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8],
                4,
                Interpolation::Linear,
            );
            Channel { node, property: Property::Rotation, curve: curve.unwrap() }
        };
        let clip = Clip { name: String::new(), channels: vec![turn(0), turn(2)] };
        let parents = vec![None, Some(0), Some(1), Some(2), None];
        let skeleton = Skeleton::new(parents, (0..5).collect(), vec![rest; 5], 1.0, vec![clip]);
        let part = |geometry: Geometry, node| Part {
            geometry: Arc::new(geometry),
            node,
            local: DMat4::IDENTITY,
            vertices: 0..0,
            triangles: 0..0,
        };
        let skinned = Geometry { skin: Some(Skin::default()), ..Geometry::default() };
        let bent = Geometry { weights_node: Some(0), ..Geometry::default() };
        let whole = Geometry::default;
        Motion {
            skeleton,
            parts: vec![
                part(whole(), 0),
                part(whole(), 1),
                part(skinned, 1),
                part(bent, 1),
                part(whole(), 3),
                part(whole(), 4),
                part(whole(), 5),
            ],
            rigid: vec![Rigid { shape: 0, node: 2, local: DMat4::IDENTITY }],
            given: vec![DMat4::from_translation(DVec3::Y)],
            ..Motion::default()
        }
    }

    #[test]
    fn what_moves_together_has_one_number_and_what_bends_none() {
        let motion = motion();
        let movers = Movers::of(&motion);
        let parts: Vec<u32> = (0..7).map(|part| movers.of_part(part)).collect();
        assert_eq!((parts, movers.of_rigid(0)), (vec![2, 2, 0, 0, 3, 0, 1], 3));
        let mut pose = motion.skeleton.pose(1.0);
        pose.world.extend(&motion.given);
        let places = movers.places(&pose);
        assert_eq!(places, [Some(pose.world[5]), Some(pose.world[0]), Some(pose.world[2])]);
        // A point that hangs on a node goes where the node that moves it takes it.
        let before = motion.skeleton.pose(0.0);
        let carried = pose.world[0] * before.world[0].inverse();
        let point = |pose: &Pose| pose.world[1].transform_point3(DVec3::new(0.2, 0.4, 0.3));
        assert!((carried.transform_point3(point(&before)) - point(&pose)).length() < 1e-9);
    }

    #[test]
    fn what_is_flattened_is_nowhere() {
        let motion = motion();
        let mut pose = motion.skeleton.pose(0.5);
        pose.world.extend(&motion.given);
        pose.world[0] = DMat4::from_scale(DVec3::new(1.0, 0.0, 1.0));
        let places = Movers::of(&motion).places(&pose);
        assert_eq!(places.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true]);
    }

    #[test]
    fn numbers_end_where_records_have_no_more_room() {
        let mut motion = motion();
        let first = motion.skeleton.nodes();
        for index in 0..200 {
            motion.given.push(DMat4::IDENTITY);
            motion.parts.push(Part { node: first + 1 + index, ..motion.parts[0].clone() });
        }
        let movers = Movers::of(&motion);
        let numbers: Vec<u32> = (6..207).map(|part| movers.of_part(part)).collect();
        assert_eq!(numbers[..MAX_MOVERS], (1..=MAX_MOVERS as u32).collect::<Vec<_>>());
        assert!(numbers[MAX_MOVERS..].iter().all(|number| *number == 0) && movers.of_part(0) == 0);
    }
}
