//! Acceleration structures of VK_KHR_acceleration_structure: triangles, and where they are shown. What stays is built once to be
//! traced fast; what moves is built anew in the same memory, fast, where commands say so.
#![allow(unsafe_code)]

mod records;

use std::sync::Arc;

use ash::vk;

use super::commands::{Commands, Held};
use super::context::{Context, RayFunctions};
use super::memory::{Allocation, HostBuffer};
use crate::error::{Error, Result};
use crate::waiting::Limits;
pub use records::{DynamicTriangles, Placement, Triangles};
use records::{Record, TRIANGLE_BYTES, instances, record_of, triangles};

/// What places of acceleration structures in memory are multiples of.
const STRUCTURE_ALIGNMENT: u64 = 256;

const BOTTOM: vk::AccelerationStructureTypeKHR = vk::AccelerationStructureTypeKHR::BOTTOM_LEVEL;
const TOP: vk::AccelerationStructureTypeKHR = vk::AccelerationStructureTypeKHR::TOP_LEVEL;
/// How what is built once is built, and what is built again and again.
const ONCE: vk::BuildAccelerationStructureFlagsKHR =
    vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_TRACE;
const OFTEN: vk::BuildAccelerationStructureFlagsKHR =
    vk::BuildAccelerationStructureFlagsKHR::PREFER_FAST_BUILD;

/// Triangles that rays find, to be shown anywhere. Clones are the same.
#[derive(Clone)]
pub struct BottomLevel(Arc<Structure>);

/// Bottom levels of triangles whose corners change, in one piece of memory. [`Commands::build_levels`] builds them: none is
/// shown before it was. Clones are the same.
#[derive(Clone)]
pub struct DynamicLevels(pub(super) Arc<Levels>);

/// A scene that rays are traced through: placements, which hits name by their places in the list (`instance_index`).
/// Clones are the same.
#[derive(Clone)]
pub struct TopLevel(pub(super) Arc<Structure>);

/// A top level whose placements change: [`Commands::build_top`] builds it, and nothing is traced through it before.
pub struct DynamicTopLevel {
    top: TopLevel,
    placements: Vec<Placement>,
    /// Those whose records are to be written before it is built.
    changed: Vec<usize>,
    input: HostBuffer,
    scratch: Arc<Allocation>,
}

pub(super) struct Structure {
    context: Context,
    pub handle: vk::AccelerationStructureKHR,
    /// Where placements find it.
    address: vk::DeviceAddress,
    /// The memory that it lies in.
    _home: Arc<Allocation>,
    /// What it refers to.
    _below: Vec<Arc<Structure>>,
}

/// What [`DynamicLevels`] are.
pub(super) struct Levels {
    context: Context,
    /// The corners of the whole list, where builds read them.
    pub input: Arc<Allocation>,
    _scratch: Arc<Allocation>,
    levels: Vec<DynamicLevel>,
}

struct DynamicLevel {
    structure: Arc<Structure>,
    of: DynamicTriangles,
    /// Where its scratch begins.
    scratch: vk::DeviceAddress,
}

/// What a structure is built of, and how.
struct BuildPlan<'a> {
    kind: vk::AccelerationStructureTypeKHR,
    flags: vk::BuildAccelerationStructureFlagsKHR,
    geometries: &'a [vk::AccelerationStructureGeometryKHR<'a>],
    counts: &'a [u32],
}

