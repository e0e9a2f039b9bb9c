//! A glade with a pond, trees, ferns, grass and boulders: rounded, overlapping triangles from millimetres to
//! metres, of any number. A stand-in for scanned and sculpted scenes, as the block town is for block worlds.
//!
//! Leaves and blades are triangles, not pictures with holes. A few dozen plants and stones are made and placed
//! over and over, turned and scaled, from the glade outwards until the wanted number of triangles is reached.

mod ground;
mod materials;
mod plants;
mod stones;

use std::f32::consts::{FRAC_1_SQRT_2, TAU};

use glam::{Quat, Vec3};
use serde_json::json;

use super::glb::Glb;
use super::shapes::Shape;
use super::{Random, hash};
use crate::error::{Error, Result};
use materials::Materials;

/// Fewest triangles that [`generate`] accepts.
pub const LEAST_TRIANGLES: u64 = 150_000;
/// Most triangles that [`generate`] accepts.
pub const MOST_TRIANGLES: u64 = 20_000_000;
/// What a scene of this kind has where nothing else is said.
pub const USUAL_TRIANGLES: u64 = 1_000_000;

/// Where the viewer stands: x and z, before the scene is turned.
const VIEWER: [f32; 2] = [0.6, 6.4];
/// Metres around the viewer's feet in which nothing taller than grass grows.
const CLEAR: f32 = 1.5;
/// Metres from the glade's middle in which no tree stands.
const GLADE: f32 = 6.5;
/// Metres from tree to tree, about.
const TREE_PITCH: i32 = 6;

/// Makes the scene as a binary glTF file: within 1 % of `triangles`, all of its instances counted. The camera
/// `viewer` stands at the pond, with nothing nearer than 0.6 m.
///
/// # Errors
/// `triangles` is not within [`LEAST_TRIANGLES`] to [`MOST_TRIANGLES`].
pub fn generate(triangles: u64, seed: u64) -> Result<Vec<u8>> {
    if !(LEAST_TRIANGLES..=MOST_TRIANGLES).contains(&triangles) {
        return Err(Error::setting(
            "triangles",
            format!(
                "{triangles} is not within {LEAST_TRIANGLES} to {MOST_TRIANGLES}; choose a number that is"
            ),
        ));
    }
    let mut grove = Grove::new(triangles as usize, seed);
    grove.lay_ground();
    grove.grow();
    Ok(grove.finish())
}

/// A mesh that is placed many times.
struct Kind {
    mesh: usize,
    triangles: usize,
}

/// All that is placed, in variants.
struct Kinds {
    broadleaves: Vec<Kind>,
    conifers: Vec<Kind>,
    ferns: Vec<Kind>,
    tufts: Vec<Kind>,
    boulders: Vec<Kind>,
    pebbles: Vec<Kind>,
    mushrooms: Vec<Kind>,
}

/// The scene while it is made.
struct Grove {
    glb: Glb,
    materials: Materials,
    kinds: Kinds,
    nodes: Vec<usize>,
    wanted: usize,
    made: usize,
    seed: u64,
}

impl Grove {
    fn new(wanted: usize, seed: u64) -> Self {
        let mut glb = Glb::default();
        let materials = Materials::add(&mut glb);
        let kinds = Kinds::add(&mut glb, &materials, seed);
        Grove { glb, materials, kinds, nodes: Vec::new(), wanted, made: 0, seed }
    }

    /// Land, water, and a log beside it.
    fn lay_ground(&mut self) {
        let (mut land, mut water) = (Shape::default(), Shape::default());
        ground::land(&mut land);
        ground::pond(&mut water);
        let log = plants::log(&mut Random::new(hash(&[self.seed, 99])));
        for (name, shape, material) in [
            ("land", &land, self.materials.soil),
            ("pond", &water, self.materials.water),
            ("log", &log, self.materials.bark),
        ] {
            let kind = add(&mut self.glb, name, &[(shape, material)]);
            let node = self.glb.node(json!({ "name": name, "mesh": kind.mesh }));
            self.nodes.push(node);
            self.made += kind.triangles;
        }
    }

    /// Square metres from the middle outwards, until there are enough triangles.
    fn grow(&mut self) {
        let reach = ground::REACH as i32;
        for ring in 0..reach {
            for [x, z] in ring_of(ring) {
                self.plant(x, z);
            }
            if self.made + self.wanted / 500 >= self.wanted {
                return;
            }
        }
    }

