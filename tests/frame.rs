//! Whole frames: from a scene to finished pictures, through the first usable device of each kind.

mod common;

use std::sync::Arc;

use foveate::bvh::WideBvh;
use foveate::config::{Config, ExposureConfig, Indirect, Method, Samples, Stereo, TimeConfig};
use foveate::foveation::BitMask;
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{FrameReport, Loaded, Output, Plan, Renderer, ViewRequest};
use foveate::gpu::interop::{self, Sharing};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, Format, Image};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::Picture;
use foveate::metrics::metric::{Viewing, compare};
use foveate::reconstruct;
use foveate::scene::generate::voxel_town;
use foveate::scene::hands::HandPlaces;
use glam::{DQuat, DVec2, DVec3};

const WIDTH: u32 = 160;
const HEIGHT: u32 = 100;

/// Both devices; says so where one is missing. On machines that promise them (CI=true) that is a failure.
fn machine() -> Option<(Device, Context)> {
    let context = common::vulkan()?;
    let Some(info) = device::list().into_iter().find(|d| d.unusable.is_none()) else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no OpenCL device");
        println!("not run: no OpenCL device");
        return None;
    };
    Some((Device::open(&info).unwrap(), context))
}

fn config(method: Method, samples: Samples, rays: u32) -> Config {
    let mut config = Config::default().without_reuse();
    config.reconstruction.method = method;
    config.foveation.samples = samples;
    config.trace.rays = rays;
    // All pictures have the light of the sky and the sun alone.
    config.trace.indirect = Indirect::Paths;
    config
}

/// Like [`config`], with edges as jagged as those of `full`.
fn jagged(method: Method, samples: Samples, rays: u32) -> Config {
    let mut config = config(method, samples, rays);
    config.trace.edge_rays = 0;
    config
}

/// A small block town under the default sky, `scale` times as large.
fn town(scale: f32) -> Loaded {
    let bytes = voxel_town::generate(20_000, 1).unwrap();
    let mut loaded = Loaded::from_glb("town", &bytes, &Config::default()).unwrap();
    if scale != 1.0 {
        loaded.scene.mesh.positions.iter_mut().for_each(|p| *p *= scale);
        loaded.bvh = WideBvh::build(&loaded.scene.mesh.positions, &loaded.scene.mesh.triangles);
    }
    loaded
}

/// Over the town's corner, looking at its middle.
fn lookout(loaded: &Loaded) -> Pose {
    let (low, high) = loaded.scene.mesh.bounds().unwrap();
    let (low, high) = (low.as_dvec3() + loaded.scene.anchor, high.as_dvec3() + loaded.scene.anchor);
    let middle = (low + high) * 0.5;
    Pose::look_at(middle + (high - low) * DVec3::new(0.45, 0.6, 0.55), middle)
}

fn view(loaded: &Loaded) -> View {
    let fov = FieldOfView::symmetric(50f64.to_radians(), f64::from(WIDTH) / f64::from(HEIGHT));
    View { world_from_eye: lookout(loaded), fov, width: WIDTH, height: HEIGHT, spacing: Default::default() }
}

fn renderer((device, context): &(Device, Context), loaded: &Loaded, config: &Config) -> Renderer {
    Renderer::new(device, context, loaded, config, Output::Radiance).unwrap().0
}

/// The renderer's picture of a plan.
fn picture(renderer: &mut Renderer, plan: &Plan, gaze: &[DVec2]) -> Picture {
    let report = renderer.frame(plan, gaze, 3).unwrap();
    assert_eq!(report.dropped, 0);
    let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&renderer.picture().unwrap());
    Picture::new(plan.width, plan.height, pixels.iter().map(|p| [p[0], p[1], p[2]]).collect()).unwrap()
}

fn psnr(picture: &Picture, reference: &Picture) -> f64 {
    compare(picture, reference, Viewing::default()).unwrap().psnr
}

