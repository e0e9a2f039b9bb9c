//! What is drawn of the wearer's hands: hands by their joints, or controllers, the ray of the one that points, and the spot
//! that it points at.
//!
//! They are moving parts of the scene, the last ones, whose matrices are given from outside for each frame instead of by
//! animations: so they are lit, throw shadows and are mirrored as all else. What is not there is left out of the tree's
//! top. No flag of the kernels is on for them.

use std::f32::consts::TAU;
use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3, Vec2, Vec3, Vec4};

use super::animation::{Geometry, Motion, Part};
use super::{Material, Mesh, Scene};
use crate::math::hand::{self, JOINTS, Joints, WRIST};
use crate::math::pose::Pose;

mod skin;

/// Metres from the hand to where its ray begins.
const BEFORE: f64 = 0.1;
/// How far fingers are bent at each joint in the hand around which trees are built, in radians.
const RELAXED: f64 = 0.3;
/// How far a ray is shown that meets nothing, in metres.
const FARTHEST: f64 = 20.0;

/// Where hands are in the scene, in metres; `None` where they are not seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandPlaces {
    /// The grips of the left and of the right hand, as OpenXR has them: -Z goes from the little finger to the thumb.
    pub grips: [Option<Pose>; 2],
    /// The joints of the left and of the right hand, where these are seen and hold no controller.
    pub joints: [Option<Joints>; 2],
    /// What the hand points at that does.
    pub aim: Option<Aim>,
}

/// A hand that points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Where it is; it points along its -Z.
    pub hand: Pose,
    /// What it meets first, if anything.
    pub met: Option<Met>,
}

/// A place that a hand points at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Met {
    /// The place.
    pub point: DVec3,
    /// The surface's unit normal there.
    pub normal: DVec3,
    /// Whether one can stand there.
    pub can_stand: bool,
}

impl HandPlaces {
    /// `world_from_node` of each node that [`attach`] has added: two controllers, ray, spot, and the joints of both hands.
    pub fn matrices(&self) -> Vec<Option<DMat4>> {
        let placed = |pose: Pose| DMat4::from_rotation_translation(pose.rotation, pose.position);
        let ray = self.aim.map(|Aim { hand, met }| {
            let length = met.map_or(FARTHEST, |met| met.point.distance(hand.position));
            let start = BEFORE.min(0.5 * length);
            placed(hand)
                * DMat4::from_translation(DVec3::NEG_Z * start)
                * DMat4::from_scale(DVec3::new(1.0, 1.0, length - start))
        });
        let spot = self.aim.and_then(|aim| aim.met).filter(|met| met.can_stand).map(|met| {
            let turn = DQuat::from_rotation_arc(DVec3::Z, met.normal);
            DMat4::from_rotation_translation(turn, met.point)
        });
        let controller = |hand: usize| self.grips[hand].filter(|_| self.joints[hand].is_none()).map(placed);
        let joints = self
            .joints
            .iter()
            .flat_map(|hand| hand.as_ref().map_or([None; JOINTS], |joints| skin::places(joints).map(Some)));
        [controller(0), controller(1), ray, spot].into_iter().chain(joints).collect()
    }
}

/// Adds the parts to a scene, at rest in its middle until they are given a place; `start` is the time for which it was
/// loaded, in seconds.
pub fn attach(scene: &mut Scene, start: f64) {
    let Some((low, high)) = scene.bounds() else { return };
    let mut motion =
        scene.motion.take().map_or_else(|| Motion { start, ..Motion::default() }, Arc::unwrap_or_clone);
    // So small that the scene's size stays what it is.
    let scale = f64::from((high - low).max_element() * 1e-3).clamp(1e-9, 1.0);
    let middle = scene.anchor + ((low + high) * 0.5).as_dvec3();
    let rest = DMat4::from_translation(middle) * DMat4::from_scale(DVec3::splat(scale));
    let matte = |name: &str, color: Vec3| Material {
        name: name.into(),
        base_color: color.extend(1.0),
        metallic: 0.0,
        roughness: 0.7,
        ..Material::default()
    };
    let first = scene.materials.len() as u32;
    scene.materials.push(matte("controller", Vec3::new(0.12, 0.13, 0.15)));
    scene.materials.push(matte("teleport mark", Vec3::new(0.1, 0.7, 0.9)));
    scene.materials.push(matte("hand", Vec3::new(0.42, 0.36, 0.33)));
    let controller = Arc::new(lathed(&CONTROLLER, 24));
    let shapes = [
        (controller.clone(), first),
        (controller, first),
        (Arc::new(lathed(&RAY, 8)), first + 1),
        (Arc::new(lathed(&SPOT, 32)), first + 1),
    ];
    for (geometry, material) in shapes {
        let node = motion.skeleton.nodes() + motion.given.len();
        motion.given.push(rest);
        let place = |p: DVec3| rest.transform_point3(p);
        let vertices = geometry.positions.iter().map(|p| place(p.as_dvec3())).collect();
        motion.parts.push(append(&mut scene.mesh, geometry, material, node, (vertices, scene.anchor)));
    }
    for left in [true, false] {
        let node = motion.skeleton.nodes() + motion.given.len();
        let joints = if left { hand::mirrored(&hand::bent(RELAXED)) } else { hand::bent(RELAXED) };
        motion.given.extend(skin::places(&joints).map(|place| rest * place));
        let geometry = Arc::new(skin::hand(std::array::from_fn(|joint| node + joint), left));
        let pose = motion.pose(start, &motion.given, &[]);
        let vertices = geometry.places(&pose, node, &DMat4::IDENTITY);
        let part = append(&mut scene.mesh, geometry, first + 2, node + WRIST, (vertices, scene.anchor));
        motion.parts.push(part);
    }
    scene.motion = Some(Arc::new(motion));
}

