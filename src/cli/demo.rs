//! `foveate demo`: the demo scene in the best headset there is: OpenXR's, or a mock one.

use std::path::PathBuf;

use super::machine::Machine;
use super::mock::{Session, check_out, fitted, stereo_defaults};
use super::options::ConfigOptions;
use super::output;
use super::run::{Presentation, stop_signal};
use crate::config::{Config, Layers, Samples};
use crate::error::Result;
use crate::frame::Loaded;
use crate::headset::mock::Profile;
use crate::headset::openxr::Runtime;
use crate::scene::{default_viewpoint, generate};

/// Arguments of `foveate demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for pictures, contact sheet, animated preview and frames.jsonl.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    #[command(flatten)]
    options: ConfigOptions,
}

/// The script's length in seconds of display time.
const SCRIPT_SECONDS: f64 = 6.0;
/// Frames at most, and the milliseconds that all of them may take together.
const MAX_FRAMES: f64 = 48.0;
const BUDGET_MS: f64 = 32_000.0;

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut defaults = stereo_defaults();
    // Two eyes share the usual number of samples.
    if let Samples::Count(count) = &mut defaults.foveation.samples {
        *count /= 2;
    }
    let config = args.options.layers(Layers::over(defaults))?.finish()?;
    check_out(&args.out)?;
    if let Ok(runtime) = Runtime::connect(config.headset.insets) {
        return in_headset(args, &config, runtime);
    }
    let (machine, loaded) = rayon::join(
        || Machine::open(&config.devices),
        || Loaded::from_glb("the demo scene", &generate::demo::generate(), &config),
    );
    let (machine, loaded) = (machine?, loaded?);
    output::print_warnings(&loaded.warnings);
    let session = Session {
        config: &config,
        loaded: &loaded,
        machine: &machine,
        profile: fitted(Profile::generic(), &config, None),
        rest: default_viewpoint(&loaded.scene, config.view.fov_y).world_from_eye,
        gaze: None,
        out: &args.out,
    };
    let frames = |frame_ms: f64| (BUDGET_MS / frame_ms.max(1.0)).clamp(2.0, MAX_FRAMES) as u32;
    session.run(frames, SCRIPT_SECONDS)?.print(args.options.json)
}

/// The same scene in a headset, until the wearer or the operator has seen enough.
fn in_headset(args: &Args, config: &Config, runtime: Runtime) -> Result<()> {
    let stop = stop_signal()?;
    let loaded = Loaded::from_glb("the demo scene", &generate::demo::generate(), config)?;
    output::print_warnings(&loaded.warnings);
    let presentation = Presentation {
        config,
        loaded: &loaded,
        rest: default_viewpoint(&loaded.scene, config.view.fov_y).world_from_eye,
        gaze: None,
        fov_y: None,
        size: [None; 2],
        frames: None,
        quiet: args.options.json,
        stop,
    };
    presentation.run(runtime)?.print(args.options.json)
}