#[test]
fn both_reconstructions_come_close_to_the_full_picture() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let plan = Plan::mono(view(&loaded));
    let render = |method, samples, plan: &Plan| {
        picture(&mut renderer(&machine, &loaded, &jagged(method, samples, 128)), plan, &[])
    };
    let full = render(Method::KNearest, Samples::Full, &plan);
    let third = Samples::Count((WIDTH * HEIGHT / 3) as usize);
    let found = [
        psnr(&render(Method::Guided, Samples::Full, &plan), &full),
        psnr(&render(Method::Guided, third, &plan), &full),
        psnr(&render(Method::KNearest, third, &plan), &full),
    ];
    println!(
        "PSNR against full: guided full {:.1}, guided {:.1}, k-NN {:.1} dB",
        found[0], found[1], found[2]
    );
    // With a sample in every pixel only the packing of colours is left, and the noise of the sun, which
    // guided pictures look for apart; else k-NN blurs what it skips, and guided reconstruction hardly does.
    assert!(found[0] > 42.0 && found[1] > 40.0 && found[2] > 25.5, "{found:?}");
    // A picture of something else is far away.
    let mut turned = plan.clone();
    turned.views[0].0.world_from_eye.rotation *= DQuat::from_rotation_y(0.1);
    let other = psnr(&render(Method::KNearest, Samples::Full, &turned), &full);
    println!("turned by 0.1 rad: {other:.1} dB");
    assert!(other < 18.0, "{other}");
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

/// A third of the samples and smooth edges are nearer to what many rays a pixel show than a sample in every
/// pixel is.
#[test]
fn smooth_edges_are_worth_more_than_samples() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let plan = Plan::mono(view(&loaded));
    let third = Samples::Count((WIDTH * HEIGHT / 3) as usize);
    let mut full = renderer(&machine, &loaded, &config(Method::KNearest, Samples::Full, 32));
    let naive = picture(&mut full, &plan, &[]);
    full.set_jitter(true);
    let mut sum = vec![[0.0f32; 3]; naive.pixels.len()];
    for seed in 0..32 {
        full.frame(&plan, &[], seed).unwrap();
        let pass: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&full.picture().unwrap());
        for (total, pixel) in sum.iter_mut().zip(pass) {
            (0..3).for_each(|c| total[c] += pixel[c] / 32.0);
        }
    }
    let reference = Picture::new(WIDTH, HEIGHT, sum).unwrap();
    let guided = |config: &Config| picture(&mut renderer(&machine, &loaded, config), &plan, &[]);
    let found = [
        psnr(&naive, &reference),
        psnr(&guided(&jagged(Method::Guided, third, 32)), &reference),
        psnr(&guided(&config(Method::Guided, third, 32)), &reference),
    ];
    println!(
        "PSNR: full {:.1}, guided with jagged edges {:.1}, guided {:.1} dB",
        found[0], found[1], found[2]
    );
    assert!(found[2] > found[0] + 1.0 && found[2] > found[1] + 1.0, "{found:?}");
}

/// Eyes whose fields of view overlap by three quarters, before a town so large that they see the same.
/// Fields of view, sizes, gazes and poses at the ends of what is possible: no sample is dropped, and every pixel is
/// a number.
#[test]
fn extreme_views_give_sound_pictures() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let rest = view(&loaded);
    let Pose { rotation, position } = rest.world_from_eye;
    let wide = |degrees: f64| View { fov: FieldOfView::symmetric(degrees.to_radians(), 1.6), ..rest };
    let at = |rotation: DQuat, position: DVec3| View { world_from_eye: Pose { rotation, position }, ..rest };
    let (middle, outside) = (DVec2::splat(0.5), DVec2::new(-40.0, 900.0));
    let cases = [
        ("1 degree", wide(1.0), middle),
        ("175 degrees", wide(175.0), middle),
        ("175 degrees, gaze far outside", wide(175.0), outside),
        ("one pixel", View { width: 1, height: 1, ..rest }, middle),
        ("one pixel, gaze far outside", View { width: 1, height: 1, ..rest }, outside),
        ("one row", View { height: 1, ..rest }, middle),
        ("gaze far outside", rest, outside),
        ("1e7 m away", at(rotation, position + DVec3::new(1e7, 2e6, -1e7)), middle),
        ("1e30 m away", at(rotation, DVec3::splat(1e30)), middle),
        ("not quite a unit quaternion", at(rotation * 1.0001, position), middle),
    ];
    for method in [Method::Guided, Method::KNearest] {
        let mut renderer = renderer(&machine, &loaded, &config(method, Samples::Count(400), 8));
        let ordinary = picture(&mut renderer, &Plan::mono(rest), &[middle]);
        for (name, view, gaze) in &cases {
            let picture = picture(&mut renderer, &Plan::mono(*view), &[*gaze]);
            assert_eq!(picture.not_finite(), 0, "{method:?}, {name}");
            let light: f64 = picture.pixels.iter().flatten().map(|value| f64::from(*value)).sum();
            assert!(name.contains("away") || light > 0.0, "{method:?}, {name}");
            assert!(picture.pixels.iter().flatten().all(|v| *v >= 0.0), "{method:?}, {name}");
            if name.contains("quaternion") {
                assert!(psnr(&picture, &ordinary) > 30.0, "{method:?}: {}", psnr(&picture, &ordinary));
            }
        }
        // A head that turns by 2000 degrees a second, one frame late.
        let turned = rest
            .world_from_eye
            .then(Pose::new(DQuat::from_rotation_y(2000f64.to_radians() / 60.0), DVec3::ZERO));
        let (late, _) = shown(&mut renderer, &machine.1, rest, None, Some(turned));
        assert_eq!(late.not_finite(), 0);
        // And one that was somewhere else altogether.
        let far = Pose { position: DVec3::splat(1e7), ..turned };
        assert_eq!(shown(&mut renderer, &machine.1, rest, None, Some(far)).0.not_finite(), 0);
    }
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

