//! The wearer's hands in the scene: seen, mirrored, with shadows, and gone without a trace where they are not tracked.

use std::path::Path;

use foveate::config::{Config, Indirect, Method, Samples};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::hands::{Aim, HandPlaces, Met};
use foveate::scene::sky::Sky;
use glam::{DQuat, DVec3};
use serde_json::json;

use crate::common::builder::Builder;
use crate::{HEIGHT, WIDTH, are_the_same_on_two_devices, config, machine};

/// Where the right hand is.
const HAND: DVec3 = DVec3::new(0.0, 0.6, 0.0);

/// A floor: white, or a mirror.
fn floor(folder: &Path, mirror: bool) -> std::path::PathBuf {
    let mut builder = Builder::new();
    let finish = match mirror {
        true => json!({ "roughnessFactor": 0.02 }),
        false => json!({ "metallicFactor": 0.0 }),
    };
    let material = builder.push("materials", json!({ "pbrMetallicRoughness": finish }));
    let positions = builder.floats(&[[-9.0, 0.0, -9.0], [-9.0, 0.0, 9.0], [9.0, 0.0, 9.0], [9.0, 0.0, -9.0]]);
    let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
    let attributes = json!({ "POSITION": positions });
    builder.place(json!({ "attributes": attributes, "indices": indices, "material": material }), json!({}));
    builder.write_glb(folder)
}

pub fn view() -> View {
    let world_from_eye = Pose::look_at(DVec3::new(0.0, 1.6, 1.6), DVec3::new(0.0, 0.2, 0.0));
    let fov = FieldOfView::symmetric(50f64.to_radians(), f64::from(WIDTH) / f64::from(HEIGHT));
    View { world_from_eye, fov, width: WIDTH, height: HEIGHT, spacing: Default::default() }
}

/// The place of a point's pixel among all.
fn pixel(point: DVec3) -> usize {
    let view = view();
    let seen = view.world_from_eye.inverse().transform_point(point);
    let (x, y) = (seen.x / -seen.z, seen.y / -seen.z);
    let FieldOfView { left, right, up, down } = view.fov;
    // Fields of view are tangents.
    let across = (x - left) / (right - left) * f64::from(WIDTH);
    let below = (up - y) / (up - down) * f64::from(HEIGHT);
    below as usize * WIDTH as usize + across as usize
}

pub fn settings() -> Config {
    let mut config = config(Method::Guided).without_reuse();
    config.trace.indirect = Indirect::Paths;
    config.foveation.samples = Samples::Full;
    config.foveation.visibility_slope = 0.0;
    (config.environment.sun_elevation, config.environment.sun_azimuth) = (50.0, 120.0);
    config
}

fn held(place: DVec3) -> HandPlaces {
    let grip = Pose { rotation: DQuat::IDENTITY, position: place };
    HandPlaces { grips: [None, Some(grip)], ..HandPlaces::default() }
}

fn seen(renderer: &mut Renderer, hands: &HandPlaces) -> Vec<f32> {
    renderer.show_hands(hands);
    renderer.show_at(0.0);
    renderer.frame(&Plan::mono(view()), &[], 3).unwrap();
    bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec()
}

/// How much darker a place is than in another picture, of green.
fn dimmed(picture: &[f32], plain: &[f32], point: DVec3) -> f32 {
    let at = pixel(point) * 4 + 1;
    picture[at] / plain[at]
}

