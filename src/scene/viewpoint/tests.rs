use glam::{DVec2, Vec3};

use super::*;
use crate::math::view::{FieldOfView, View};

/// Adds a quad with its corners counter-clockwise seen from the front.
fn quad(scene: &mut Scene, corners: [[f32; 3]; 4]) {
    let first = scene.mesh.positions.len() as u32;
    scene.mesh.positions.extend(corners.map(Vec3::from));
    for triangle in [[0, 1, 2], [0, 2, 3]] {
        scene.mesh.triangles.push(triangle.map(|i| first + i));
    }
}

/// A floor or, facing down, a ceiling.
fn slab(scene: &mut Scene, low: [f32; 2], high: [f32; 2], y: f32, up: bool) {
    let mut corners =
        [[low[0], y, low[1]], [low[0], y, high[1]], [high[0], y, high[1]], [high[0], y, low[1]]];
    if !up {
        corners.reverse();
    }
    quad(scene, corners);
}

/// A closed box whose fronts look outwards.
fn block(scene: &mut Scene, low: [f32; 3], high: [f32; 3]) {
    let ([a, b, c], [x, y, z]) = (low, high);
    slab(scene, [a, c], [x, z], y, true);
    slab(scene, [a, c], [x, z], b, false);
    quad(scene, [[a, b, z], [x, b, z], [x, y, z], [a, y, z]]);
    quad(scene, [[x, b, c], [a, b, c], [a, y, c], [x, y, c]]);
    quad(scene, [[x, b, z], [x, b, c], [x, y, c], [x, y, z]]);
    quad(scene, [[a, b, c], [a, b, z], [a, y, z], [a, y, c]]);
}

/// A floor of 30 m by 18 m with walls around it.
fn courtyard() -> Scene {
    let mut scene = Scene::default();
    slab(&mut scene, [-15.0, -9.0], [15.0, 9.0], 0.0, true);
    block(&mut scene, [-16.0, 0.0, -10.0], [-15.0, 12.0, 10.0]);
    block(&mut scene, [15.0, 0.0, -10.0], [16.0, 12.0, 10.0]);
    block(&mut scene, [-16.0, 0.0, -10.0], [16.0, 12.0, -9.0]);
    block(&mut scene, [-16.0, 0.0, 9.0], [16.0, 12.0, 10.0]);
    scene
}

/// A heightmap of 33 x 33 points over that many metres.
fn terrain(side: f32, height: impl Fn(f32, f32) -> f32) -> Scene {
    let mut scene = Scene::default();
    let at = |i: u32| (i as f32 / 32.0 - 0.5) * side;
    for z in 0..33 {
        scene.mesh.positions.extend((0..33).map(|x| Vec3::new(at(x), height(at(x), at(z)), at(z))));
    }
    for i in (0..32 * 33).filter(|i| i % 33 != 32) {
        scene.mesh.triangles.extend([[i, i + 33, i + 34], [i, i + 34, i + 1]]);
    }
    scene
}

fn forward(viewpoint: Viewpoint) -> DVec3 {
    viewpoint.world_from_eye.rotation * DVec3::NEG_Z
}

fn camera(name: &str, x: f64, fov_y: Option<f64>) -> Camera {
    let world_from_eye = Pose { position: DVec3::X * x, ..Pose::IDENTITY };
    Camera { name: name.into(), world_from_eye, fov_y, half_height: None }
}

#[test]
fn a_thing_on_an_open_floor_is_in_sight() {
    let mut scene = Scene::default();
    slab(&mut scene, [-6.0, -6.0], [6.0, 6.0], -1.0, true);
    block(&mut scene, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]);
    let found = default_viewpoint(&scene, 70.0);
    let to_thing = (scene.anchor - found.world_from_eye.position).normalize();
    assert!(forward(found).dot(to_thing) > 0.9, "{found:?}");
}

#[test]
fn the_camera_that_is_asked_for_comes_before_all() {
    let mut scene = courtyard();
    scene.cameras = vec![camera("viewer", 1.0, Some(0.7)), camera("b", 2.0, Some(0.8))];
    scene.camera = Some(1);
    assert_eq!(default_viewpoint(&scene, 70.0).world_from_eye.position.x, 2.0);
}