fn eyes(loaded: &Loaded) -> [View; 2] {
    let fov = FieldOfView { left: -0.5, right: 0.3, up: 0.5, down: -0.5 };
    let [left, right] = parallel_eyes(lookout(loaded), 0.064, fov, 80, HEIGHT);
    [left, View { fov: FieldOfView { left: -0.3, right: 0.5, ..fov }, ..right }]
}

#[test]
fn both_kinds_of_stereo_agree_on_what_is_far_away() {
    let Some(machine) = machine() else { return };
    let loaded = town(1000.0);
    let eyes = eyes(&loaded);
    let mut renderer = renderer(&machine, &loaded, &config(Method::KNearest, Samples::Full, 256));
    let mut render = |stereo| picture(&mut renderer, &Plan::stereo(eyes, stereo).unwrap(), &[]);
    let (apart, shared) = (render(Stereo::PerEye), render(Stereo::Shared));
    let found = psnr(&shared, &apart);
    println!("shared against per-eye: {found:.1} dB");
    assert!(found > 30.0, "{found}");
    // Swapped eyes are noticed.
    let swapped = Picture {
        pixels: apart.pixels.chunks(160).flat_map(|row| [&row[80..], &row[..80]].concat()).collect(),
        ..apart
    };
    let wrong = psnr(&shared, &swapped);
    println!("with swapped eyes: {wrong:.1} dB");
    assert!(wrong < 20.0, "{wrong}");
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

#[test]
fn copied_samples_give_the_same_picture_as_shared_ones() {
    let Some((device, context)) = machine() else { return };
    if interop::probe(&device, &context) != Sharing::ZeroCopy {
        println!("not run: these devices do not share memory");
        return;
    }
    let loaded = town(1.0);
    let plan = Plan::stereo(eyes(&loaded), Stereo::PerEye).unwrap();
    for method in [Method::Guided, Method::KNearest] {
        let config = config(method, Samples::Count(2500), 16);
        let render = |sharing| {
            let made = Renderer::with_sharing(&device, &context, &loaded, &config, Output::Display, sharing);
            let mut renderer = made.unwrap().0;
            assert_eq!(renderer.sharing(), sharing);
            // A moving gaze makes new patterns, some of them in old memory.
            [0.5, 0.1, 0.9].map(|x| {
                renderer.frame(&plan, &[DVec2::new(x, 0.4); 2], 3).unwrap();
                renderer.picture().unwrap()
            })
        };
        let (shared, copied) = (render(Sharing::ZeroCopy), render(Sharing::Staged));
        assert!(shared[0].iter().any(|&byte| byte > 100) && shared[0] != shared[1]);
        assert!(shared == copied, "{method:?}: pictures differ");
    }
    assert_eq!(context.validation_messages(), Vec::<String>::new());
}

/// A view's picture, shown from another pose where one is given.
fn shown(
    renderer: &mut Renderer,
    context: &Context,
    view: View,
    hidden: Option<Arc<BitMask>>,
    from: Option<Pose>,
) -> (Picture, usize) {
    let image = Image::new(context, Format::R32G32B32A32_SFLOAT, view.width, view.height).unwrap();
    let outputs = vec![reconstruct::Output::whole(image.target(), 0.0)];
    let request = ViewRequest { view, gaze: view.optical_centre(), widening: 1.0, hidden, outputs };
    let report = renderer.render_views(&[request], 3, &mut |_| from).unwrap();
    let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&image.read().unwrap());
    let rgb = pixels.iter().map(|p| [p[0], p[1], p[2]]).collect();
    (Picture::new(view.width, view.height, rgb).unwrap(), report.samples)
}

