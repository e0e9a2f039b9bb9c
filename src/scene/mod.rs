//! A scene on the host: what a glTF file says, flattened to one list of triangles, but for shapes that are placed very
//! often ([`Instanced`]).
//!
//! Everything is in metres, right-handed, +Y up. Positions are stored in `f32` relative to
//! [`Scene::anchor`], which is kept in `f64`: transforms are composed in `f64` first, so a scene
//! far from the origin loses nothing.

pub mod animation;
pub mod budget;
pub mod emitters;
pub mod environment;
pub mod features;
pub mod formats;
pub mod generate;
pub mod glossy;
pub mod gltf;
pub mod grab;
pub mod hands;
pub mod importance;
pub mod info;
pub mod instanced;
pub mod layers;
pub mod light_tree;
pub mod material;
mod obj;
mod options;
pub mod pick;
pub mod sky;
mod source;
pub mod texture;
pub mod viewpoint;

use glam::{DVec3, Vec2, Vec3, Vec4};

pub use environment::{Environment, Sun};
pub use features::Features;
pub use instanced::{Instanced, Instancing};
pub use layers::Layers;
pub use material::{AlphaMode, Glass, Material, TextureRef};
pub use options::{LoadOptions, Progress};
pub use texture::Texture;
pub use viewpoint::{Viewpoint, default_viewpoint};

use std::path::Path;
use std::sync::Arc;

use self::formats::Format;
use crate::math::pose::Pose;
use crate::{Error, Result};

/// What went right, or a clause about what is wrong with a file and the next step.
type Outcome<T> = std::result::Result<T, String>;

/// A scene, ready to be traced.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// World position, in metres, of the origin that [`Mesh::positions`] and lights are relative to.
    pub anchor: DVec3,
    /// All triangles of all instances, in world orientation, but for those of `instanced`.
    pub mesh: Mesh,
    /// Shapes that are kept once and shown at many places, where that pays.
    pub instanced: Option<Arc<Instanced>>,
    /// Materials; [`Mesh::materials`] points here. Never empty when there are triangles.
    pub materials: Vec<Material>,
    /// Textures; [`TextureRef::texture`] points here.
    pub textures: Vec<Texture>,
    /// Punctual lights (KHR_lights_punctual), in world orientation, relative to the anchor.
    pub lights: Vec<Light>,
    /// The file's cameras.
    pub cameras: Vec<Camera>,
    /// The camera that views start from, if one was asked for.
    pub camera: Option<usize>,
    /// The file's animations.
    pub animations: Vec<animation::ClipInfo>,
    /// What moves, where that was asked for ([`LoadOptions::keeps_motion`]) and anything does.
    pub motion: Option<Arc<animation::Motion>>,
    /// Names of the file's scenes, which may be empty; one of them is this.
    pub scenes: Vec<String>,
    /// Names of the file's variants of materials (KHR_materials_variants).
    pub variants: Vec<String>,
    /// Mesh instances (primitives placed by nodes).
    pub instances: usize,
    /// Triangles that were left out.
    pub left_out: LeftOut,
    /// Sentences about what was left out or repaired, each said once.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Reads a file: glTF 2.0 ([`gltf::load`]) or Wavefront OBJ.
    ///
    /// # Errors
    /// [`Error::File`] when the file itself cannot be read, [`Error::Scene`] when it is of a format that is
    /// not read, what it or its neighbours say cannot be used, or takes more memory than is free.
    pub fn load(path: &Path) -> Result<Self> {
        Self::load_with(path, &LoadOptions::default())
    }

    /// The same in a way that is not the usual one.
    ///
    /// # Errors
    /// As [`Scene::load`], and where the file has no scene or variant of the name that is asked for.
    pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Self> {
        let start = source::read_file(path, 64).map_err(|error| Error::io(path, &error))?;
        let refuse = |problem| Error::Scene { path: path.to_path_buf(), problem };
        let mut scene = match formats::format_of(path, &start).map_err(refuse)? {
            Format::Gltf => gltf::load(path, options)?,
            Format::Obj => obj::load(path, options)?,
        };
        if let Some(wanted) = &options.camera {
            let names: Vec<&str> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
            scene.camera = Some(options::by_name(&names, wanted, "camera").map_err(refuse)?);
        }
        Ok(scene)
    }

    /// Tells whether a file can be read; see [`gltf::check`].
    pub fn check(path: &Path) -> Result<()> {
        gltf::check(path)
    }

    /// Reads a binary glTF 2.0 file from memory; see [`gltf::load_glb`].
    pub fn from_glb(name: &Path, bytes: &[u8]) -> Result<Self> {
        Self::from_glb_with(name, bytes, &LoadOptions::default())
    }

    /// The same in a way that is not the usual one.
    pub fn from_glb_with(name: &Path, bytes: &[u8], options: &LoadOptions) -> Result<Self> {
        gltf::load_glb(name, bytes, options)
    }
}

/// Numbers of triangles that a file has and its scene has not, of all instances, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct LeftOut {
    /// Some corner is not finite, or lies beyond single precision relative to the anchor.
    pub not_finite: usize,
    /// The corners lie on a line, or are one point in single precision relative to the anchor.
    pub no_area: usize,
    /// Not triangles, but primitives that were to be placed and have none.
    pub empty_primitives: usize,
}

/// Triangles as separate arrays. Per-vertex arrays other than `positions` and `normals` are either
/// empty (no material needs them) or as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions relative to the scene's anchor, in metres; all finite.
    pub positions: Vec<Vec3>,
    /// Unit shading normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents; w is the bitangent's sign (glTF's TANGENT).
    pub tangents: Vec<Vec4>,
    /// Texture coordinates of the two slots that a material may use ([`TextureRef::uv_slot`]).
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours that multiply the base colour.
    pub colors: Vec<Vec4>,
    /// Vertex indices, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// The material of each triangle.
    pub materials: Vec<u32>,
}

impl Mesh {
    /// Bounds of all positions relative to the anchor; `None` without triangles.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut corners = self.triangles.iter().flatten().map(|&index| self.positions[index as usize]);
        let first = corners.next()?;
        Some(corners.fold((first, first), |(low, high), p| (low.min(p), high.max(p))))
    }
}

/// A light of KHR_lights_punctual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Its kind and what only that kind has.
    pub kind: LightKind,
    /// Linear colour times intensity: candela for point and spot, lux for directional.
    pub intensity: Vec3,
    /// Position relative to the anchor (unused for directional lights).
    pub position: Vec3,
    /// Unit direction in which the light shines (unused for point lights).
    pub direction: Vec3,
    /// Distance in metres beyond which the light is gone; infinite when the file names none.
    pub range: f32,
}

/// The kinds of punctual lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Shines everywhere from a point.
    Point,
    /// Shines in parallel from infinitely far.
    Directional,
    /// A cone: cosines of the inner and the outer cone angle.
    Spot {
        /// Full intensity inside this angle's cosine.
        cos_inner: f32,
        /// Nothing outside this angle's cosine.
        cos_outer: f32,
    },
}

/// A camera of the file, placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The file's name for it, or empty.
    pub name: String,
    /// Where it is; it looks along its -Z.
    pub world_from_eye: Pose,
    /// Vertical field of view in radians, of perspective cameras.
    pub fov_y: Option<f64>,
    /// Half of what it sees from its top to its bottom, in metres, of orthographic cameras.
    pub half_height: Option<f64>,
}
