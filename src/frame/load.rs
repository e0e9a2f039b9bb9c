//! From files to what a renderer needs, and how long each step took.

use std::borrow::Cow;
use std::path::Path;
use std::time::Instant;

use glam::Vec3;

use crate::bvh::cache::TreeCache;
use crate::bvh::instances::over_instances;
use crate::bvh::{Parted, TreeFor, Trees, WideBvh};
use crate::config::{Config, EnvironmentConfig};
use crate::error::Result;
use crate::gpu::opencl::{self, Device};
use crate::progress;
use crate::scene::grab::Grab;
use crate::scene::hands;
use crate::scene::instanced::InstancedShape;
use crate::scene::sky::Sky;
use crate::scene::sky::day::DayCycle;
use crate::scene::{Environment, Instanced, LoadOptions, Progress, Scene, Sun};
use crate::trace::{SceneData, Traversal};
use crate::waiting::{self, Limits};

/// A step of starting up.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Step {
    /// What was done.
    pub name: &'static str,
    /// How long it took, in milliseconds of wall time; steps may overlap.
    pub ms: f64,
}

/// A scene with its tree and its light.
#[derive(Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Its tree.
    pub bvh: WideBvh,
    /// The trees of the shapes that are kept once, in their order.
    pub shapes: Vec<WideBvh>,
    /// The trees of its moving parts, where it is to move on and anything does.
    pub parted: Option<Parted>,
    /// The tree was found on disk, not built.
    pub bvh_was_cached: bool,
    /// Its light, at the time of the settings.
    pub environment: Environment,
    /// How that changes, where the scene is to move on and its sun does.
    pub day: Option<DayCycle>,
    /// What was done for it.
    pub steps: Vec<Step>,
    /// Sentences that the operator should read once.
    pub warnings: Vec<String>,
}

impl Loaded {
    /// Loads a scene from a file.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn from_file(path: &Path, config: &Config) -> Result<Loaded> {
        Self::with(config, false, || read(path, config, Kept::Nothing))
    }

    /// Loads a scene from a file that moves on from its first instant, where anything in it does.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn moving_from_file(path: &Path, config: &Config) -> Result<Loaded> {
        Self::with(config, true, || read(path, config, Kept::Motion))
    }

    /// The same with the wearer's hands in it, where the settings want to see them.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn worn_from_file(path: &Path, config: &Config) -> Result<Loaded> {
        Self::with(config, true, || read(path, config, Kept::Worn).map(|scene| worn(scene, config)))
    }

    /// Takes a glTF binary from memory; `name` stands for it in messages.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn from_glb(name: &str, bytes: &[u8], config: &Config) -> Result<Loaded> {
        Self::with(config, false, || Scene::from_glb(Path::new(name), bytes))
    }

    /// Takes a glTF binary from memory whose animations play on, where it has some.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn moving_from_glb(name: &str, bytes: &[u8], config: &Config) -> Result<Loaded> {
        let options = Kept::Motion.over(config, Progress::default());
        Self::with(config, true, || Scene::from_glb_with(Path::new(name), bytes, &options))
    }

    /// The same with the wearer's hands in it, where the settings want to see them.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn worn_from_glb(name: &str, bytes: &[u8], config: &Config) -> Result<Loaded> {
        let options = Kept::Worn.over(config, Progress::default());
        let read = || Scene::from_glb_with(Path::new(name), bytes, &options);
        Self::with(config, true, || read().map(|scene| worn(scene, config)))
    }

    fn with(config: &Config, moves: bool, load: impl FnOnce() -> Result<Scene> + Send) -> Result<Loaded> {
        let light = || environment(&config.environment, config.scene.time);
        let (scene, light) = rayon::join(|| timed("scene", load), || timed("environment", light));
        let ((scene, scene_step), ((mut environment, mut warnings), light_step)) = (scene?, light?);
        let day = day(&config.environment).filter(|_| moves);
        if day.is_some() {
            // Kernels have to know of a sun that is yet to rise.
            environment.sun = environment.sun.or(Some(Sun {
                direction: Vec3::NEG_Y,
                cos_radius: 1.0,
                radiance: Vec3::ZERO,
            }));
        }
        let ((bvh, shapes, parted, bvh_was_cached), bvh_step) =
            timed("bvh", || Ok(trees_of(&scene, tree_for(config))))?;
        warnings.extend(scene.warnings.iter().cloned());
        Ok(Loaded {
            scene,
            bvh,
            shapes,
            parted,
            bvh_was_cached,
            environment,
            day,
            steps: vec![scene_step, light_step, bvh_step],
            warnings,
        })
    }
}

impl Loaded {
    /// All trees.
    pub fn trees(&self) -> Trees<'_> {
        Trees { world: &self.bvh, shapes: &self.shapes }
    }

    /// Levels of all that rays walk, whatever its parts do.
    pub fn depth(&self) -> u32 {
        let spare = self.parted.as_ref().map_or(0, |parted| parted.depth() - self.bvh.depth());
        self.trees().depth() + spare
    }
}

