//! Rays by ray queries alone, from the host's memory and back: for tests and measurements.

use super::{GROUP, HardwareRays, PLANE_ORIGIN, Rays};
use crate::bvh::Trees;
use crate::error::Result;
use crate::gpu::vulkan::Context;
use crate::scene::{Environment, Scene};
use crate::trace::SceneData;

/// Groups of rays under way at most.
const MOST: usize = 1 << 14;
/// What rays look for, and what has become of them, as `kernels/rays.wgsl` has it.
const RAY_FOR_SKY: u32 = 1;
const RAY_FOR_EMITTER: u32 = 3;
const RAY_FOR_FRONT: u32 = 32;
const RAY_FOR_BLOCKER: u32 = 64;
const RAY_LOST: u32 = 4;
const IS_OPEN: u32 = 16;
const NONE: u32 = u32::MAX;
const PLANE_TARGET: usize = 13;
const PLANE_TRIANGLE: usize = 14;

/// What is asked of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Whether they hit anything.
    Any,
    /// Whether they hit anything from its front, or from any side where it is double-sided.
    AnyFront,
    /// The nearest triangle that they meet from its front, or from any side where it is double-sided.
    NearestFront,
    /// The nearest triangle.
    Nearest,
}

/// What was found of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Whether anything is hit.
    pub hit: bool,
    /// The answer is the kernels' to find, since a triangle with alpha is met before.
    pub open: bool,
    /// How far away the hit is; infinite without one, and where only whether there is one was asked.
    pub t: f32,
    /// Its place in leaf order, as [`crate::layout::HitRecord`] has it; `u32::MAX` likewise.
    pub triangle: u32,
}

/// A scene in a device that traces rays.
#[derive(Debug)]
pub struct RayQueries(HardwareRays);

impl RayQueries {
    /// Builds the acceleration structure of a scene for a context that traces rays, as it is at first where it moves.
    ///
    /// # Errors
    /// Where the scene cannot be packed, the context has no ray queries switched on, the device has no room for it, or is lost.
    pub fn new<'a>(context: &Context, scene: &Scene, trees: impl Into<Trees<'a>>) -> Result<Self> {
        let data = SceneData::pack(scene, trees, &Environment::constant(glam::Vec3::ZERO))?;
        HardwareRays::new(context, None, &data, MOST).map(RayQueries)
    }

    /// Traces rays, 32 from each origin in turn; of the last as many as there are. What was found, and how many milliseconds
    /// the device took.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    ///
    /// # Panics
    /// Where there are more rays than 32 for each origin.
    pub fn trace(
        &mut self,
        origins: &[[f32; 3]],
        directions: &[[f32; 3]],
        asked: Asked,
    ) -> Result<(Vec<Answer>, f64)> {
        assert!(directions.len() <= GROUP * origins.len(), "each ray has an origin");
        let most = self.0.most();
        let (mut answers, mut ms) = (Vec::with_capacity(directions.len()), 0.0);
        for (origins, directions) in origins.chunks(most).zip(directions.chunks(most * GROUP)) {
            ms += self.trace_some(origins, directions, asked, &mut answers)?;
        }
        Ok((answers, ms))
    }

    fn trace_some(
        &mut self,
        origins: &[[f32; 3]],
        directions: &[[f32; 3]],
        asked: Asked,
        answers: &mut Vec<Answer>,
    ) -> Result<f64> {
        let (groups, stride) = (origins.len(), origins.len() * GROUP);
        self.0.reserve(None, groups)?;
        let mut words = vec![0u32; stride * PLANE_ORIGIN as usize + 3 * groups];
        let sought = match asked {
            Asked::Any => RAY_FOR_SKY,
            Asked::AnyFront => RAY_FOR_EMITTER,
            Asked::NearestFront => RAY_FOR_FRONT,
            Asked::Nearest => RAY_FOR_BLOCKER,
        };
        // Ray i of group k is ray i * groups + k.
        let place = |ray: usize| ray % GROUP * groups + ray / GROUP;
        for (ray, direction) in directions.iter().enumerate() {
            let at = place(ray);
            words[at] = sought;
            (0..3).for_each(|axis| words[(1 + axis) * stride + at] = direction[axis].to_bits());
            words[4 * stride + at] = f32::INFINITY.to_bits();
            words[PLANE_TARGET * stride + at] = NONE;
        }
        for (k, origin) in origins.iter().enumerate() {
            let first = PLANE_ORIGIN as usize * stride + k;
            (0..3).for_each(|axis| words[first + axis * groups] = origin[axis].to_bits());
        }
        let batch = self.0.batch.as_ref().expect("it was just reserved");
        batch.rays.write(0, &words);
        let origin = (PLANE_ORIGIN, groups as u32);
        let ms = self.0.trace(Rays { groups: groups as u32, count: stride as u32, origin })?;
        let batch = self.0.batch.as_ref().expect("it is still there");
        let words = batch.rays.sparse((PLANE_TRIANGLE + 1) * stride, 1);
        answers.extend((0..directions.len()).map(|ray| {
            let at = place(ray);
            let (became, triangle) = (words[at], words[PLANE_TRIANGLE * stride + at]);
            let is_any = matches!(asked, Asked::Any | Asked::AnyFront);
            let triangle = if is_any { NONE } else { triangle };
            let hit = if is_any { became == RAY_LOST } else { triangle != NONE };
            let t = if triangle == NONE { f32::INFINITY } else { f32::from_bits(words[4 * stride + at]) };
            Answer { hit, open: became & IS_OPEN != 0, t, triangle }
        }));
        Ok(ms)
    }
}

#[cfg(test)]
mod tests;
