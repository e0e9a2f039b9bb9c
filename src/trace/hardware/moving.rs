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
use crate::trace::SceneState;
use crate::trace::hardware::free;
use crate::trace::hardware::structure::IDENTITY;
use crate::trace::scene_buffers::SceneData;

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
    /// It shows something elsewhere than the instant that was taken in has it.
    stale: bool,
}

/// Moving parts, each a bottom level.
pub(super) struct MovingParts {
    /// Whose kernels gather the corners; none where nobody does.
    device: Option<Device>,
    levels: DynamicLevels,
    /// Of the triangles at `places`, one after the other.
    corners: Shared<f32>,
    places: Range<u32>,
    /// Of each level.
    parts: Vec<Part>,
}

/// A part that moves.
struct Part {
    mover: Mover,
    hidden: bool,
    /// As [`SceneState::changed`] has it; 0 of where it was packed.
    changed: u64,
    /// The same of the triangles that its level was built of, if it was.
    built: Option<u64>,
}

impl Part {
    /// Whether its level has to be built for rays to meet triangles that are where they are since an instant. What is hidden
    /// waits until it is seen.
    fn lacks(&self, changed: u64) -> bool {
        !self.hidden && self.built != Some(changed)
    }
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
        let mut own_parts = Vec::new();
        for (level, (number, own)) in numbered().enumerate() {
            let mover = Mover { placement: placements.len(), number };
            own_parts.push(Part { mover, hidden: false, changed: 0, built: None });
            placements.push(Placement {
                shape: levels.level(level),
                world_from_shape: IDENTITY,
                culled: packed(own) & (TRIANGLE_ALPHA | TRIANGLE_DOUBLE_SIDED) == 0,
            });
        }
        let corners = Shared::new(device, context, 9 * places.len())?;
        let packed: Vec<[f32; 9]> = places.clone().map(|place| data.corners(place).0).collect();
        corners.write(0, packed.as_flattened());
        Ok(Some(MovingParts { device: device.cloned(), levels, corners, places, parts: own_parts }))
    }

    /// Takes an instant in, and has the corners gathered where some level lacks them: whether one does.
    fn move_to(
        &mut self,
        state: &SceneState,
        gather: impl FnOnce(Range<u32>, &Buffer<f32>) -> Result<()>,
    ) -> Result<bool> {
        let changed = |part: &Part| state.changed[part.mover.number];
        let lacking = self.parts.iter().any(|part| part.lacks(changed(part)));
        if lacking && let Some(corners) = self.corners.opencl() {
            corners.acquire()?;
            let gathered = gather(self.places.clone(), corners);
            // Whatever came of it, the memory is Vulkan's again.
            let released = corners.release();
            gathered.and(released)?;
        }
        for part in &mut self.parts {
            part.changed = changed(part);
        }
        Ok(lacking)
    }

    /// Records the builds of levels that are not of the corners that were gathered last.
    fn renew(&self, commands: &mut Commands) {
        let lacks = |part: &Part| part.lacks(part.changed);
        if self.parts.iter().any(lacks) {
            let corners = self.corners.vulkan();
            commands.build_levels(&self.levels, &corners, |level| lacks(&self.parts[level]));
        }
    }

    /// What was recorded is done.
    fn renewed(&mut self) {
        for part in self.parts.iter_mut().filter(|part| !part.hidden) {
            part.built = Some(part.changed);
        }
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
                self.stale |= self.top.place(mover.placement, record.world_from_shape);
            }
        }
        if let Some(parts) = &mut self.parts {
            for part in &mut parts.parts {
                part.hidden = state.hidden[part.mover.number];
                let place = if part.hidden { NOWHERE } else { IDENTITY };
                self.stale |= self.top.place(part.mover.placement, place);
            }
            self.stale |= parts.move_to(state, gather)?;
        }
        Ok(())
    }

    /// Records what builds it for the instant that was taken in, where it shows another one: whether it does. Whatever wrote
    /// the corners is done, and so are commands that built it before. [`Moving::renewed`] is for when it is built.
    pub fn renew(&mut self, commands: &mut Commands) -> bool {
        if self.stale {
            if let Some(parts) = &self.parts {
                parts.renew(commands);
            }
            commands.build_top(&mut self.top);
        }
        self.stale
    }

    /// The commands that were recorded last are done. Where they fail, it is built again.
    pub fn renewed(&mut self) {
        if let Some(parts) = self.parts.as_mut().filter(|_| self.stale) {
            parts.renewed();
        }
        self.stale = false;
    }

    /// Frees the corners. Nothing is built any more.
    pub fn let_go(&mut self) {
        if let Some(parts) = self.parts.take() {
            let device = parts.device.clone();
            free(parts, || device.as_ref().map_or(Ok(()), Device::finish));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::path::Path;

    use super::*;
    use crate::bvh::{Parted, TreeFor, Trees, WideBvh};
    use crate::error::Error;
    use crate::gpu::opencl::{Arg, DeviceInfo, Program, device};
    use crate::gpu::vulkan::testing;
    use crate::scene::animation::Choice;
    use crate::scene::generate::demo;
    use crate::scene::{Environment, Instancing, LoadOptions, Scene};
    use crate::trace::hardware::HardwareRays;
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
        let (tree, parted) =
            Parted::build(TreeFor::Packets, &mesh.positions, &mesh.triangles, &parts, still, &[]);
        let dark = Environment::constant(glam::Vec3::ZERO);
        (SceneData::pack(scene, &tree, &dark).unwrap(), tree, parted)
    }

    /// The levels that lack their triangles' places.
    fn lacking(own: &Moving) -> Vec<usize> {
        let parts = own.parts.iter().flat_map(|parts| &parts.parts).enumerate();
        parts.filter(|(_, part)| part.lacks(part.changed)).map(|(level, _)| level).collect()
    }

    #[test]
    fn only_what_has_moved_is_built_anew() {
        let Some(context) = testing::tracing_context() else { return };
        let (moving, still) = (scene(Choice::Auto), scene(Choice::None));
        let top = |data: &SceneData| Structure::of(&context, None, data).unwrap().top;
        assert!(matches!(top(&packed(&still).0), Top::Still(_)));
        // One tree over all: an instant that stays.
        let whole = WideBvh::build(&moving.mesh.positions, &moving.mesh.triangles);
        let dark = Environment::constant(glam::Vec3::ZERO);
        assert!(matches!(top(&SceneData::pack(&moving, &whole, &dark).unwrap()), Top::Still(_)));
        let (data, tree, parted) = packed(&moving);
        let Top::Moving(mut own) = top(&data) else { panic!("parts of it move") };
        let levels = lacking(&own);
        let mut commands = Commands::new(&context).unwrap();
        let mut renew = |own: &mut Moving| {
            commands.begin().unwrap();
            let recorded = own.renew(&mut commands);
            // Until it is known to be built, it is built again.
            assert_eq!(own.renew(&mut commands), recorded);
            commands.submit().unwrap();
            commands.wait().unwrap();
            own.renewed();
            recorded
        };
        let mut take = |own: &mut Moving, state: &SceneState| {
            own.move_to(state, |_, _| unreachable!("no device shares the memory")).unwrap();
            let levels = lacking(own);
            (levels, [0; 2].map(|_| renew(own)))
        };
        let trees = Trees { world: &tree, shapes: &[] };
        let mut motion = MovingScene::new(&moving, trees, &parted, DeformedBy::Host).unwrap();
        assert_eq!(take(&mut own, &motion.at(0.5)), (levels.clone(), [true, false]));
        assert_eq!(take(&mut own, &motion.at(0.5)), (vec![], [false; 2]), "nothing has moved");
        assert_eq!(take(&mut own, &motion.at(0.6)), (levels.clone(), [true, false]));
        // One alone, and what is hidden when it is seen again.
        let mut state = motion.at(0.6);
        let last = own.parts.as_ref().unwrap().parts.last().unwrap().mover.number;
        state.changed[last] = 100;
        assert_eq!(take(&mut own, &state), (levels[levels.len() - 1..].to_vec(), [true, false]));
        (state.changed[last], state.hidden[last]) = (101, true);
        assert_eq!(take(&mut own, &state), (vec![], [true, false]), "it is not seen");
        state.hidden[last] = false;
        assert_eq!(take(&mut own, &state), (levels[levels.len() - 1..].to_vec(), [true, false]));
        testing::assert_valid(&context);
    }

    /// A kernel that works for a while before it writes, to other memory than the corners.
    const SLOW: &str = "
__kernel void slow(__global float *corners, __global uint *told)
{
    uint x = get_global_id(0);
    for (uint i = 0; i < 200000000u; i++)
        x = x * 1664525u + (x >> 16) + 1013904223u;
    told[0] = x | 1u;
}";

    /// OpenCL does not keep the memory for its kernels, rays or none.
    #[test]
    fn corners_outlive_the_kernels_that_gather_them() {
        let Some(context) = testing::tracing_context() else { return };
        let shares = |info: &DeviceInfo| info.unusable.is_none() && info.host_unified;
        let Some(info) = device::list().into_iter().find(shares) else {
            println!("not run: no OpenCL device uses the host's memory");
            return;
        };
        let device = Device::open(&info).unwrap();
        let kernel = Program::build(&device, "slow", SLOW, "-cl-std=CL1.2").unwrap().kernel("slow").unwrap();
        let moving = scene(Choice::Auto);
        let (data, tree, parted) = packed(&moving);
        let trees = Trees { world: &tree, shapes: &[] };
        let mut motion = MovingScene::new(&moving, trees, &parted, DeformedBy::Host).unwrap();
        let told: Shared<u32> = Shared::new(Some(&device), &context, 1).unwrap();
        let mut rays = HardwareRays::new(&context, Some(&device), &data, 64).unwrap();
        let gather = |_: Range<u32>, corners: &Buffer<f32>| {
            let args = [Arg::buffer(corners), Arg::buffer(told.opencl().unwrap())];
            kernel.launch(&args, 1, 1).map(drop)
        };
        rays.move_to(&motion.at(0.5), gather).unwrap();
        device.flush().unwrap();
        assert_eq!(told.sparse(1, 1), [0], "the kernel is too fast");
        drop(rays);
        assert_ne!(told.sparse(1, 1), [0], "the kernel still runs");
        device.finish().unwrap();
    }

    #[test]
    fn memory_is_left_to_a_device_that_has_failed() {
        struct Memory<'a>(&'a Cell<bool>);
        impl Drop for Memory<'_> {
            fn drop(&mut self) {
                self.0.set(true);
            }
        }
        let is_freed = Cell::new(false);
        free(Memory(&is_freed), || Err(Error::Device { device: "one".into(), problem: "lost".into() }));
        assert!(!is_freed.get());
        free(Memory(&is_freed), || {
            assert!(!is_freed.get(), "it was not waited for");
            Ok(())
        });
        assert!(is_freed.get());
    }
}
