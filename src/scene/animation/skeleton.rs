//! A hierarchy of nodes and where its curves put them.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DMat4, DQuat, DVec3, Vec3};

use super::curve::unit;
use super::{Clip, Paint, Property};

/// A node relative to its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// By a matrix, which curves leave alone.
    Matrix(DMat4),
    /// By parts, scaled first and translated last.
    Parts {
        /// In the parent's units.
        translation: DVec3,
        /// Of any length; without one it turns nothing.
        rotation: DQuat,
        /// For each axis.
        scale: DVec3,
    },
}

impl Local {
    /// `parent_from_node`.
    pub fn matrix(&self) -> DMat4 {
        match *self {
            Local::Matrix(matrix) => matrix,
            Local::Parts { translation, rotation, scale } => {
                DMat4::from_scale_rotation_translation(scale, unit(rotation), translation)
            }
        }
    }
}

/// All nodes of a file at rest, and the clips that move them.
#[derive(Clone, Debug, Default)]
pub struct Skeleton {
    parents: Vec<Option<usize>>,
    /// All nodes, parents before children.
    order: Vec<usize>,
    rest: Vec<Local>,
    /// Nodes that are not seen at rest, nor what is below them; empty where all are.
    hidden: Vec<bool>,
    /// Metres that a unit of the file is.
    scale: f64,
    clips: Vec<Clip>,
}

/// Where all nodes are at one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pose {
    /// `world_from_node` of every node, in metres.
    pub world: Vec<DMat4>,
    /// Weights of morph targets, of the nodes whose weights move.
    pub weights: BTreeMap<usize, Vec<f64>>,
    /// Whether each node is hidden, by itself or by one above; empty where clips hide and show nothing.
    pub hidden: Vec<bool>,
    /// Lights of the file that change.
    pub lights: BTreeMap<usize, Glow>,
    /// Materials of the file that change.
    pub materials: BTreeMap<usize, Paint>,
}

/// What of a light clips have changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Glow {
    /// Linear colour.
    pub color: Option<[f64; 3]>,
    /// In the light's unit.
    pub intensity: Option<f64>,
}

impl Pose {
    /// Whether a clip hides a node now, or one above.
    pub fn hides(&self, node: usize) -> bool {
        self.hidden.get(node).copied().unwrap_or(false)
    }
}

impl Skeleton {
    /// `order` holds each node once, parents before children; clips move nodes that are there.
    pub fn new(
        parents: Vec<Option<usize>>,
        order: Vec<usize>,
        rest: Vec<Local>,
        scale: f64,
        clips: Vec<Clip>,
    ) -> Self {
        Skeleton { parents, order, rest, hidden: Vec::new(), scale, clips }
    }

    /// The same where these nodes are hidden at rest, with all below them.
    pub fn with_hidden(self, hidden: Vec<bool>) -> Self {
        Skeleton { hidden, ..self }
    }

    /// How many nodes there are.
    pub fn nodes(&self) -> usize {
        self.rest.len()
    }

    /// The node that a node hangs on, if any.
    pub fn parent(&self, node: usize) -> Option<usize> {
        self.parents.get(node).copied().flatten()
    }

    /// Where everything is at a time, in seconds since its clips began to play; each loops by itself.
    pub fn pose(&self, time: f64) -> Pose {
        self.pose_with(time, &BTreeMap::new())
    }

