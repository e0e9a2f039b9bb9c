//! Several devices that share frames: the same picture however it is split, and none with a hole in it.

#[path = "../common/mod.rs"]
mod common;
mod day;
mod eyes;
mod grabs;
mod hands;
mod moving;
mod painted;
mod slow;
mod worn;

use std::sync::Arc;
use std::time::Duration;

use foveate::config::{Config, Method, Samples};
use foveate::error::Error;
use foveate::frame::{FrameReport, Loaded, Output, Plan, Renderer, Scheduler};
use foveate::gpu::interop::{self, Sharing};
use foveate::gpu::opencl::{Device, DeviceInfo, device};
use foveate::gpu::vulkan::Context;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::generate::voxel_town;
use foveate::trace::{DeviceWorker, Fleet, Opener, SceneData, Traversal, Traversals, Worker};
use glam::{DVec2, DVec3};

use hands::{Failing, Fault, Release};
use slow::Slow;

const WIDTH: u32 = 200;
const HEIGHT: u32 = 120;

/// The first usable OpenCL device and the presenting one; says so where one is missing. On machines that
/// promise them (CI=true) that is a failure.
fn machine() -> Option<(DeviceInfo, Context)> {
    let context = common::vulkan()?;
    let Some(info) = device::list().into_iter().find(|d| d.unusable.is_none()) else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no OpenCL device");
        println!("not run: no OpenCL device");
        return None;
    };
    Some((info, context))
}

/// Two halves of a device with at least two compute units, which run at the same time.
fn halves(info: &DeviceInfo) -> Option<Vec<Device>> {
    let half = info.compute_units / 2;
    match device::subdivide(info, &[half, half]) {
        Ok(parts) => Some(parts.iter().map(|part| Device::open(part).unwrap()).collect()),
        Err(error) => {
            println!("not run: {error}");
            None
        }
    }
}

/// Five frames that one device has traced are those that its halves have, to the bit, and change. `show` brings a renderer
/// to a frame.
fn are_the_same_on_two_devices(
    loaded: &Loaded,
    config: &Config,
    plan: &Plan,
    show: impl Fn(&mut Renderer, u32),
) {
    let Some((info, context)) = machine() else { return };
    let Some(parts) = halves(&info) else { return };
    let pictures = |devices: &[Device]| {
        let made = Renderer::with_devices(devices, &context, loaded, config, Output::Display);
        let mut renderer = made.unwrap().0;
        let frames = (0..5u32).map(|frame| {
            show(&mut renderer, frame);
            let report = renderer.frame(plan, &[], frame).unwrap();
            assert!(report.devices.iter().all(|device| device.samples > 0));
            renderer.picture().unwrap()
        });
        frames.collect::<Vec<_>>()
    };
    let (one, two) = (pictures(&[Device::open(&info).unwrap()]), pictures(&parts));
    assert!(one[1] != one[4], "nothing has moved");
    for (frame, (one, two)) in one.iter().zip(&two).enumerate() {
        assert!(one == two, "frame {frame} differs");
    }
}

fn town() -> Loaded {
    Loaded::from_glb("town", &voxel_town::generate(20_000, 1).unwrap(), &Config::default()).unwrap()
}

fn plan(loaded: &Loaded) -> Plan {
    let (low, high) = loaded.scene.mesh.bounds().unwrap();
    let (low, high) = (low.as_dvec3() + loaded.scene.anchor, high.as_dvec3() + loaded.scene.anchor);
    let middle = (low + high) * 0.5;
    let world_from_eye = Pose::look_at(middle + (high - low) * DVec3::new(0.45, 0.4, 0.55), middle);
    let fov = FieldOfView::symmetric(50f64.to_radians(), f64::from(WIDTH) / f64::from(HEIGHT));
    Plan::mono(View { world_from_eye, fov, width: WIDTH, height: HEIGHT, spacing: Default::default() })
}

fn config(method: Method) -> Config {
    let mut config = Config::default();
    config.reconstruction.method = method;
    config.foveation.samples = Samples::Count(4000);
    // Rays that fall off: at the usual slope so few pixels would all have theirs.
    config.foveation.visibility_slope = 0.2;
    config.trace.rays = 16;
    // One device alone would send fewer in motion than several.
    config.time.rays_in_motion = 1.0;
    config
}

fn data(loaded: &Loaded) -> Arc<SceneData> {
    Arc::new(SceneData::pack(&loaded.scene, &loaded.bvh, &loaded.environment).unwrap())
}

/// A hand that is opened as the fleet opens its own, inside a wrapper.
fn opener(
    device: &Device,
    data: &Arc<SceneData>,
    wrap: impl Fn(DeviceWorker, u32) -> Box<dyn Worker> + Send + 'static,
) -> (String, Opener) {
    let (device, data) = (device.clone(), data.clone());
    let name = device.info().name.clone();
    (
        name,
        Box::new(move |times| {
            Ok(wrap(DeviceWorker::new(&device, &data, Traversal::for_device(&device).into(), false)?, times))
        }),
    )
}

