//! What kernels know of the motion of a scene's triangles and instances.

use std::ops::Range;

use crate::layout;
use crate::scene::Scene;
use crate::scene::animation::Movers;

/// The motion of each triangle and instance of a scene, told apart by numbers.
#[derive(Debug, Default)]
pub(in crate::trace) struct Moved {
    movers: Movers,
    /// Triangles of each moving part, in their order.
    parts: Vec<Range<usize>>,
    /// Instances before the first that moves.
    resting: usize,
    moving: usize,
}

impl Moved {
    /// Of a scene; without motion nothing moves.
    pub fn of(scene: &Scene) -> Moved {
        let Some(motion) = &scene.motion else { return Moved::default() };
        Moved {
            movers: Movers::of(motion),
            parts: motion.parts.iter().map(|part| part.triangles.clone()).collect(),
            resting: scene.instanced.as_ref().map_or(0, |instanced| motion.first_instance(instanced)),
            moving: motion.rigid.len(),
        }
    }

    /// [`layout::SURFACE_MOTION`] of a triangle of the mesh.
    pub fn triangle(&self, triangle: usize) -> u32 {
        let part = self.parts.partition_point(|part| part.end <= triangle);
        let moves = self.parts.get(part).is_some_and(|range| range.start <= triangle);
        if moves { motion(self.movers.of_part(part, triangle - self.parts[part].start)) } else { 0 }
    }

    /// [`layout::Instance::motion`] of an instance.
    pub fn instance(&self, instance: usize) -> u32 {
        let rigid = instance.checked_sub(self.resting).filter(|&rigid| rigid < self.moving);
        rigid.map_or(0, |rigid| motion(self.movers.of_rigid(rigid)))
    }

    /// What the numbers are of.
    pub fn movers(self) -> Movers {
        self.movers
    }
}

/// [`layout::SURFACE_MOTION`] of what moves by a number of [`Movers`].
fn motion(number: u32) -> u32 {
    layout::SURFACE_MOVES | number << layout::SURFACE_MOVER
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::{DMat4, DVec3, Vec3};

    use super::*;
    use crate::scene::animation::Choice;
    use crate::scene::generate::demo;
    use crate::scene::{Instancing, LoadOptions};

    fn number(motion: u32) -> usize {
        assert_eq!(motion & layout::SURFACE_MOVES, layout::SURFACE_MOVES);
        (motion >> layout::SURFACE_MOVER) as usize
    }

    /// Between two instants what has a number goes where the number's matrices take it.
    #[test]
    fn numbers_are_of_what_takes_things_along() {
        for (instancing, counts) in [(Instancing::Flat, [3, 0]), (Instancing::Shared, [0, 3])] {
            let animation = Choice::Auto;
            let options = LoadOptions { keeps_motion: true, animation, instancing, ..LoadOptions::default() };
            let scene = Scene::from_glb_with(Path::new("demo"), &demo::generate(), &options).unwrap();
            let (motion, moved) = (scene.motion.as_ref().unwrap(), Moved::of(&scene));
            let own = motion.own_triangles(&scene.mesh);
            let [before, after] = [0.2, 1.1].map(|time| motion.at(time, scene.anchor, &own));
            let anchor = DMat4::from_translation(scene.anchor);
            let places = [&before, &after].map(|instant| moved.movers.places(&instant.pose));
            let carried = |motion: u32, point: DVec3| {
                let [was, is] = [0, 1].map(|instant: usize| places[instant][number(motion) - 1].unwrap());
                (anchor.inverse() * is * was.inverse() * anchor).transform_point3(point)
            };
            let mut found = [0; 2];
            for (index, part) in motion.parts.iter().enumerate() {
                let [was, is] = [&before, &after].map(|i| &i.parts[index].as_ref().unwrap().positions);
                let motion = moved.triangle(part.triangles.start);
                assert_eq!(motion, moved.triangle(part.triangles.end - 1));
                let off = |(was, is): (&Vec3, &Vec3)| carried(motion, was.as_dvec3()).distance(is.as_dvec3());
                let worst = was.iter().zip(is).map(off).fold(0.0, f64::max);
                assert!(worst < 1e-4 && was != is, "{instancing:?} {index}: {worst}");
                found[0] += 1;
            }
            let resting = scene.instanced.as_ref().map_or(0, |all| all.instances.len()) - motion.rigid.len();
            for index in 0..motion.rigid.len() {
                let point = DVec3::new(0.1, 0.2, 0.3);
                let [was, is] =
                    [&before, &after].map(|i| i.rigid[index].unwrap().matrix().transform_point3(point));
                let motion = moved.instance(resting + index);
                assert!(
                    carried(motion, was).distance(is) < 1e-4 && was.distance(is) > 1e-3,
                    "{instancing:?} {index}"
                );
                found[1] += 1;
            }
            assert!(found[0] >= counts[0] && found[1] >= counts[1], "{found:?}");
            assert_eq!((moved.triangle(0), moved.instance(resting.wrapping_sub(1))), (0, 0));
        }
    }
}
