//! Acceleration structures of VK_KHR_acceleration_structure: triangles, and where they are shown.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk;

use super::commands::Commands;
use super::context::{Context, RayFunctions};
use super::memory::{Allocation, HostBuffer};
use crate::error::{Error, Result};
use crate::waiting::Limits;

/// Some triangles of a bottom level.
#[derive(Clone, Copy)]
pub struct Triangles<'a> {
    /// The corners of each: x, y and z of the first, the second, the third.
    pub corners: &'a [[f32; 9]],
    /// Rays end at them; shaders are asked about others (`rayQueryProceed`).
    pub opaque: bool,
}

/// Triangles that rays find, to be shown anywhere. Clones are the same.
#[derive(Clone)]
pub struct BottomLevel(Arc<Structure>);

/// A bottom level that is shown somewhere.
#[derive(Clone)]
pub struct Placement {
    /// What is shown.
    pub shape: BottomLevel,
    /// The rows of the matrix that takes its points to the world's. It does not mirror.
    pub world_from_shape: [[f32; 4]; 3],
    /// Whether rays that cull back faces pass its triangles from behind. Those are seen from the front whose corners go
    /// counter-clockwise.
    pub culled: bool,
}

/// A scene that rays are traced through: placements, which hits name by their places in the list (`instance_index`).
/// Clones are the same.
#[derive(Clone)]
pub struct TopLevel(pub(super) Arc<Structure>);

pub(super) struct Structure {
    context: Context,
    pub handle: vk::AccelerationStructureKHR,
    /// The memory that it lies in.
    _home: Allocation,
    /// What it refers to.
    _below: Vec<Arc<Structure>>,
}

impl BottomLevel {
    /// Builds it, from parts whose triangles hits name by `geometry_index`, the part's place among those that are not empty,
    /// and `primitive_index`.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no room for it, or is lost.
    ///
    /// # Panics
    /// If the context has no ray queries switched on, or there is no triangle.
    pub fn build(context: &Context, parts: &[Triangles]) -> Result<Self> {
        let parts: Vec<&Triangles> = parts.iter().filter(|part| !part.corners.is_empty()).collect();
        let count: usize = parts.iter().map(|part| part.corners.len()).sum();
        assert!(count > 0, "a bottom level without triangles");
        let functions = functions(context);
        if count as u64 > functions.most_triangles {
            return Err(too_many(context, count, "triangles", functions.most_triangles));
        }
        let input = HostBuffer::build_input(context, count * size_of::<[f32; 9]>())?;
        let start = address(context, &input.0);
        let mut first = 0;
        let mut geometries = Vec::new();
        let mut counts = Vec::new();
        for part in parts {
            input.write(first, part.corners);
            let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
                .vertex_format(vk::Format::R32G32B32_SFLOAT)
                .vertex_data(vk::DeviceOrHostAddressConstKHR { device_address: start + first as u64 })
                .vertex_stride(size_of::<[f32; 3]>() as u64)
                .max_vertex(3 * part.corners.len() as u32 - 1)
                .index_type(vk::IndexType::NONE_KHR);
            let flags = match part.opaque {
                true => vk::GeometryFlagsKHR::OPAQUE,
                false => vk::GeometryFlagsKHR::empty(),
            };
            geometries.push(
                vk::AccelerationStructureGeometryKHR::default()
                    .geometry_type(vk::GeometryTypeKHR::TRIANGLES)
                    .geometry(vk::AccelerationStructureGeometryDataKHR { triangles: data })
                    .flags(flags),
            );
            counts.push(part.corners.len() as u32);
            first += size_of_val(part.corners);
        }
        let kind = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
        // SAFETY: the geometries lie in `input`, which is handed over.
        unsafe { Structure::build(context, kind, &geometries, &counts, input, Vec::new()) }.map(BottomLevel)
    }
}

impl TopLevel {
    /// Builds it.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no room for it, or is lost.
    ///
    /// # Panics
    /// If the context has no ray queries switched on.
    pub fn build(context: &Context, placements: &[Placement]) -> Result<Self> {
        let functions = functions(context);
        if placements.len() as u64 > functions.most_instances {
            return Err(too_many(context, placements.len(), "instances", functions.most_instances));
        }
        let records: Vec<[u32; 16]> =
            placements.iter().map(|placement| instance(context, placement)).collect();
        let input = HostBuffer::build_input(context, size_of_val(&records[..]))?;
        input.write(0, &records);
        let data = vk::AccelerationStructureGeometryInstancesDataKHR::default()
            .data(vk::DeviceOrHostAddressConstKHR { device_address: address(context, &input.0) });
        let geometry = [vk::AccelerationStructureGeometryKHR::default()
            .geometry_type(vk::GeometryTypeKHR::INSTANCES)
            .geometry(vk::AccelerationStructureGeometryDataKHR { instances: data })];
        let mut below: Vec<Arc<Structure>> = placements.iter().map(|p| p.shape.0.clone()).collect();
        below.sort_by_key(Arc::as_ptr);
        below.dedup_by_key(|structure| Arc::as_ptr(structure));
        let kind = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
        // SAFETY: the records lie in `input`, which is handed over; what they refer to is kept.
        unsafe { Structure::build(context, kind, &geometry, &[records.len() as u32], input, below) }
            .map(TopLevel)
    }
}