/// Frames with a gaze that moves now and then, so that patterns are made anew.
fn pictures(renderer: &mut Renderer, plan: &Plan, frames: u32) -> Vec<(Vec<u8>, FrameReport)> {
    (0..frames)
        .map(|frame| {
            let gaze = DVec2::new(if frame < 2 { 0.5 } else { 0.2 }, 0.6);
            let report = renderer.frame(plan, &[gaze], frame).unwrap();
            assert_eq!(report.devices.iter().map(|d| d.samples).sum::<u64>(), report.samples as u64);
            (renderer.picture().unwrap(), report)
        })
        .collect()
}

/// Pictures of one device are the truth.
fn alone(device: &Device, context: &Context, loaded: &Loaded, config: &Config, frames: u32) -> Vec<Vec<u8>> {
    let mut renderer = Renderer::new(device, context, loaded, config, Output::Display).unwrap().0;
    let made = pictures(&mut renderer, &plan(loaded), frames);
    assert!(made[0].0.iter().any(|&byte| byte > 100) && made[0].0 != made[1].0);
    made.into_iter().map(|(picture, _)| picture).collect()
}

fn with_scheduler(
    openers: Vec<(String, Opener)>,
    context: &Context,
    loaded: &Loaded,
    config: &Config,
) -> Renderer {
    let scheduler = Scheduler::new(Fleet::new(openers).unwrap(), None);
    Renderer::with_scheduler(scheduler, context, loaded, config, Output::Display).unwrap().0
}

#[test]
fn pictures_do_not_depend_on_how_they_are_split() {
    let Some((info, context)) = machine() else { return };
    let Some(parts) = halves(&info) else { return };
    let whole = Device::open(&info).unwrap();
    let loaded = town();
    let scene = data(&loaded);
    for method in [Method::Guided, Method::KNearest] {
        let config = config(method);
        let truth = alone(&whole, &context, &loaded, &config, 4);

        let made = Renderer::with_devices(&parts, &context, &loaded, &config, Output::Display);
        let mut equal = made.unwrap().0;
        assert!(equal.take_notes().is_empty());
        let found = pictures(&mut equal, &plan(&loaded), 4);
        // Both took part, and the first one wrote in place, if it can.
        assert!(found.iter().all(|(_, report)| report.devices.iter().all(|d| d.samples > 0)));
        let direct = interop::probe(&parts[0], &context) == Sharing::ZeroCopy;
        assert_eq!(equal.sharing() == Sharing::ZeroCopy, direct);
        assert!(found.iter().zip(&truth).all(|((picture, _), truth)| picture == truth), "{method:?}, equal");

        let slow = opener(&parts[1], &scene, |worker, _| Box::new(Slow { worker, times: 4 }));
        let fast = opener(&parts[0], &scene, |worker, _| Box::new(worker));
        let mut unequal = with_scheduler(vec![fast, slow], &context, &loaded, &config);
        let found = pictures(&mut unequal, &plan(&loaded), 4);
        let last = &found[3].1.devices;
        println!("{method:?}: shares of a device and one four times as slow: {last:?}");
        assert!(last.iter().all(|d| d.samples > 0) && last[0].samples != last[1].samples);
        assert!(
            found.iter().zip(&truth).all(|((picture, _), truth)| picture == truth),
            "{method:?}, unequal"
        );
    }
    assert_eq!(context.validation_messages(), Vec::<String>::new());
}

/// Devices of one fleet may walk the tree in different ways: hits are the same, edges' among them, and only
/// rounding tells the pictures apart.
#[test]
fn devices_with_different_kernels_share_a_picture() {
    let Some((info, context)) = machine() else { return };
    let Some(parts) = halves(&info) else { return };
    let loaded = town();
    let scene = data(&loaded);
    let config = config(Method::Guided);
    let truth = alone(&Device::open(&info).unwrap(), &context, &loaded, &config, 2);
    let walking: Vec<_> = parts.into_iter().zip(Traversal::ALL.map(Traversals::from)).collect();
    let fleet = Fleet::of_devices(&walking, &scene, false).unwrap();
    let made =
        Renderer::with_scheduler(Scheduler::new(fleet, None), &context, &loaded, &config, Output::Display);
    let found = pictures(&mut made.unwrap().0, &plan(&loaded), 2);
    for ((picture, report), truth) in found.iter().zip(&truth) {
        assert!(report.devices.iter().all(|d| d.samples > 0));
        let apart = |limit: u8| picture.iter().zip(truth).filter(|(a, b)| a.abs_diff(**b) > limit).count();
        println!("of {} bytes {} differ, {} by more than 4", truth.len(), apart(0), apart(4));
        assert!(apart(4) <= truth.len() / 1000);
    }
}