/// Appends a geometry to a mesh, with its vertices where they are in the world.
fn append(
    mesh: &mut Mesh,
    geometry: Arc<Geometry>,
    material: u32,
    node: usize,
    (vertices, anchor): (Vec<DVec3>, DVec3),
) -> Part {
    let (first, first_triangle) = (mesh.positions.len(), mesh.triangles.len());
    let count = geometry.positions.len();
    mesh.positions.extend(vertices.iter().map(|p| (*p - anchor).as_vec3()));
    mesh.normals.extend(&geometry.normals);
    // What materials of others read, and these do not.
    fn fill<T: Clone>(list: &mut Vec<T>, value: T, count: usize) {
        if !list.is_empty() {
            list.extend(std::iter::repeat_n(value, count));
        }
    }
    fill(&mut mesh.tangents, Vec4::new(1.0, 0.0, 0.0, 1.0), count);
    fill(&mut mesh.colors, Vec4::ONE, count);
    mesh.uvs.iter_mut().for_each(|uvs| fill(uvs, Vec2::ZERO, count));
    mesh.triangles.extend(geometry.triangles.iter().map(|triangle| triangle.map(|v| v + first as u32)));
    mesh.materials.resize(mesh.triangles.len(), material);
    Part {
        geometry,
        node,
        local: DMat4::IDENTITY,
        vertices: first..mesh.positions.len(),
        triangles: first_triangle..mesh.triangles.len(),
    }
}

/// Distance along -Z and radius, in metres: a handle, a thicker head before it.
const CONTROLLER: [[f32; 2]; 10] = [
    [-0.066, 0.0],
    [-0.062, 0.010],
    [-0.05, 0.015],
    [0.0, 0.017],
    [0.035, 0.016],
    [0.045, 0.024],
    [0.065, 0.029],
    [0.085, 0.024],
    [0.1, 0.010],
    [0.104, 0.0],
];
/// A metre long.
const RAY: [[f32; 2]; 4] = [[0.0, 0.0], [0.0, 0.003], [1.0, 0.003], [1.0, 0.0]];
/// A ring, a centimetre high, that lies on the ground.
const SPOT: [[f32; 2]; 5] = [[-0.01, 0.2], [0.0, 0.2], [0.0, 0.16], [-0.01, 0.16], [-0.01, 0.2]];