#[test]
fn controllers_are_seen_throw_shadows_and_are_mirrored() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let sun = Sky { sun_elevation_deg: 50.0, sun_azimuth_deg: 120.0, ..Sky::default() }.sun_direction();
    for mirror in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let path = floor(folder.path(), mirror);
        let config = settings();
        let renderer =
            |loaded: &Loaded| Renderer::new(&device, &context, loaded, &config, Output::Radiance).unwrap().0;
        let (worn, bare) = (
            Loaded::worn_from_file(&path, &config).unwrap(),
            Loaded::moving_from_file(&path, &config).unwrap(),
        );
        assert!(worn.scene.motion.is_some() && bare.scene.motion.is_none());
        let (mut worn, mut bare) = (renderer(&worn), renderer(&bare));
        let nothing = seen(&mut bare, &HandPlaces::default());
        assert!(seen(&mut worn, &HandPlaces::default()) == nothing, "what is not tracked leaves a trace");
        let picture = seen(&mut worn, &held(HAND));
        // A mirror shows a dark sky, which what is dark does not make darker.
        let is_there = |picture: &[f32], point: DVec3| {
            let dimmed = dimmed(picture, &nothing, point);
            if mirror { (dimmed - 1.0).abs() > 0.1 } else { dimmed < 0.6 }
        };
        assert!(is_there(&picture, HAND));
        // On the floor where the sun throws it; in a mirror as far below the floor.
        let there = if mirror { HAND * DVec3::new(1.0, -1.0, 1.0) } else { HAND - sun * (HAND.y / sun.y) };
        assert!(is_there(&picture, there), "{mirror}: {}", dimmed(&picture, &nothing, there));
        let beside = dimmed(&picture, &nothing, there + DVec3::X * 0.3);
        assert!((0.9..1.1).contains(&beside), "{mirror}: {beside}");
        // Elsewhere, and gone again; a place that is none is nowhere.
        let moved = seen(&mut worn, &held(HAND + DVec3::X * 0.4));
        assert!(is_there(&moved, HAND + DVec3::X * 0.4));
        assert!((0.8..1.2).contains(&dimmed(&moved, &nothing, HAND)));
        let lost = held(DVec3::NAN);
        assert!(seen(&mut worn, &lost) == nothing);
    }
}

#[test]
fn the_ray_and_the_spot_of_who_aims_are_seen() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let config = settings();
    let loaded = Loaded::worn_from_file(&floor(folder.path(), false), &config).unwrap();
    let mut renderer = Renderer::new(&device, &context, &loaded, &config, Output::Radiance).unwrap().0;
    let nothing = seen(&mut renderer, &HandPlaces::default());
    let target = DVec3::new(0.3, 0.0, -0.3);
    let aiming = |can_go| {
        let met = Some(Met { point: target, normal: DVec3::Y, can_stand: can_go });
        HandPlaces { aim: Some(Aim { hand: Pose::look_at(HAND, target), met }), ..HandPlaces::default() }
    };
    let blue = |picture: &[f32], point: DVec3| {
        let at = pixel(point) * 4;
        picture[at + 2] / picture[at]
    };
    let ring = target + DVec3::new(0.18, 0.005, 0.0);
    let (go, stay) = (seen(&mut renderer, &aiming(true)), seen(&mut renderer, &aiming(false)));
    assert!(blue(&go, ring) > 2.0 * blue(&nothing, ring), "{}", blue(&go, ring));
    assert!(blue(&stay, ring) < 1.5 * blue(&nothing, ring), "a spot where nobody can go");
    let changed = |picture: &[f32]| picture.iter().zip(&nothing).filter(|(a, b)| *a != *b).count();
    assert!(changed(&stay) > 40 && changed(&go) > changed(&stay) + 40);
}

#[test]
fn pictures_with_hands_do_not_depend_on_how_they_are_split() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(Method::Guided);
    let loaded = Loaded::worn_from_file(&floor(folder.path(), false), &config).unwrap();
    let show = |renderer: &mut Renderer, frame: u32| {
        let place = HAND + DVec3::X * (0.1 * f64::from(frame));
        renderer.show_hands(&if frame == 0 { HandPlaces::default() } else { held(place) });
        renderer.show_at(f64::from(frame) * 0.01);
    };
    are_the_same_on_two_devices(&loaded, &config, &Plan::mono(view()), show);
}
