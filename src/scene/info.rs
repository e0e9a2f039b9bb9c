//! What a scene holds, in numbers: the answer of `foveate scene info`.

use std::collections::HashSet;
use std::sync::Arc;

use serde::Serialize;

use super::animation::ClipInfo;
use super::{Environment, Features, LeftOut, LightKind, Scene};

/// A summary of a scene under an environment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneInfo {
    /// Triangles of all instances.
    pub triangles: usize,
    /// Vertices of all instances.
    pub vertices: usize,
    /// Primitives placed by nodes.
    pub instances: usize,
    /// Those of which there is one copy alone, where there are any.
    pub shared: Option<Shared>,
    /// Materials in use.
    pub materials: usize,
    /// Textures in use.
    pub textures: usize,
    /// Bytes of all textures' texels with their mip levels.
    pub texture_bytes: usize,
    /// World bounds in metres; absent without triangles.
    pub bounds: Option<Bounds>,
    /// What the kernels need for it.
    pub features: Features,
    /// The file's cameras.
    pub cameras: Vec<CameraInfo>,
    /// The file's animations.
    pub animations: Vec<ClipInfo>,
    /// Names of the file's scenes.
    pub scenes: Vec<String>,
    /// Names of the file's variants of materials.
    pub variants: Vec<String>,
    /// The file's lights, by kind.
    pub lights: LightCounts,
    /// Triangles that were left out.
    pub left_out: LeftOut,
    /// What was left out or repaired.
    pub warnings: Vec<String>,
}

/// Shapes that are kept once ([`super::Instanced`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Shared {
    /// How many.
    pub shapes: usize,
    /// Triangles of each once.
    pub triangles: usize,
    /// Places where they are shown.
    pub instances: usize,
}

/// An axis-aligned box in world metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Least coordinates.
    pub min: [f64; 3],
    /// Greatest coordinates.
    pub max: [f64; 3],
}

/// A camera of the file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// The file's name for it, or empty.
    pub name: String,
    /// World position in metres.
    pub position: [f64; 3],
    /// Vertical field of view in degrees, of perspective cameras.
    pub fov_y: Option<f64>,
    /// Metres from the top to the bottom of what it sees, of orthographic cameras.
    pub height: Option<f64>,
}

/// Numbers of punctual lights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LightCounts {
    /// Point lights.
    pub point: usize,
    /// Spot lights.
    pub spot: usize,
    /// Directional lights.
    pub directional: usize,
}

/// Texels that textures share count once.
fn texture_bytes(scene: &Scene) -> usize {
    let mut seen = HashSet::new();
    let distinct = scene.textures.iter().filter(|texture| seen.insert(Arc::as_ptr(&texture.texels)));
    distinct.map(|texture| size_of_val(texture.texels.as_slice())).sum()
}

/// Sums up `scene` as it is lit by `environment`.
pub fn summarise(scene: &Scene, environment: &Environment) -> SceneInfo {
    let world = |corner: glam::Vec3| (scene.anchor + corner.as_dvec3()).to_array();
    let mut lights = LightCounts::default();
    for light in &scene.lights {
        match light.kind {
            LightKind::Point => lights.point += 1,
            LightKind::Spot { .. } => lights.spot += 1,
            LightKind::Directional => lights.directional += 1,
        }
    }
    let cameras = scene.cameras.iter().map(|camera| CameraInfo {
        name: camera.name.clone(),
        position: camera.world_from_eye.position.to_array(),
        fov_y: camera.fov_y.map(f64::to_degrees),
        height: camera.half_height.map(|half| 2.0 * half),
    });
    let instanced = scene.instanced.as_ref();
    SceneInfo {
        triangles: scene.triangles(),
        vertices: scene.mesh.positions.len() + instanced.map_or(0, |instanced| instanced.vertices()),
        instances: scene.instances,
        shared: instanced.map(|instanced| Shared {
            shapes: instanced.shapes.len(),
            triangles: instanced.mesh.triangles.len(),
            instances: instanced.instances.len(),
        }),
        materials: scene.materials.len(),
        textures: scene.textures.len(),
        texture_bytes: texture_bytes(scene),
        bounds: scene.bounds().map(|(low, high)| Bounds { min: world(low), max: world(high) }),
        features: Features::required_by(scene, environment),
        cameras: cameras.collect(),
        animations: scene.animations.clone(),
        scenes: scene.scenes.clone(),
        variants: scene.variants.clone(),
        lights,
        left_out: scene.left_out,
        warnings: scene.warnings.clone(),
    }
}
