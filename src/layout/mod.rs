//! Every struct that the host and a kernel both read, in one place.
//!
//! Fields are `f32`, `u32` and arrays of them, so that no compiler pads them. OpenCL's copies are in
//! `kernels/shared/types.h`, which [`types_header`] writes; the Vulkan shaders read the two records that
//! cross from OpenCL, whose copies are in `kernels/shared/types.wgsl` ([`types_wgsl`]). A test compares both.

mod cache;
mod constants;
mod deform;
mod frame;
mod kernel_type;
mod packing;
mod records;
mod scene;
#[cfg(test)]
mod tests;
mod tree;

pub use cache::{CacheCell, CacheInfo, CacheSum};
pub use constants::*;
pub use deform::{Influence, Morph, RestVertex};
pub use frame::{Camera, HitRecord, SampleLaw, Shading};
pub use packing::{
    NOISE_UNLIT, noise_code, noise_variance, pack_emission, pack_normal, pack_normal24, pack_surface,
    unpack_emission, unpack_normal, unpack_normal24, unpack_surface,
};
pub use records::{SampleRecord, VisibilityRecord};
pub use scene::{
    DirectionCell, Emitter, EnvironmentTexel, Instance, Light, LightNode, Material, TextureInfo, TextureUse,
    Triangle,
};
pub use tree::{CompactNode, WideNode};

/// The text of `kernels/shared/types.h`.
pub fn types_header() -> String {
    let mut header = String::from("// Written from src/layout/: change it there.\n\n");
    for structs in
        [records::opencl, frame::opencl, scene::opencl, cache::opencl, tree::opencl, deform::opencl]
    {
        header += &structs();
    }
    for (name, value) in constants::named() {
        header += &format!("#define {name} {value:#x}u\n");
    }
    header
}

/// The text of `kernels/shared/types.wgsl`.
pub fn types_wgsl() -> String {
    let shared = [
        "SUN_VISIBLE",
        "SURFACE_MOVES",
        "SURFACE_MOVER",
        "BLOCKER_STEPS",
        "BLOCKER_METRE",
        "IS_MAPPED",
        "SAMPLE_REUSES",
    ];
    let mut text = String::from("// Written from src/layout/: change it there.\n") + &records::wgsl();
    for (name, value) in constants::named().into_iter().filter(|(name, _)| shared.contains(name)) {
        text += &format!("const {name} = {value:#x}u;\n");
    }
    text
}
