//! A town of unit blocks, of any size: a stand-in for large block worlds such as Rungholt.
//!
//! Houses with rooms, towers, churches, parks and markets stand along a grid of streets on hills by a
//! river. Only faces between a block and something one can see through are made, two triangles each and
//! none merged, as exporters of such worlds do.
//!
//! The town is endless: what stands at a place depends on the place and the seed alone. Its lots are
//! made ring by ring around the centre until the wanted number of triangles is reached, and the last
//! lot is cut short, so that the number is met to within one face.

mod blocks;
mod lots;
mod palette;

use glam::{DVec3, Quat, Vec3};
use rayon::prelude::*;
use serde_json::json;

use super::glb::{Accessor, Component, Glb, Use};
use crate::error::{Error, Result};
use blocks::{Block, HEIGHT, PITCH, World};

/// Fewest triangles that [`generate`] accepts.
pub const LEAST_TRIANGLES: u64 = 10_000;
/// Most triangles that [`generate`] accepts.
pub const MOST_TRIANGLES: u64 = 20_000_000;

/// One visible side of a block.
#[derive(Clone, Copy)]
struct Face {
    x: u16,
    z: u16,
    y: u8,
    side: u8,
    block: Block,
}

/// Makes the town as a binary glTF file: within 1 % of `triangles`, about 44 bytes each. Blocks are cubes of
/// 1 m; positions are 16-bit (KHR_mesh_quantization). The camera `viewer` stands on a lookout near the
/// centre, `overview` sees all of the town.
///
/// Error: `triangles` is not within [`LEAST_TRIANGLES`] to [`MOST_TRIANGLES`].
pub fn generate(triangles: u64, seed: u64) -> Result<Vec<u8>> {
    if !(LEAST_TRIANGLES..=MOST_TRIANGLES).contains(&triangles) {
        return Err(Error::setting(
            "triangles",
            format!(
                "{triangles} is not within {LEAST_TRIANGLES} to {MOST_TRIANGLES}; choose a number that is"
            ),
        ));
    }
    let wanted = (triangles / 2) as usize;
    // A lot has some 3,000 faces; where that falls short, the next try is larger.
    let mut rings = ((wanted as f64 / 3000.0).sqrt() / 2.0).ceil() as usize + 1;
    loop {
        let world = World::new(rings, seed);
        let lots = visible_faces(&world, wanted);
        if lots.iter().map(Vec::len).sum::<usize>() >= wanted {
            return Ok(document(&world, &by_block(&lots, wanted)));
        }
        rings += rings.div_ceil(5);
    }
}

/// Faces of the lots, from the centre outwards, until there are `wanted`.
fn visible_faces(world: &World, wanted: usize) -> Vec<Vec<Face>> {
    let mut lots = Vec::new();
    let mut sum = 0;
    // The outermost ring has no neighbours yet: it only shows which sides are hidden.
    for ring in 0..world.rings {
        let made: Vec<Vec<Face>> =
            ring_of(ring as i32).into_par_iter().map(|lot| lot_faces(world, lot)).collect();
        sum += made.iter().map(Vec::len).sum::<usize>();
        lots.extend(made);
        if sum >= wanted {
            break;
        }
    }
    lots
}

/// The lots at Chebyshev distance `ring` from the centre, in a fixed order.
fn ring_of(ring: i32) -> Vec<[i32; 2]> {
    (-ring..=ring)
        .flat_map(|x| (-ring..=ring).map(move |z| [x, z]))
        .filter(|[x, z]| x.abs().max(z.abs()) == ring)
        .collect()
}

/// Sides in the order +X, -X, +Y, -Y, +Z, -Z.
const SIDES: [[i32; 3]; 6] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

fn lot_faces(world: &World, lot: [i32; 2]) -> Vec<Face> {
    let start = lot.map(|l| (l + world.rings as i32) as usize * PITCH);
    let mut faces = Vec::with_capacity(4096);
    for x in start[0]..start[0] + PITCH {
        for z in start[1]..start[1] + PITCH {
            for y in 0..HEIGHT {
                let block = world.block(x, y, z);
                if block == Block::AIR {
                    continue;
                }
                for (side, step) in SIDES.iter().enumerate() {
                    if block.shows_against(world.neighbour([x, y, z], *step)) {
                        faces.push(Face { x: x as u16, z: z as u16, y: y as u8, side: side as u8, block });
                    }
                }
            }
        }
    }
    faces
}

/// The first `wanted` faces, sorted into one list for each kind of block.
fn by_block(lots: &[Vec<Face>], wanted: usize) -> Vec<Vec<Face>> {
    let mut sorted = vec![Vec::new(); palette::COUNT];
    for face in lots.iter().flatten().take(wanted) {
        sorted[face.block.material()].push(*face);
    }
    sorted
}

fn document(world: &World, faces: &[Vec<Face>]) -> Vec<u8> {
    let mut glb = Glb::default();
    glb.extension("KHR_mesh_quantization", true);
    glb.reserve(faces.iter().map(|list| list.len() * 88 + 64).sum::<usize>() + (1 << 16));
    let materials = palette::add(&mut glb);
    let primitives = faces
        .iter()
        .zip(materials)
        .filter(|(list, _)| !list.is_empty())
        .map(|(list, material)| primitive(&mut glb, list, material))
        .collect();
    let mesh = glb.mesh("voxel town", primitives);
    let half = (world.size / 2) as f64;
    let town = glb.node(json!({ "name": "town", "mesh": mesh, "translation": [-half, 0.0, -half] }));
    let extent = faces
        .iter()
        .flatten()
        .map(|f| (f64::from(f.x) - half).abs().max((f64::from(f.z) - half).abs()))
        .fold(PITCH as f64, f64::max);
    let viewer = camera(&mut glb, "viewer", world.lookout(), DVec3::new(1.0, -0.34, 0.8));
    let above = DVec3::new(-1.15, 0.75, -0.85) * extent + DVec3::Y * 20.0;
    let overview = camera(&mut glb, "overview", above, DVec3::new(0.0, 10.0, 0.0) - above);
    glb.finish(&[town, viewer, overview])
}

