//! `foveate scene`: tells about a scene, or generates one.

mod info;

use std::path::{Path, PathBuf};

use clap::{Args as ClapArgs, Subcommand};
use serde::Serialize;

use super::output;
use crate::error::{Error, Result};
use crate::scene::{Scene, generate};
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
    /// Triangles, met within 1 %: of the voxel town 10,000 to 20,000,000, where not given 500,000; of the
    /// organic scene 150,000 to 20,000,000, where not given 1,000,000. The demo's are fixed.
    #[arg(long)]
    triangles: Option<u64>,
    /// Seed of the voxel town and the organic scene.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The file to write: .glb, or .obj with its materials and pictures beside it.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Print one JSON object on standard output instead of text, and errors as one on standard error.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kind {
    /// A town of unit blocks, a stand-in for Rungholt.
    VoxelTown,
    /// A glade with trees, ferns, grass and boulders: rounded triangles of all sizes.
    Organic,
    /// The demo's courtyard.
    Demo,
}

#[derive(Serialize)]
struct Generated {
    out: String,
    bytes: usize,
}

impl Args {
    /// Whether the result is to be JSON.
    pub fn json(&self) -> bool {
        match &self.command {
            Command::Info(args) => args.options.json,
            Command::Generate(args) => args.json,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    match &args.command {
        Command::Info(args) => info::run(args),
        Command::Generate(args) => generate(args),
    }
}

fn generate(args: &GenerateArgs) -> Result<()> {
    if !["glb", "obj"].iter().any(|ending| ends_in(&args.out, ending)) {
        let problem = format!(
            "{} ends in neither .glb nor .obj, which are what is written; give such a name",
            args.out.display()
        );
        return Err(Error::setting("--out", problem));
    }
    whole_file::check(&args.out)?;
    let bytes = made(args).map_err(|error| match error {
        Error::Setting { key, problem } => Error::setting(format!("--{key}"), problem),
        other => other,
    })?;
    let size = write(&args.out, &bytes)?;
    if args.json {
        return output::print_json(&Generated { out: args.out.display().to_string(), bytes: size });
    }
    output::print_line(&format!("{}: {:.1} MB", args.out.display(), size as f64 * 1e-6))
}

/// Writes a generated glTF binary in the format that the file's name asks for; returns the file's size.
fn write(out: &Path, glb: &[u8]) -> Result<usize> {
    if ends_in(out, "obj") {
        return generate::obj::write(out, &Scene::from_glb(out, glb)?);
    }
    generate::write(out, glb)?;
    Ok(glb.len())
}

fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

fn made(args: &GenerateArgs) -> Result<Vec<u8>> {
    use generate::{demo, organic, voxel_town};
    match args.kind {
        Kind::VoxelTown => voxel_town::generate(args.triangles.unwrap_or(500_000), args.seed),
        Kind::Organic => organic::generate(args.triangles.unwrap_or(organic::USUAL_TRIANGLES), args.seed),
        Kind::Demo if args.triangles.is_some() => {
            Err(Error::setting("triangles", "the demo scene has a fixed number; leave this out"))
        }
        Kind::Demo => Ok(demo::generate()),
    }
}
