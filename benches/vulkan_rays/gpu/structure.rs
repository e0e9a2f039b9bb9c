//! A scene's triangles as an acceleration structure that is built to be traced fast.
#![allow(unsafe_code)]

use std::time::Instant;

use ash::{khr, vk};
use glam::Vec3;

use super::device::{Buffer, Device, failed};

/// Triangles as a device traces them.
pub struct Structure {
    pub handle: vk::AccelerationStructureKHR,
    /// How long its building took, the copies to the device apart.
    pub build_ms: f64,
}

impl Structure {
    /// Builds it: triangles below, and above them one instance.
    pub fn build(device: &Device, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Structure, String> {
        let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        let vertices = device.upload(positions, usage)?;
        let indices = device.upload(triangles, usage)?;
        let start = Instant::now();
        let functions = khr::acceleration_structure::Device::new(&device.instance, &device.device);
        let data = vk::AccelerationStructureGeometryTrianglesDataKHR::default()
            .vertex_format(vk::Format::R32G32B32_SFLOAT)
            .vertex_data(address(device, vertices))
            .vertex_stride(12)
            .max_vertex(positions.len().saturating_sub(1) as u32)
            .index_type(vk::IndexType::UINT32)
            .index_data(address(device, indices));
        let bottom = level(
            device,
            &functions,
            vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL,
            vk::GeometryTypeKHR::TRIANGLES,
            vk::AccelerationStructureGeometryDataKHR { triangles: data },
            triangles.len() as u32,
        )?;
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(bottom);
        // SAFETY: the structure was just built.
        let below = unsafe { functions.get_acceleration_structure_device_address(&info) };
        let instances = device.upload(&[instance(below)], usage)?;
        let data =
            vk::AccelerationStructureGeometryInstancesDataKHR::default().data(address(device, instances));
        let handle = level(
            device,
            &functions,
            vk::AccelerationStructureTypeKHR::TOP_LEVEL,
            vk::GeometryTypeKHR::INSTANCES,
            vk::AccelerationStructureGeometryDataKHR { instances: data },
            1,
        )?;
        Ok(Structure { handle, build_ms: start.elapsed().as_secs_f64() * 1e3 })
    }
}

/// The identity, visible to every mask, as VkAccelerationStructureInstanceKHR lays it out.
fn instance(below: vk::DeviceAddress) -> [u32; 16] {
    let mut instance = [0u32; 16];
    for axis in 0..3 {
        instance[axis * 5] = 1f32.to_bits();
    }
    instance[12] = 0xff << 24;
    instance[13] = vk::GeometryInstanceFlagsKHR::TRIANGLE_FACING_CULL_DISABLE.as_raw() << 24;
    instance[14..].copy_from_slice(&[below as u32, (below >> 32) as u32]);
    instance
}

fn address(device: &Device, buffer: Buffer) -> vk::DeviceOrHostAddressConstKHR {
    vk::DeviceOrHostAddressConstKHR { device_address: device.address(buffer) }
}

fn level(
    device: &Device,
    functions: &khr::acceleration_structure::Device,
    level: vk::AccelerationStructureTypeKHR,
    kind: vk::GeometryTypeKHR,
    data: vk::AccelerationStructureGeometryDataKHR,
    count: u32,
) -> Result<vk::AccelerationStructureKHR, String> {
    let geometry = [vk::AccelerationStructureGeometryKHR::default()
        .geometry_type(kind)
        .geometry(data)
        .flags(vk::GeometryFlagsKHR::OPAQUE)];
    let mut info = vk::AccelerationStructureBuildGeometryInfoKHR::default()
        .ty(level)
        .flags(vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE)
        .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
        .geometries(&geometry);
    let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
    // SAFETY: one geometry, one count.
    unsafe {
        functions.get_acceleration_structure_build_sizes(
            vk::AccelerationStructureBuildTypeKHR::DEVICE,
            &info,
            &[count],
            &mut sizes,
        );
    }
    let storage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
    let home = device.buffer(sizes.acceleration_structure_size, storage, false)?;
    let create = vk::AccelerationStructureCreateInfoKHR::default()
        .buffer(home.buffer)
        .size(sizes.acceleration_structure_size)
        .ty(level);
    // SAFETY: the buffer is as large as was asked for.
    let structure = unsafe { functions.create_acceleration_structure(&create, None) }
        .map_err(failed("makes no acceleration structure"))?;
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
    let alignment = device.able.scratch_alignment;
    let scratch = device.buffer(sizes.build_scratch_size + alignment, usage, false)?;
    info.dst_acceleration_structure = structure;
    info.scratch_data =
        vk::DeviceOrHostAddressKHR { device_address: device.address(scratch).next_multiple_of(alignment) };
    let range = vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count);
    device.submit(|device, commands| {
        // SAFETY: everything that the build reads and writes lives until it is done, in `submit`; the barrier lets
        // what follows read it.
        unsafe {
            functions.cmd_build_acceleration_structures(commands, &[info], &[&[range]]);
            let barrier = vk::MemoryBarrier::default()
                .src_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_WRITE_KHR)
                .dst_access_mask(vk::AccessFlags::ACCELERATION_STRUCTURE_READ_KHR);
            device.cmd_pipeline_barrier(
                commands,
                vk::PipelineStageFlags::ACCELERATION_STRUCTURE_BUILD_KHR,
                vk::PipelineStageFlags::ALL_COMMANDS,
                vk::DependencyFlags::empty(),
                &[barrier],
                &[],
                &[],
            );
        }
    })?;
    device.free(scratch);
    Ok(structure)
}