impl Structure {
    /// Builds a structure to be traced fast, and waits for it.
    ///
    /// # Safety
    /// What the geometries refer to lies in `input` or, for instances, in what is `below`, and is as large as the counts say.
    unsafe fn build(
        context: &Context,
        kind: vk::AccelerationStructureTypeKHR,
        geometries: &[vk::AccelerationStructureGeometryKHR],
        counts: &[u32],
        input: HostBuffer,
        below: Vec<Arc<Structure>>,
    ) -> Result<Arc<Self>> {
        let RayFunctions { structures, scratch_alignment, .. } = functions(context);
        let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(kind)
            .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(geometries);
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let by_device = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        // SAFETY: each geometry has its count.
        unsafe { structures.get_acceleration_structure_build_sizes(by_device, &info, counts, &mut sizes) };
        let storage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR;
        let home = Allocation::addressed(context, sizes.acceleration_structure_size, storage)?;
        let create = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(home.buffer)
            .size(sizes.acceleration_structure_size)
            .ty(kind);
        // SAFETY: the buffer is as large as was asked for.
        let handle = unsafe { structures.create_acceleration_structure(&create, None) }
            .map_err(|code| context.refused("an acceleration structure", code))?;
        let built = Arc::new(Structure { context: context.clone(), handle, _home: home, _below: below });
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let scratch =
            Arc::new(Allocation::addressed(context, sizes.build_scratch_size + scratch_alignment, usage)?);
        let at = address(context, &scratch).next_multiple_of(*scratch_alignment);
        info.dst_acceleration_structure = handle;
        info.scratch_data = vk::DeviceOrHostAddressKHR { device_address: at };
        let range =
            |&count: &u32| vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
        let ranges: Vec<_> = counts.iter().map(range).collect();
        let mut commands = Commands::new(context)?;
        commands.begin()?;
        // SAFETY: structure and scratch are as large as was asked for, the input by this function's contract, and the commands
        // hold them until they are done.
        unsafe { commands.build(structures, info, &ranges, [built.clone(), scratch, input.0]) };
        commands.submit()?;
        commands.wait_within(Limits::BUILDING)?;
        Ok(built)
    }
}

impl Drop for Structure {
    fn drop(&mut self) {
        // SAFETY: commands and what is above it hold it until they are done.
        unsafe { functions(&self.context).structures.destroy_acceleration_structure(self.handle, None) };
    }
}

fn functions(context: &Context) -> &RayFunctions {
    context.0.rays.as_ref().unwrap_or_else(|| panic!("{} traces no rays", context.report().name))
}

fn address(context: &Context, allocation: &Allocation) -> vk::DeviceAddress {
    let info = vk::BufferDeviceAddressInfo::default().buffer(allocation.buffer);
    // SAFETY: the callers' buffers were made to have an address.
    unsafe { functions(context).addresses.get_buffer_device_address(&info) }
}

fn too_many(context: &Context, count: usize, what: &str, most: u64) -> Error {
    Error::Device {
        device: context.report().name.clone(),
        problem: format!(
            "its acceleration structures hold {most} {what} and the scene has {count}; use a smaller scene"
        ),
    }
}

/// A VkAccelerationStructureInstanceKHR that every mask sees.
fn instance(context: &Context, placement: &Placement) -> [u32; 16] {
    let mut record = [0u32; 16];
    for (word, value) in record.iter_mut().zip(placement.world_from_shape.as_flattened()) {
        *word = value.to_bits();
    }
    // Fronts are those whose corners go counter-clockwise along right-handed axes, as specifications have it: clockwise along
    // left-handed ones.
    let flags = match placement.culled {
        true => vk::GeometryInstanceFlagsKHR::empty(),
        false => vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE,
    };
    let info = vk::AccelerationStructureDeviceAddressInfoKHR::default()
        .acceleration_structure(placement.shape.0.handle);
    // SAFETY: the structure was built.
    let below = unsafe { functions(context).structures.get_acceleration_structure_device_address(&info) };
    record[12] = 0xff << 24;
    record[13] = flags.as_raw() << 24;
    record[14..].copy_from_slice(&[below as u32, (below >> 32) as u32]);
    record
}