    /// What grows on one square metre: mostly grass, and what its random number says.
    fn plant(&mut self, x: i32, z: i32) {
        let mut random = Random::new(hash(&[self.seed, x as u64, z as u64]));
        let at = [x as f32 + random.range(-0.4, 0.4), z as f32 + random.range(-0.4, 0.4)];
        let from_middle = at[0].hypot(at[1]);
        let from_viewer = (at[0] - VIEWER[0]).hypot(at[1] - VIEWER[1]);
        let depth = ground::depth_of_water(at[0], at[1]);
        let lattice = |c: i32| c.rem_euclid(TREE_PITCH) == 0;
        if lattice(x) && lattice(z) && from_middle > GLADE && from_viewer > 3.0 {
            let conifer = random.unit() < 0.35;
            let scale = random.range(0.75, 1.25);
            self.place(|k| if conifer { &k.conifers } else { &k.broadleaves }, at, scale, 0.0, &mut random);
        }
        let choice = random.unit();
        let tall_allowed = from_viewer > CLEAR;
        // Stones lie at the water's edge, ferns under trees.
        let shore = (depth + 0.1).abs() < 0.16;
        match choice {
            c if c < if shore { 0.30 } else { 0.05 } && tall_allowed => {
                let size = 0.16 + 0.75 * random.unit().powi(3);
                self.place(|k| &k.boulders, at, size, 0.5, &mut random);
            }
            c if c < 0.12 && depth < 0.0 => {
                let size = random.range(0.03, 0.1);
                self.place(|k| &k.pebbles, at, size, 0.5, &mut random);
            }
            c if c < 0.30 && depth < -0.15 && tall_allowed && from_middle > 3.0 => {
                let size = random.range(0.6, 1.15);
                self.place(|k| &k.ferns, at, size, 0.4, &mut random);
            }
            c if c < 0.34 && depth < -0.1 => {
                let size = random.range(0.7, 1.4);
                self.place(|k| &k.mushrooms, at, size, 0.4, &mut random);
            }
            _ => {}
        }
        if depth < -0.04 {
            let size = random.range(0.75, 1.3);
            self.place(|k| &k.tufts, [x as f32, z as f32], size, 1.0, &mut random);
        }
    }

    /// Places one of several variants where it still fits into the wanted number; `lean` is how much it
    /// follows the ground's slope.
    fn place(
        &mut self,
        of: impl Fn(&Kinds) -> &[Kind],
        [x, z]: [f32; 2],
        scale: f32,
        lean: f32,
        random: &mut Random,
    ) {
        let variants = of(&self.kinds);
        let kind = &variants[(random.unit() * variants.len() as f32) as usize % variants.len()];
        let turn = Quat::from_rotation_y(TAU * random.unit());
        if self.made + kind.triangles > self.wanted {
            return;
        }
        let up = Vec3::Y.lerp(ground::normal(x, z), lean).normalize();
        let rotation = Quat::from_rotation_arc(Vec3::Y, up) * turn;
        let node = self.glb.node(json!({
            "mesh": kind.mesh, "translation": [x, ground::height(x, z), z],
            "rotation": rotation.to_array(), "scale": [scale, scale, scale],
        }));
        self.made += kind.triangles;
        self.nodes.push(node);
    }

