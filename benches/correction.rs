//! What the late correction is worth: `cargo bench --bench correction [-- --scene demo --size 960 --margin 0.02 --periods 8]`.
//!
//! A head turns at 30, 100 or 300 degrees a second about its neck. One eye's view, 90 degrees wide, is traced
//! where the eye is, and shown one period of 60 Hz later, or as many as `--periods` says, when it has gone on: a loaded
//! machine's frames take several. Both pictures that can be shown
//! then, as traced and corrected, are compared with one that is traced where the eye is by then; the last
//! column, a picture from there with other random numbers, says how much of that is noise. With a margin that
//! much more is traced at each side, as `headset.margin` has it. Prints a table in Markdown, and what the
//! pass over the pixels takes with and without the correction.

use foveate::config::{Config, Method};
use foveate::frame::{Loaded, Output, Renderer, ViewRequest};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions, Format, Image};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::metrics::metric::Viewing;
use foveate::metrics::{Picture, compare};
use foveate::reconstruct;
use foveate::scene::{default_viewpoint, generate};
use glam::{DQuat, DVec3};

/// Seconds from tracing to showing, for each period.
const LATENESS: f64 = 1.0 / 60.0;
/// The eye in the head, from the joint that it turns about, in metres.
const EYE: DVec3 = DVec3::new(0.032, 0.075, -0.0805);

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let size: u32 = value("--size").map_or(960, |size| size.parse().expect("a number of pixels"));
    let margin: f64 = value("--margin").map_or(0.0, |margin| margin.parse().expect("a share"));
    let periods: f64 =
        value("--periods").map_or(1.0, |periods| periods.parse().expect("a number of periods"));
    let scene = value("--scene").map_or("demo", String::as_str);

    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let tracer = Device::open(&info).expect("the OpenCL device");
    let margin = (f64::from(size) * margin).ceil() as u32;
    println!(
        "{} (OpenCL), {} (Vulkan), {scene}, {size}x{size}, {margin} pixels of margin, {periods} periods\n",
        info.name,
        context.report().name
    );
    let loaded = match scene {
        "demo" => Loaded::from_glb(scene, &generate::demo::generate(), &Config::default()),
        path => Loaded::from_file(path.as_ref(), &Config::default()),
    }
    .expect("the scene");
    println!(
        "| head, deg/s | turned by | method | as traced: PSNR dB | FLIP | corrected: PSNR dB | FLIP | noise: PSNR dB | FLIP | pixels ms | corrected |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for method in [Method::Guided, Method::KNearest] {
        let mut config = Config::default().without_reuse();
        config.reconstruction.method = method;
        let output = Output::Radiance;
        let mut renderer = Renderer::new(&tracer, &context, &loaded, &config, output).expect("a renderer").0;
        for speed in [30.0f64, 100.0, 300.0] {
            let angle = (speed * periods * LATENESS).to_radians();
            let (from, to) = (view(&loaded, size, 0.0), view(&loaded, size, angle));
            let mut shown = |seed: u32, view: View, pose: Option<Pose>| {
                picture(&mut renderer, &context, (view, margin), seed, pose)
            };
            let (truth, _) = shown(1, to, None);
            let others = [shown(2, from, None), shown(2, from, Some(to.world_from_eye)), shown(2, to, None)];
            let [_, corrected, plain] = [0, 1, 2].map(|index| others[index].1);
            let scores = others.map(|(picture, _)| {
                let compared = compare(&picture, &truth, Viewing::default()).expect("finite pictures");
                format!("{:.2} | {:.4}", compared.psnr, compared.flip)
            });
            let line =
                format!("| {speed} | {:.1} deg | {method:?} | {}", angle.to_degrees(), scores.join(" | "));
            println!("{line} | {plain:.1} | {corrected:.1} |");
        }
    }
}

/// What the eye sees once the head has turned to the left.
fn view(loaded: &Loaded, size: u32, angle: f64) -> View {
    let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
    let joint = rest.then(Pose { position: -EYE, ..Pose::IDENTITY });
    let turned = joint.then(Pose::new(DQuat::from_rotation_y(angle), DVec3::ZERO));
    let fov = FieldOfView { left: -1.0, right: 1.0, up: 1.0, down: -1.0 };
    let world_from_eye = turned.then(Pose { position: EYE, ..Pose::IDENTITY });
    View { world_from_eye, fov, width: size, height: size, spacing: Default::default() }
}

/// What is shown of a view with a margin, and what the passes that reconstruct it took in milliseconds.
fn picture(
    renderer: &mut Renderer,
    context: &Context,
    (view, margin): (View, u32),
    seed: u32,
    shown_from: Option<Pose>,
) -> (Picture, f64) {
    let image = Image::new(context, Format::R32G32B32A32_SFLOAT, view.width, view.height).expect("an image");
    let traced = view.with_margin([margin; 2]);
    let gaze = traced.optical_centre();
    let output = reconstruct::Output::whole(image.target(), 0.0);
    let outputs = vec![reconstruct::Output { source: [margin; 2], ..output }];
    let request = ViewRequest { view: traced, gaze, widening: 1.0, hidden: None, outputs };
    let report = renderer.render_views(&[request], seed, &mut |_| shown_from).expect("a frame");
    let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&image.read().expect("pixels"));
    let picture = Picture::new(view.width, view.height, pixels.iter().map(|p| [p[0], p[1], p[2]]).collect());
    (picture.expect("finite pixels"), report.stages.reconstruct)
}