#[test]
fn pictures_shown_from_elsewhere_are_what_is_seen_there() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let traced = view(&loaded);
    let size = (traced.fov.right - traced.fov.left) / f64::from(WIDTH);
    // How far a pose moves the eye and turns it, in pixels; the methods that must follow it.
    for (turn, step, methods) in [
        (12.0, 0.0, &[Method::Guided, Method::KNearest][..]),
        (0.0, 1.5, &[Method::Guided]),
        (-7.0, 1.0, &[Method::Guided]),
    ] {
        let motion = Pose::new(
            DQuat::from_rotation_y(turn * size) * DQuat::from_rotation_x(turn * size * 0.5),
            DVec3::new(step, -0.3 * step, -0.5 * step),
        );
        let there = View { world_from_eye: traced.world_from_eye.then(motion), ..traced };
        for &method in methods {
            let mut renderer = renderer(&machine, &loaded, &config(method, Samples::Full, 32));
            let context = &machine.1;
            let (truth, _) = shown(&mut renderer, context, there, None, None);
            let (stale, _) = shown(&mut renderer, context, traced, None, None);
            let (still, _) = shown(&mut renderer, context, traced, None, Some(traced.world_from_eye));
            let (late, _) = shown(&mut renderer, context, traced, None, Some(there.world_from_eye));
            assert!(psnr(&still, &stale) > 60.0, "a pose that is the same changes nothing");
            let (without, with) = (psnr(&stale, &truth), psnr(&late, &truth));
            let gain = if step == 0.0 { 3.0 } else { 2.0 };
            assert!(with > without + gain, "{method:?} {turn} {step}: {with} dB, {without} without");
        }
    }
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

#[test]
fn hidden_pixels_get_no_samples() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let view = view(&loaded);
    let hidden = Arc::new(BitMask::from_fn(WIDTH, HEIGHT, |x, _| x < WIDTH / 2));
    let mut renderer = renderer(&machine, &loaded, &config(Method::Guided, Samples::Full, 8));
    let (whole, all) = shown(&mut renderer, &machine.1, view, None, None);
    let (half, left) = shown(&mut renderer, &machine.1, view, Some(hidden), None);
    assert_eq!((all, left), (view.pixels(), view.pixels() / 2));
    let seen = |picture: &Picture| {
        let rows = picture.pixels.chunks(WIDTH as usize);
        let right = rows.flat_map(|row| row[WIDTH as usize / 2 + 2..].to_vec()).collect();
        Picture::new(WIDTH / 2 - 2, HEIGHT, right).unwrap()
    };
    assert!(psnr(&seen(&half), &seen(&whole)) > 25.0, "what is seen stays as it is");
}

#[test]
fn frames_at_rest_hold_still_and_a_switch_makes_them_stand_alone() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let alone = config(Method::Guided, Samples::Count(3000), 4);
    let mut together = alone.clone();
    // Pixels as they are: means over pictures hold still by themselves.
    together.time = TimeConfig { pictures: 1, ..TimeConfig::default() };
    let plan = Plan::stereo(eyes(&loaded), Stereo::PerEye).unwrap();
    let frames = |config: &Config, forgets: bool| -> Vec<Picture> {
        let mut renderer = renderer(&machine, &loaded, config);
        let picture = |seed| {
            if forgets {
                renderer.forget();
            }
            renderer.frame(&plan, &[], seed).unwrap();
            let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&renderer.picture().unwrap());
            let rgb = pixels.iter().map(|p| [p[0], p[1], p[2]]).collect();
            Picture::new(plan.width, plan.height, rgb).unwrap()
        };
        (0..12).map(picture).collect()
    };
    let (off, on, forgotten) = (frames(&alone, false), frames(&together, false), frames(&together, true));
    let left = |picture: &Picture| -> Vec<[f32; 3]> {
        picture.pixels.chunks(plan.width as usize).flat_map(|row| row[..row.len() / 2].to_vec()).collect()
    };
    // The first eye has nothing to look up then; the second one has the first.
    assert!(off.iter().zip(&forgotten).all(|(a, b)| left(a) == left(b)), "bit for bit");
    let noise = |frames: &[Picture]| psnr(&frames[11], &frames[10]);
    let (boiling, calm) = (noise(&off), noise(&on));
    println!("from frame to frame: {boiling:.1} dB alone, {calm:.1} dB with reuse");
    assert!(calm > boiling + 12.0, "{boiling} {calm}");
    let truth = frames(&config(Method::Guided, Samples::Count(3000), 512), false);
    let (noisy, settled) = (psnr(&off[11], &truth[11]), psnr(&on[11], &truth[11]));
    println!("to light without noise: {noisy:.1} dB alone, {settled:.1} dB with reuse");
    assert!(settled > noisy + 6.0, "{noisy} {settled}");
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

