//! `foveate demo`: the demo scene in the best headset there is: OpenXR's, or a mock one.

use std::path::{Path, PathBuf};

use super::machine::Machine;
use super::mock::{Session, check_out, fitted, stereo_defaults};
use super::options::{Options, RenderOptions, SpeedFlag, keep_up};
use super::output;
use super::window::Show;
use crate::config::{Config, Layers, Stereo};
use crate::error::{Error, Result};
use crate::frame::Loaded;
use crate::headset::mock::Profile;
use crate::scene::{Scene, generate};

/// Arguments of `foveate demo`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A file, .gltf, .glb or .obj, to show instead of the demo scene.
    scene: Option<PathBuf>,
    /// Folder for pictures, contact sheet, animated preview and frames.jsonl.
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Show it in a window: the mouse (click first) and WASD move the head, Escape ends.
    #[arg(long, conflicts_with = "out")]
    window: bool,
    /// Render for a headset's lenses and follow its tracker, in a window or on its own monitor: dk1.
    #[arg(long, value_enum, value_name = "NAME", conflicts_with = "out")]
    headset: Option<Headset>,
    /// Frames to show in a window; until it is closed by default.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    #[command(flatten)]
    speed: SpeedFlag,
    #[command(flatten)]
    pub(super) options: RenderOptions,
}

/// The script's length in seconds of display time.
const SCRIPT_SECONDS: f64 = 6.0;
/// Frames at most, and the milliseconds that all of them may take together.
const MAX_FRAMES: f64 = 48.0;
const BUDGET_MS: f64 = 32_000.0;

/// Headsets that are shown in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Headset {
    /// The Oculus Rift DK1.
    Dk1,
}

/// The scene of a file, or the demo scene.
///
/// # Errors
/// Where the scene or the environment cannot be used.
pub fn load(scene: Option<&Path>, config: &Config) -> Result<Loaded> {
    match scene {
        Some(path) => Loaded::moving_from_file(path, config),
        None => Loaded::moving_from_glb("the demo scene", &generate::demo::generate(), config),
    }
}

/// The same in a headset, with the wearer's hands in it, where the settings want to see them.
///
/// # Errors
/// Where the scene or the environment cannot be used.
#[cfg(feature = "openxr")]
pub fn load_worn(scene: Option<&Path>, config: &Config) -> Result<Loaded> {
    match scene {
        Some(path) => Loaded::worn_from_file(path, config),
        None => Loaded::worn_from_glb("the demo scene", &generate::demo::generate(), config),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut defaults = stereo_defaults();
    if args.window && args.headset.is_none() {
        defaults.view.stereo = Stereo::Mono;
        // Eyes that nothing follows look anywhere in a window.
        defaults.foveation.visibility_slope = 0.0;
    }
    if args.scene.is_none() {
        args.options
            .picture
            .scene
            .refuse("it chooses in a file, and the demo scene is shown; give a file too")?;
    }
    let mut layers = args.options.layers(Layers::over(defaults))?;
    let config = args.speed.over(args.options.finished(&layers)?)?;
    let notes = keep_up(&mut layers);
    let displayed = args.speed.over(args.options.finished(&layers)?)?;
    if args.window || args.headset.is_some() {
        args.options
            .picture
            .view
            .refuse_pose("a window begins where the scene says, and is walked from there; leave it out")?;
        args.options.look.refuse("in a window it is the centre; leave it out")?;
        let (config, scene) = (&displayed, args.scene.as_deref());
        let show = Show { config, notes, scene, headset: args.headset, frames: args.frames };
        return show.run(args.options.picture.config.json);
    }
    if args.frames.is_some() {
        return Err(Error::setting("--frames", "it counts frames of a window; give --window too"));
    }
    args.scene.as_deref().map_or(Ok(()), Scene::check)?;
    check_out(&args.out)?;
    match headset(args, [&config, &displayed], &notes) {
        Ok(ended) => return ended,
        Err(why) => output::print_warnings(&[format!("a mock headset stands in for a real one: {why}")]),
    }
    let (machine, loaded) = rayon::join(|| Machine::open(&config), || load(args.scene.as_deref(), &config));
    let (machine, loaded) = (machine?, loaded?);
    output::print_warnings(&loaded.warnings);
    let session = Session {
        config: &config,
        loaded: &loaded,
        machine: &machine,
        profile: fitted(Profile::generic(), &config, args.options.picture.view.fov_y()),
        rest: args.options.picture.view.viewpoint(&loaded.scene, &config)?.0,
        gaze: args.options.look.gaze,
        still: false,
        hands: None,
        out: &args.out,
    };
    let frames = |frame_ms: f64| (BUDGET_MS / frame_ms.max(1.0)).clamp(2.0, MAX_FRAMES) as u32;
    session.run(frames, SCRIPT_SECONDS)?.print(args.options.picture.config.json)
}

#[cfg(feature = "openxr")]
use super::run::demo as headset;

/// Without OpenXR there is no headset.
#[cfg(not(feature = "openxr"))]
fn headset(_: &Args, _: [&Config; 2], _: &[String]) -> std::result::Result<Result<()>, String> {
    Err("this program was built without OpenXR; build it with the feature openxr".to_string())
}

#[cfg(feature = "openxr")]
impl Args {
    /// The scene to show instead of the demo scene.
    pub fn scene(&self) -> Option<&Path> {
        self.scene.as_deref()
    }
}
