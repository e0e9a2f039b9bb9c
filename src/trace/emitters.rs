//! What shines, as kernels read it.

use crate::bvh::WideBvh;
use crate::layout;
use crate::scene::emitters::{self, Source};
use crate::scene::light_tree::{LightTree, Link, Node};
use crate::scene::{LightKind, Scene};

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
        Some(PackedEmitters {
            list: sorted.iter().zip(&tree.trails).map(pack).collect(),
            nodes: tree.nodes.iter().map(node).collect(),
            triangles: sorted.iter().filter(|e| matches!(e.source, Source::Triangle(_))).count() as u32,
        })
    }
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
