//! `foveate run`: a scene in the headset of the active OpenXR runtime.

mod keys;
mod present;
mod stats;
mod terminal;
mod watchdog;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::mock::stereo_defaults;
use super::options::{Options, RenderOptions, SpeedFlag};
use super::output;
use crate::config::{Config, Layers, Stereo};
use crate::error::{Error, Result};
use crate::headset::Fault;
use crate::headset::openxr::Runtime;
use crate::scene::Scene;

pub use present::Presentation;
pub use watchdog::Watchdog;

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
    let stop = stop_signal()?;
    // Whether there is a headset is known at once, and a scene may take long.
    let watch = Watchdog::start(stop.clone(), args.options.config.json);
    watch.asks();
    let insets = takes_insets(&config);
    let runtime = match args.wait {
        true => present::find(insets, &stop),
        false => Some(Runtime::connect(insets).map_err(Fault::into_error)?),
    };
    watch.works();
    let Some(runtime) = runtime else { return Ok(()) };
    let loaded = super::render::load_moving(&args.scene, &config)?;
    output::print_warnings(&loaded.warnings);
    output::print_warnings(&notes);
    let (rest, _) = args.options.view.viewpoint(&loaded.scene, &config)?;
    let [width, height] = args.options.given_size()?;
    let presentation = Presentation {
        config: &config,
        loaded: &loaded,
        rest,
        gaze: args.options.look.gaze,
        fov_y: args.options.view.fov_y(),
        size: [width.map(|both| both.div_ceil(2)), height],
        frames: args.frames,
        quiet: args.options.config.json,
        log: args.log.as_deref(),
        waits: args.wait,
        stop,
    };
    presentation.run(runtime, &watch)
}

/// Whether a headset that has a sharp inset for each eye gets four views: one view cannot serve them all.
pub fn takes_insets(config: &Config) -> bool {
    config.headset.insets && config.view.stereo == Stereo::PerEye
}

/// Signals that come so soon after the first are the same wish: some senders signal a program and its group.
const ONE_WISH: Duration = Duration::from_millis(300);

/// Becomes true when the operator wants to leave: Ctrl-C or a signal to end. The second one ends at once.
pub fn stop_signal() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let asked = stop.clone();
    let mut first = None;
    let handler = move || {
        crate::waiting::leave();
        let first = *first.get_or_insert_with(Instant::now);
        if asked.swap(true, Ordering::Relaxed) && first.elapsed() > ONE_WISH {
            watchdog::leave_now();
            terminal::restore();
            std::process::exit(130);
        }
    };
    ctrlc::set_handler(handler)
        .map_err(|e| Error::setting("Ctrl-C", format!("it cannot be listened to ({e}); start again")))?;
    Ok(stop)
}