/// Camera rays fall off with the eye: fewer of them, the same where it looks, and nearly the same picture; not where
/// every pixel is to be right.
#[test]
fn camera_rays_fall_off_outside_of_the_gaze() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let gaze = DVec2::new(0.3, 0.55);
    let plan = Plan::mono(view(&loaded));
    let at = |slope: f64, samples: Samples| {
        let mut config = config(Method::Guided, samples, 32);
        config.foveation.visibility_slope = slope;
        let mut renderer = renderer(&machine, &loaded, &config);
        let rays = renderer.frame(&plan, &[gaze], 3).unwrap().rays;
        let seen = picture(&mut renderer, &plan, &[gaze]);
        (rays, renderer.depths(0), seen)
    };
    let dense = at(0.0, Samples::Count(6000));
    let fewer = at(0.12, Samples::Count(6000));
    let (all, rest) = (u64::from(WIDTH * HEIGHT), dense.0 - u64::from(WIDTH * HEIGHT));
    assert!(
        fewer.0 < dense.0 - all / 4,
        "{} rays, {} and {rest} of light where they do not fall off",
        fewer.0,
        all
    );
    let (mut near, mut far, mut apart) = (0, 0, 0);
    for (index, (&depth, &other)) in dense.1.iter().zip(&fewer.1).enumerate() {
        let (x, y) = (index as u32 % WIDTH, index as u32 / WIDTH);
        let away =
            DVec2::new(f64::from(x), f64::from(y)) - gaze * DVec2::new(f64::from(WIDTH), f64::from(HEIGHT));
        if away.length() < 0.05 * f64::from(WIDTH) {
            assert_eq!(depth, other, "{x} {y}");
            near += 1;
        } else {
            far += 1;
            apart += usize::from((depth - other).abs() > 0.02 * depth.max(other));
        }
    }
    assert!(near > 100 && apart * 5 < far && apart > 20, "{near} {far} {apart}");
    let quality = psnr(&fewer.2, &dense.2);
    println!("{quality:.1} dB between them, {} and {} rays", dense.0, fewer.0);
    assert!(quality > 24.0, "{quality}");
    assert_eq!(at(0.12, Samples::Full).1, at(0.0, Samples::Full).1, "full pictures have all their rays");
    assert_eq!(machine.1.validation_messages(), Vec::<String>::new());
}

