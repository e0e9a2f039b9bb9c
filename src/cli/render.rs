//! `foveate render`: one picture.

use std::path::PathBuf;
use std::time::Instant;

use serde::Serialize;

use super::machine::Machine;
use super::options::{Options, RenderOptions, eye_fov};
use super::output::{self, RenderSummary};
use crate::config::{Config, ExposureConfig, Quality, Stereo, ViewConfig};
use crate::error::{Error, Result};
use crate::frame::budget;
use crate::frame::exposure::stops_for;
use crate::frame::stereo::parallel_eyes;
use crate::frame::{FrameReport, Loaded, Output, Plan, Renderer, Step};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::metrics::{Display, Picture};
use crate::scene::environment::luminance;
use crate::whole_file;

/// Arguments of `foveate render`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    /// Where the picture goes: .png is tone-mapped sRGB, .exr holds linear radiance.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Average this many pictures, each with its own random numbers and camera rays through random
    /// points of their pixels: for references.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    passes: u32,
    #[command(flatten)]
    pub(super) options: RenderOptions,
}

/// Steps of the cache of light before a picture: as many as frames take until a new view is lit.
const LIGHT_STEPS: u64 = 96;

#[derive(Clone, Copy, PartialEq)]
enum FileKind {
    Png,
    Exr,
}

#[derive(Serialize)]
struct Summary {
    #[serde(flatten)]
    render: RenderSummary,
    passes: u32,
    out: String,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let start = Instant::now();
    let kind = file_kind(&args.out)?;
    let config = chosen(args.options.config_for_picture()?)?.without_reuse();
    // Nobody should wait for a picture that has no place to go.
    whole_file::check(&args.out)?;
    let (machine, loaded) = open(&args.scene, &config)?;
    output::print_warnings(&loaded.warnings);
    let plan = plan(&args.options, &config, &loaded)?;
    let averaged = args.passes > 1;
    let output = if kind == FileKind::Exr || averaged { Output::Radiance } else { Output::Display };
    let (mut renderer, steps) = machine.renderer(&loaded, &config, output)?;
    output::print_warnings(&renderer.take_notes());
    let gaze = args.options.look.gaze.map(|gaze| plan.gaze_points(gaze)).unwrap_or_default();

    let mut frames = Vec::new();
    let mut sum = Sum::default();
    let bar = output::progress(args.passes.into(), "passes");
    renderer.set_jitter(averaged);
    // No frames came before that could have filled the cache of light.
    renderer.light_ahead(LIGHT_STEPS);
    for pass in 0..args.passes {
        frames.push(renderer.frame(&plan, &gaze, config.trace.seed.wrapping_add(pass))?);
        if averaged {
            sum.add(bytemuck::cast_slice(&renderer.picture()?));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let first_frame = Step { name: "first picture", ms: start.elapsed().as_secs_f64() * 1e3 };
    let pixels = if averaged { bytemuck::cast_slice(&sum.mean()).to_vec() } else { renderer.picture()? };
    write(args, kind, output, &plan, &pixels, &config)?;

    let steps: Vec<Step> = loaded.steps.iter().chain(&steps).copied().chain([first_frame]).collect();
    report(args, &config, &plan, &machine, &renderer, &frames, &steps)
}

/// The point of the front that is expected to meet the targets, where there are any.
fn chosen(config: Config) -> Result<Config> {
    let Some(mut controller) = budget::controller(&config, None)? else { return Ok(config) };
    output::print_warnings(&controller.take_notes());
    output::print_warnings(controller.expectation().as_slice());
    Ok(controller.quality(Quality::of(&config)).applied_to(&config))
}

/// Opens the devices while the scene loads.
pub fn open(scene: &std::path::Path, config: &Config) -> Result<(Machine, Loaded)> {
    open_with(config, || load(scene, config))
}

/// Opens the devices while `load` loads a scene.
pub fn open_with(config: &Config, load: impl FnOnce() -> Result<Loaded> + Send) -> Result<(Machine, Loaded)> {
    let (machine, loaded) = rayon::join(|| Machine::open(config), load);
    // What is wrong with the scene comes first: it is the likelier mistake.
    let loaded = loaded?;
    Ok((machine?, loaded))
}

/// Loads a scene that has something to show.
pub fn load(scene: &std::path::Path, config: &Config) -> Result<Loaded> {
    let loaded = Loaded::from_file(scene, config)?;
    require_triangles(scene, &loaded)?;
    Ok(loaded)
}

/// Loads a scene that has something to show, and whose animations play on.
pub fn load_moving(scene: &std::path::Path, config: &Config) -> Result<Loaded> {
    let loaded = Loaded::moving_from_file(scene, config)?;
    require_triangles(scene, &loaded)?;
    Ok(loaded)
}

/// The same with the wearer's hands in it, where the settings want to see them.
pub fn load_worn(scene: &std::path::Path, config: &Config) -> Result<Loaded> {
    let loaded = Loaded::worn_from_file(scene, config)?;
    require_triangles(scene, &loaded)?;
    Ok(loaded)
}

/// Refuses a scene without anything to show.
pub fn require_triangles(scene: &std::path::Path, loaded: &Loaded) -> Result<()> {
    if loaded.scene.triangles() > 0 {
        return Ok(());
    }
    Err(Error::Scene {
        path: scene.to_path_buf(),
        problem: "it has no triangles to show; check its export".into(),
    })
}

fn file_kind(path: &std::path::Path) -> Result<FileKind> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    match extension.as_str() {
        "png" => Ok(FileKind::Png),
        "exr" => Ok(FileKind::Exr),
        _ => Err(Error::setting(
            "--out",
            format!("{} ends in neither .png nor .exr; give a name that does", path.display()),
        )),
    }
}

fn plan(options: &RenderOptions, config: &Config, loaded: &Loaded) -> Result<Plan> {
    let (head, fov_y) = options.picture.view.viewpoint(&loaded.scene, config)?;
    plan_at(config, head, fov_y)
}

/// The views of a picture of the configured size, seen from `head`.
pub fn plan_at(config: &Config, head: Pose, fov_y: f64) -> Result<Plan> {
    let (width, height) = (config.view.width, config.view.height);
    if config.view.stereo == Stereo::Mono {
        let fov = eye_fov(fov_y, width, height);
        return Ok(Plan::mono(View {
            world_from_eye: head,
            fov,
            width,
            height,
            spacing: Default::default(),
        }));
    }
    let eye = width / 2;
    let eyes = parallel_eyes(head, config.view.ipd, eye_fov(fov_y, eye, height), eye, height);
    Plan::stereo(eyes, config.view.stereo)
}

/// Mean of pictures, in double precision.
#[derive(Default)]
struct Sum {
    total: Vec<f64>,
    count: f64,
}

impl Sum {
    fn add(&mut self, values: &[f32]) {
        self.total.resize(values.len(), 0.0);
        self.total.iter_mut().zip(values).for_each(|(t, &v)| *t += f64::from(v));
        self.count += 1.0;
    }