    /// The same where some nodes are elsewhere (`world_from_node`, in metres), with all that hangs on them.
    pub fn pose_with(&self, time: f64, elsewhere: &BTreeMap<usize, DMat4>) -> Pose {
        let (mut locals, mut weights) = (self.rest.clone(), BTreeMap::new());
        let mut lights: BTreeMap<usize, Glow> = BTreeMap::new();
        let mut materials: BTreeMap<usize, Paint> = BTreeMap::new();
        let mut shown: BTreeMap<usize, bool> = BTreeMap::new();
        for clip in &self.clips {
            let time = clip.looped(time);
            for channel in &clip.channels {
                let mut vector = [0.0; 3];
                let curve = &channel.curve;
                if channel.property == Property::Visible {
                    curve.sample(time, &mut vector[..1]);
                    shown.insert(channel.node, vector[0] > 0.0);
                    continue;
                }
                if channel.property.is_paint() {
                    materials.entry(channel.node).or_default().take(channel.property, curve, time);
                    continue;
                }
                match channel.property {
                    Property::Intensity => {
                        curve.sample(time, &mut vector[..1]);
                        lights.entry(channel.node).or_default().intensity = Some(vector[0]);
                        continue;
                    }
                    Property::Color => {
                        curve.sample(time, &mut vector);
                        lights.entry(channel.node).or_default().color = Some(vector);
                        continue;
                    }
                    _ => {}
                }
                match (&mut locals[channel.node], channel.property) {
                    (_, Property::Weights) => {
                        let mut values = vec![0.0; curve.width()];
                        curve.sample(time, &mut values);
                        weights.insert(channel.node, values);
                    }
                    (Local::Parts { rotation, .. }, Property::Rotation) => *rotation = curve.rotation(time),
                    (Local::Parts { translation, .. }, Property::Translation) => {
                        curve.sample(time, &mut vector);
                        *translation = vector.into();
                    }
                    (Local::Parts { scale, .. }, Property::Scale) => {
                        curve.sample(time, &mut vector);
                        *scale = vector.into();
                    }
                    _ => {}
                }
            }
        }
        let mut world = vec![DMat4::IDENTITY; self.rest.len()];
        for &node in &self.order {
            let root = || DMat4::from_scale(DVec3::splat(self.scale));
            let hung =
                || self.parents[node].map_or_else(root, |parent| world[parent]) * locals[node].matrix();
            world[node] = elsewhere.get(&node).copied().unwrap_or_else(hung);
        }
        let hidden = if shown.is_empty() { Vec::new() } else { self.hidden(&shown) };
        Pose { world, weights, hidden, lights, materials }
    }

    /// Whether each node is hidden where these are shown or not, and others are as they rest.
    fn hidden(&self, shown: &BTreeMap<usize, bool>) -> Vec<bool> {
        let mut hidden = vec![false; self.rest.len()];
        for &node in &self.order {
            let rests_hidden = || self.hidden.get(node).copied().unwrap_or(false);
            let own = shown.get(&node).map_or_else(rests_hidden, |shown| !shown);
            hidden[node] = own || self.parents[node].is_some_and(|parent| hidden[parent]);
        }
        hidden
    }

    /// The nodes that clips show and hide by themselves.
    pub fn visibility_channels(&self) -> BTreeSet<usize> {
        let channels = self.clips.iter().flat_map(|clip| &clip.channels);
        channels.filter(|channel| channel.property == Property::Visible).map(|channel| channel.node).collect()
    }

    /// Which nodes clips show and hide, by themselves or with one above.
    pub fn visibility_changes(&self) -> Vec<bool> {
        let mut visibility_changes = vec![false; self.rest.len()];
        self.visibility_channels().into_iter().for_each(|node| visibility_changes[node] = true);
        for &node in &self.order {
            visibility_changes[node] |= self.parents[node].is_some_and(|parent| visibility_changes[parent]);
        }
        visibility_changes
    }

    /// Materials that change, each as bright and as clear as it ever gets: see [`Paint::take_most`].
    pub fn most_paint(&self) -> BTreeMap<usize, Paint> {
        let mut materials: BTreeMap<usize, Paint> = BTreeMap::new();
        let channels = self.clips.iter().flat_map(|clip| &clip.channels);
        for channel in channels.filter(|channel| channel.property.is_paint()) {
            materials.entry(channel.node).or_default().take_most(channel.property, &channel.curve);
        }
        materials
    }

    /// Which nodes move: those that clips move, show or hide, these others, and all below them.
    pub fn moving(&self, others: &[usize]) -> Vec<bool> {
        self.roots_of_motion(others).iter().map(Option::is_some).collect()
    }

    /// For each node the one that moves it as a whole: itself if clips move, show or hide it, or it is one of these others, else the nearest
    /// above that is so; `None` where it rests.
    pub fn roots_of_motion(&self, others: &[usize]) -> Vec<Option<usize>> {
        let mut roots = vec![None; self.rest.len()];
        others.iter().for_each(|&node| roots[node] = Some(node));
        for channel in self.clips.iter().flat_map(|clip| &clip.channels) {
            use Property::{Rotation, Scale, Translation, Visible};
            let moves = matches!(channel.property, Translation | Rotation | Scale | Visible);
            if moves {
                roots[channel.node] = Some(channel.node);
            }
        }
        for &node in &self.order {
            roots[node] = roots[node].or_else(|| self.parents[node].and_then(|parent| roots[parent]));
        }
        roots
    }
}

/// The orientation of a node whose axes may be scaled, mirrored or sheared: -Z and, as far as
/// possible, +Y point where the node's do.
pub fn orientation(world: &DMat4) -> DQuat {
    let back = world.z_axis.truncate().try_normalize().unwrap_or(DVec3::Z);
    let up = world.y_axis.truncate();
    let right = up.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back))
}