/// The overlay shows the samples that are there, each once, the gaze where it is, and rays where they are denser.
#[test]
fn the_overlay_shows_where_samples_gaze_and_rays_are() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let (gaze, size) = (DVec2::new(0.3, 0.55), DVec2::new(f64::from(WIDTH), f64::from(HEIGHT)));
    let plan = Plan::mono(view(&loaded));
    let [sample, ring] = [[0.3, 1.0, 0.2], [1.0, 0.9, 0.1]];
    for (method, slope) in [(Method::KNearest, 0.0), (Method::Guided, 0.0), (Method::Guided, 0.12)] {
        let mut config = config(method, Samples::Count(800), 4);
        config.foveation.visibility_slope = slope;
        let mut shown = |overlay: &str| {
            config.view.overlay = overlay.parse().unwrap();
            picture(&mut renderer(&machine, &loaded, &config), &plan, &[gaze])
        };
        let (plain, samples, rays) = (shown(""), shown("samples"), shown("rays"));
        let marked = samples.pixels.iter().filter(|&&pixel| pixel == sample).count();
        // Pixels at the border that are wider may have their centres beyond it.
        let least = if slope > 0.0 { 740 } else { 796 };
        assert!((least..=800).contains(&marked), "{method:?} {slope}: {marked}");
        let differing = |other: &Picture| -> Vec<DVec2> {
            let at = |i: usize| DVec2::new((i as u32 % WIDTH).into(), (i as u32 / WIDTH).into());
            (0..plain.pixels.len()).filter(|&i| plain.pixels[i] != other.pixels[i]).map(at).collect()
        };
        assert!(differing(&samples).len() <= 800);
        let around = shown("gaze");
        let away = |at: &DVec2| (*at + 0.5 - gaze * size).length();
        let ringed = differing(&around);
        assert!(ringed.len() > 40 && ringed.iter().all(|at| away(at) < 12.0), "{method:?}");
        assert!(around.pixels.contains(&ring));
        // A quarter of the pixels have a line beside them where each has its ray.
        let lines = differing(&rays);
        let (near, far): (Vec<&DVec2>, Vec<&DVec2>) = lines.iter().partition(|at| away(at) < 20.0);
        let far_share = far.len() as f64 / (size.x * size.y - 1257.0);
        assert!((0.15..0.3).contains(&(near.len() as f64 / 1257.0)), "{}", near.len());
        assert_eq!(far_share < 0.2, slope > 0.0, "{method:?} {slope}: {far_share}");
    }
}

/// The mean of each square of so many pixels.
fn shrunk(picture: &Picture, times: u32) -> Picture {
    let (width, height) = (picture.width / times, picture.height / times);
    let mean = |place: u32| {
        let first = (place / width * picture.width + place % width) * times;
        let mut sum = glam::Vec3::ZERO;
        for row in 0..times {
            let start = (first + row * picture.width) as usize;
            sum += picture.pixels[start..start + times as usize]
                .iter()
                .map(|&p| glam::Vec3::from(p))
                .sum::<glam::Vec3>();
        }
        (sum / (times * times) as f32).to_array()
    };
    Picture::new(width, height, (0..width * height).map(mean).collect()).unwrap()
}

/// At rest pictures become means over several, which look all over their pixels, also where each pixel has a ray of its own.
#[test]
fn at_rest_edges_become_smooth_where_each_pixel_has_its_ray() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let mut config = config(Method::Guided, Samples::Count(48_000), 32);
    config.foveation.visibility_slope = 0.0;
    let fine = Plan::mono(View { width: 4 * WIDTH, height: 4 * HEIGHT, ..view(&loaded) });
    let truth = shrunk(&picture(&mut renderer(&machine, &loaded, &config), &fine, &[]), 4);
    config.foveation.samples = Samples::Count(3000);
    let plan = Plan::mono(view(&loaded));
    let mut told = |pictures: u32| {
        config.time = TimeConfig { pictures, ..TimeConfig::default() };
        let mut renderer = renderer(&machine, &loaded, &config);
        let pictures = [0; 16].map(|_| picture(&mut renderer, &plan, &[]));
        [0, 15].map(|frame: usize| psnr(&pictures[frame], &truth))
    };
    let ([first, last], [_, without]) = (told(16), told(1));
    println!("PSNR: {first:.1}, after 15 more {last:.1}, without means {without:.1} dB");
    assert!(last > first + 2.0 && last > without + 2.0, "{first} {last} {without}");
}

