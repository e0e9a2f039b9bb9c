//! From files to what a renderer needs, and how long each step took.

use std::path::Path;
use std::time::Instant;

use crate::bvh::WideBvh;
use crate::config::{Config, EnvironmentConfig};
use crate::error::Result;
use crate::scene::sky::Sky;
use crate::scene::{Environment, Scene};

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
    /// Its light.
    pub environment: Environment,
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
        Self::with(config, || Scene::load(path))
    }

    /// Takes a glTF binary from memory; `name` stands for it in messages.
    ///
    /// # Errors
    /// Where the scene or the environment cannot be used.
    pub fn from_glb(name: &str, bytes: &[u8], config: &Config) -> Result<Loaded> {
        Self::with(config, || Scene::from_glb(Path::new(name), bytes))
    }

    fn with(config: &Config, load: impl FnOnce() -> Result<Scene> + Send) -> Result<Loaded> {
        let (scene, light) = rayon::join(
            || timed("scene", load),
            || timed("environment", || environment(&config.environment)),
        );
        let ((scene, scene_step), ((environment, mut warnings), light_step)) = (scene?, light?);
        let (bvh, bvh_step) =
            timed("bvh", || Ok(WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles)))?;
        warnings.extend(scene.warnings.iter().cloned());
        Ok(Loaded { scene, bvh, environment, steps: vec![scene_step, light_step, bvh_step], warnings })
    }
}

/// Runs a step and times it.
pub fn timed<T>(name: &'static str, run: impl FnOnce() -> Result<T>) -> Result<(T, Step)> {
    let start = Instant::now();
    let result = run()?;
    Ok((result, Step { name, ms: start.elapsed().as_secs_f64() * 1e3 }))
}

/// The environment that the settings ask for, with warnings.
pub fn environment(config: &EnvironmentConfig) -> Result<(Environment, Vec<String>)> {
    let (mut environment, warnings) = if config.map.as_os_str().is_empty() {
        let sky = Sky {
            sun_elevation_deg: config.sun_elevation,
            sun_azimuth_deg: config.sun_azimuth,
            turbidity: config.turbidity,
            ..Sky::default()
        };
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