impl<'a> BuildPlan<'a> {
    fn info(&self) -> vk::AccelerationStructureBuildGeometryInfoKHR<'a> {
        vk::AccelerationStructureBuildGeometryInfoKHR::default()
            .ty(self.kind)
            .flags(self.flags)
            .mode(vk::BuildAccelerationStructureModeKHR::BUILD)
            .geometries(self.geometries)
    }

    /// Bytes of the structure, and of the scratch of its build.
    fn sizes(&self, context: &Context) -> (u64, u64) {
        let mut sizes = vk::AccelerationStructureBuildSizesInfoKHR::default();
        let by_device = vk::AccelerationStructureBuildTypeKHR::DEVICE;
        let structures = &functions(context).structures;
        // SAFETY: each geometry has its count.
        unsafe {
            structures.get_acceleration_structure_build_sizes(
                by_device,
                &self.info(),
                self.counts,
                &mut sizes,
            );
        }
        (sizes.acceleration_structure_size, sizes.build_scratch_size)
    }

    /// A structure of so many bytes from a place of a piece of memory on, for this plan; it is not built yet.
    ///
    /// # Safety
    /// The memory has room for it there, and was made to hold structures.
    unsafe fn create_in(
        &self,
        context: &Context,
        (home, first, size): (&Arc<Allocation>, u64, u64),
        below: Vec<Arc<Structure>>,
    ) -> Result<Arc<Structure>> {
        let structures = &functions(context).structures;
        let create = vk::AccelerationStructureCreateInfoKHR::default()
            .buffer(home.buffer)
            .offset(first)
            .size(size)
            .ty(self.kind);
        // SAFETY: by this function's contract.
        let handle = unsafe { structures.create_acceleration_structure(&create, None) }
            .map_err(|code| context.refused("an acceleration structure", code))?;
        let info = vk::AccelerationStructureDeviceAddressInfoKHR::default().acceleration_structure(handle);
        // SAFETY: the structure was just made.
        let address = unsafe { structures.get_acceleration_structure_device_address(&info) };
        let context = context.clone();
        Ok(Arc::new(Structure { context, handle, address, _home: home.clone(), _below: below }))
    }

    /// A structure in memory of its own, and the scratch of its build; it is not built yet.
    fn create(
        &self,
        context: &Context,
        below: Vec<Arc<Structure>>,
    ) -> Result<(Arc<Structure>, Arc<Allocation>)> {
        let (size, scratch) = self.sizes(context);
        let home = home(context, size)?;
        // SAFETY: the memory is as large as was asked for.
        let structure = unsafe { self.create_in(context, (&home, 0, size), below) }?;
        Ok((structure, scratch_of(context, scratch)?))
    }

    /// What has a structure built, with scratch from an address on.
    fn build_info(
        &self,
        structure: &Structure,
        scratch: vk::DeviceAddress,
    ) -> vk::AccelerationStructureBuildGeometryInfoKHR<'a> {
        let mut info = self.info();
        info.dst_acceleration_structure = structure.handle;
        info.scratch_data = vk::DeviceOrHostAddressKHR { device_address: scratch };
        info
    }
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
            geometries.push(triangles(start + first as u64, part.corners.len() as u32, part.opaque));
            counts.push(part.corners.len() as u32);
            first += size_of_val(part.corners);
        }
        let plan = BuildPlan { kind: BOTTOM, flags: ONCE, geometries: &geometries, counts: &counts };
        // SAFETY: the geometries lie in `input`, which is handed over.
        unsafe { Structure::build(context, &plan, input, Vec::new()) }.map(BottomLevel)
    }
}

impl DynamicLevels {
    /// Makes room for the bottom levels of some parts of a list of triangles.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no room for them.
    ///
    /// # Panics
    /// If the context has no ray queries switched on, a part is empty, or there is none: nothing would be built.
    pub fn new(context: &Context, parts: &[DynamicTriangles]) -> Result<Self> {
        assert!(!parts.is_empty(), "bottom levels of no parts");
        let RayFunctions { most_triangles, scratch_alignment, .. } = functions(context);
        let (mut bytes, mut scratch, mut places) = (0, 0, Vec::new());
        for part in parts {
            let count = part.triangles.len();
            assert!(count > 0, "a bottom level without triangles");
            if count as u64 > *most_triangles {
                return Err(too_many(context, count, "triangles", *most_triangles));
            }
            let (size, of_build) = {
                let (geometry, count) = (part.geometry(0), [part.count()]);
                BuildPlan { kind: BOTTOM, flags: OFTEN, geometries: &geometry, counts: &count }.sizes(context)
            };
            places.push((bytes, size, scratch));
            bytes = (bytes + size).next_multiple_of(STRUCTURE_ALIGNMENT);
            scratch = (scratch + of_build).next_multiple_of(*scratch_alignment);
        }
        let end = parts.iter().map(|part| part.triangles.end).max().unwrap_or(0);
        let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
            | vk::BufferUsageFlags::TRANSFER_DST;
        let input = Arc::new(Allocation::addressed(context, u64::from(end) * TRIANGLE_BYTES, usage)?);
        let (home, scratch) = (home(context, bytes)?, scratch_of(context, scratch)?);
        let scratch_start = scratch_start(context, &scratch);
        let level = |(part, (first, size, scratch)): (&DynamicTriangles, (u64, u64, u64))| {
            let (geometry, count) = (part.geometry(0), [part.count()]);
            let plan = BuildPlan { kind: BOTTOM, flags: OFTEN, geometries: &geometry, counts: &count };
            // SAFETY: the memory is as large as all of them were asked to be, one after the other.
            let structure = unsafe { plan.create_in(context, (&home, first, size), Vec::new()) }?;
            Ok(DynamicLevel { structure, of: part.clone(), scratch: scratch_start + scratch })
        };
        let levels = parts.iter().zip(places).map(level).collect::<Result<Vec<_>>>()?;
        Ok(DynamicLevels(Arc::new(Levels { context: context.clone(), input, _scratch: scratch, levels })))
    }