/// Half the light rays where the view stays, all of them at first and for frames that stand alone; after a turn a part of them
/// for what the frame before has seen, all where nothing was found before.
#[test]
fn frames_send_fewer_rays_where_others_have_left_light() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let mut config = config(Method::Guided, Samples::Count(3000), 32);
    let plan = |yaw: f64| {
        let mut eye = view(&loaded);
        eye.world_from_eye.rotation *= DQuat::from_rotation_y(yaw);
        Plan::mono(eye)
    };
    let mut rays = |rays: u32, reuse: bool, (rays_in_motion, samples_in_motion): (f64, f64)| -> Vec<u64> {
        // Pixels that look aside of their middles have other edges.
        config.time =
            TimeConfig { reuse, pictures: 1, rays_in_motion, samples_in_motion, ..TimeConfig::default() };
        config.trace.rays = rays;
        let mut renderer = renderer(&machine, &loaded, &config);
        let turns = [0.0, 0.0, 0.001, 0.031, 0.0315];
        turns.iter().map(|&yaw| renderer.frame(&plan(yaw), &[], 1).unwrap().rays).collect()
    };
    let [all, half, eighth] = [32, 16, 4].map(|count| rays(count, false, (0.125, 1.0)));
    assert!(all.iter().zip(&half).all(|(all, half)| all > half));
    let (reused, moving) = (rays(32, true, (1.0, 0.5)), rays(32, true, (0.125, 1.0)));
    assert_eq!(reused, [all[0], half[1], half[2], all[3], half[4]], "of {all:?} and {half:?}");
    // Something new comes into sight by that turn, not much.
    let some = moving[3];
    assert_eq!(moving, [all[0], half[1], half[2], some, half[4]], "of {all:?} and {half:?}");
    assert!(some > eighth[3] && some < half[3], "{some} of {all:?} and {eighth:?}");
    // Of what was seen before half is shaded.
    let in_turn = rays(32, true, (0.125, 0.5));
    assert_eq!(in_turn, [all[0], half[1], half[2], in_turn[3], half[4]], "of {all:?} and {half:?}");
    assert!(in_turn[3] < some, "{} of {some}", in_turn[3]);
}

/// However many frames there were, those after a restart are as the first; light that the cache has would tell.
#[test]
fn frames_after_a_restart_are_as_the_first() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let mut config = config(Method::Guided, Samples::Count(3000), 8);
    config.trace.indirect = Indirect::Cache;
    config.time = TimeConfig::default();
    let turned = |yaw: f64| {
        let mut eye = view(&loaded);
        eye.world_from_eye.rotation *= DQuat::from_rotation_y(yaw);
        Plan::mono(eye)
    };
    let shown = |before: u32, restarts: bool| -> Vec<Vec<u8>> {
        let mut renderer = renderer(&machine, &loaded, &config);
        for frame in 0..before {
            renderer.frame(&turned(0.1), &[], 7 + frame).unwrap();
        }
        if restarts {
            renderer.restart()
        } else {
            renderer.forget()
        }
        (0..3)
            .map(|frame| {
                renderer.frame(&turned(0.01 * f64::from(frame)), &[], frame).unwrap();
                renderer.picture().unwrap()
            })
            .collect()
    };
    let first = shown(0, false);
    assert!(shown(1, true) == first && shown(3, true) == first);
    assert!(shown(3, false) != first, "the cache knows nothing that shows");
}

/// Frames of a view that turns are nearly what they are with all rays, for much less than all; after a cut all are sent.
#[test]
fn views_that_turn_live_on_light_of_earlier_frames() {
    let Some(machine) = machine() else { return };
    let loaded = town(1.0);
    let mut config = config(Method::Guided, Samples::Count(3000), 32);
    let mut shown = |rays: u32, rays_in_motion: f64, reuse: bool| {
        config.time = TimeConfig { rays_in_motion, reuse, ..TimeConfig::default() };
        config.trace.rays = rays;
        let mut renderer = renderer(&machine, &loaded, &config);
        let mut eye = view(&loaded);
        let frames = (0..14).map(|frame| {
            eye.world_from_eye.rotation *= DQuat::from_rotation_y(0.005);
            if frame == 12 {
                renderer.forget();
            }
            // The gaze follows, so that the pattern is another one in each frame.
            let gaze = DVec2::new(0.5 + 0.01 * f64::from(frame), 0.5);
            let rays = renderer.frame(&Plan::mono(eye), &[gaze], frame).unwrap().rays;
            let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&renderer.picture().unwrap());
            let pixels = pixels.iter().map(|p| [p[0], p[1], p[2]]).collect();
            (rays, Picture::new(WIDTH, HEIGHT, pixels).unwrap())
        });
        frames.collect::<Vec<_>>()
    };
    let (truth, all, some) = (shown(400, 1.0, false), shown(32, 1.0, true), shown(32, 0.25, true));
    for frame in 0..14 {
        let (all_rays, rays) = (all[frame].0, some[frame].0);
        match frame {
            0 | 12 => assert_eq!(rays, all_rays, "frame {frame}"),
            _ => assert!(4 * rays < 3 * all_rays, "frame {frame}: {rays} of {all_rays}"),
        }
    }
    let [all, some] = [&all, &some].map(|shown| psnr(&shown[11].1, &truth[11].1));
    println!("PSNR after ten frames: {all:.1} dB with all rays, {some:.1} dB with fewer");
    assert!(some > all - 0.7, "{some} {all}");
}