    fn mean(&self) -> Vec<f32> {
        self.total.iter().map(|&t| (t / self.count) as f32).collect()
    }
}

fn write(
    args: &Args,
    kind: FileKind,
    output: Output,
    plan: &Plan,
    pixels: &[u8],
    config: &Config,
) -> Result<()> {
    let (width, height) = (plan.width, plan.height);
    if output == Output::Display {
        return write_display(&Display::from_rgba(width, height, pixels), &args.out, &config.view);
    }
    let floats: &[f32] = bytemuck::cast_slice(pixels);
    let rgb = floats.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect();
    let picture = Picture::new(width, height, rgb)?;
    match kind {
        FileKind::Exr => picture.write_exr(&args.out),
        FileKind::Png => {
            let display = Display::from_picture(&picture, stops(&picture, &config.view));
            write_display(&display, &args.out, &config.view)
        }
    }
}

/// sRGB codes, in 0..1, from which on colours are nearly white.
const NEARLY_WHITE: f32 = 0.875;

/// Writes a picture as a display shows it, and says what to do where most of it comes out white at an exposure of no stops,
/// the default.
fn write_display(display: &Display, out: &std::path::Path, view: &ViewConfig) -> Result<()> {
    display.write_png(out)?;
    let white = display.pixels.iter().filter(|pixel| pixel.iter().all(|&code| code > NEARLY_WHITE)).count();
    if view.exposure == ExposureConfig::Stops(0.0) && 2 * white > display.pixels.len() {
        output::print_warnings(&[
            "most of the picture is nearly white; --exposure auto meters it, and stops below 0 show less of the light".into(),
        ]);
    }
    Ok(())
}

/// The stops that a picture is shown with: its own, where they are to be metered.
fn stops(picture: &Picture, view: &ViewConfig) -> f32 {
    let [least, most] = view.exposure_range;
    let metered = || stops_for(picture.pixels.iter().map(|&p| luminance(p.into()) as f32).collect());
    match view.exposure {
        ExposureConfig::Auto => metered().unwrap_or(0.0).clamp(least, most) as f32,
        ExposureConfig::Stops(stops) => stops as f32,
    }
}

fn report(
    args: &Args,
    config: &Config,
    plan: &Plan,
    machine: &Machine,
    renderer: &Renderer,
    frames: &[FrameReport],
    steps: &[Step],
) -> Result<()> {
    let render = RenderSummary::of(frames).about((plan.width, plan.height), machine, renderer, steps);
    if args.options.picture.config.json {
        return output::print_json(&Summary {
            render,
            passes: args.passes,
            out: args.out.display().to_string(),
        });
    }
    output::print_line(&format!(
        "{}: {}x{}, {} samples for {} pixels, {} rays each{}, {:.0} ms ({:.2} Mrays/s), samples {} from {}",
        args.out.display(),
        plan.width,
        plan.height,
        render.samples,
        render.pixels,
        config.trace.rays,
        if args.passes > 1 { format!(", {} passes", args.passes) } else { String::new() },
        render.frame_ms.p50,
        render.mrays_per_second,
        render.sharing,
        machine.describe(),
    ))
}
