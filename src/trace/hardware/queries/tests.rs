use glam::Vec3;

use super::*;
use crate::bvh::WideBvh;
use crate::gpu::vulkan::testing;
use crate::scene::{AlphaMode, Material};

/// Squares across the z axis, seen from the front by who looks along it: at 2, 3, 4 and 5, farther ones larger, of one side,
/// with alpha, of two sides, and of one side but turned.
fn squares() -> Scene {
    let blend = Material { alpha: AlphaMode::Blend, ..Material::default() };
    let both = Material { double_sided: true, ..Material::default() };
    let mut scene = Scene { materials: vec![Material::default(), blend, both], ..Scene::default() };
    for (half, z, material, turned) in
        [(1.0, 2.0, 0, false), (2.0, 3.0, 1, false), (3.0, 4.0, 2, false), (4.0, 5.0, 0, true)]
    {
        let first = scene.mesh.positions.len() as u32;
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
        scene.mesh.positions.extend(corners.map(|(x, y)| Vec3::new(x * half, y * half, z)));
        scene.mesh.normals.extend([Vec3::NEG_Z; 4]);
        let [a, b, c, d] = [first, first + 1, first + 2, first + 3];
        let triangles = [[a, b, c], [a, c, d]];
        scene.mesh.triangles.extend(triangles.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
        scene.mesh.materials.extend([material; 2]);
    }
    scene
}

/// From where rays start, along z or back, what each question finds: how far away, and whether it is open. Any hit has a
/// distance of 0 here.
type Known = (f32, [f32; 3], [(Option<f32>, bool); 4]);
const QUESTIONS: [Asked; 4] = [Asked::Any, Asked::AnyFront, Asked::NearestFront, Asked::Nearest];
const KNOWN: [Known; 6] = [
    // Through all four: the first is met from its front.
    (1.0, [0.5, 0.5, 0.0], [(Some(0.0), false), (Some(0.0), false), (Some(2.0), false), (Some(2.0), false)]),
    // Past the first: alpha comes first.
    (1.0, [1.5, 0.0, 0.0], [(Some(0.0), false), (Some(0.0), false), (Some(4.0), true), (Some(4.0), true)]),
    (1.0, [2.5, 0.5, 0.0], [(Some(0.0), false), (Some(0.0), false), (Some(4.0), false), (Some(4.0), false)]),
    // The last alone, which is turned away.
    (1.0, [3.5, 0.5, 0.0], [(Some(0.0), false), (None, false), (None, false), (Some(5.0), false)]),
    (1.0, [9.0, 0.0, 0.0], [(None, false), (None, false), (None, false), (None, false)]),
    // Back from behind the last, whose front this is.
    (-1.0, [3.5, 0.5, 7.0], [(Some(0.0), false), (Some(0.0), false), (Some(2.0), false), (Some(2.0), false)]),
];

#[test]
fn known_rays_have_known_answers() {
    let Some(context) = testing::tracing_context() else { return };
    let scene = squares();
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let mut queries = RayQueries::new(&context, &scene, &tree).unwrap();
    // A ray of each group, and a group that is not full.
    for (number, asked) in QUESTIONS.into_iter().enumerate() {
        for (along, origin, known) in KNOWN {
            let (found, _) = queries.trace(&[origin], &[[0.0, 0.0, along]], asked).unwrap();
            let (t, open) = known[number];
            let [answer] = found[..] else { panic!("{found:?}") };
            assert_eq!(
                (answer.hit, answer.open),
                (t.is_some(), open),
                "{asked:?} from {origin:?}: {answer:?}"
            );
            if let (Some(t), true) = (t, number > 1) {
                assert!((answer.t - t).abs() < 1e-5, "{asked:?} from {origin:?}: {answer:?}");
                let triangle = tree.order[answer.triangle as usize].triangle as usize;
                let z = scene.mesh.positions[scene.mesh.triangles[triangle][0] as usize].z;
                assert!((origin[2] + along * answer.t - z).abs() < 1e-5, "{answer:?} is not at {z}");
            }
        }
        let origins = KNOWN.map(|(_, origin, _)| origin);
        let directions: Vec<[f32; 3]> =
            (0..5 * GROUP + 1).map(|ray| [0.0, 0.0, KNOWN[ray / GROUP].0]).collect();
        let (found, _) = queries.trace(&origins, &directions, asked).unwrap();
        assert_eq!(found.len(), directions.len());
        for (ray, answer) in found.iter().enumerate() {
            assert_eq!(answer.hit, KNOWN[ray / GROUP].2[number].0.is_some(), "{asked:?}, ray {ray}");
        }
    }
    testing::assert_valid(&context);
}

#[test]
fn a_scene_of_nothing_is_missed() {
    let Some(context) = testing::tracing_context() else { return };
    let scene = Scene::default();
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let mut queries = RayQueries::new(&context, &scene, &tree).unwrap();
    let (found, _) = queries.trace(&[[0.0; 3]], &[[0.0, 0.0, 1.0]], Asked::Nearest).unwrap();
    assert!(!found[0].hit && !found[0].open, "{found:?}");
    testing::assert_valid(&context);
}

#[test]
fn a_context_without_ray_queries_is_refused() {
    let Some(context) = testing::context() else { return };
    let scene = squares();
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let refused = RayQueries::new(&context, &scene, &tree).unwrap_err().to_string();
    assert!(refused.contains("open it with ContextOptions::ray_queries"), "{refused}");
}
