//! Devices that have begun with both eyes at once.

use std::sync::Arc;

use foveate::config::{Config, Indirect, Method, Samples, Stereo};
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::math::view::FieldOfView;
use glam::DVec2;

use super::hands::{Failing, Fault, Release};

fn eyes(loaded: &Loaded) -> Plan {
    let head = super::plan(loaded).views[0].0.world_from_eye;
    let fov = FieldOfView::symmetric(50f64.to_radians(), 1.0);
    Plan::stereo(parallel_eyes(head, 0.064, fov, 96, 96), Stereo::PerEye).unwrap()
}

fn config() -> Config {
    let mut config = super::config(Method::Guided);
    config.foveation.samples = Samples::Count(1500);
    // Who does another's part of the first eye has brought light to its cache for the second one already.
    config.trace.indirect = Indirect::Paths;
    config
}

/// Pictures of three frames, the last with another gaze, and each device's samples in them.
fn pictures(renderer: &mut Renderer, plan: &Plan) -> Vec<(Vec<u8>, Vec<u64>)> {
    let frame = |frame: u32| {
        let gaze = DVec2::new(if frame < 2 { 0.5 } else { 0.3 }, 0.6);
        let report = renderer.frame(plan, &[gaze; 2], frame).unwrap();
        let samples: Vec<u64> = report.devices.iter().map(|device| device.samples).collect();
        assert_eq!(samples.iter().sum::<u64>(), report.samples as u64);
        (renderer.picture().unwrap(), samples)
    };
    (0..3).map(frame).collect()
}

/// A device that fails, or hangs, with the first eye leaves the second one undone too, which it was told of; one that
/// has done the first fails with the second. Either way the other does what is left in the same frame.
#[test]
fn a_device_that_fails_with_either_eye_leaves_no_hole() {
    let Some((info, context)) = super::machine() else { return };
    let Some(parts) = super::halves(&info) else { return };
    let loaded = super::town();
    let (scene, plan, config) = (super::data(&loaded), eyes(&loaded), config());
    let alone = Device::open(&info).unwrap();
    let mut alone = Renderer::new(&alone, &context, &loaded, &config, Output::Display).unwrap().0;
    let truth = pictures(&mut alone, &plan);
    assert!(truth[0].0.iter().any(|&byte| byte > 100) && truth[1].0 != truth[2].0);
    for (fault, after) in [(Fault::Error, 2), (Fault::Error, 3), (Fault::Hang, 2), (Fault::Hang, 3)] {
        let release = Arc::new(Release::default());
        let released = release.clone();
        let sound = super::opener(&parts[0], &scene, |worker, _| Box::new(worker));
        let failing = super::opener(&parts[1], &scene, move |worker, times| {
            let (fault, release) = ((times == 0).then_some(fault), released.clone());
            Box::new(Failing { worker, fault, after, release })
        });
        let mut renderer = super::with_scheduler(vec![sound, failing], &context, &loaded, &config);
        let found = pictures(&mut renderer, &plan);
        assert!(found.iter().zip(&truth).all(|(found, truth)| found.0 == truth.0), "{fault:?}, {after}");
        let [first, second] = [&found[0].1, &found[1].1];
        assert!(first[0] > 0 && first[1] > 0, "{fault:?}, {after}: {first:?}");
        assert_eq!(second[1] > 0, after == 3, "{fault:?}, {after}: {second:?}");
        release.now();
    }
    assert_eq!(context.validation_messages(), Vec::<String>::new());
}
