//! `foveate scene`: tells about a scene, or generates one.

use std::path::PathBuf;

use clap::{Args as ClapArgs, Subcommand};
use serde::Serialize;

use super::machine::Machine;
use super::options::ConfigOptions;
use super::output;
use crate::config::Layers;
use crate::error::Result;
use crate::frame::Loaded;
use crate::scene::generate;
use crate::scene::info::{SceneInfo, summarise};
use crate::trace::{BufferBytes, SceneBuffers};

/// Arguments of `foveate scene`.
#[derive(Debug, ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Tell what a scene holds, which features it requires, and what it costs on the device.
    Info(InfoArgs),
    /// Generate a scene.
    Generate(GenerateArgs),
}

#[derive(Debug, ClapArgs)]
struct InfoArgs {
    /// A glTF 2.0 file, .gltf or .glb.
    scene: PathBuf,
    #[command(flatten)]
    options: ConfigOptions,
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
    /// Print one JSON object on standard output instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// A town of unit blocks, a stand-in for Rungholt.
    VoxelTown,
    /// The demo's courtyard.
    Demo,
}

#[derive(Serialize)]
struct Info {
    scene: String,
    #[serde(flatten)]
    info: SceneInfo,
    bvh: BvhInfo,
    device: String,
    device_buffers: Vec<BufferBytes>,
    device_bytes: usize,
}

#[derive(Serialize)]
struct BvhInfo {
    nodes: usize,
    depth: u32,
}

#[derive(Serialize)]
struct Generated {
    out: String,
    bytes: usize,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Command::Info(args) => info(args),
        Command::Generate(args) => generate(args),
    }
}

fn info(args: &InfoArgs) -> Result<()> {
    let config = args.options.layers(Layers::default())?.finish()?;
    let loaded = Loaded::from_file(&args.scene, &config)?;
    let machine = Machine::open(&config.devices)?;
    let buffers = SceneBuffers::upload(&machine.device, &loaded.scene, &loaded.bvh, &loaded.environment)?;
    let device_buffers = buffers.bytes();
    let info = Info {
        scene: args.scene.display().to_string(),
        info: summarise(&loaded.scene, &loaded.environment),
        bvh: BvhInfo { nodes: loaded.bvh.nodes.len(), depth: loaded.bvh.depth() },
        device: machine.device.info().name.clone(),
        device_bytes: device_buffers.iter().map(|b| b.bytes).sum(),
        device_buffers,
    };
    if args.options.json {
        return output::print_json(&info);
    }
    let text = serde_json::to_string_pretty(&info).unwrap_or_default();
    output::print_line(&text)
}

fn generate(args: &GenerateArgs) -> Result<()> {
    let bytes = match args.kind {
        Kind::VoxelTown => generate::voxel_town::generate(args.triangles, args.seed)?,
        Kind::Demo => generate::demo::generate(),
    };
    generate::write(&args.out, &bytes)?;
    if args.json {
        return output::print_json(&Generated { out: args.out.display().to_string(), bytes: bytes.len() });
    }
    output::print_line(&format!("{}: {:.1} MB", args.out.display(), bytes.len() as f64 * 1e-6))
}
