//! The demo scene: a courtyard with a table of curiosities, arcades, a fountain, trees and far towers.
//!
//! It has what foveation has to cope with: fine textures and normal maps, mirrors and rough metals, thin
//! wires, railings and lattices, leaves with holes, small lamps, and depths from 1 m to 70 m. It is built
//! looking along -Z; its root node turns it so that the default sky's sun shines from the viewer's right,
//! a little from behind.

mod courtyard;
mod garden;
pub(super) mod materials;
mod table;

use std::f32::consts::FRAC_1_SQRT_2;

use glam::{Quat, Vec3};
use serde_json::json;

use super::glb::Glb;
use super::shapes::Shape;
use materials::Materials;

/// The demo scene as a binary glTF file; always the same bytes. The camera `viewer` is at eye height, and
/// nothing is nearer to it than 0.6 m.
pub fn generate() -> Vec<u8> {
    let mut stage = Stage::new();
    courtyard::build(&mut stage);
    table::build(&mut stage);
    garden::build(&mut stage);
    stage.finish()
}

/// The scene while it is built: meshes, and where they are placed.
struct Stage {
    glb: Glb,
    materials: Materials,
    nodes: Vec<usize>,
    /// What turns: its node, its rotation at rest, and seconds for a turn.
    turning: Vec<(usize, Quat, f32)>,
}

impl Stage {
    fn new() -> Self {
        let mut glb = Glb::default();
        let materials = Materials::add(&mut glb);
        Stage { glb, materials, nodes: Vec::new(), turning: Vec::new() }
    }

    /// Adds a mesh of shapes with their materials.
    fn mesh(&mut self, name: &str, parts: &[(&Shape, usize)]) -> usize {
        let primitives = parts.iter().map(|(shape, material)| self.glb.primitive(shape, *material)).collect();
        self.glb.mesh(name, primitives)
    }

    /// Places a mesh, turned about +Y by `turn` radians and scaled.
    fn place_turned(&mut self, mesh: usize, at: Vec3, turn: f32, scale: f32) {
        let node = self.glb.node(json!({
            "mesh": mesh, "translation": at.to_array(),
            "rotation": Quat::from_rotation_y(turn).to_array(), "scale": [scale, scale, scale],
        }));
        self.nodes.push(node);
    }

    /// Has what was placed last turn about its own +Y, once in so many seconds, which divide 24. At the beginning it is
    /// as it was placed, so that pictures are the same.
    fn turn_last(&mut self, rest: Quat, seconds: f32) {
        self.turning.extend(self.nodes.last().map(|&node| (node, rest, seconds)));
    }

    /// Places a mesh.
    fn place(&mut self, mesh: usize, at: Vec3) {
        let node = self.glb.node(json!({ "mesh": mesh, "translation": at.to_array() }));
        self.nodes.push(node);
    }

    /// Adds a mesh of one shape and places it where it was built.
    fn put(&mut self, name: &str, shape: &Shape, material: usize) {
        let mesh = self.mesh(name, &[(shape, material)]);
        let node = self.glb.node(json!({ "name": name, "mesh": mesh }));
        self.nodes.push(node);
    }

    fn finish(mut self) -> Vec<u8> {
        let camera = self.glb.camera("viewer", 60f64.to_radians());
        let down = Quat::from_rotation_x(-0.07);
        let viewer = self.glb.node(json!({
            "name": "viewer", "camera": camera, "translation": [0.0, 1.6, 0.0], "rotation": down.to_array(),
        }));
        self.nodes.push(viewer);
        // A quarter turn to the left.
        let root = self.glb.node(json!({
            "name": "courtyard", "children": self.nodes, "rotation": [0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2],
        }));
        self.glb.turning("curiosities", &self.turning);
        self.glb.finish(&[root])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::animation::Choice;
    use crate::scene::generate::glb_reader::Read;
    use crate::scene::{LoadOptions, Scene};

    #[test]
    fn the_scene_is_as_large_as_promised_and_always_the_same() {
        let bytes = generate();
        assert!(bytes.len() < 25_000_000, "{}", bytes.len());
        assert!(bytes == generate());
        let triangles = Read::new(&bytes).triangles.len();
        assert!((100_000..=300_000).contains(&triangles), "{triangles}");
    }

    #[test]
    fn what_turns_begins_as_it_lies_and_comes_round() {
        let bytes = generate();
        let at = |animation: &str, time: f64| {
            let options = LoadOptions { animation: Choice::new(animation), time, ..LoadOptions::default() };
            let scene = Scene::from_glb_with(std::path::Path::new("demo"), &bytes, &options).unwrap();
            assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
            scene.mesh.positions.iter().map(|p| scene.anchor + p.as_dvec3()).collect::<Vec<_>>()
        };
        let farthest = |a: &[glam::DVec3], b: &[glam::DVec3]| {
            a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
        };
        let rest = at("none", 0.0);
        for time in [0.0, 24.0, 48.0] {
            assert!(farthest(&rest, &at("auto", time)) < 1e-5, "{time}");
        }
        let turned = at("auto", 3.0);
        let moved = rest.iter().zip(&turned).filter(|(a, b)| a.distance(**b) > 1e-3).count();
        assert!(moved > 5000 && farthest(&rest, &turned) < 0.5, "{moved}");
    }

    #[test]
    fn triangles_are_sound_and_the_viewer_stands_free() {
        let read = Read::new(&generate());
        read.assert_sound();
        let viewer = read.camera("viewer");
        assert!(viewer.distance(glam::DVec3::new(0.0, 1.6, 0.0)) < 1e-5);
        read.assert_free(viewer, 0.6);
        let (low, high) = read.bounds();
        assert!(low.min_element() > -120.0 && high.max_element() < 120.0, "{low} {high}");
    }

    #[test]
    fn the_parser_finds_nothing_wrong_and_every_kind_of_material() {
        let file = gltf::Gltf::from_slice(&generate()).unwrap();
        let any = |f: &dyn Fn(&gltf::Material) -> bool| file.materials().any(|m| f(&m));
        assert!(any(&|m| m.normal_texture().is_some()));
        assert!(any(&|m| m.alpha_mode() == gltf::material::AlphaMode::Mask));
        assert!(any(&|m| m.emissive_strength().is_some()));
        assert!(any(&|m| m.pbr_metallic_roughness().metallic_roughness_texture().is_some()));
        assert!(file.nodes().filter(|n| n.mesh().is_some()).count() > 2 * file.meshes().count());
    }
}