#[test]
fn an_orthographic_camera_is_seen_through_from_far_away() {
    let mut scene = courtyard();
    scene.cameras = vec![Camera { half_height: Some(2.0), ..camera("flat", 1.0, None) }];
    let found = default_viewpoint(&scene, 70.0);
    let away = found.world_from_eye.position - DVec3::X;
    assert!(away.truncate().length() < 1e-9 && away.z > 0.0, "{away}");
    // Its frame, where the camera was, fills the picture.
    assert!((away.z * (found.fov_y * 0.5).tan() - 2.0).abs() < 1e-9);
}

#[test]
fn the_files_camera_comes_first() {
    let mut scene = courtyard();
    scene.cameras = vec![camera("flat", 1.0, None), camera("a", 2.0, Some(0.7)), camera("b", 3.0, Some(0.8))];
    let found = default_viewpoint(&scene, 70.0);
    assert_eq!((found.world_from_eye.position.x, found.fov_y), (2.0, 0.7));
    scene.cameras.push(camera("Viewer", 4.0, Some(0.9)));
    let found = default_viewpoint(&scene, 70.0);
    assert_eq!((found.world_from_eye.position.x, found.fov_y), (4.0, 0.9));
    scene.cameras = vec![camera("viewer", 5.0, None), camera("odd", 6.0, Some(f64::NAN))];
    assert!(default_viewpoint(&scene, 70.0).world_from_eye.position.x.abs() < 1e-9);
}

#[test]
fn a_courtyard_is_seen_from_its_floor_along_its_length() {
    let found = default_viewpoint(&courtyard(), 70.0);
    assert!((found.world_from_eye.position - DVec3::Y * 1.65).length() < 1e-9);
    assert!(forward(found).x.abs() > 0.999);
    assert!((found.fov_y - 70f64.to_radians()).abs() < 1e-12);
}

#[test]
fn the_eye_looks_where_there_is_more_room() {
    for (wall, towards) in [(4.0, -1.0), (-4.0, 1.0)] {
        let mut scene = courtyard();
        block(&mut scene, [wall - 0.5, 0.0, -8.0], [wall + 0.5, 5.0, 8.0]);
        let ahead = forward(default_viewpoint(&scene, 70.0)).x;
        assert!(ahead * towards > 0.999, "wall at {wall}: looks at {ahead}");
    }
}

#[test]
fn the_anchor_is_where_the_scene_is() {
    let mut scene = courtyard();
    scene.anchor = DVec3::new(1e7, -300.0, 5e6);
    let there = default_viewpoint(&scene, 70.0).world_from_eye.position;
    assert!((there - scene.anchor - DVec3::Y * 1.65).length() < 1e-8);
}

#[test]
fn a_roofed_courtyard_is_seen_from_under_its_roof() {
    let mut scene = courtyard();
    slab(&mut scene, [-16.0, -10.0], [16.0, 10.0], 11.9, false);
    slab(&mut scene, [-16.0, -10.0], [16.0, 10.0], 12.0, true);
    let eye = default_viewpoint(&scene, 70.0).world_from_eye.position;
    assert!((eye.y - 1.65).abs() < 1e-6, "{eye}");
}

#[test]
fn a_block_in_the_centre_of_a_town_is_stepped_around() {
    let mut scene = Scene::default();
    slab(&mut scene, [-60.0, -60.0], [60.0, 60.0], 0.0, true);
    block(&mut scene, [-8.0, 0.0, -8.0], [8.0, 20.0, 8.0]);
    let eye = default_viewpoint(&scene, 70.0).world_from_eye.position;
    assert!((eye.y - 1.65).abs() < 1e-6 && eye.x.abs().max(eye.z.abs()) > 8.0, "{eye}");
}

/// Checks that the whole bounds are in a square picture, and fill most of it.
fn assert_framed(scene: &Scene, fov_y_deg: f64) {
    let Viewpoint { world_from_eye, fov_y } = default_viewpoint(scene, fov_y_deg);
    let view = View {
        world_from_eye,
        fov: FieldOfView::symmetric(fov_y, 1.0),
        width: 1000,
        height: 1000,
        spacing: Default::default(),
    };
    let (low, high) = scene.mesh.bounds().unwrap();
    let bounds = Bounds { low: low.as_dvec3(), high: high.as_dvec3() };
    let points: Vec<DVec2> = bounds
        .corners()
        .map(|p| view.project(world_from_eye.inverse().transform_point(scene.anchor + p)).unwrap())
        .collect();
    let reach = points.iter().map(|p| (*p - 500.0).abs().max_element()).fold(0.0, f64::max);
    assert!((449.0..=451.0).contains(&reach), "reaches {reach} of 500 from the centre");
    assert!(world_from_eye.position.y > scene.anchor.y + bounds.centre().y, "seen from above");
}

