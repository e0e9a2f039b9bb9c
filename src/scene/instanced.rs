//! Shapes that are kept once and shown at many places: object instancing, as pbrt calls it.
//!
//! **Instances.** A forest of ten thousand trees of a hundred thousand triangles each would be a thousand million
//! triangles. Where a file places one primitive often, and all instances together have more than [`FLAT_TRIANGLES`]
//! triangles, it stays one shape with a tree of its own; the scene's tree has a leaf for each place, which holds
//! the matrix that puts the shape there. Triangles are put into the world while they are tested, so that those at an edge
//! see the same two points, watertight as ever; boxes are tested in the shape's frame, where they fit, with rays,
//! frustums and beams that are turned once for each instance they come into. Light, records and pictures know only
//! points of the world, so that a picture is what the flattened scene's is but for the rounding of positions (units in
//! the last place of a coordinate relative to the anchor). Surfaces of two instances that touch are rounded each by
//! itself: unlike flattened ones they may leave a gap of that width.
//!
//! What is flattened all the same: small scenes, where that saves little; what bends or changes its form; what shines,
//! since emitters are aimed at one by one; and places of a matrix that flattens the shape.
//!
//! **Instances that move.** What an animation moves as a whole is a shape too, even if it is placed once, where such parts
//! have more than [`MOVED_TRIANGLES`] triangles together: then a frame needs a matrix for each, and neither vertices nor
//! trees are made anew. Doors to them are among the parts below the top that is built for each frame
//! (`src/bvh/parted.rs`). While its matrix flattens it, a shape is not there; where motion mirrors it, it stays wound as it
//! was at first.

use std::ops::Range;

use glam::{DMat3, DMat4, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::{Mesh, Scene};

/// Triangles of all instances of a scene up to which none is kept as one: 2 GB while they are loaded.
pub const FLAT_TRIANGLES: u64 = 4_000_000;

/// Triangles of all parts that move as a whole up to which none of these is kept as a shape: two cores make so many anew for
/// a frame in three milliseconds, and rays find what is placed already a little sooner than what is not.
pub const MOVED_TRIANGLES: u64 = 40_000;

/// A matrix whose determinant is less of its columns' lengths flattens what it places.
const FLATTENS: f64 = 1e-6;

/// Triangles that instances of a shape have more than the shape at least, for it to be kept once.
const LEAST_SAVED: u64 = 10_000;

/// Which shapes are kept once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Instancing {
    /// Those that are placed often, in scenes of more than [`FLAT_TRIANGLES`].
    #[default]
    Auto,
    /// All that are placed more than once.
    Shared,
    /// None.
    Flat,
}

impl Instancing {
    /// Whether a shape of `triangles` that is placed `copies` times is kept once, in a scene whose instances have `all`
    /// triangles.
    pub fn shares(self, triangles: u64, copies: u64, all: u64) -> bool {
        let saved = triangles.saturating_mul(copies.saturating_sub(1));
        match self {
            Instancing::Auto => all > FLAT_TRIANGLES && saved >= LEAST_SAVED,
            Instancing::Shared => copies > 1 && triangles > 0,
            Instancing::Flat => false,
        }
    }

    /// The same for a shape that moves as a whole, in a scene where `all` triangles do.
    pub fn shares_moving(self, all: u64) -> bool {
        match self {
            Instancing::Auto => all > MOVED_TRIANGLES,
            Instancing::Shared => true,
            Instancing::Flat => false,
        }
    }
}

/// Shapes that are kept once, and their places.
#[derive(Clone, Debug, Default)]
pub struct Instanced {
    /// The shapes' triangles, each in its shape's frame, in metres.
    pub mesh: Mesh,
    /// Each shape's part of the mesh.
    pub shapes: Vec<InstancedShape>,
    /// Where they are shown.
    pub instances: Vec<Instance>,
}

/// A shape: a part of [`Instanced::mesh`].
#[derive(Clone, Debug, PartialEq)]
pub struct InstancedShape {
    /// Its triangles.
    pub triangles: Range<usize>,
    /// Its vertices.
    pub vertices: Range<usize>,
}

/// A shape at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index of its shape.
    pub shape: u32,
    /// The rows of the matrix that takes the shape's points to places relative to the anchor, in metres. It does not mirror.
    pub anchor_from_shape: [[f32; 4]; 3],
}

