//! What moves as a whole, or nearly so, by numbers that a pixel's record can hold: so that light is carried along with it.

use glam::DMat4;

use super::{Motion, Pose};
use crate::layout::MAX_MOVERS;

/// The nodes by which things move as a whole, and the numbers of these, from 1 on; 0 is what has no number any more. A
/// triangle of a skin goes with the joint that it follows most, and what is morphed as if it was not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Movers {
    nodes: Vec<usize>,
    parts: Vec<Numbers>,
    rigid: Vec<u32>,
}

/// The numbers of a part's triangles.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Numbers {
    /// Of all.
    One(u32),
    /// Of each.
    Each(Vec<u32>),
}

impl Movers {
    /// Of what moves. What is given a place from outside is numbered first, then as much of the rest as there are
    /// numbers; joints of skins come last.
    pub fn of(motion: &Motion) -> Movers {
        let seized: Vec<usize> = motion.grabbable.iter().map(|thing| thing.node).collect();
        let roots = motion.skeleton.roots_of_motion(&seized);
        // A node beyond the skeleton's moves by itself; one that rests, under what is morphed, by nothing.
        let root = |node: usize| roots.get(node).copied().flatten().unwrap_or(node);
        let mut movers = Movers { parts: vec![Numbers::One(0); motion.parts.len()], ..Movers::default() };
        let given = motion.parts_before_given();
        let in_order =
            || (given..motion.parts.len()).chain(0..given).map(|index| (index, &motion.parts[index]));
        for (index, part) in in_order().filter(|(_, part)| part.geometry.skin.is_none()) {
            movers.parts[index] = Numbers::One(movers.number(root(part.node)));
        }
        movers.rigid = motion.rigid.iter().map(|rigid| movers.number(root(rigid.node))).collect();
        for (index, part) in in_order() {
            let Some(skin) = &part.geometry.skin else { continue };
            let number = |triangle| skin.leader(triangle).map_or(0, |joint| movers.number(root(joint)));
            movers.parts[index] = Numbers::Each(part.geometry.triangles.iter().map(number).collect());
        }
        movers
    }

    fn number(&mut self, node: usize) -> u32 {
        if let Some(index) = self.nodes.iter().position(|own| *own == node) {
            return index as u32 + 1;
        }
        if self.nodes.len() == MAX_MOVERS {
            return 0;
        }
        self.nodes.push(node);
        self.nodes.len() as u32
    }

    /// The number of a triangle of a part of the mesh.
    pub fn of_part(&self, part: usize, triangle: usize) -> u32 {
        match &self.parts[part] {
            Numbers::One(number) => *number,
            Numbers::Each(numbers) => numbers[triangle],
        }
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
        Channel, Clip, Curve, Geometry, Interpolation, Local, Part, Property, Rigid, Skeleton, Skin,
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
        // Three vertices hang on nodes 2, 3 and 4, one on all of them.
        let skin = Skin {
            joints: vec![4, 2, 3],
            bind: vec![DMat4::IDENTITY; 3],
            starts: vec![0, 1, 2, 3, 6],
            influences: vec![(1, 1.0), (2, 1.0), (0, 1.0), (1, 0.2), (2, 0.6), (0, 0.2)],
        };
        let triangles = vec![[0, 0, 1], [3, 2, 1], [2, 2, 3]];
        let skinned = Geometry { skin: Some(skin), triangles, ..Geometry::default() };
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
    fn what_moves_together_has_one_number() {
        let motion = motion();
        let movers = Movers::of(&motion);
        let parts: Vec<u32> = [0, 1, 3, 4, 5, 6].map(|part| movers.of_part(part, 0)).to_vec();
        assert_eq!((parts, movers.of_rigid(0)), (vec![2, 2, 2, 3, 4, 1], 3));
        // Node 3 goes where 2 takes it; 4 rests.
        assert_eq!([0, 1, 2].map(|triangle| movers.of_part(2, triangle)), [3, 3, 4]);
        let mut pose = motion.skeleton.pose(1.0);
        pose.world.extend(&motion.given);
        let places = movers.places(&pose);
        assert_eq!(places, [5, 0, 2, 4].map(|node: usize| Some(pose.world[node])));
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
        assert_eq!(places.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true, true]);
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
        let numbers: Vec<u32> = (6..207).map(|part| movers.of_part(part, 0)).collect();
        assert_eq!(numbers[..MAX_MOVERS], (1..=MAX_MOVERS as u32).collect::<Vec<_>>());
        assert!(numbers[MAX_MOVERS..].iter().all(|number| *number == 0) && movers.of_part(0, 0) == 0);
    }
}
