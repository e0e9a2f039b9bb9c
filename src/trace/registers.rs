//! Kernels of one text in several programs, where a compiler takes a limit of registers for a program as a whole.
//!
//! NVIDIA's compiler is one (`cl_nv_compiler_options`). A multiprocessor has 65,536 registers for all that it keeps resident, and
//! kernels that do nothing but trace wait for memory most of the time, which others hide that are resident beside them. So they get 64, which is
//! what Blender's Cycles gives its own on the same cards, and put a few numbers that they seldom need into memory. Those that
//! look at surfaces, which take up to 136 without a limit, get 128. The others take fewer by themselves, and more where a limit allows
//! it: they have none. `make gpu-static` counts all.

use crate::error::Result;
use crate::gpu::opencl::{Device, Program};

/// Kernels that share a limit.
#[derive(Debug)]
pub struct Limited {
    /// A work-item's registers at most, if there is a limit.
    pub registers: Option<u32>,
    /// The text, without other kernels.
    pub text: String,
}

/// What declares a kernel; one ends with a line that is a brace.
const KERNEL: &str = "__kernel void ";
const END: &str = "\n}\n";

/// Kernels that look at a surface whole, with its textures and layers.
const OF_SURFACES: [&str; 5] =
    ["begin_samples", "describe_pixels", "shade_mirror_hits", "cross_glass_surfaces", "shade_path_vertices"];

/// A text's kernels by their limits.
pub fn limited(text: &str) -> [Limited; 3] {
    [Some(64), Some(128), None]
        .map(|registers| Limited { registers, text: with_kernels(text, |name| limit(name) == registers) })
}

fn limit(kernel: &str) -> Option<u32> {
    if kernel.starts_with("trace_") || kernel.starts_with("intersect_") {
        Some(64)
    } else {
        OF_SURFACES.contains(&kernel).then_some(128)
    }
}

/// A text without the kernels that are not wanted.
fn with_kernels(text: &str, wanted: impl Fn(&str) -> bool) -> String {
    let mut kept = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(KERNEL) {
        let kernel = &rest[start..];
        let length = kernel.find(END).map_or(kernel.len(), |end| end + END.len());
        let name = kernel[KERNEL.len()..].split('(').next().unwrap_or_default();
        kept += &rest[..start];
        kept += if wanted(name) { &kernel[..length] } else { "" };
        rest = &kernel[length..];
    }
    kept + rest
}

/// Builds a text's kernels: with their limits where they trace single rays and the compiler takes some.
///
/// # Errors
/// As [`Program::build`].
pub fn build(device: &Device, name: &str, text: &str, options: &str) -> Result<Program> {
    if device.info().limits_registers && options.contains("SINGLE_RAYS=1") {
        // A compiler that refuses its own option still has the kernels to build.
        if let Ok(program) = build_parts(device, name, text, options) {
            return Ok(program);
        }
    }
    Program::build(device, name, text, options)
}

fn build_parts(device: &Device, name: &str, text: &str, options: &str) -> Result<Program> {
    let [tracing, of_surfaces, others] = limited(text).map(|part| {
        let limit = part.registers.map_or(String::new(), |most| format!(" -cl-nv-maxrregcount={most}"));
        Program::build(device, name, &part.text, &format!("{options}{limit}"))
    });
    Ok(tracing?.with(of_surfaces?).with(others?))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::gpu::opencl::device;
    use crate::trace::source;

    /// Each variant of the kernels declares its own of a name.
    fn kernels(text: &str) -> BTreeSet<&str> {
        text.split(KERNEL).skip(1).map(|rest| rest.split('(').next().unwrap()).collect()
    }

    #[test]
    fn each_kernel_is_in_one_part() {
        for text in [source::text(), source::probe_text()] {
            let parts = limited(&text);
            let in_parts = parts.iter().map(|part| kernels(&part.text));
            let [tracing, of_surfaces, others] = in_parts.collect::<Vec<_>>().try_into().unwrap();
            assert!(tracing.iter().all(|name| name.starts_with("trace_") || name.starts_with("intersect_")));
            assert!(tracing.contains("trace_pixels"));
            assert!(of_surfaces.is_empty() || of_surfaces.len() == OF_SURFACES.len());
            let number = tracing.len() + of_surfaces.len() + others.len();
            let all: BTreeSet<&str> = [tracing, of_surfaces, others].into_iter().flatten().collect();
            assert_eq!((&all, all.len()), (&kernels(&text), number));
            // Nothing else is gone.
            let code = |text: &str| with_kernels(text, |_| false);
            assert!(parts.iter().all(|part| code(&part.text) == code(&text)));
        }
        assert!(OF_SURFACES.iter().all(|name| kernels(&source::text()).contains(name)));
    }

    /// Programs of parts know each other's kernels; PoCL's compiler, which has no such option, builds them whole.
    #[test]
    fn kernels_are_found_in_parts_and_whole() {
        let Some(info) = device::list().into_iter().find(|info| info.unusable.is_none()) else {
            println!("not run: there is no OpenCL device");
            return;
        };
        let device = Device::open(&info).unwrap();
        let kernel = |name| format!("{KERNEL}{name}(__global uint *to)\n{{\n    to[0] = 1u;\n}}\n");
        let names = ["trace_it", "begin_samples", "shade_it"];
        let text = &names.map(kernel).concat();
        let programs = limited(text).map(|part| Program::build(&device, "part", &part.text, "").unwrap());
        for (program, own) in programs.iter().zip(names) {
            assert!(names.iter().all(|name| program.kernel(name).is_ok() == (*name == own)));
        }
        let together = programs.into_iter().reduce(Program::with).unwrap();
        let refused = build_parts(&device, "parts", text, "").is_err();
        assert!(refused || device.info().platform != "Portable Computing Language");
        let whole = build(&device, "parts", text, "-D SINGLE_RAYS=1").unwrap();
        for name in names {
            together.kernel(name).unwrap();
            whole.kernel(name).unwrap();
        }
        assert!(together.kernel("another").is_err());
    }
}
