//! A packed scene as an acceleration structure.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use bytemuck::{Pod, Zeroable};

use crate::error::Result;
use crate::gpu::vulkan::{
    BottomLevel, BufferRef, Commands, Context, DeviceBuffer, HostBuffer, Placement, TopLevel, Triangles,
};
use crate::layout::{TRIANGLE_ALPHA, TRIANGLE_DOUBLE_SIDED};
use crate::trace::scene_buffers::{PlacedShape, SceneData};

/// The scene, and how its triangles are called.
pub(super) struct Structure {
    pub top: TopLevel,
    /// A [`Placed`] for each placement.
    pub placed: DeviceBuffer,
    /// Of each opaque triangle its place in leaf order, bottom level by bottom level.
    pub places: DeviceBuffer,
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
    /// are seen from both sides or have alpha, which are met from any side, since the kernels look at them again.
    pub fn of(context: &Context, data: &SceneData) -> Result<Self> {
        let (mut placements, mut placed, mut places) = (Vec::new(), Vec::new(), Vec::new());
        let mut built: HashMap<u32, Vec<Level>> = HashMap::new();
        for shape in data.placed_shapes() {
            let first = shape.places.start;
            let levels = match built.entry(first) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(levels_of(context, data, &shape, &mut places)?),
            };
            for level in levels {
                placements.push(Placement {
                    shape: level.built.clone(),
                    world_from_shape: shape.world_from_shape,
                    culled: level.culled,
                });
                placed.push(Placed { first: level.first, more: shape.first_triangle.wrapping_sub(first) });
            }
        }
        let top = TopLevel::build(context, &placements)?;
        Ok(Structure { top, placed: upload(context, &placed)?, places: upload(context, &places)? })
    }
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
