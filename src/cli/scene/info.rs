//! `foveate scene info`.

use std::fmt::Write;
use std::path::PathBuf;

use serde::Serialize;

use crate::bvh::wide::Cost;
use crate::cli::machine::Machine;
use crate::cli::options::{ConfigOptions, SceneFlags};
use crate::cli::output;
use crate::config::Layers;
use crate::error::Result;
use crate::frame::Loaded;
use crate::scene::info::{SceneInfo, summarise};
use crate::trace::{BufferBytes, DeformedBy, SceneData, deformed_bytes, tree_bytes};

/// Arguments of `foveate scene info`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    #[command(flatten)]
    pub(super) options: ConfigOptions,
    #[command(flatten)]
    flags: SceneFlags,
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
    /// Of nodes, vertices in leaf order, and what hits need to know of a triangle.
    bytes_per_triangle: f64,
    cost: Cost,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let mut layers = args.options.layers(Layers::default())?;
    args.flags.lay(&mut layers)?;
    let config = layers.finish()?;
    let loaded = Loaded::moving_from_file(&args.scene, &config)?;
    let machine = Machine::open(&config)?;
    let traversals = config.trace.traversal.on(&machine.device).traversals;
    let mut device_buffers =
        SceneData::count(&loaded.scene, loaded.trees(), &loaded.environment, traversals)?;
    let by = config.trace.deform.by(machine.devices.iter().map(|device| device.info().kind));
    if let (DeformedBy::Devices, Some(parted)) = (by, &loaded.parted) {
        device_buffers.extend(deformed_bytes(&loaded.scene, parted));
    }
    let info = Info {
        scene: args.scene.display().to_string(),
        info: summarise(&loaded.scene, &loaded.environment),
        bvh: BvhInfo {
            nodes: loaded.bvh.nodes.len() + loaded.shapes.iter().map(|tree| tree.nodes.len()).sum::<usize>(),
            depth: loaded.depth(),
            bytes_per_triangle: tree_bytes(&device_buffers) as f64
                / loaded.scene.meshes().map(|mesh| mesh.triangles.len()).sum::<usize>().max(1) as f64,
            cost: loaded.bvh.cost(),
        },
        device: machine.device.info().name.clone(),
        device_bytes: device_buffers.iter().map(|b| b.bytes).sum(),
        device_buffers,
    };
    if args.options.json { output::print_json(&info) } else { output::print_line(&info.text()) }
}

impl Info {
    fn text(&self) -> String {
        let scene = &self.info;
        let mut text = format!("{}\n", self.scene);
        let mut line = |name: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  {name:<11} {value}");
        };
        line("triangles", format!("{} with {} vertices", scene.triangles, scene.vertices));
        line("instances", scene.instances.to_string());
        if let Some(shared) = scene.shared {
            line(
                "kept once",
                format!(
                    "{} shapes of {} triangles, at {} places",
                    shared.shapes, shared.triangles, shared.instances
                ),
            );
        }
        line("materials", scene.materials.to_string());
        line("textures", format!("{}, {} with mip levels", scene.textures, size(scene.texture_bytes)));
        line("bounds", scene.bounds.map_or("none".into(), |b| format!("{:.3?} to {:.3?} m", b.min, b.max)));
        line("features", self.features());
        line("lights", self.lights());
        for (i, camera) in scene.cameras.iter().enumerate() {
            let what = match (camera.fov_y, camera.height) {
                (Some(fov), _) => format!("{fov:.1} degrees high"),
                (None, Some(height)) => format!("orthographic, {height:.3} m high"),
                (None, None) => "not usable".into(),
            };
            line("camera", format!("{i} {:?} at {:.3?}, {what}", camera.name, camera.position));
        }
        for (i, clip) in scene.animations.iter().enumerate() {
            let plays = if clip.plays { "" } else { ", not played" };
            line(
                "animation",
                format!("{i} {:?}, {:.3} s, {} channels{plays}", clip.name, clip.seconds, clip.channels),
            );
        }
        // One scene is no choice.
        for (kind, names) in [("scene", &scene.scenes), ("variant", &scene.variants)] {
            for (i, name) in names.iter().enumerate().filter(|_| kind == "variant" || names.len() > 1) {
                line(kind, format!("{i} {name:?}"));
            }
        }
        let BvhInfo { nodes, depth, bytes_per_triangle, cost } = &self.bvh;
        line("tree", format!("{nodes} nodes, {depth} deep, {bytes_per_triangle:.1} bytes a triangle"));
        line("", format!("a ray visits {:.1} nodes and {:.1} leaves on average", cost.nodes, cost.leaves));
        line("buffers", format!("{} on {}", size(self.device_bytes), self.device));
        for buffer in &self.device_buffers {
            line("", format!("{:<12} {:>10}", buffer.name, size(buffer.bytes)));
        }
        for warning in &scene.warnings {
            line("note", warning.clone());
        }
        text.trim_end().to_string()
    }

    fn features(&self) -> String {
        let on = self.info.features.defines().into_iter().filter(|(_, on)| *on);
        let names: Vec<String> =
            on.map(|(name, _)| name.trim_start_matches("HAS_").to_lowercase().replace('_', " ")).collect();
        if names.is_empty() { "none".into() } else { names.join(", ") }
    }

    fn lights(&self) -> String {
        let lights = self.info.lights;
        let counts = [(lights.point, "point"), (lights.spot, "spot"), (lights.directional, "directional")];
        let some: Vec<String> = counts
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, kind)| format!("{count} {kind}"))
            .collect();
        if some.is_empty() { "none of its own".into() } else { some.join(", ") }
    }
}

/// Bytes in a unit that is easy to read.
fn size(bytes: usize) -> String {
    match bytes {
        0..1024 => format!("{bytes} B"),
        1024..1_048_576 => format!("{:.1} KiB", bytes as f64 / 1024.0),
        _ => format!("{:.1} MiB", bytes as f64 / 1_048_576.0),
    }
}