    fn finish(mut self) -> Vec<u8> {
        let [x, z] = VIEWER;
        let camera = self.glb.camera("viewer", 60f64.to_radians());
        let rotation = Quat::from_rotation_y(0.06) * Quat::from_rotation_x(-0.12);
        let viewer = self.glb.node(json!({
            "name": "viewer", "camera": camera, "translation": [x, ground::height(x, z) + 1.6, z],
            "rotation": rotation.to_array(),
        }));
        self.nodes.push(viewer);
        // A quarter turn to the left: the default sky's sun shines from the right, a little from behind.
        let root = self.glb.node(json!({
            "name": "glade", "children": self.nodes, "rotation": [0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
        }));
        self.glb.finish(&[root])
    }
}

impl Kinds {
    fn add(glb: &mut Glb, m: &Materials, seed: u64) -> Kinds {
        let mut variants = |name: &str, count: u64, make: &dyn Fn(&mut Random) -> Vec<(Shape, usize)>| {
            let one = |index: u64| {
                let shapes = make(&mut Random::new(hash(&[seed, index, hash_of(name)])));
                let parts: Vec<(&Shape, usize)> = shapes.iter().map(|(shape, m)| (shape, *m)).collect();
                add(glb, &format!("{name} {index}"), &parts)
            };
            (0..count).map(one).collect::<Vec<Kind>>()
        };
        Kinds {
            broadleaves: variants("broadleaf", 4, &|r| {
                let (wood, leaves) = plants::broadleaf(r);
                let autumn = r.unit() < 0.3;
                vec![(wood, m.bark), (leaves, if autumn { m.autumn } else { m.leaves })]
            }),
            conifers: variants("conifer", 3, &|r| {
                let (wood, needles) = plants::conifer(r);
                vec![(wood, m.bark), (needles, m.needles)]
            }),
            ferns: variants("fern", 4, &|r| vec![(plants::fern(r), m.fern)]),
            tufts: variants("tuft", 8, &|r| vec![(plants::tuft(r), m.grass)]),
            boulders: variants("boulder", 6, &|r| vec![(stones::stone(r, 11), m.rock)]),
            pebbles: variants("pebble", 4, &|r| vec![(stones::stone(r, 4), m.rock)]),
            mushrooms: variants("mushrooms", 3, &|r| {
                let (stems, caps) = plants::mushrooms(r);
                vec![(stems, m.stem), (caps, m.cap)]
            }),
        }
    }
}

fn hash_of(name: &str) -> u64 {
    name.bytes().fold(0, |sum, byte| hash(&[sum, u64::from(byte)]))
}

fn add(glb: &mut Glb, name: &str, parts: &[(&Shape, usize)]) -> Kind {
    let primitives = parts.iter().map(|(shape, material)| glb.primitive(shape, *material)).collect();
    let triangles = parts.iter().map(|(shape, _)| shape.triangles()).sum();
    Kind { mesh: glb.mesh(name, primitives), triangles }
}

/// The square metres at Chebyshev distance `ring` from the middle, in a fixed order.
fn ring_of(ring: i32) -> Vec<[i32; 2]> {
    (-ring..=ring)
        .flat_map(|x| {
            let step = if x.abs() == ring { 1 } else { (2 * ring).max(1) };
            (-ring..=ring).step_by(step as usize).map(move |z| [x, z])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::generate::glb_reader::Read;

    #[test]
    fn the_wanted_number_of_triangles_is_met() {
        for wanted in [LEAST_TRIANGLES, 333_333, USUAL_TRIANGLES] {
            let read = Read::new(&generate(wanted, 3).unwrap());
            let got = read.triangles.len() as f64;
            assert!((got / wanted as f64 - 1.0).abs() < 0.01, "{wanted} {got}");
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        for triangles in [0, LEAST_TRIANGLES - 1, MOST_TRIANGLES + 1, u64::MAX] {
            assert!(generate(triangles, 0).unwrap_err().to_string().contains("triangles"));
        }
    }

    #[test]
    fn the_seed_decides_and_nothing_else() {
        let glade = |seed| generate(LEAST_TRIANGLES, seed).unwrap();
        assert!(glade(5) == glade(5));
        assert!(glade(5) != glade(6));
    }

    #[test]
    fn triangles_are_sound_uneven_and_far_enough_from_the_viewer() {
        let read = Read::new(&generate(400_000, 1).unwrap());
        read.assert_sound();
        let viewer = read.camera("viewer");
        read.assert_free(viewer, 0.6);
        let (low, high) = read.bounds();
        assert!(low.min_element() > -300.0 && high.max_element() < 300.0, "{low} {high}");
        let mut areas: Vec<f64> =
            read.triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length()).collect();
        areas.sort_by(f64::total_cmp);
        let at = |share: usize| areas[areas.len() * share / 100];
        assert!(at(99) > 100.0 * at(1), "{} {}", at(1), at(99));
    }

    #[test]
    fn each_square_metre_comes_once() {
        let mut all: Vec<[i32; 2]> = (0..5).flat_map(ring_of).collect();
        assert_eq!(all.len(), 81);
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 81);
    }
}