    /// The bottom level of a part, by its place among those that room was made for.
    ///
    /// # Panics
    /// If there were fewer.
    pub fn level(&self, part: usize) -> BottomLevel {
        BottomLevel(self.0.levels[part].structure.clone())
    }

    /// Bytes of the corners of the list, as far as parts of it have levels.
    pub(super) fn bytes(&self) -> usize {
        let end = self.0.levels.iter().map(|level| level.of.triangles.end).max().unwrap_or(0);
        (u64::from(end) * TRIANGLE_BYTES) as usize
    }
}

impl Levels {
    /// Records the builds of those of them that are `wanted`, from corners that are there already.
    pub(super) fn record(self: &Arc<Self>, commands: &mut Commands, wanted: impl Fn(usize) -> bool) {
        let start = address(&self.context, &self.input);
        let wanted = self.levels.iter().enumerate().filter(|(part, _)| wanted(*part));
        let wanted: Vec<_> =
            wanted.map(|(_, level)| (level, level.of.geometry(start), [level.of.count()])).collect();
        let infos = wanted.iter().map(|(level, geometries, counts)| {
            BuildPlan { kind: BOTTOM, flags: OFTEN, geometries, counts }
                .build_info(&level.structure, level.scratch)
        });
        let infos: Vec<_> = infos.collect();
        let ranges: Vec<_> = wanted.iter().map(|(.., [count])| [range(*count)]).collect();
        let ranges: Vec<_> = ranges.iter().map(|range| &range[..]).collect();
        if !infos.is_empty() {
            let structures = &functions(&self.context).structures;
            // SAFETY: structures, scratch and input are as large as was asked for, each level has its own of them, and the
            // commands hold them until they are done.
            unsafe { commands.build(structures, &infos, &ranges, [self.clone() as Held]) };
        }
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
        let input = instance_input(context, placements)?;
        let (geometry, count) = ([instances(address(context, &input.0))], [placements.len() as u32]);
        let plan = BuildPlan { kind: TOP, flags: ONCE, geometries: &geometry, counts: &count };
        // SAFETY: the records lie in `input`, which is handed over; what they refer to is kept.
        unsafe { Structure::build(context, &plan, input, below(placements)) }.map(TopLevel)
    }
}

impl DynamicTopLevel {
    /// Makes room for it.
    ///
    /// # Errors
    /// [`Error::Device`] where the device has no room for it.
    ///
    /// # Panics
    /// If the context has no ray queries switched on.
    pub fn new(context: &Context, placements: Vec<Placement>) -> Result<Self> {
        let input = instance_input(context, &placements)?;
        let (geometry, count) = ([instances(address(context, &input.0))], [placements.len() as u32]);
        let plan = BuildPlan { kind: TOP, flags: OFTEN, geometries: &geometry, counts: &count };
        let (structure, scratch) = plan.create(context, below(&placements))?;
        Ok(DynamicTopLevel { top: TopLevel(structure), placements, changed: Vec::new(), input, scratch })
    }

