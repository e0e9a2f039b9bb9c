//! A packed scene as an acceleration structure.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use bytemuck::{Pod, Zeroable};

use super::moving::{Mover, Moving, MovingParts};
use crate::error::{Error, Result};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::{
    BottomLevel, BufferRef, Commands, Context, DeviceBuffer, HostBuffer, Placement, TopLevel, Triangles,
};
use crate::layout::{TRIANGLE_ALPHA, TRIANGLE_DOUBLE_SIDED};
use crate::trace::scene_buffers::{PlacedShape, SceneData};

/// Bottom levels have memory of their own, each a piece: they take this share of those that there can be, so that pictures,
/// samples and drivers have theirs.
const SHARE_OF_ALLOCATIONS: u32 = 2;

/// The rows of a matrix that leaves points where they are.
pub(super) const IDENTITY: [[f32; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The scene, and how its triangles are called.
pub(super) struct Structure {
    pub top: Top,
    /// A [`Placed`] for each placement.
    pub placed: DeviceBuffer,
    /// Of each opaque triangle its place in leaf order, bottom level by bottom level.
    pub places: DeviceBuffer,
}

/// What rays are traced through.
pub(super) enum Top {
    /// Of a scene that stands still, built once.
    Still(TopLevel),
    /// Of one that moves, built for each instant.
    Moving(Box<Moving>),
}

impl Top {
    pub fn level(&self) -> &TopLevel {
        match self {
            Top::Still(top) => top,
            Top::Moving(moving) => moving.top(),
        }
    }
}

/// As `Placed` of `kernels/rays.wgsl`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Placed {
    first: u32,
    more: u32,
}

/// A bottom level of a shape.
struct Level {
    built: BottomLevel,
    /// The first of its opaque triangles in the list of places.
    first: u32,
    culled: bool,
}

/// Triangles on their way to a bottom level.
#[derive(Default)]
struct Gathered {
    opaque: Vec<[f32; 9]>,
    alpha: Vec<[f32; 9]>,
    places: Vec<u32>,
}

impl Structure {
    /// Builds it: of each shape a bottom level of the triangles that are seen from the front alone, and one of those that
    /// are seen from both sides or have alpha, which are met from any side, since the kernels look at them again. What moves
    /// has room, and is to be built; `device` is the one whose kernels move it.
    pub fn of(context: &Context, device: Option<&Device>, data: &SceneData) -> Result<Self> {
        let most_levels = context.most_allocations() / SHARE_OF_ALLOCATIONS;
        let limits = Limits { most_levels, list_bytes: context.storage_range() };
        Self::within((context, device), data, limits)
    }

    fn within(
        (context, device): (&Context, Option<&Device>),
        data: &SceneData,
        limits: Limits,
    ) -> Result<Self> {
        let (name, moving) = (&context.report().name, data.moving());
        let mut levels_built = 0;
        let (mut placements, mut placed, mut places) = (Vec::new(), Vec::new(), Vec::new());
        let mut instances = Vec::new();
        let mut built: HashMap<u32, Vec<Level>> = HashMap::new();
        for shape in data.placed_shapes() {
            let first = shape.places.start;
            let levels = match built.entry(first) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => {
                    limits.check_levels(name, levels_built + 1)?;
                    let levels = levels_of(context, data, &shape, &mut places)?;
                    levels_built += levels.len();
                    limits.check_levels(name, levels_built)?;
                    limits.check_list(name, "triangles", size_of_val(&places[..]))?;
                    new.insert(levels)
                }
            };
            for level in levels {
                if moving.has(shape.instance) {
                    instances.push(Mover { placement: placements.len(), number: shape.instance });
                }
                placements.push(Placement {
                    shape: level.built.clone(),
                    world_from_shape: shape.world_from_shape,
                    culled: level.culled,
                });
                placed.push(Placed { first: level.first, more: shape.first_triangle.wrapping_sub(first) });
            }
        }
        for part in moving.parts.iter().filter(|part| !part.is_empty()) {
            placed.push(Placed { first: places.len() as u32, more: 0 });
            places.extend(part.clone());
        }
        limits.check_list(name, "triangles", size_of_val(&places[..]))?;
        limits.check_list(name, "placements", size_of_val(&placed[..]))?;
        let top = if moving.is_empty() {
            Top::Still(TopLevel::build(context, &placements)?)
        } else {
            let parts = MovingParts::of((context, device), data, &mut placements)?;
            let first = moving.first_instance.unwrap_or(0);
            Top::Moving(Box::new(Moving::new(context, placements, first, instances, parts)?))
        };
        Ok(Structure { top, placed: upload(context, &placed)?, places: upload(context, &places)? })
    }
}

