//! What of an acceleration structure follows a scene that moves: where instances are, and the bottom levels of parts whose
//! triangles are elsewhere at each instant.

use std::ops::Range;

use crate::error::Result;
use crate::gpu::interop::Shared;
use crate::gpu::opencl::{Buffer, Device};
use crate::gpu::vulkan::{
    Commands, Context, DynamicLevels, DynamicTopLevel, DynamicTriangles, Placement, TopLevel,
};
use crate::layout::{TRIANGLE_ALPHA, TRIANGLE_DOUBLE_SIDED};
use crate::trace::scene_buffers::SceneData;
use crate::trace::{SceneState, hardware::structure::IDENTITY};

/// Of a placement that shows nothing.
const NOWHERE: [[f32; 4]; 3] = [[0.0; 4]; 3];

/// A placement of something that moves.
#[derive(Clone, Copy)]
pub(super) struct Mover {
    pub placement: usize,
    /// The instance's number among what kernels know of instances, or the part's among all parts.
    pub number: usize,
}

/// A top level that is built anew for each instant, and what below it is.
pub(super) struct Moving {
    top: DynamicTopLevel,
    /// The number of the first instance that moves.
    first_instance: usize,
    instances: Vec<Mover>,
    parts: Option<MovingParts>,
    /// It shows another instant than the one that was taken in.
    stale: bool,
}

/// Moving parts, each a bottom level.
pub(super) struct MovingParts {
    levels: DynamicLevels,
    /// Of the triangles at `places`, one after the other.
    corners: Shared<f32>,
    places: Range<u32>,
    /// Of each level; where it is placed.
    movers: Vec<Mover>,
    /// Whether each is hidden.
    hidden: Vec<bool>,
}

impl MovingParts {
    /// The parts of a scene that have triangles, as they were packed; their placements are added to others. A part is of one
    /// material.
    pub fn of(
        (context, device): (&Context, Option<&Device>),
        data: &SceneData,
        placements: &mut Vec<Placement>,
    ) -> Result<Option<Self>> {
        let (parts, places) = (&data.moving().parts, data.moving().places());
        if places.is_empty() {
            return Ok(None);
        }
        let numbered = || parts.iter().enumerate().filter(|(_, own)| !own.is_empty());
        let packed = |own: &Range<u32>| data.corners(own.start).1;
        let triangles = |(_, own): (usize, &Range<u32>)| DynamicTriangles {
            triangles: own.start - places.start..own.end - places.start,
            opaque: packed(own) & TRIANGLE_ALPHA == 0,
        };
        let levels = DynamicLevels::new(context, &numbered().map(triangles).collect::<Vec<_>>())?;
        let mut movers = Vec::new();
        for (level, (number, own)) in numbered().enumerate() {
            movers.push(Mover { placement: placements.len(), number });
            placements.push(Placement {
                shape: levels.level(level),
                world_from_shape: IDENTITY,
                culled: packed(own) & (TRIANGLE_ALPHA | TRIANGLE_DOUBLE_SIDED) == 0,
            });
        }
        let corners = Shared::new(device, context, 9 * places.len())?;
        let packed: Vec<[f32; 9]> = places.clone().map(|place| data.corners(place).0).collect();
        corners.write(0, packed.as_flattened());
        let hidden = vec![false; movers.len()];
        Ok(Some(MovingParts { levels, corners, places, movers, hidden }))
    }
}

impl Moving {
    /// As the scene was packed; it is not built yet.
    pub fn new(
        context: &Context,
        placements: Vec<Placement>,
        first_instance: usize,
        instances: Vec<Mover>,
        parts: Option<MovingParts>,
    ) -> Result<Self> {
        let top = DynamicTopLevel::new(context, placements)?;
        Ok(Moving { top, first_instance, instances, parts, stale: true })
    }

    /// What rays are traced through.
    pub fn top(&self) -> &TopLevel {
        self.top.top()
    }