    /// Puts a placement somewhere, from the next build on: whether that is elsewhere.
    ///
    /// # Panics
    /// If there are fewer placements.
    pub fn place(&mut self, placement: usize, world_from_shape: [[f32; 4]; 3]) -> bool {
        let own = &mut self.placements[placement].world_from_shape;
        if *own == world_from_shape {
            return false;
        }
        *own = world_from_shape;
        self.changed.push(placement);
        true
    }

    /// What rays are traced through, as it was last built.
    pub fn top(&self) -> &TopLevel {
        &self.top
    }

    /// Records its build; no build before is under way.
    pub(super) fn record(&mut self, commands: &mut Commands) {
        for placement in self.changed.drain(..) {
            self.input.write(placement * size_of::<Record>(), &[record_of(&self.placements[placement])]);
        }
        let context = &self.top.0.context;
        let (geometry, count) =
            ([instances(address(context, &self.input.0))], [self.placements.len() as u32]);
        let plan = BuildPlan { kind: TOP, flags: OFTEN, geometries: &geometry, counts: &count };
        let info = plan.build_info(&self.top.0, scratch_start(context, &self.scratch));
        let (structures, ranges) = (&functions(context).structures, [range(count[0])]);
        let held: [Held; 3] = [self.top.0.clone(), self.scratch.clone(), self.input.0.clone()];
        // SAFETY: structure and scratch are as large as was asked for so many placements; what these refer to is kept by the
        // structure, and was built or is built before by the same queue.
        unsafe { commands.build(structures, &[info], &[&ranges], held) };
    }
}

impl Structure {
    /// Builds a structure, and waits for it.
    ///
    /// # Safety
    /// What the geometries refer to lies in `input` or, for instances, in what is `below`, and is as large as the counts say.
    unsafe fn build(
        context: &Context,
        plan: &BuildPlan,
        input: HostBuffer,
        below: Vec<Arc<Structure>>,
    ) -> Result<Arc<Self>> {
        let (built, scratch) = plan.create(context, below)?;
        let info = plan.build_info(&built, scratch_start(context, &scratch));
        let ranges: Vec<_> = plan.counts.iter().map(|&count| range(count)).collect();
        let mut commands = Commands::new(context)?;
        commands.begin()?;
        let held: [Held; 3] = [built.clone(), scratch, input.0];
        // SAFETY: structure and scratch are as large as was asked for, the input by this function's contract, and the commands
        // hold them until they are done.
        unsafe { commands.build(&functions(context).structures, &[info], &[&ranges], held) };
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

/// Memory for structures.
fn home(context: &Context, bytes: u64) -> Result<Arc<Allocation>> {
    let usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR;
    Allocation::addressed(context, bytes, usage).map(Arc::new)
}

/// Memory in which so many bytes of scratch are aligned: see [`scratch_start`].
fn scratch_of(context: &Context, bytes: u64) -> Result<Arc<Allocation>> {
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
    Allocation::addressed(context, bytes + functions(context).scratch_alignment, usage).map(Arc::new)
}

fn scratch_start(context: &Context, scratch: &Allocation) -> vk::DeviceAddress {
    address(context, scratch).next_multiple_of(functions(context).scratch_alignment)
}

fn range(count: u32) -> vk::AccelerationStructureBuildRangeInfoKHR {
    vk::AccelerationStructureBuildRangeInfoKHR::default().primitive_count(count)
}

/// The records of placements, for builds to read.
fn instance_input(context: &Context, placements: &[Placement]) -> Result<HostBuffer> {
    let (count, most) = (placements.len(), functions(context).most_instances);
    if count as u64 > most {
        return Err(too_many(context, count, "instances", most));
    }
    let input = HostBuffer::build_input(context, count * size_of::<Record>())?;
    input.write(0, &placements.iter().map(record_of).collect::<Vec<_>>());
    Ok(input)
}

/// What placements show, each once.
fn below(placements: &[Placement]) -> Vec<Arc<Structure>> {
    let mut below: Vec<Arc<Structure>> = placements.iter().map(|p| p.shape.0.clone()).collect();
    below.sort_by_key(Arc::as_ptr);
    below.dedup_by_key(|structure| Arc::as_ptr(structure));
    below
}
