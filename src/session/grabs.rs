//! What the wearer's hands carry.
//!
//! A hand that is squeezed seizes the nearest thing within its reach: only as the squeeze begins, and from the other hand if
//! that has it. From then on the thing keeps its place in the hand, wherever this goes, by itself or with its wearer, until
//! the squeeze ends; there it stays, and its animation no longer moves it. While a hand's place is not known, what it
//! carries stays too.

use std::sync::Arc;

use glam::DMat4;

use crate::math::pose::Pose;
use crate::scene::animation::Motion;

/// Metres from a grip to the box around a thing that it can seize.
const REACH: f64 = 0.1;

/// Both hands and all that they can seize.
pub struct Grabs {
    motion: Arc<Motion>,
    /// Whether each hand was squeezed at the last step.
    squeezed: [bool; 2],
    held: [Option<Held>; 2],
    /// `world_from_node` of each thing that has been seized once.
    places: Vec<Option<DMat4>>,
}

/// What a hand carries.
#[derive(Clone, Copy)]
struct Held {
    /// Its number among all.
    thing: usize,
    hand_from_node: DMat4,
}

impl Grabs {
    /// Empty hands; `None` where the scene has nothing for them.
    pub fn new(motion: &Arc<Motion>) -> Option<Self> {
        let places = vec![None; motion.grabbable.len()];
        let motion = motion.clone();
        (!places.is_empty()).then_some(Grabs { motion, squeezed: [false; 2], held: [None; 2], places })
    }

    /// Seizes, carries and puts down, for grips in the scene, `passed` seconds of the scene's time after its beginning.
    /// Returns where each thing has been put, if it has (`world_from_node`).
    pub fn step(&mut self, grips: &[Option<Pose>; 2], squeezes: [bool; 2], passed: f64) -> &[Option<DMat4>] {
        let finite = |grip: Pose| grip.position.is_finite() && grip.rotation.is_finite();
        let matrix = |grip: Pose| DMat4::from_rotation_translation(grip.rotation, grip.position);
        let hands = grips.map(|grip| grip.filter(|grip| finite(*grip)).map(matrix));
        for (hand, world_from_hand) in hands.into_iter().enumerate() {
            if !squeezes[hand] {
                self.held[hand] = None;
            }
            if let Some((held, world_from_hand)) = self.held[hand].zip(world_from_hand) {
                self.places[held.thing] = Some(world_from_hand * held.hand_from_node);
            }
        }
        for (hand, world_from_hand) in hands.into_iter().enumerate() {
            let before = std::mem::replace(&mut self.squeezed[hand], squeezes[hand]);
            let begins = squeezes[hand] && !before;
            if let Some(world_from_hand) = world_from_hand.filter(|_| begins) {
                self.seize(hand, &world_from_hand, passed);
            }
        }
        &self.places
    }

    /// Has a hand carry the nearest thing that it can reach, if any; of several around it the smallest.
    fn seize(&mut self, hand: usize, world_from_hand: &DMat4, passed: f64) {
        let motion = &self.motion;
        let pose = motion.pose(motion.start + passed, &motion.given, &self.places);
        let point = world_from_hand.w_axis.truncate();
        let reached = motion.grabbable.iter().enumerate().filter_map(|(thing, grabbable)| {
            let (distance, size) = grabbable.reach(&pose, point)?;
            (distance <= REACH).then_some((distance, size, thing))
        });
        let least =
            |a: &(f64, f64, usize), b: &(f64, f64, usize)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
        let Some((_, _, thing)) = reached.min_by(least) else { return };
        self.held.iter_mut().for_each(|held| *held = held.filter(|held| held.thing != thing));
        let world_from_node = pose.world[motion.grabbable[thing].node];
        self.held[hand] = Some(Held { thing, hand_from_node: world_from_hand.inverse() * world_from_node });
        self.places[thing] = Some(world_from_node);
    }
}

#[cfg(test)]
mod tests;