/// What of a scene's motion is kept.
#[derive(Clone, Copy)]
enum Kept {
    Nothing,
    /// Animations play on.
    Motion,
    /// And hands seize things.
    Worn,
}

impl Kept {
    fn over(self, config: &Config, progress: Progress) -> LoadOptions {
        let grab = if matches!(self, Kept::Worn) { config.headset.grab } else { Grab::None };
        LoadOptions {
            keeps_motion: !matches!(self, Kept::Nothing),
            grab,
            ..config.scene.load_options(progress)
        }
    }
}

/// A scene with the wearer's hands in it, where the settings want to see them.
fn worn(mut scene: Scene, config: &Config) -> Scene {
    if config.headset.show_hands {
        hands::attach(&mut scene, config.scene.time);
    }
    scene
}

/// Reads a scene, under a progress bar where standard error is a terminal.
fn read(path: &Path, config: &Config, kept: Kept) -> Result<Scene> {
    let (bar, progress) = reading();
    let scene = Scene::load_with(path, &kept.over(config, progress));
    bar.finish_and_clear();
    scene
}

/// What walks the trees: the variant that settings force; else single rays where all devices that are to trace are graphics
/// cards, whose usual variant that is. That is asked before devices are opened: one that then refuses changes speed alone.
pub fn tree_for(config: &Config) -> TreeFor {
    match config.trace.traversal.forced() {
        Some(Traversal::Packet) => return TreeFor::Packets,
        Some(Traversal::SingleRay) => return TreeFor::SingleRays,
        None => {}
    }
    // Where nobody answers, or none can be used, opening them says so.
    let all = waiting::ask("OpenCL", "an OpenCL driver", Limits::MOMENTS, opencl::device::list);
    let all = all.unwrap_or_default();
    match opencl::choose(&all, &config.devices.opencl, &[0; 16]) {
        Ok(chosen) if chosen.iter().all(|&index| all[index].kind == "gpu") => TreeFor::SingleRays,
        _ => TreeFor::Packets,
    }
}

/// The scene's tree, those of shapes that are kept once and of its moving parts, and whether that of the others was in the
/// user's cache.
fn trees_of(scene: &Scene, tree_for: TreeFor) -> (WideBvh, Vec<WideBvh>, Option<Parted>, bool) {
    let (mesh, motion) = (&scene.mesh, scene.motion.as_ref());
    let first = motion.map_or(mesh.triangles.len(), |motion| motion.first_triangle(mesh));
    let (still, was_cached) = tree_of(tree_for, &mesh.positions, &mesh.triangles[..first]);
    let boxes = scene.instanced.iter().flat_map(|instanced| instanced.boxes()).collect::<Vec<_>>();
    let resting = boxes.len() - motion.map_or(0, |motion| motion.rigid.len());
    let still = if resting > 0 { over_instances(still, &boxes[..resting]) } else { still };
    let shapes = scene.instanced.as_ref().map_or_else(Vec::new, |instanced| shape_trees(tree_for, instanced));
    let Some(motion) = motion else { return (still, shapes, None, was_cached) };
    let parts: Vec<_> = motion.parts.iter().map(|part| part.triangles.clone()).collect();
    let moving: Vec<_> = (1..).zip(boxes).skip(resting).collect();
    let (bvh, parted) = Parted::build(tree_for, &mesh.positions, &mesh.triangles, &parts, still, &moving);
    (bvh, shapes, Some(parted), was_cached)
}

/// The tree of each shape, over its triangles and vertices as if there were no others.
fn shape_trees(tree_for: TreeFor, instanced: &Instanced) -> Vec<WideBvh> {
    let tree = |shape: &InstancedShape| {
        let first = shape.vertices.start as u32;
        let own = instanced.mesh.triangles[shape.triangles.clone()].iter().map(|t| t.map(|v| v - first));
        tree_of(tree_for, &instanced.mesh.positions[shape.vertices.clone()], &own.collect::<Vec<_>>()).0
    };
    instanced.shapes.iter().map(tree).collect()
}

/// The tree over triangles from the user's cache, and whether it was there; else built, under a progress bar where
/// standard error is a terminal.
fn tree_of(tree_for: TreeFor, positions: &[Vec3], triangles: &[[u32; 3]]) -> (WideBvh, bool) {
    let build = || {
        let bar = progress::bar(STEPS, "building the tree", "{msg} [{bar:30}] {percent} %, {elapsed}");
        let tree = WideBvh::build_for(tree_for, positions, triangles, &|done| {
            bar.set_position((done * STEPS as f64) as u64);
        });
        bar.finish_and_clear();
        tree
    };
    match TreeCache::of_user() {
        Some(cache) => cache.find_or(tree_for, positions, triangles, build),
        None => (build(), false),
    }
}

/// Parts of the whole that a progress bar tells apart.
const STEPS: u64 = 1000;

