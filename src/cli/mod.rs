//! The command line: arguments to a configuration, and one command.

mod bench;
pub mod caches;
mod demo;
mod devices;
mod machine;
mod measure;
mod mock;
mod options;
mod output;
mod render;
#[cfg(feature = "openxr")]
mod run;
mod scene;
mod stop;
pub mod tracker;
#[cfg(not(feature = "window"))]
#[path = "windowless.rs"]
mod window;
#[cfg(feature = "window")]
mod window;

use clap::{Parser, Subcommand};

use crate::error::{Error, Result};
pub use crate::progress::complain;
pub use stop::end_with;

/// Ray-traces a glTF scene for a headset: sharp where the eye looks, sparse elsewhere.
#[derive(Debug, Parser)]
#[command(name = "foveate", version = crate::VERSION, about, after_help = EXAMPLES, args_override_self = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "Examples:
  foveate demo                                       the demo scene, in the best headset there is
  foveate demo --window                              the same in a window; mouse and WASD move the head
  foveate demo --headset dk1                         the same on a Rift DK1
  foveate render scene.glb --out picture.png         one foveated picture
  foveate render scene.glb --out all.exr --samples full --rays 256
  foveate run scene.glb                              in a headset, through OpenXR
  foveate mock scene.glb --frames 60 --out frames/   a mock headset that follows a script
  foveate measure scene.glb --out trade --quick      what speed costs in accuracy, as a report
  foveate devices                                    what this machine offers, and what is used

Every setting has a place in configs/default.toml; --config FILE and --set key=value change it,
and flags win over both.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Render one picture of a scene: .png for a display, .exr for linear radiance.
    Render(render::Args),
    /// Show a scene in the headset of the active OpenXR runtime, such as SteamVR or Monado.
    #[cfg(feature = "openxr")]
    Run(run::Args),
    /// Render a mock headset's frames along a scripted head and gaze path.
    Mock(mock::Args),
    /// Measure what speed costs in accuracy on this scene and these devices, and write a report.
    Measure(measure::Args),
    /// Show the demo scene in the best headset there is; a mock one where there is none.
    Demo(demo::Args),
    /// Tell about a scene, or generate one.
    Scene(scene::Args),
    /// Watch, record or replay a Rift DK1's head tracker.
    Tracker(tracker::Args),
    /// Measure how fast a scene's rays are traced on each OpenCL device.
    Bench(bench::Args),
    /// List what OpenCL and Vulkan offer here, what is used, and why not the rest.
    Devices(devices::Args),
    /// Try kernels that a driver may crash or hang over: this program starts itself so.
    #[command(hide = true)]
    TryKernels {
        /// The task.
        task: String,
    },
}

impl Cli {
    /// Whether drivers are used, which keep caches.
    pub fn uses_drivers(&self) -> bool {
        !matches!(self.command, Command::Tracker(_))
    }

    /// Whether results, and so errors too, are to be JSON.
    pub fn json(&self) -> bool {
        match &self.command {
            Command::Render(args) => args.options.picture.config.json,
            #[cfg(feature = "openxr")]
            Command::Run(args) => args.options.picture.config.json,
            Command::Mock(args) => args.options.picture.config.json,
            Command::Measure(args) => args.options.config.json,
            Command::Demo(args) => args.options.picture.config.json,
            Command::Scene(args) => args.json(),
            Command::Tracker(args) => args.json,
            Command::Bench(args) => args.options.config.json,
            Command::Devices(args) => args.options.json,
            Command::TryKernels { .. } => false,
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// One sentence for the operator.
    pub fn run(self) -> Result<()> {
        match self.command {
            Command::Render(args) => render::run(&args),
            #[cfg(feature = "openxr")]
            Command::Run(args) => run::run(&args),
            Command::Mock(args) => mock::run(&args),
            Command::Measure(args) => measure::run(&args),
            Command::Demo(args) => demo::run(&args),
            Command::Scene(args) => scene::run(&args),
            Command::Tracker(args) => tracker::run(&args),
            Command::Bench(args) => bench::run(&args),
            Command::Devices(args) => devices::run(&args),
            Command::TryKernels { task } => crate::bench::trial::work(&task),
        }
    }
}

/// Tells why a command failed, on standard error: as a sentence, or as one JSON object with a code.
pub fn fail(error: &Error, json: bool) {
    use std::io::Write;
    if json {
        let object = serde_json::json!({ "error": { "code": error.code(), "message": error.to_string() } });
        // Nobody who reads it is no error.
        let _ = writeln!(std::io::stderr(), "{object}");
    } else {
        complain(&error.to_string());
    }
}