/// What a device has room for.
struct Limits {
    most_levels: u32,
    /// Bytes of a list that the shader reads.
    list_bytes: u64,
}

impl Limits {
    fn check_levels(&self, device: &str, levels: usize) -> Result<()> {
        let most = self.most_levels;
        let problem =
            || format!("it has room for {most} shapes that rays are traced through, and the scene has more");
        if levels as u64 > u64::from(most) { Err(smaller(device, problem())) } else { Ok(()) }
    }

    fn check_list(&self, device: &str, of: &str, bytes: usize) -> Result<()> {
        let most = self.list_bytes;
        let problem = || {
            format!("its shaders read lists of {} MiB, and that of the scene's {of} is longer", most >> 20)
        };
        if bytes as u64 > most { Err(smaller(device, problem())) } else { Ok(()) }
    }
}

fn smaller(device: &str, problem: String) -> Error {
    Error::Device { device: device.to_string(), problem: format!("{problem}; use a smaller scene") }
}

/// Values in the device's own memory, where each hit asks for them.
fn upload<T: Pod>(context: &Context, values: &[T]) -> Result<DeviceBuffer> {
    let staging = HostBuffer::new(context, size_of_val(values))?;
    staging.write(0, values);
    let buffer = DeviceBuffer::new(context, staging.len())?;
    let mut commands = Commands::new(context)?;
    commands.begin()?;
    commands.copy(&BufferRef::from(&staging), &BufferRef::from(&buffer), staging.len());
    commands.submit()?;
    commands.wait()?;
    Ok(buffer)
}

fn levels_of(
    context: &Context,
    data: &SceneData,
    shape: &PlacedShape,
    places: &mut Vec<u32>,
) -> Result<Vec<Level>> {
    let [mut front, mut both] = [Gathered::default(), Gathered::default()];
    for place in shape.places.clone() {
        let (corners, packed) = data.corners(place);
        let is_alpha = packed & TRIANGLE_ALPHA != 0;
        let level = if is_alpha || packed & TRIANGLE_DOUBLE_SIDED != 0 { &mut both } else { &mut front };
        if is_alpha {
            level.alpha.push(corners);
        } else {
            level.opaque.push(corners);
            level.places.push(place);
        }
    }
    let mut levels = Vec::new();
    for (gathered, culled) in [(front, true), (both, false)] {
        if gathered.opaque.is_empty() && gathered.alpha.is_empty() {
            continue;
        }
        let parts = [
            Triangles { corners: &gathered.opaque, opaque: true },
            Triangles { corners: &gathered.alpha, opaque: false },
        ];
        let built = BottomLevel::build(context, &parts)?;
        levels.push(Level { built, first: places.len() as u32, culled });
        places.extend(gathered.places);
    }
    Ok(levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::WideBvh;
    use crate::gpu::vulkan::testing;
    use crate::scene::Environment;
    use crate::scene::Scene;
    use crate::scene::generate::demo;
    use crate::trace::probe::shape_of;

    #[test]
    fn scenes_that_a_device_has_no_room_for_are_refused() {
        let Some(context) = testing::tracing_context() else { return };
        let scene = shape_of(Scene::from_glb(std::path::Path::new("demo.glb"), &demo::generate()).unwrap());
        let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let data = SceneData::pack(&scene, &tree, &Environment::constant(glam::Vec3::ONE)).unwrap();
        let refused = |most_levels, list_bytes| {
            let made = Structure::within((&context, None), &data, Limits { most_levels, list_bytes });
            made.err().map(|error| error.to_string()).unwrap_or_default()
        };
        let (shapes, lists) = (refused(0, u64::MAX), refused(8, 64));
        assert!(shapes.contains("has room for 0 shapes") && shapes.contains("smaller scene"), "{shapes}");
        assert!(lists.contains("scene's triangles is longer"), "{lists}");
        assert_eq!(refused(8, context.storage_range()), "");
    }
}
