//! `foveate run`: a scene in the headset of the active OpenXR runtime.

mod keys;
#[cfg(not(feature = "window"))]
#[path = "run/mirrorless.rs"]
mod mirror;
mod present;
mod stats;
mod terminal;
mod watchdog;

use std::path::PathBuf;

use super::mock::stereo_defaults;
use super::options::{Options, RenderOptions, SpeedFlag};
use super::output;
use super::stop::stop_signal;
use crate::config::{Config, Layers, Stereo};
use crate::error::Result;
use crate::frame::log::FrameLog;
use crate::headset::Fault;
use crate::headset::openxr::Runtime;
use crate::scene::Scene;

#[cfg(feature = "window")]
use crate::headset::panel::Mirror;
#[cfg(not(feature = "window"))]
use mirror::Mirror;
use present::Presentation;
use watchdog::Watchdog;

/// Arguments of `foveate run`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    /// End after this many pictures; otherwise Ctrl-C, or the runtime's own menu, ends.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Wait for a runtime or a headset that is not there yet, or fails again and again.
    #[arg(long)]
    wait: bool,
    /// Open a window for spectators, which shows what the left eye sees.
    #[arg(long)]
    mirror: bool,
    /// Write a line of JSON for each picture: what it was made with, its times, how old its poses were.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    #[command(flatten)]
    speed: SpeedFlag,
    #[command(flatten)]
    pub(super) options: RenderOptions,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let (config, notes) = args.options.config_for_display(Layers::over(stereo_defaults()))?;
    let config = args.speed.over(config)?;
    Scene::check(&args.scene)?;
    args.log.as_deref().map_or(Ok(()), FrameLog::check)?;
    let mirror = args.mirror.then(Mirror::connect).transpose()?;
    let stop = stop_signal(last_words)?;
    // Whether there is a headset is known at once, and a scene may take long.
    let watch = Watchdog::start(stop.clone(), args.options.picture.config.json);
    watch.asks();
    let insets = takes_insets(&config);
    let runtime = match args.wait {
        true => present::find(insets, &stop),
        false => Some(Runtime::connect(insets).map_err(Fault::into_error)?),
    };
    watch.works();
    let Some(runtime) = runtime else { return Ok(()) };
    let loaded = super::render::load_worn(&args.scene, &config)?;
    output::print_warnings(&loaded.warnings);
    output::print_warnings(&notes);
    let (rest, _) = args.options.picture.view.viewpoint(&loaded.scene, &config)?;
    let [width, height] = args.options.given_size()?;
    let presentation = Presentation {
        config: &config,
        loaded: &loaded,
        rest,
        gaze: args.options.look.gaze,
        fov_y: args.options.picture.view.fov_y(),
        size: [width.map(|both| both.div_ceil(2)), height],
        frames: args.frames,
        quiet: args.options.picture.config.json,
        log: args.log.as_deref(),
        waits: args.wait,
        stop,
    };
    presentation.run(runtime, &watch, mirror)
}

/// What is done before a second Ctrl-C ends the program.
fn last_words() {
    watchdog::leave_now();
    terminal::restore();
}

/// Whether a headset that has a sharp inset for each eye gets four views: one view cannot serve them all.
fn takes_insets(config: &Config) -> bool {
    config.headset.insets && config.view.stereo == Stereo::PerEye
}

/// `foveate demo` in the headset of a runtime that answers, until the wearer or the operator has seen enough; the
/// reason why there is none otherwise. `config` are the settings for files, `displayed` those for a display.
pub fn demo(
    args: &super::demo::Args,
    [config, displayed]: [&Config; 2],
    notes: &[String],
) -> std::result::Result<Result<()>, String> {
    let runtime = Runtime::connect(takes_insets(config)).map_err(|absent| absent.sentence())?;
    Ok(in_headset(args, displayed, notes, runtime))
}

fn in_headset(args: &super::demo::Args, config: &Config, notes: &[String], runtime: Runtime) -> Result<()> {
    let stop = stop_signal(last_words)?;
    let watch = Watchdog::start(stop.clone(), args.options.picture.config.json);
    let loaded = super::demo::load_worn(args.scene(), config)?;
    output::print_warnings(&loaded.warnings);
    output::print_warnings(notes);
    let [width, height] = args.options.given_size()?;
    let presentation = Presentation {
        config,
        loaded: &loaded,
        rest: args.options.picture.view.viewpoint(&loaded.scene, config)?.0,
        gaze: args.options.look.gaze,
        fov_y: args.options.picture.view.fov_y(),
        size: [width.map(|both| both.div_ceil(2)), height],
        frames: None,
        quiet: args.options.picture.config.json,
        log: None,
        waits: false,
        stop,
    };
    presentation.run(runtime, &watch, None)
}