impl Glow {
    /// Linear colour times intensity, not negative and finite, where the file says these.
    pub fn radiated(&self, color: Option<[f64; 3]>, intensity: Option<f64>) -> Vec3 {
        let intensity = self.intensity.or(intensity).unwrap_or(1.0);
        let color = self.color.or(color).unwrap_or([1.0; 3]);
        Vec3::from_array(color.map(|c| (c * intensity).clamp(0.0, f64::from(f32::MAX)) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::animation::{Channel, Curve, Interpolation};

    fn parts(translation: DVec3) -> Local {
        Local::Parts { translation, rotation: DQuat::IDENTITY, scale: DVec3::ONE }
    }

    fn channel(node: usize, property: Property, values: &[f32], width: usize) -> Channel {
        let curve = Curve::new(vec![0.0, 1.0], values.to_vec(), width, Interpolation::Linear).unwrap();
        Channel { node, property, curve }
    }

    #[test]
    fn what_is_hidden_hides_what_is_below_it() {
        let key = |node, values: &[f32]| {
            let curve = Curve::new(vec![0.0, 1.0], values.to_vec(), 1, Interpolation::Step).unwrap();
            Channel { node, property: Property::Visible, curve }
        };
        let skeleton = |channels| {
            // 0 above 1 above 2, which rests hidden; 3 alone.
            let parents = vec![None, Some(0), Some(1), None];
            let clip = Clip { name: String::new(), channels };
            Skeleton::new(parents, vec![0, 1, 2, 3], vec![parts(DVec3::ZERO); 4], 1.0, vec![clip])
                .with_hidden(vec![false, false, true, false])
        };
        // Bytes are fractions: 1 of 255.
        let one = 1.0 / 255.0;
        let both = skeleton(vec![key(0, &[one, 0.0]), key(2, &[0.0, one])]);
        assert_eq!(both.pose(0.5).hidden, [false, false, true, false]);
        assert_eq!(both.pose(1.0).hidden, [true, true, true, false]);
        assert_eq!(
            (both.visibility_changes(), both.moving(&[])),
            (vec![true, true, true, false], vec![true, true, true, false])
        );
        let last = skeleton(vec![key(2, &[one, one])]);
        assert_eq!(last.pose(0.5).hidden, [false; 4]);
        assert_eq!(last.visibility_changes(), [false, false, true, false]);
        let none = skeleton(vec![]).pose(0.0);
        assert!(none.hidden.is_empty() && !none.hides(2));
    }

    #[test]
    fn curves_replace_parts_and_children_follow() {
        let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2).to_array().map(|v| v as f32);
        let turn = [DQuat::IDENTITY.to_array().map(|v| v as f32), quarter].concat();
        let clip = Clip {
            name: String::new(),
            channels: vec![
                channel(1, Property::Rotation, &turn, 4),
                channel(0, Property::Weights, &[0.0, 1.0, 1.0, 3.0], 2),
            ],
        };
        // 1 is the parent of 2; 0 stands alone.
        let skeleton = Skeleton::new(
            vec![None, None, Some(1)],
            vec![0, 1, 2],
            vec![parts(DVec3::X), parts(DVec3::Y), parts(DVec3::X)],
            2.0,
            vec![clip],
        );
        assert_eq!(skeleton.moving(&[]), [false, true, true]);
        assert_eq!(skeleton.moving(&[0]), [true; 3]);
        let pose = skeleton.pose(1.0);
        let origin = |node: usize| pose.world[node].transform_point3(DVec3::ZERO);
        assert!((origin(0) - DVec3::new(2.0, 0.0, 0.0)).length() < 1e-9);
        assert!((origin(2) - DVec3::new(0.0, 4.0, 0.0)).length() < 1e-6, "{}", origin(2));
        assert_eq!(pose.weights, BTreeMap::from([(0, vec![1.0, 3.0])]));
        assert_eq!(skeleton.pose(0.5).weights[&0], [0.5, 2.0]);
        // Who is put elsewhere leaves its curves, and its children follow.
        let put = skeleton.pose_with(1.0, &BTreeMap::from([(1, DMat4::from_translation(DVec3::Z))]));
        assert_eq!((put.world[0], put.world[1]), (pose.world[0], DMat4::from_translation(DVec3::Z)));
        assert!(put.world[2].transform_point3(DVec3::ZERO).distance(DVec3::new(1.0, 0.0, 1.0)) < 1e-12);
        assert_eq!((skeleton.parent(2), skeleton.parent(1), skeleton.parent(9)), (Some(1), None, None));
    }
}
