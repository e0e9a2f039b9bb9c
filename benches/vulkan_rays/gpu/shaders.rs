//! From WGSL to SPIR-V, by naga: nothing has to be installed where this runs.

use std::ffi::CStr;

use ash::vk;
use naga::ShaderStage;
use naga::back::spv;
use naga::valid::{Capabilities, ValidationFlags, Validator};

/// A shader of the ray-tracing pipeline.
#[derive(Clone, Copy)]
pub enum Stage {
    /// Sends rays to their nearest hits.
    Closest,
    /// Sends rays to anything.
    Any,
    /// What a ray does that hits nothing.
    Missed,
    /// What a ray does that hits something.
    Met,
}

impl Stage {
    /// Its entry point in pipeline.wgsl.
    pub fn name(self) -> &'static CStr {
        match self {
            Stage::Closest => c"closest",
            Stage::Any => c"any",
            Stage::Missed => c"missed",
            Stage::Met => c"met",
        }
    }

    /// What Vulkan calls it.
    pub fn flag(self) -> vk::ShaderStageFlags {
        match self {
            Stage::Closest | Stage::Any => vk::ShaderStageFlags::RAYGEN_KHR,
            Stage::Missed => vk::ShaderStageFlags::MISS_KHR,
            Stage::Met => vk::ShaderStageFlags::CLOSEST_HIT_KHR,
        }
    }

    fn shader(self) -> ShaderStage {
        match self {
            Stage::Closest | Stage::Any => ShaderStage::RayGeneration,
            Stage::Missed => ShaderStage::Miss,
            Stage::Met => ShaderStage::ClosestHit,
        }
    }
}

/// A module with one shader of the ray-tracing pipeline.
pub fn stage(stage: Stage) -> Result<Vec<u32>, String> {
    let text = include_str!("pipeline.wgsl");
    let entry_point = stage.name().to_string_lossy().into_owned();
    let one = spv::PipelineOptions { shader_stage: stage.shader(), entry_point };
    let module = naga::front::wgsl::parse_str(text).map_err(|error| error.emit_to_string(text))?;
    let info =
        Validator::new(ValidationFlags::all(), Capabilities::IMMEDIATES | Capabilities::RAY_TRACING_PIPELINE)
            .validate(&module)
            .map_err(|error| error.emit_to_string(text))?;
    // Checks that other tracers do not make either are left out.
    let options = spv::Options {
        lang_version: (1, 4),
        flags: spv::WriterFlags::empty(),
        force_loop_bounding: false,
        trace_ray_argument_validation: false,
        ..spv::Options::default()
    };
    spv::write_vec(&module, &info, &options, Some(&one)).map_err(|error| error.to_string())
}