/// A progress bar for reading files that take long, and who moves it.
fn reading() -> (indicatif::ProgressBar, Progress) {
    let bar = progress::bar(STEPS, "reading the scene", "{msg} [{bar:30}] {percent} %, {elapsed}");
    let moved = bar.clone();
    (bar, Progress::to(move |done| moved.set_position((done * STEPS as f64) as u64)))
}

/// Runs a step under a line that names it, where standard error is a terminal, and times it.
pub fn timed<T>(name: &'static str, run: impl FnOnce() -> Result<T>) -> Result<(T, Step)> {
    let _line = progress::step(name);
    let start = Instant::now();
    let result = run()?;
    Ok((result, Step { name, ms: start.elapsed().as_secs_f64() * 1e3 }))
}

/// The sky that the settings ask for at time 0.
fn sky(config: &EnvironmentConfig) -> Sky {
    Sky {
        sun_elevation_deg: config.sun_elevation,
        sun_azimuth_deg: config.sun_azimuth,
        turbidity: config.turbidity,
        ..Sky::default()
    }
}

/// How the sky of the settings turns, where it does.
fn day(config: &EnvironmentConfig) -> Option<DayCycle> {
    let (seconds, scale) = (config.day_length, config.exposure.exp2() as f32);
    (seconds > 0.0).then(|| DayCycle { sky: sky(config), seconds, scale })
}

/// The environment that the settings ask for at a time in seconds, with warnings.
pub fn environment(config: &EnvironmentConfig, time: f64) -> Result<(Environment, Vec<String>)> {
    let (mut environment, warnings) = if config.map.as_os_str().is_empty() {
        let sky = day(config).map_or_else(|| sky(config), |cycle| cycle.at(time));
        (sky.bake(), Vec::new())
    } else {
        Environment::load(&config.map)?
    };
    let scale = config.exposure.exp2() as f32;
    if scale != 1.0 {
        environment.texels.iter_mut().for_each(|texel| *texel *= scale);
        if let Some(sun) = &mut environment.sun {
            sun.radiance *= scale;
        }
    }
    Ok((environment, warnings))
}

/// The map as all of these devices can hold it beside a scene: averaged down where it takes more than an eighth of
/// one's memory, or more than its largest buffer.
pub fn fitting_environment<'a>(map: &'a Environment, devices: &[Device]) -> Cow<'a, Environment> {
    let known = |bytes: u64| if bytes > 0 { bytes } else { u64::MAX };
    let room = |device: &Device| {
        let info = device.info();
        known(info.memory / 8).min(known(info.largest_buffer))
    };
    fitting(map, devices.iter().map(room).min().unwrap_or(u64::MAX))
}

fn fitting(map: &Environment, room: u64) -> Cow<'_, Environment> {
    let bytes = |factor: u64| {
        u64::from(map.width).div_ceil(factor)
            * u64::from(map.height).div_ceil(factor)
            * SceneData::ENVIRONMENT_TEXEL_BYTES
    };
    // A map of one texel always fits.
    let factor =
        (1..=u64::from(map.width.max(map.height))).find(|&factor| bytes(factor) <= room).unwrap_or(1);
    if factor == 1 { Cow::Borrowed(map) } else { Cow::Owned(map.reduced(factor as usize)) }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::config::TraversalConfig;
    use crate::scene::generate::voxel_town;

    #[test]
    fn trees_are_those_of_the_variant_that_settings_force() {
        let mut config = Config::default();
        let largest = |config: &Config| {
            let loaded = Loaded::from_glb("town", &voxel_town::generate(10_000, 1).unwrap(), config).unwrap();
            loaded.bvh.order.iter().map(|slot| slot.leaf_len).max()
        };
        config.trace.traversal = TraversalConfig::Packet;
        assert_eq!((tree_for(&config), largest(&config)), (TreeFor::Packets, Some(8)));
        config.trace.traversal = TraversalConfig::SingleRay;
        assert_eq!((tree_for(&config), largest(&config)), (TreeFor::SingleRays, Some(2)));
        // Where nothing is forced and a processor traces, alone or with others.
        config.trace.traversal = TraversalConfig::Auto;
        if opencl::device::list().iter().any(|info| info.kind == "cpu" && info.unusable.is_none()) {
            assert_eq!(tree_for(&config), TreeFor::Packets);
        }
    }

    #[test]
    fn maps_are_averaged_down_only_where_memory_demands_it() {
        let map = Environment {
            width: 8,
            height: 4,
            texels: vec![Vec3::splat(2.0); 32],
            ..Environment::constant(Vec3::ONE)
        };
        let size = |room: u64| {
            let map = fitting(&map, room * SceneData::ENVIRONMENT_TEXEL_BYTES);
            assert!(map.texels.iter().all(|&texel| texel == Vec3::splat(2.0)));
            (map.width, map.height)
        };
        assert_eq!([size(32), size(31), size(7)], [(8, 4), (4, 2), (3, 2)]);
    }
}
