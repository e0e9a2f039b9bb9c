//! The SPIR-V that the build made of `kernels/*.wgsl`.

use super::denoise::DenoiseParameters;
use super::magnify::MagnifyParameters;
use super::motion_vectors::MotionParameters;
use super::parameters::{FilterParameters, PixelParameters};
use super::resolve::ResolveParameters;
use crate::gpu::vulkan::Shader;
use crate::reconstruct::history::AccumulateParameters;
use crate::reconstruct::tables::NeighbourParameters;

macro_rules! spirv {
    ($stem:literal) => {
        include_bytes!(concat!(env!("OUT_DIR"), "/", $stem, ".spv"))
    };
}

pub const FILTER: Shader = Shader {
    name: "filter.wgsl",
    words: spirv!("filter"),
    buffers: 5,
    push: size_of::<FilterParameters>() as u32,
};

pub const DENOISE: Shader = Shader {
    name: "denoise.wgsl",
    words: spirv!("denoise"),
    buffers: 5,
    push: size_of::<DenoiseParameters>() as u32,
};

pub const ACCUMULATE: Shader = Shader {
    name: "accumulate.wgsl",
    words: spirv!("accumulate"),
    buffers: 14,
    push: size_of::<AccumulateParameters>() as u32,
};

pub const RECONSTRUCT: Shader = Shader {
    name: "reconstruct.wgsl",
    words: spirv!("reconstruct"),
    buffers: 8,
    push: size_of::<PixelParameters>() as u32,
};

pub const MAGNIFY: Shader = Shader {
    name: "magnify.wgsl",
    words: spirv!("magnify"),
    buffers: 5,
    push: size_of::<MagnifyParameters>() as u32,
};

pub const RESOLVE: Shader = Shader {
    name: "resolve.wgsl",
    words: spirv!("resolve"),
    buffers: 7,
    push: size_of::<ResolveParameters>() as u32,
};

pub const MOTION: Shader = Shader {
    name: "motion.wgsl",
    words: spirv!("motion"),
    buffers: 3,
    push: size_of::<MotionParameters>() as u32,
};

/// How long the lists of that variant are.
pub fn capacity(wanted: u32) -> u32 {
    [5, 9, 17].into_iter().find(|&capacity| wanted <= capacity).unwrap_or(25)
}

/// The variant of `neighbours.wgsl` with the shortest lists that hold `wanted` samples.
pub fn neighbours(wanted: u32) -> Shader {
    let words: &'static [u8] = match capacity(wanted) {
        5 => spirv!("neighbours_5"),
        9 => spirv!("neighbours_9"),
        17 => spirv!("neighbours_17"),
        _ => spirv!("neighbours_25"),
    };
    Shader { name: "neighbours.wgsl", words, buffers: 5, push: size_of::<NeighbourParameters>() as u32 }
}