fn camera(glb: &mut Glb, name: &str, position: DVec3, towards: DVec3) -> usize {
    let camera = glb.camera(name, 60f64.to_radians());
    let towards = towards.normalize().as_vec3();
    let right = towards.cross(Vec3::Y).normalize();
    let rotation = Quat::from_mat3(&glam::Mat3::from_cols(right, right.cross(towards), -towards)).normalize();
    glb.node(json!({
        "name": name, "camera": camera, "translation": position.to_array(), "rotation": rotation.to_array(),
    }))
}

/// Corners of each side's face, counter-clockwise from outside, from the lower left; order of [`SIDES`].
const CORNERS: [[[u16; 3]; 4]; 6] = [
    [[1, 0, 1], [1, 0, 0], [1, 1, 0], [1, 1, 1]],
    [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
    [[0, 1, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0]],
    [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
    [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    [[1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]],
];

fn primitive(glb: &mut Glb, faces: &[Face], material: usize) -> serde_json::Value {
    let (mut low, mut high) = ([u16::MAX; 3], [0u16; 3]);
    let view = glb.view(Use::Vertices(8), |binary| {
        for face in faces {
            for corner in CORNERS[usize::from(face.side)] {
                let at = [face.x + corner[0], u16::from(face.y) + corner[1], face.z + corner[2]];
                for axis in 0..3 {
                    (low[axis], high[axis]) = (low[axis].min(at[axis]), high[axis].max(at[axis]));
                }
                binary.extend_from_slice(bytemuck::cast_slice(&[at[0], at[1], at[2], 0]));
            }
        }
    });
    let vertices = |component, normalized, kind| Accessor {
        component,
        normalized,
        count: faces.len() * 4,
        kind,
        bounds: None,
    };
    let bounds = Some((low.map(f64::from).to_vec(), high.map(f64::from).to_vec()));
    let positions = glb.accessor(view, Accessor { bounds, ..vertices(Component::U16, false, "VEC3") });
    let view = glb.view(Use::Vertices(4), |binary| {
        for face in faces {
            let normal = SIDES[usize::from(face.side)].map(|c| (c * 127) as i8 as u8);
            binary.extend_from_slice(&[normal[0], normal[1], normal[2], 0].repeat(4));
        }
    });
    let normals = glb.accessor(view, vertices(Component::I8, true, "VEC3"));
    let view = glb.view(Use::Vertices(4), |binary| {
        for _ in faces {
            binary.extend_from_slice(&[0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        }
    });
    let uvs = glb.accessor(view, vertices(Component::U8, false, "VEC2"));
    let view = glb.view(Use::Indices, |binary| {
        for base in (0..faces.len() as u32).map(|i| i * 4) {
            binary.extend_from_slice(bytemuck::cast_slice(&[
                base,
                base + 1,
                base + 2,
                base,
                base + 2,
                base + 3,
            ]));
        }
    });
    let indices = Accessor {
        component: Component::U32,
        normalized: false,
        count: faces.len() * 6,
        kind: "SCALAR",
        bounds: None,
    };
    let indices = glb.accessor(view, indices);
    json!({
        "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs },
        "indices": indices, "material": material,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::generate::glb_reader::Read;

    #[test]
    fn the_wanted_number_of_triangles_is_met() {
        for wanted in [10_000, 12_345, 100_000, 777_777] {
            let read = Read::new(&generate(wanted, 3).unwrap());
            let got = read.triangles.len() as f64;
            assert!((got / wanted as f64 - 1.0).abs() < 0.01, "{wanted} {got}");
        }
    }

    #[test]
    fn a_large_town_is_made_and_its_size_is_as_promised() {
        let bytes = generate(2_000_000, 1).unwrap();
        assert!(bytes.len() < 2_000_000 * 45, "{}", bytes.len());
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for triangles in [0, 9_999, 20_000_001, u64::MAX] {
            assert!(generate(triangles, 0).unwrap_err().to_string().contains("triangles"));
        }
    }

    #[test]
    fn the_seed_decides_and_nothing_else() {
        let town = |seed| generate(20_000, seed).unwrap();
        assert!(town(5) == town(5));
        assert!(town(5) != town(6));
    }

    #[test]
    fn triangles_are_sound_and_the_viewer_stands_free() {
        let read = Read::new(&generate(200_000, 2).unwrap());
        read.assert_sound();
        let viewer = read.camera("viewer");
        read.assert_free(viewer, 0.6);
        read.camera("overview");
        let (low, high) = read.bounds();
        assert!(low.y >= 0.0 && high.y <= HEIGHT as f64 && high.x < 200.0 && low.x > -200.0, "{low} {high}");
        // There is a floor to stand on, 1.6 m below.
        let below = viewer - DVec3::Y * 1.6;
        assert!(read.distance(below) < 1e-3);
    }

    #[test]
    fn no_face_is_made_twice() {
        let read = Read::new(&generate(50_000, 2).unwrap());
        let mut centres: Vec<[i64; 3]> = read
            .triangles
            .iter()
            .map(|t| {
                let sum = (t[0] + t[1] + t[2]) * 3.0;
                [sum.x as i64, sum.y as i64, sum.z as i64]
            })
            .collect();
        let all = centres.len();
        centres.sort_unstable();
        centres.dedup();
        assert_eq!(centres.len(), all);
    }
}
