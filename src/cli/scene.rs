//! `foveate scene`: tells about a scene, or generates one.

mod info;

use std::path::PathBuf;

use clap::{Args as ClapArgs, Subcommand};
use serde::Serialize;

use super::options::ConfigOptions;
use super::output;
use crate::config::Layers;
use crate::error::{Error, Result};
use crate::scene::generate;
use crate::whole_file;

/// Arguments of `foveate scene`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Tell what a scene holds, which features it requires, and what it costs on the device.
    Info(info::Args),
    /// Generate a scene.
    Generate(GenerateArgs),
}

#[derive(Debug, ClapArgs)]
struct GenerateArgs {
    /// Which scene.
    #[arg(value_enum)]
    kind: Kind,
    /// Triangles of the voxel town, 10,000 to 20,000,000: met within 1 %.
    #[arg(long, default_value_t = 500_000)]
    triangles: u64,
    /// Seed of the voxel town.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The .glb file to write.
    #[arg(long, value_name = "FILE.glb")]
    out: PathBuf,
    #[command(flatten)]
    options: ConfigOptions,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// A town of unit blocks, a stand-in for Rungholt.
    VoxelTown,
    /// The demo's courtyard.
    Demo,
}

#[derive(Serialize)]
struct Generated {
    out: String,
    bytes: usize,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Command::Info(args) => info::run(args),
        Command::Generate(args) => generate(args),
    }
}

fn generate(args: &GenerateArgs) -> Result<()> {
    args.options.layers(Layers::default())?.finish()?;
    whole_file::check(&args.out)?;
    let bytes = match args.kind {
        Kind::VoxelTown => {
            generate::voxel_town::generate(args.triangles, args.seed).map_err(|error| match error {
                Error::Setting { key, problem } => Error::setting(format!("--{key}"), problem),
                other => other,
            })?
        }
        Kind::Demo => generate::demo::generate(),
    };
    generate::write(&args.out, &bytes)?;
    if args.options.json {
        return output::print_json(&Generated { out: args.out.display().to_string(), bytes: bytes.len() });
    }
    output::print_line(&format!("{}: {:.1} MB", args.out.display(), bytes.len() as f64 * 1e-6))
}