/// A device that fails, or hangs, in the middle of a run: its part is done by the other in the same frame,
/// and it comes back.
#[test]
fn a_failing_device_leaves_no_hole_and_comes_back() {
    let Some((info, context)) = machine() else { return };
    let Some(parts) = halves(&info) else { return };
    let loaded = town();
    let scene = data(&loaded);
    let config = config(Method::Guided);
    let truth = alone(&Device::open(&info).unwrap(), &context, &loaded, &config, 4);
    for (fault, note) in [(Fault::Error, "out of paper"), (Fault::Hang, "does not answer")] {
        let sound = opener(&parts[0], &scene, |worker, _| Box::new(worker));
        let release = Arc::new(Release::default());
        let released = release.clone();
        let failing = opener(&parts[1], &scene, move |worker, times| {
            let (fault, release) = ((times == 0).then_some(fault), released.clone());
            Box::new(Failing { worker, fault, after: 2, release })
        });
        let mut renderer = with_scheduler(vec![sound, failing], &context, &loaded, &config);
        let found = pictures(&mut renderer, &plan(&loaded), 4);
        assert!(found.iter().zip(&truth).all(|((picture, _), truth)| picture == truth), "{fault:?}");
        let samples: Vec<u64> = found.iter().map(|(_, report)| report.devices[1].samples).collect();
        assert!(samples[0] > 0 && samples[1] > 0 && samples[2] == 0, "{fault:?}: {samples:?}");
        let mut notes = renderer.take_notes();
        assert!(notes.iter().any(|n| n.contains(note)), "{notes:?}");
        // It is tried again until it takes part: frames go on meanwhile.
        release.now();
        let plan = plan(&loaded);
        let back = (0..2000).any(|_| renderer.frame(&plan, &[], 1).unwrap().devices[1].samples > 0);
        assert!(back, "{fault:?}: it never came back");
        notes.extend(renderer.take_notes());
        assert!(notes.iter().any(|n| n.contains("again")), "{notes:?}");
    }
}

/// The only device hangs: a frame that may wait does so until it answers; one that may not fails soon, leaves the
/// picture as it was, and the next ones find the device once it is back.
#[test]
fn the_only_device_is_waited_for_or_its_picture_held() {
    let Some((info, context)) = machine() else { return };
    let loaded = town();
    let scene = data(&loaded);
    let config = config(Method::Guided);
    let device = Device::open(&info).unwrap();
    let truth = alone(&device, &context, &loaded, &config, 4);
    let hanging = |release: &Arc<Release>| {
        let release = release.clone();
        let failing = opener(&device, &scene, move |worker, times| {
            let fault = (times == 0).then_some(Fault::Hang);
            Box::new(Failing { worker, fault, after: 2, release: release.clone() })
        });
        with_scheduler(vec![failing], &context, &loaded, &config)
    };
    let release = Arc::new(Release::default());
    let mut renderer = hanging(&release);
    let after = release.clone();
    let back = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_secs(5));
        after.now();
    });
    let found = pictures(&mut renderer, &plan(&loaded), 4);
    assert!(found.iter().zip(&truth).all(|((picture, _), truth)| picture == truth));
    back.join().unwrap();

    let release = Arc::new(Release::default());
    let (mut renderer, plan) = (hanging(&release), plan(&loaded));
    renderer.set_comeback(Duration::from_millis(100));
    pictures(&mut renderer, &plan, 2);
    let held = renderer.picture().unwrap();
    let gaze = [DVec2::new(0.2, 0.6)];
    for _ in 0..3 {
        let error = renderer.frame(&plan, &gaze, 2).unwrap_err();
        assert!(matches!(error, Error::NoDevice { kind: "OpenCL", .. }), "{error}");
        assert!(error.to_string().contains("none is left to trace with"), "{error}");
        assert!(renderer.picture().unwrap() == held);
    }
    release.now();
    let back = (0..600).find_map(|_| renderer.frame(&plan, &gaze, 3).ok());
    assert_eq!(back.expect("it comes back").samples, 4000);
    assert!(renderer.picture().unwrap() != held);
    let notes = renderer.take_notes();
    assert!(notes.iter().any(|note| note.contains("answers again")), "{notes:?}");
}

/// A scene that does not fit a device leaves it out with a sentence; where it fits none, that is the error.
#[test]
fn devices_that_cannot_be_used_are_left_out_with_a_sentence() {
    let Some((info, context)) = machine() else { return };
    let loaded = town();
    let scene = data(&loaded);
    let device = Device::open(&info).unwrap();
    let mut small = info.clone();
    (small.memory, small.name) = (1 << 20, "a small one".into());
    let small = Device::open(&small).unwrap();
    let config = config(Method::KNearest);
    let made = Renderer::with_devices(&[device, small.clone()], &context, &loaded, &config, Output::Display);
    let mut renderer = made.unwrap().0;
    let notes = renderer.take_notes();
    assert!(notes.len() == 1 && notes[0].starts_with("a small one: the scene needs"), "{notes:?}");
    let found = pictures(&mut renderer, &plan(&loaded), 1);
    assert_eq!(found[0].1.devices[1].samples, 0);
    let error =
        Fleet::of_devices(&[(small, Traversal::Packet.into())], &scene, false).err().unwrap().to_string();
    assert!(error.contains("a small one: the scene needs"), "{error}");
}