impl Instance {
    /// By the matrix that takes the shape's points to places relative to the anchor.
    pub fn new(shape: u32, anchor_from_shape: &DMat4) -> Self {
        let row = |axis: usize| anchor_from_shape.row(axis).as_vec4().to_array();
        Instance { shape, anchor_from_shape: [row(0), row(1), row(2)] }
    }

    /// Where it puts a point: as kernels do (`placed` in `kernels/shared/scene.h`), in the same roundings.
    pub fn place(&self, p: Vec3) -> Vec3 {
        let row = |[x, y, z, w]: [f32; 4]| x.mul_add(p.x, y.mul_add(p.y, z.mul_add(p.z, w)));
        Vec3::from_array(self.anchor_from_shape.map(row))
    }

    /// The box around a box of its shape: what [`Instance::place`] makes of any point in that lies in this, since rounding
    /// keeps order.
    pub fn place_box(&self, (low, high): (Vec3, Vec3)) -> (Vec3, Vec3) {
        let pick = |row: [f32; 4], upper: bool| {
            let end = |axis: usize| if (row[axis] < 0.0) != upper { high[axis] } else { low[axis] };
            row[0].mul_add(end(0), row[1].mul_add(end(1), row[2].mul_add(end(2), row[3])))
        };
        (
            Vec3::from_array(self.anchor_from_shape.map(|row| pick(row, false))),
            Vec3::from_array(self.anchor_from_shape.map(|row| pick(row, true))),
        )
    }

    /// The same matrix in double precision.
    pub fn matrix(&self) -> DMat4 {
        let column = |axis: usize| DVec3::from_array(self.anchor_from_shape.map(|row| f64::from(row[axis])));
        DMat4::from_cols(
            column(0).extend(0.0),
            column(1).extend(0.0),
            column(2).extend(0.0),
            column(3).extend(1.0),
        )
    }
}

/// Whether an instance of a shape in a box is what the flattened shape would be: its matrix flattens nothing, and sums of a
/// few terms stay finite in single precision.
pub fn is_usable(anchor_from_shape: &DMat4, (low, high): (DVec3, DVec3)) -> bool {
    let linear = DMat3::from_mat4(*anchor_from_shape);
    let lengths = linear.x_axis.length() * linear.y_axis.length() * linear.z_axis.length();
    let is_solid = linear.determinant().abs() > FLATTENS * lengths && lengths.is_finite();
    let reach = linear.abs() * low.abs().max(high.abs()) + anchor_from_shape.w_axis.truncate().abs();
    is_solid && reach.max_element() < f64::from(f32::MAX) * 0.25 && lengths > f64::from(f32::MIN_POSITIVE)
}

impl Instanced {
    /// The box around each shape, in its frame.
    pub fn shape_bounds(&self) -> Vec<(Vec3, Vec3)> {
        let of = |shape: &InstancedShape| {
            let corners = self.mesh.triangles[shape.triangles.clone()].iter().flatten();
            let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            corners.fold(none, |(low, high), &corner| {
                let p = self.mesh.positions[corner as usize];
                (low.min(p), high.max(p))
            })
        };
        self.shapes.iter().map(of).collect()
    }

    /// The box around each instance, relative to the anchor.
    pub fn boxes(&self) -> Vec<(Vec3, Vec3)> {
        let shapes = self.shape_bounds();
        self.instances.iter().map(|instance| instance.place_box(shapes[instance.shape as usize])).collect()
    }

    /// Triangles of all instances.
    pub fn triangles(&self) -> usize {
        let of = |instance: &Instance| self.shapes[instance.shape as usize].triangles.len();
        self.instances.iter().map(of).sum()
    }

    /// Vertices of all instances.
    pub fn vertices(&self) -> usize {
        let of = |instance: &Instance| self.shapes[instance.shape as usize].vertices.len();
        self.instances.iter().map(of).sum()
    }
}

