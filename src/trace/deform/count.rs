//! What devices need of their memory to deform moving parts, before any of it is made.

use super::rest::{can_deform, morphs_of};
use crate::bvh::Parted;
use crate::layout::{Influence, Morph, RestVertex};
use crate::scene::Scene;
use crate::scene::animation::{Geometry, Part};
use crate::trace::BufferBytes;
use crate::trace::moving::shines;

/// The buffers that a device has beside the scene's own where devices deform its moving parts, whose trees are `parted`;
/// none where there is nothing to deform.
pub fn deformed_bytes(scene: &Scene, parted: &Parted) -> Vec<BufferBytes> {
    let Some(motion) = &scene.motion else { return Vec::new() };
    let is_lit = |part: &Part| !shines(scene, part.triangles.start);
    let own = || motion.parts.iter().filter(|part| can_deform(&part.geometry) && is_lit(part));
    let (Some(last), Some(first)) = (own().next_back(), motion.parts.first()) else { return Vec::new() };
    let sum = |count: fn(&Geometry) -> usize| own().map(|part| count(&part.geometry)).sum::<usize>();
    let moving_nodes: usize = parted.parts.iter().map(|part| part.nodes.len()).sum();
    let list = [
        ("vertices at rest", sum(|own| own.positions.len()) + 1, size_of::<RestVertex>()),
        ("joints' shares", sum(influences), size_of::<Influence>()),
        (
            "morph targets",
            sum(|own| (0..own.positions.len()).map(|v| morphs_of(own, v).count()).sum()),
            size_of::<Morph>(),
        ),
        ("joints", sum(joints), size_of::<[[f32; 4]; 3]>()),
        ("morph weights", sum(|own| own.targets.len()), size_of::<f32>()),
        ("moved vertices", last.vertices.end - first.vertices.start, size_of::<[f32; 3]>()),
        ("moving nodes", moving_nodes, size_of::<u32>()),
        ("top nodes", parted.top, size_of::<u32>()),
        ("moving boxes", parted.top + moving_nodes, size_of::<[[f32; 3]; 2]>()),
    ];
    list.map(|(name, count, each)| BufferBytes { name, bytes: count.max(1) * each }).to_vec()
}

fn joints(geometry: &Geometry) -> usize {
    geometry.skin.as_ref().map_or(1, |skin| skin.joints.len())
}

fn influences(geometry: &Geometry) -> usize {
    geometry.skin.as_ref().map_or(geometry.positions.len(), |skin| skin.influences.len())
}