/// Where view and light have rested some samples are shaded in each frame and the others keep their means: pictures and
/// exposure stay as they were. A turn, a new gaze and a scene that moves have all of them shaded again.
#[test]
fn samples_take_turns_at_rest_alone() {
    let Some(machine) = machine() else { return };
    // After sunset, where exposure goes by the light that samples find.
    let mut dusk = Config::default();
    dusk.environment.sun_elevation = -2.0;
    let glb = voxel_town::generate(20_000, 1).unwrap();
    let loaded = Loaded::from_glb("town", &glb, &dusk).unwrap();
    let mut config = config(Method::Guided, Samples::Count(3000), 32);
    config.view.exposure = ExposureConfig::Auto;
    let (frames, turned, looked) = (56, 40, 44);
    let mut shown = |loaded: &Loaded, samples: f64, frames: u32, hand_from: u32| {
        config.time = TimeConfig { pictures: 1, frames: 8, samples, ..TimeConfig::default() };
        let (device, context) = &machine;
        let mut renderer = Renderer::new(device, context, loaded, &config, Output::Display).unwrap().0;
        renderer.meter().set_pace(0.02);
        let mut eye = view(loaded);
        let reports = (0..frames).map(|frame| {
            if frame >= hand_from {
                let grips = [None, Some(view(loaded).world_from_eye)];
                renderer.show_hands(&HandPlaces { grips, ..HandPlaces::default() });
            }
            let by = if frame == turned { 0.02 } else { 0.0 };
            eye.world_from_eye.rotation *= DQuat::from_rotation_y(by);
            let gaze = DVec2::new(if frame < looked { 0.5 } else { 0.3 }, 0.5);
            let report = renderer.frame(&Plan::mono(eye), &[gaze], frame).unwrap();
            assert_eq!(report.dropped, 0);
            (report, renderer.picture().unwrap())
        });
        reports.collect::<Vec<_>>()
    };
    let (all, some) = (shown(&loaded, 1.0, frames, frames), shown(&loaded, 0.25, frames, frames));
    let saves = |frame: &u32| some[*frame as usize].0.rays < all[*frame as usize].0.rays;
    let saving: Vec<u32> = (0..frames).filter(saves).collect();
    // The cache has had its early steps after 32 frames, and four frames have to rest before others may.
    let expected = (32..turned).chain(looked + 4..frames);
    assert_eq!(saving, expected.collect::<Vec<_>>());
    let rays =
        |frames: &[(FrameReport, Vec<u8>)]| frames[36..40].iter().map(|(report, _)| report.rays).sum::<u64>();
    println!("rays of four frames at rest: {} in place of {}", rays(&some), rays(&all));
    for (frame, ((all, full), (some, parts))) in all.iter().zip(&some).enumerate() {
        assert!((all.exposure.unwrap() - some.exposure.unwrap()).abs() < 0.05, "frame {frame}");
        let squares =
            full.iter().zip(parts).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>();
        let psnr = 10.0 * (65025.0 * full.len() as f64 / squares.max(1.0)).log10();
        assert!(psnr > 36.0, "frame {frame}: {psnr:.1} dB");
    }
    // Under a sun that moves none waits, nor in the frame in which a hand is there.
    let mut moving = Config::default();
    moving.environment.day_length = 600.0;
    let under_sun = Loaded::moving_from_glb("town", &glb, &moving).unwrap();
    let worn = Loaded::worn_from_glb("town", &glb, &Config::default()).unwrap();
    let mut rays = |loaded: &Loaded, samples: f64| {
        shown(loaded, samples, 37, 35).iter().map(|(report, _)| report.rays).collect::<Vec<_>>()
    };
    assert_eq!(rays(&under_sun, 1.0), rays(&under_sun, 0.25));
    let (all, some) = (rays(&worn, 1.0), rays(&worn, 0.25));
    assert!(some[34] < all[34] && some[35..] == all[35..], "{some:?} {all:?}");
}