impl Scene {
    /// What the scene's triangles are in: what is placed already, and shapes that are kept once.
    pub fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        std::iter::once(&self.mesh).chain(self.instanced.iter().map(|instanced| &instanced.mesh))
    }

    /// Triangles of all instances.
    pub fn triangles(&self) -> usize {
        self.mesh.triangles.len() + self.instanced.as_ref().map_or(0, |instanced| instanced.triangles())
    }

    /// Bounds of everything relative to the anchor; `None` without triangles. Around an instance lies the box of its
    /// shape's box.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let boxes = self.instanced.iter().flat_map(|instanced| instanced.boxes());
        self.mesh.bounds().into_iter().chain(boxes).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// The scene with the boxes of instances in their place, twelve triangles each: what is enough to find a place to
    /// stand.
    pub fn outlines(&self) -> std::borrow::Cow<'_, Mesh> {
        let Some(instanced) = &self.instanced else { return std::borrow::Cow::Borrowed(&self.mesh) };
        let mut mesh = Mesh {
            positions: self.mesh.positions.clone(),
            triangles: self.mesh.triangles.clone(),
            ..Mesh::default()
        };
        let shapes = instanced.shape_bounds();
        for instance in &instanced.instances {
            let (low, high) = shapes[instance.shape as usize];
            let first = mesh.positions.len() as u32;
            let corner =
                |i: u32| Vec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), high, low);
            mesh.positions.extend((0..8).map(|i| instance.place(corner(i))));
            mesh.triangles.extend(BOX.map(|triangle| triangle.map(|i| first + i)));
        }
        std::borrow::Cow::Owned(mesh)
    }

    /// The same scene with every instance's triangles in the mesh: what tests compare pictures with. Normals and tangents
    /// are turned in double precision, and nothing moves on.
    pub fn flattened(&self) -> Scene {
        let mut scene = Scene { instanced: None, motion: None, ..self.clone() };
        let Some(instanced) = &self.instanced else { return scene };
        for instance in &instanced.instances {
            append(&mut scene.mesh, instanced, instance);
        }
        scene
    }
}

/// A box's sides, seen from outside, by corners of which bit k is set where axis k is at its upper end.
const BOX: [[u32; 3]; 12] = [
    [0, 4, 6],
    [0, 6, 2],
    [1, 3, 7],
    [1, 7, 5],
    [0, 1, 5],
    [0, 5, 4],
    [2, 6, 7],
    [2, 7, 3],
    [0, 2, 3],
    [0, 3, 1],
    [4, 5, 7],
    [4, 7, 6],
];

/// Adds an instance's triangles to a mesh.
fn append(mesh: &mut Mesh, instanced: &Instanced, instance: &Instance) {
    use super::gltf::vectors::{transform_normal, transform_tangent};
    let (from, shape) = (&instanced.mesh, &instanced.shapes[instance.shape as usize]);
    let linear = DMat3::from_mat4(instance.matrix());
    let (base, vertices) = (mesh.positions.len() as u32, shape.vertices.clone());
    mesh.positions.extend(from.positions[vertices.clone()].iter().map(|&p| instance.place(p)));
    mesh.normals.extend(from.normals[vertices.clone()].iter().map(|&n| transform_normal(&linear, n)));
    let count = mesh.positions.len();
    if !from.tangents.is_empty() || !mesh.tangents.is_empty() {
        mesh.tangents.resize(base as usize, glam::Vec4::new(1.0, 0.0, 0.0, 1.0));
        let own = from.tangents.get(vertices.clone()).unwrap_or_default();
        mesh.tangents.extend(own.iter().map(|&t| transform_tangent(&linear, t)));
        mesh.tangents.resize(count, glam::Vec4::new(1.0, 0.0, 0.0, 1.0));
    }
    for (uvs, from) in mesh.uvs.iter_mut().zip(&from.uvs) {
        if !from.is_empty() || !uvs.is_empty() {
            uvs.resize(base as usize, Default::default());
            uvs.extend_from_slice(from.get(vertices.clone()).unwrap_or_default());
            uvs.resize(count, Default::default());
        }
    }
    if !from.colors.is_empty() || !mesh.colors.is_empty() {
        mesh.colors.resize(base as usize, glam::Vec4::ONE);
        mesh.colors.extend_from_slice(from.colors.get(vertices.clone()).unwrap_or_default());
        mesh.colors.resize(count, glam::Vec4::ONE);
    }
    let place = |triangle: &[u32; 3]| triangle.map(|corner| corner - vertices.start as u32 + base);
    mesh.triangles.extend(from.triangles[shape.triangles.clone()].iter().map(place));
    mesh.materials.extend_from_slice(&from.materials[shape.triangles.clone()]);
}