#[test]
fn single_things_of_any_size_are_framed_from_outside() {
    for (scale, fov) in [(1e-6, 70.0), (0.01, 30.0), (1.0, 70.0), (10.0, 100.0), (500.0, 70.0), (1e20, 45.0)]
    {
        let mut scene = Scene { anchor: DVec3::splat(3.0 * f64::from(scale)), ..Scene::default() };
        block(&mut scene, [-scale, 0.0, -scale], [scale, 1.5 * scale, scale * 0.5]);
        assert_framed(&scene, fov);
    }
}

#[test]
fn flat_things_are_framed_from_outside() {
    let mut wall = Scene::default();
    quad(&mut wall, [[-20.0, 0.0, 0.0], [20.0, 0.0, 0.0], [20.0, 8.0, 0.0], [-20.0, 8.0, 0.0]]);
    assert_framed(&wall, 70.0);
    let mut sheet = Scene::default();
    slab(&mut sheet, [-1.0, -1.0], [1.0, 1.0], 0.0, true);
    assert_framed(&sheet, 70.0);
}

#[test]
fn landscapes_are_stood_upon() {
    let flat = default_viewpoint(&terrain(100.0, |_, _| 2.0), 70.0).world_from_eye.position;
    assert!((flat - DVec3::new(0.0, 3.65, 0.0)).length() < 1e-6, "{flat}");
    let hills = |x: f32, z: f32| 5.0 * (x * 0.05).sin() * (z * 0.04).cos();
    let eye = default_viewpoint(&terrain(200.0, hills), 70.0).world_from_eye.position;
    assert!((eye.y - 1.65).abs() < 0.1, "{eye}");
    // A plateau all of which is high: nothing lower is near the centre.
    let plateau = |x: f32, z: f32| if x.abs().max(z.abs()) < 45.0 { 10.0 } else { 0.0 };
    let eye = default_viewpoint(&terrain(100.0, plateau), 70.0).world_from_eye.position;
    assert!((eye.y - 11.65).abs() < 1e-5, "{eye}");
}

#[test]
fn a_scene_too_large_for_metres_raises_the_eye() {
    let scene = terrain(1e6, |_, _| 0.0);
    let eye = default_viewpoint(&scene, 70.0).world_from_eye.position;
    assert!((eye.y / (1e6 * 2f64.sqrt() * 1.65 / 2000.0) - 1.0).abs() < 1e-6, "{eye}");
}

#[test]
fn things_around_an_empty_centre_are_seen_from_among_them() {
    let mut scene = Scene::default();
    for (x, z) in [(-10.0, -10.0), (10.0, -10.0), (-10.0, 10.0), (10.0, 10.0)] {
        block(&mut scene, [x - 1.0, 0.5, z - 1.0], [x + 1.0, 6.0, z + 1.0]);
    }
    let eye = default_viewpoint(&scene, 70.0).world_from_eye.position;
    assert!((eye - DVec3::Y * 2.15).length() < 1e-6, "{eye}");
}

#[test]
fn degenerate_scenes_and_settings_are_finite() {
    let mut point = Scene::default();
    point.mesh.positions = vec![Vec3::ONE; 3];
    point.mesh.triangles = vec![[0, 1, 2]; 4];
    let mut line = Scene::default();
    line.mesh.positions = vec![Vec3::ZERO, Vec3::X * 50.0, Vec3::X * 100.0];
    line.mesh.triangles = vec![[0, 1, 2]];
    let mut vast = Scene::default();
    block(&mut vast, [-f32::MAX; 3], [f32::MAX; 3]);
    for scene in [Scene::default(), point, line, vast, courtyard()] {
        for fov in [70.0, f64::NAN, f64::INFINITY, 0.0, -10.0, 500.0] {
            let Viewpoint { world_from_eye, fov_y } = default_viewpoint(&scene, fov);
            assert!(world_from_eye.position.is_finite() && world_from_eye.rotation.is_normalized());
            assert!(fov_y > 0.0 && fov_y < std::f64::consts::PI);
        }
    }
    let empty = default_viewpoint(&Scene::default(), 70.0);
    assert_eq!(empty.world_from_eye.position, DVec3::Y * EYE_HEIGHT);
}
