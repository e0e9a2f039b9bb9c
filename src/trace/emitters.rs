//! What shines, as kernels read it.

use glam::Vec3;

use crate::bvh::WideBvh;
use crate::layout;
use crate::scene::animation::Motion;
use crate::scene::emitters::{self, Source};
use crate::scene::light_tree::{LightTree, Link, Node};
use crate::scene::{Light, LightKind, Scene};

/// Emitters and the tree over them.
#[derive(Debug)]
pub(super) struct PackedEmitters {
    /// Triangles sorted by their places in leaf order, then punctual lights.
    pub list: Vec<layout::Emitter>,
    /// The tree, its root first.
    pub nodes: Vec<layout::LightNode>,
    /// How many of them are triangles.
    pub triangles: u32,
}

const PUNCTUAL: u32 = 1;
const DOUBLE_SIDED: u32 = 2;

impl PackedEmitters {
    /// None where there is nothing to aim at.
    pub fn of(scene: &Scene, bvh: &WideBvh) -> Option<Self> {
        Self::with_tree(scene, bvh).map(|(packed, ..)| packed)
    }

    /// The same with the emitters in the list's order, and the tree over them.
    fn with_tree(scene: &Scene, bvh: &WideBvh) -> Option<(Self, Vec<emitters::Emitter>, LightTree)> {
        let found = emitters::of(scene);
        if found.is_empty() {
            return None;
        }
        let mut places = vec![0u32; scene.mesh.triangles.len()];
        (0u32..).zip(&bvh.order).for_each(|(place, slot)| places[slot.triangle as usize] = place);
        let mut lights = vec![0u32; scene.lights.len()];
        (0u32..).zip(lights_in_order(scene)).for_each(|(place, light)| lights[light] = place);
        let place = |source: Source| match source {
            Source::Triangle(index) => (0, places[index as usize]),
            Source::Light(index) => (1, lights[index as usize]),
        };
        let mut sorted = found;
        sorted.sort_by_key(|emitter| place(emitter.source));
        let tree = LightTree::new(&sorted);
        let pack = |(emitter, &trail): (&emitters::Emitter, &u32)| {
            let (kind, place) = place(emitter.source);
            match emitter.source {
                Source::Triangle(index) => triangle(scene, index, place, trail),
                Source::Light(_) => {
                    layout::Emitter { place, trail, kind: kind * PUNCTUAL, ..Default::default() }
                }
            }
        };
        let packed = PackedEmitters {
            list: sorted.iter().zip(&tree.trails).map(pack).collect(),
            nodes: tree.nodes.iter().map(node).collect(),
            triangles: sorted.iter().filter(|e| matches!(e.source, Source::Triangle(_))).count() as u32,
        };
        Some((packed, sorted, tree))
    }
}

/// Emitters some of which move.
#[derive(Debug)]
pub(super) struct MovingEmitters {
    packed: PackedEmitters,
    /// In the list's order.
    sorted: Vec<emitters::Emitter>,
    tree: LightTree,
    /// Moving ones: their place in the list, and of triangles the power that a square metre sends.
    moving: Vec<(usize, f64)>,
}

impl MovingEmitters {
    /// None where nothing that shines moves. `bvh` is the tree in which the scene was packed.
    pub fn of(scene: &Scene, motion: &Motion, bvh: &WideBvh) -> Option<Self> {
        let (packed, sorted, tree) = PackedEmitters::with_tree(scene, bvh)?;
        let first = motion.first_triangle(&scene.mesh) as u32;
        let moves = |(place, emitter): (usize, &emitters::Emitter)| match emitter.source {
            Source::Triangle(index) if index >= first => {
                let corners = scene.mesh.triangles[index as usize].map(|v| scene.mesh.positions[v as usize]);
                Some((place, f64::from(emitter.power) / area(corners)))
            }
            Source::Light(index) if motion.lights.iter().any(|moving| moving.light == index as usize) => {
                Some((place, 0.0))
            }
            _ => None,
        };
        let moving: Vec<(usize, f64)> = sorted.iter().enumerate().filter_map(moves).collect();
        (!moving.is_empty()).then_some(MovingEmitters { packed, sorted, tree, moving })
    }

    /// All of them and their tree where they are now; `corners` tells, of moving triangles.
    pub fn at(
        &mut self,
        corners: impl Fn(u32) -> [Vec3; 3],
        lights: &[Light],
    ) -> (Vec<layout::Emitter>, Vec<layout::LightNode>) {
        for &(place, by_area) in &self.moving {
            let emitter = &mut self.sorted[place];
            match emitter.source {
                Source::Triangle(index) => {
                    let [a, b, c] = corners(index);
                    *emitter = emitter.moved([a, b, c], (by_area * area([a, b, c])) as f32);
                    let packed = &mut self.packed.list[place];
                    packed.corner = a.to_array();
                    packed.edges = [(b - a).to_array(), (c - a).to_array()];
                }
                Source::Light(index) => {
                    let light = &lights[index as usize];
                    if let Some(power) = emitters::light_power(light) {
                        emitter.power = power;
                    }
                    emitter.bounds = [light.position; 2];
                    emitter.axis = light.direction.normalize_or(Vec3::Y);
                }
            }
        }
        self.tree.refit(&self.sorted);
        (self.packed.list.clone(), self.tree.nodes.iter().map(node).collect())
    }
}

fn area([a, b, c]: [Vec3; 3]) -> f64 {
    0.5 * (b - a).as_dvec3().cross((c - a).as_dvec3()).length()
}

/// Punctual lights in the order in which kernels have them: those first that are all asked.
pub(super) fn lights_in_order(scene: &Scene) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scene.lights.len()).collect();
    if emitters::chooses_lights(scene) {
        order.sort_by_key(|&index| scene.lights[index].kind != LightKind::Directional);
    }
    order
}

/// How many punctual lights are all asked at each surface.
pub(super) fn lights_asked(scene: &Scene) -> usize {
    let chosen = emitters::chooses_lights(scene);
    scene.lights.iter().filter(|light| !chosen || light.kind == LightKind::Directional).count()
}

fn triangle(scene: &Scene, index: u32, place: u32, trail: u32) -> layout::Emitter {
    let mesh = &scene.mesh;
    let [a, b, c] = mesh.triangles[index as usize].map(|vertex| mesh.positions[vertex as usize]);
    let double_sided = scene.materials[mesh.materials[index as usize] as usize].double_sided;
    layout::Emitter {
        corner: a.to_array(),
        place,
        edges: [(b - a).to_array(), (c - a).to_array()],
        trail,
        kind: if double_sided { DOUBLE_SIDED } else { 0 },
    }
}

fn node(node: &Node) -> layout::LightNode {
    layout::LightNode {
        lower: node.bounds[0].to_array(),
        power: node.power,
        upper: node.bounds[1].to_array(),
        cos_spread: node.cos_spread,
        axis: node.axis.to_array(),
        link: match node.link {
            Link::Inner(second) => second,
            Link::Leaf(emitter) => crate::bvh::wide::LEAF | emitter,
        },
    }
}
