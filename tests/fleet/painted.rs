//! Materials that change: each frame shows those of its instant.

use foveate::config::{Config, Indirect, Method, Samples};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use glam::DVec3;

use crate::common::painted::painted;
use crate::{HEIGHT, WIDTH, are_the_same_on_two_devices, config, machine};

fn plan() -> Plan {
    let world_from_eye = Pose::look_at(DVec3::new(0.0, 3.0, 9.0), DVec3::new(0.0, 1.5, 0.0));
    let fov = FieldOfView::symmetric(60f64.to_radians(), f64::from(WIDTH) / f64::from(HEIGHT));
    Plan::mono(View { world_from_eye, fov, width: WIDTH, height: HEIGHT, spacing: Default::default() })
}

fn settings(time: f64) -> Config {
    let mut config = config(Method::KNearest).without_reuse();
    (config.trace.indirect, config.trace.rays) = (Indirect::Paths, 64);
    config.foveation.samples = Samples::Full;
    // Night, so that the lamp matters.
    config.environment.sun_elevation = -8.0;
    config.scene.time = time;
    config
}

fn mean(picture: &[f32]) -> [f64; 3] {
    let channel = |c: usize| picture.iter().skip(c).step_by(4).map(|&v| f64::from(v)).sum::<f64>();
    [0, 1, 2].map(|c| channel(c) / (picture.len() / 4) as f64)
}

#[test]
fn frames_show_the_materials_of_their_instant() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = painted().write_glb(folder.path());
    let seen = |renderer: &mut Renderer| -> Vec<f32> {
        renderer.frame(&plan(), &[], 3).unwrap();
        bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec()
    };
    let loaded = Loaded::moving_from_file(&path, &settings(0.0)).unwrap();
    let mut moving = Renderer::new(&device, &context, &loaded, &settings(0.0), Output::Radiance).unwrap().0;
    let mut before = [0.0; 3];
    for time in [0.0, 0.6, 1.9, 1.0] {
        moving.show_at(time);
        let picture = seen(&mut moving);
        let loaded = Loaded::from_file(&path, &settings(time)).unwrap();
        let mut still =
            Renderer::new(&device, &context, &loaded, &settings(time), Output::Radiance).unwrap().0;
        let truth = seen(&mut still);
        let (is, should) = (mean(&picture), mean(&truth));
        for (is, should) in is.iter().zip(should) {
            assert!((is / should - 1.0).abs() < 0.02, "{time}: {is} is not {should}");
        }
        // Place by place: where the texture lies, and what covers what.
        let off: f64 = picture.iter().zip(&truth).map(|(a, b)| f64::from((a - b).abs().min(1.0))).sum();
        let all: f64 = truth.iter().map(|&v| f64::from(v.min(1.0))).sum();
        assert!(off < 0.15 * all, "{time}: {off} of {all}");
        assert!(before != is);
        before = is;
    }
}

#[test]
fn pictures_of_changing_materials_do_not_depend_on_how_they_are_split() {
    let folder = tempfile::tempdir().unwrap();
    let path = painted().write_glb(folder.path());
    let config = config(Method::Guided);
    let loaded = Loaded::moving_from_file(&path, &config).unwrap();
    let show = |renderer: &mut Renderer, frame| renderer.show_at(f64::from(frame) * 0.5);
    are_the_same_on_two_devices(&loaded, &config, &plan(), show);
}