    /// Takes an instant in. `gather` has kernels write the corners of the triangles at places.
    pub fn move_to(
        &mut self,
        state: &SceneState,
        gather: impl FnOnce(Range<u32>, &Buffer<f32>) -> Result<()>,
    ) -> Result<()> {
        let (first, records) = &state.instances;
        debug_assert!(records.is_empty() || *first == self.first_instance);
        for mover in &self.instances {
            if let Some(record) = records.get(mover.number - self.first_instance) {
                self.top.place(mover.placement, record.world_from_shape);
            }
        }
        if let Some(parts) = &mut self.parts {
            for (mover, hidden) in parts.movers.iter().zip(&mut parts.hidden) {
                *hidden = state.hidden[mover.number];
                self.top.place(mover.placement, if *hidden { NOWHERE } else { IDENTITY });
            }
            if let Some(corners) = parts.corners.opencl() {
                corners.acquire()?;
                gather(parts.places.clone(), corners)?;
                corners.release()?;
            }
        }
        self.stale = true;
        Ok(())
    }

    /// Records what builds it for the instant that was taken in, where it shows another one: whether it does. Whatever wrote
    /// the corners is done, and so are commands that built it before.
    pub fn renew(&mut self, commands: &mut Commands) -> bool {
        if !std::mem::take(&mut self.stale) {
            return false;
        }
        if let Some(parts) = &self.parts {
            commands.build_levels(&parts.levels, &parts.corners.vulkan(), |level| !parts.hidden[level]);
        }
        commands.build_top(&self.top);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::bvh::{Parted, Trees, WideBvh};
    use crate::gpu::vulkan::{ContextOptions, testing};
    use crate::scene::animation::Choice;
    use crate::scene::generate::demo;
    use crate::scene::{Environment, Instancing, LoadOptions, Scene};
    use crate::trace::hardware::structure::{Structure, Top};
    use crate::trace::{DeformedBy, MovingScene};

    fn scene(animation: Choice) -> Scene {
        let instancing = Instancing::Flat;
        let options = LoadOptions { keeps_motion: true, animation, instancing, ..LoadOptions::default() };
        Scene::from_glb_with(Path::new("demo"), &demo::generate(), &options).unwrap()
    }

    /// The scene with a tree for each part that moves.
    fn packed(scene: &Scene) -> (SceneData, WideBvh, Parted) {
        let (mesh, motion) = (&scene.mesh, scene.motion.as_ref());
        let first = motion.map_or(mesh.triangles.len(), |motion| motion.first_triangle(mesh));
        let parts: Vec<_> =
            motion.iter().flat_map(|motion| &motion.parts).map(|part| part.triangles.clone()).collect();
        let still = WideBvh::build(&mesh.positions, &mesh.triangles[..first]);
        let (tree, parted) = Parted::build(&mesh.positions, &mesh.triangles, &parts, still, &[]);
        let dark = Environment::constant(glam::Vec3::ZERO);
        (SceneData::pack(scene, &tree, &dark).unwrap(), tree, parted)
    }

    #[test]
    fn only_what_has_moved_is_built_anew() {
        let options = ContextOptions { validation: true, ray_queries: true, ..ContextOptions::default() };
        let Some(context) = Context::new(&options).ok().filter(Context::traces_rays) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "no Vulkan device has ray queries");
            println!("not run: no Vulkan device has ray queries");
            return;
        };
        let (moving, still) = (scene(Choice::Auto), scene(Choice::None));
        let top = |data: &SceneData| Structure::of(&context, None, data).unwrap().top;
        assert!(matches!(top(&packed(&still).0), Top::Still(_)));
        // One tree over all: an instant that stays.
        let whole = WideBvh::build(&moving.mesh.positions, &moving.mesh.triangles);
        let dark = Environment::constant(glam::Vec3::ZERO);
        assert!(matches!(top(&SceneData::pack(&moving, &whole, &dark).unwrap()), Top::Still(_)));
        let (data, tree, parted) = packed(&moving);
        let Top::Moving(mut own) = top(&data) else { panic!("parts of it move") };
        let mut commands = Commands::new(&context).unwrap();
        let mut renew = |own: &mut Moving| {
            commands.begin().unwrap();
            let renewed = own.renew(&mut commands);
            commands.submit().unwrap();
            commands.wait().unwrap();
            renewed
        };
        let trees = Trees { world: &tree, shapes: &[] };
        let mut motion = MovingScene::new(&moving, trees, &parted, DeformedBy::Host).unwrap();
        assert_eq!([0; 2].map(|_| renew(&mut own)), [true, false]);
        for _ in 0..2 {
            own.move_to(&motion.at(0.5), |_, _| unreachable!("no device shares the memory")).unwrap();
            assert_eq!([0; 2].map(|_| renew(&mut own)), [true, false]);
        }
        testing::assert_valid(&context);
    }
}