/// A profile that goes round the Z axis.
fn lathed(profile: &[[f32; 2]], sides: u32) -> Geometry {
    let mut geometry = Geometry::default();
    // Each stretch has rings of its own, so that edges stay sharp, but where the profile bends slightly.
    let slope = |pair: usize| {
        let [a, b] = [profile[pair], profile[pair + 1]].map(Vec2::from);
        let along = (b - a).normalize_or_zero();
        // Outwards, of a profile that runs along -Z: to the right of its way.
        Vec2::new(-along.y, along.x)
    };
    let stretches = profile.len() - 1;
    for stretch in 0..stretches {
        for (ring, neighbour) in [(stretch, stretch.checked_sub(1)), (stretch + 1, Some(stretch + 1))] {
            let own = slope(stretch);
            let next = neighbour.filter(|&next| next < stretches).map(slope);
            let normal = next.filter(|next| next.dot(own) > 0.7).map_or(own, |next| (own + next).normalize());
            for side in 0..sides {
                let (sin, cos) = (side as f32 / sides as f32 * TAU).sin_cos();
                let [along, radius] = profile[ring];
                geometry.positions.push(Vec3::new(radius * cos, radius * sin, -along));
                geometry.normals.push(Vec3::new(normal.y * cos, normal.y * sin, -normal.x));
            }
        }
        let first = stretch as u32 * 2 * sides;
        for side in 0..sides {
            let next = (side + 1) % sides;
            let [a, b] = [side, next].map(|side| first + side);
            let [c, d] = [side, next].map(|side| first + sides + side);
            if profile[stretch + 1][1] > 0.0 {
                geometry.triangles.push([a, c, d]);
            }
            if profile[stretch][1] > 0.0 {
                geometry.triangles.push([a, d, b]);
            }
        }
    }
    geometry
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_closed_and_face_outwards() {
        for (profile, sides) in [(&CONTROLLER[..], 24), (&RAY[..], 8), (&SPOT[..], 32)] {
            let geometry = lathed(profile, sides);
            let mut volume = 0.0;
            let mut area = DVec3::ZERO;
            for triangle in &geometry.triangles {
                let [a, b, c] = triangle.map(|v| geometry.positions[v as usize].as_dvec3());
                let cross = (b - a).cross(c - a);
                volume += a.dot(cross) / 6.0;
                area += cross;
                for vertex in triangle {
                    let normal = geometry.normals[*vertex as usize].as_dvec3();
                    assert!((normal.length() - 1.0).abs() < 1e-5 && normal.dot(cross) > 0.5 * cross.length());
                }
            }
            assert!(volume > 1e-6 && area.length() < 1e-6, "{volume} {area}");
        }
    }

    #[test]
    fn parts_lie_where_hands_are_and_point() {
        let grip = Pose::new(DQuat::from_rotation_y(0.5), DVec3::new(1.0, 2.0, 3.0));
        let (point, normal) = (DVec3::new(1.0, 0.0, 0.0), DVec3::Y);
        let aim = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), point);
        let shown = |can_stand| {
            let met = Some(Met { point, normal, can_stand });
            HandPlaces {
                grips: [None, Some(grip)],
                aim: Some(Aim { hand: aim, met }),
                ..HandPlaces::default()
            }
        };
        let [left, right, ray, spot, ref joints @ ..] = shown(true).matrices()[..] else { unreachable!() };
        assert!(left.is_none() && shown(false).matrices()[3].is_none());
        assert!(right.unwrap().transform_point3(DVec3::ZERO).distance(grip.position) < 1e-12);
        assert!(ray.unwrap().transform_point3(DVec3::NEG_Z).distance(point) < 1e-9, "the ray ends there");
        let spot = spot.unwrap();
        assert!(spot.transform_point3(DVec3::ZERO).distance(point) < 1e-12);
        assert!(spot.transform_vector3(DVec3::Z).distance(normal) < 1e-12);
        assert_eq!(joints, [None; 2 * JOINTS]);
        // A hand that is seen holds no controller.
        let seen = HandPlaces { joints: [None, Some(hand::bent(0.2))], ..shown(true) }.matrices();
        assert!(seen[1].is_none() && seen[2] == ray && seen[4..4 + JOINTS].iter().all(Option::is_none));
        let tip = seen[4 + JOINTS + 10].unwrap();
        assert!(tip.w_axis.truncate().distance(hand::bent(0.2)[10].pose.position) < 1e-12);
    }

    #[test]
    fn a_scene_with_hands_is_as_large_and_needs_no_more_of_kernels() {
        let glb = crate::scene::generate::demo::generate();
        let mut scene = Scene::from_glb(std::path::Path::new("demo"), &glb).unwrap();
        let environment = crate::scene::Environment::constant(Vec3::ONE);
        let before = (scene.bounds(), crate::scene::Features::required_by(&scene, &environment));
        attach(&mut scene, 0.5);
        assert_eq!(before, (scene.bounds(), crate::scene::Features::required_by(&scene, &environment)));
        let (mesh, motion) = (&scene.mesh, scene.motion.as_ref().unwrap());
        assert_eq!((motion.parts.len(), motion.given.len(), motion.start), (6, 4 + 2 * JOINTS, 0.5));
        for list in [mesh.tangents.len(), mesh.colors.len(), mesh.uvs[0].len(), mesh.uvs[1].len()] {
            assert!(list == 0 || list == mesh.positions.len());
        }
        assert_eq!(mesh.materials.len(), mesh.triangles.len());
        // What rests in the middle is in nobody's way.
        let (low, high) = scene.bounds().unwrap();
        let above = ((low + high) * 0.5).as_dvec3() + DVec3::Y * 1e-3;
        let bare = Scene::from_glb(std::path::Path::new("demo"), &glb).unwrap();
        let met = |scene: &Scene| crate::scene::pick::nearest(scene, above, DVec3::NEG_Y);
        assert_eq!(met(&scene), met(&bare));
    }
}
