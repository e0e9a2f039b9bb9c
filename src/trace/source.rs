//! The kernels' text, and the options they are built with.
//!
//! Pitfalls met by those who write kernels:
//!
//! - `local` is a keyword of OpenCL C, as are `global` and `constant`: no variable may be called so, and the
//!   compiler's message does not say why.
//! - PoCL inlines everything, and inlined tree walks with alpha tests took minutes to build. Large functions
//!   (`trace_ray`, `occluded_streams`, `trace_block`, `surface_at`, `alpha_passes`) are marked `noinline`.
//! - Drivers finish building kernels at the first launch, and some build anew for each group size. Group
//!   sizes are fixed, and `foveate mock` and `foveate demo` render frames that do not count first.
//! - In PoCL the work-items of a group share a kernel's structure arguments: what one writes there, the
//!   others read. Kernels change copies only.
//! - Not every driver finds include files: all OpenCL files are joined into one text.
//! - Vectors of three floats, booleans and sizes differ between host and devices: shared records have none.
//! - A load of one lane from a vector that was stored just before waits longer than the tests of a whole
//!   node, and so does a branch that depends on it: what goes to a stack as vectors is read half a round
//!   later, and unrolling a loop of such loads makes it slower.
//! - An empty child slot has an inverted box, and a slab test that takes minimum and maximum lets it pass:
//!   walkers look at the child's link too.
//! - A platform without devices (Mesa's, often) answers with an error. It is skipped, not fatal.
//! - A driver may take host memory and still keep a copy of its own behind the pointer: sharing is proven by
//!   a probe, not believed.
//! - `1/0` in a slab test makes 0 times infinity, which is not a number: inverses are clamped to finite ones.

use super::Traversal;
use crate::foveation::lens::STEPS as LENS_STEPS;
use crate::gpu::opencl::DeviceInfo;
use crate::math::blue_noise;
use crate::scene::Features;

/// Bytes of memory set aside for a sample that is being shaded: `ShadedSample` in `kernels/gpu/shade.cl`, whose size depends on
/// the features.
pub(super) const STATE_BYTES: usize = 768;
/// The same for the surface that a path has met, while the rays that leave it are traced: `Surface` in `kernels/shared/surface.h`.
pub(super) const SURFACE_BYTES: usize = 304;

/// All kernel files, in the order in which they depend on each other. They travel in the program and
/// are one translation unit, since not every driver finds include files.
const FILES: [&str; 49] = [
    include_str!("../../kernels/shared/types.h"),
    include_str!("../../kernels/shared/math.h"),
    include_str!("../../kernels/shared/random.h"),
    include_str!("../../kernels/shared/scene.h"),
    include_str!("../../kernels/shared/texture.h"),
    include_str!("../../kernels/shared/volume.h"),
    include_str!("../../kernels/shared/traverse.h"),
    include_str!("../../kernels/shared/compact.h"),
    include_str!("../../kernels/shared/streams.h"),
    include_str!("../../kernels/shared/surface.h"),
    include_str!("../../kernels/shared/eight.h"),
    include_str!("../../kernels/shared/bsdf.h"),
    include_str!("../../kernels/shared/layers.h"),
    include_str!("../../kernels/shared/environment.h"),
    include_str!("../../kernels/shared/punctual.h"),
    include_str!("../../kernels/shared/emitters.h"),
    include_str!("../../kernels/shared/glass.h"),
    include_str!("../../kernels/shared/glossy.h"),
    include_str!("../../kernels/shared/shadow.h"),
    include_str!("../../kernels/shared/light.h"),
    include_str!("../../kernels/shared/cache.h"),
    include_str!("../../kernels/shared/camera.h"),
    include_str!("../../kernels/shared/frustum.h"),
    include_str!("../../kernels/shared/tiles.h"),
    include_str!("../../kernels/trace.cl"),
    include_str!("../../kernels/cpu/beam.h"),
    include_str!("../../kernels/cpu/groups.h"),
    include_str!("../../kernels/cpu/sun.h"),
    include_str!("../../kernels/blend.cl"),
    include_str!("../../kernels/visibility.cl"),
    include_str!("../../kernels/gpu/visibility.cl"),
    include_str!("../../kernels/gpu/mirrors.cl"),
    include_str!("../../kernels/shared/edge.h"),
    include_str!("../../kernels/edges.cl"),
    include_str!("../../kernels/gpu/edges.cl"),
    include_str!("../../kernels/gpu/paths.cl"),
    include_str!("../../kernels/cache.cl"),
    include_str!("../../kernels/cpu/cells.cl"),
    include_str!("../../kernels/gpu/cells.cl"),
    include_str!("../../kernels/shared/sample.h"),
    include_str!("../../kernels/shared/reuse.h"),
    include_str!("../../kernels/cpu/shade.cl"),
    include_str!("../../kernels/gpu/shade.cl"),
    include_str!("../../kernels/gpu/sun.cl"),
    include_str!("../../kernels/gpu/glass.cl"),
    include_str!("../../kernels/gpu/hardware.cl"),
    include_str!("../../kernels/gather.cl"),
    include_str!("../../kernels/deform.cl"),
    include_str!("../../kernels/refit.cl"),
];

/// The whole text.
pub fn text() -> String {
    lanes_of_bits() + &FILES.join("\n")
}

/// What rays alone need, for measurements of them.
const PROBE_FILES: [&str; 13] = [
    include_str!("../../kernels/shared/types.h"),
    include_str!("../../kernels/shared/math.h"),
    include_str!("../../kernels/shared/random.h"),
    include_str!("../../kernels/shared/scene.h"),
    include_str!("../../kernels/shared/volume.h"),
    include_str!("../../kernels/shared/traverse.h"),
    include_str!("../../kernels/shared/compact.h"),
    include_str!("../../kernels/shared/streams.h"),
    include_str!("../../kernels/shared/camera.h"),
    include_str!("../../kernels/shared/frustum.h"),
    include_str!("../../kernels/shared/tiles.h"),
    include_str!("../../kernels/trace.cl"),
    include_str!("../../kernels/bundles.cl"),
];

/// The text of the kernels that measurements use.
pub fn probe_text() -> String {
    lanes_of_bits() + &PROBE_FILES.join("\n")
}

/// The text of the kernels that choose samples, which stand for themselves: they round as the host does.
pub fn pattern_text() -> String {
    [include_str!("../../kernels/shared/types.h"), include_str!("../../kernels/pattern.cl")].join("\n")
}

/// The text of the kernels that find neighbours, for lists of so many: what fills a list is joined for each kind of it.
pub fn neighbours_text(of_pixel: u32, of_sample: u32) -> String {
    // Beside a pixel's own the nearest outside of its list, for weights; lists have one place at least.
    let (pixel, sample) = (of_pixel + 1, of_sample.max(1));
    let [grid, nearest, kernels] = [
        include_str!("../../kernels/cpu/sample_grid.h"),
        include_str!("../../kernels/cpu/nearest.h"),
        include_str!("../../kernels/cpu/neighbours.cl"),
    ];
    let narrow = [
        ("KEYS", "uint16"),
        ("TO_KEYS(v)", "(v)"),
        ("TO_WORDS(v)", "(v)"),
        ("INDEX_BITS", "20"),
        ("INDEX_MASK", "0xfffffu"),
        ("FARTHEST", "4095u"),
    ];
    let wide = [
        ("KEYS", "ulong16"),
        ("TO_KEYS(v)", "convert_ulong16(v)"),
        ("TO_WORDS(v)", "convert_uint16(v)"),
        ("INDEX_BITS", "32"),
        ("INDEX_MASK", "0xffffffffu"),
        ("FARTHEST", "0xffffffffu"),
    ];
    let list = |name: &str, places: u32, keys: &[(&str, &str)]| {
        let (of_run, places) = (format!("{name}_of_run"), places.to_string());
        let own = [("NEAREST", name), ("NEAREST_OF_RUN", of_run.as_str()), ("LIST", places.as_str())];
        let all: Vec<_> = own.iter().chain(keys).collect();
        let defined: String = all.iter().map(|(key, value)| format!("#define {key} {value}\n")).collect();
        let key = |name: &str| name.split('(').next().unwrap_or(name).to_string();
        let ended: String = all.iter().map(|(name, _)| format!("#undef {}\n", key(name))).collect();
        defined + nearest + &ended
    };
    let lengths = format!("#define PIXEL_LIST {pixel}\n#define SAMPLE_LIST {sample}\n");
    [
        grid,
        &lengths,
        &list("nearest_to_block", pixel, &narrow),
        &list("nearest_to_block_far", pixel, &wide),
        &list("nearest_to_run", sample, &narrow),
        &list("nearest_to_run_far", sample, &wide),
        kernels,
    ]
    .join("\n")
}

/// The options that patterns' kernels are built with; `group`: work-items of a group that counts.
pub fn pattern_options(group: usize) -> String {
    let (mask, lens) = (blue_noise::SIZE, LENS_STEPS);
    format!("-cl-std=CL1.2 -D GROUP={group} -D MASK={mask} -D LENS_STEPS={lens}")
}

/// A table that moves chosen lanes of a vector together: for each byte the places of its set bits, the lowest in the
/// lowest byte.
fn lanes_of_bits() -> String {
    let places = |bits: u32| {
        let set = (0..8u64).filter(|lane| bits >> lane & 1 == 1);
        set.enumerate().fold(0u64, |packed, (place, lane)| packed | lane << (8 * place))
    };
    let entries: Vec<String> = (0..256).map(|bits| format!("{:#x}ul", places(bits))).collect();
    format!("__constant ulong LANES_OF_BITS[256] = {{{}}};\n", entries.join(", "))
}

/// Build options for a device: every feature and the variant, always defined, whether to prefetch, whether large
/// functions are called rather than inlined (which takes graphics cards twice the registers, and processors' drivers
/// less time to build), and the depth of the kernels' stacks.
pub fn options(device: &DeviceInfo, features: &Features, tree_depth: u32, traversal: Traversal) -> String {
    options_with(features, tree_depth, traversal, prefetches(device), device.kind != "gpu")
}

/// The same for kernels whose rays others trace: `kernels/gpu/hardware.cl`.
pub fn options_for_hardware_rays(options: &str) -> String {
    format!("{options} -D HARDWARE_RAYS=1")
}

/// The same for graphics cards, whose compilers need no card.
pub fn options_of_gpus(features: &Features, tree_depth: u32) -> String {
    options_with(features, tree_depth, Traversal::SingleRay, false, false)
}

fn options_with(
    features: &Features,
    tree_depth: u32,
    traversal: Traversal,
    prefetch: bool,
    calls: bool,
) -> String {
    // Without warnings: compilers for processors without AVX-512 have one for each function that takes sixteen lanes, and
    // PoCL tells on standard error how many there were.
    let mut options = String::from("-cl-std=CL1.2 -w");
    for (name, on) in features.defines() {
        options += &format!(" -D {name}={}", u32::from(on));
    }
    // Seven siblings wait at every level, and eight are written where some count. Rounded up, so that scenes
    // share built kernels.
    let entries = (tree_depth * 7 + 9).next_multiple_of(64);
    // A ray by itself has one entry for each level above its node, and the last one for leaves that wait.
    let levels = (tree_depth + 1).next_multiple_of(8);
    let [single, prefetch, calls] = [traversal == Traversal::SingleRay, prefetch, calls].map(u32::from);
    options
        + &format!(
            " -D SINGLE_RAYS={single} -D PREFETCH={prefetch} -D CALLS={calls} -D STACK_SIZE={entries} -D STACK_LEVELS={levels} -D STATE_BYTES={STATE_BYTES} -D SURFACE_BYTES={SURFACE_BYTES}"
        )
}

/// Whether kernels may use a compiler's own prefetch: with PoCL on a processor, where it was measured to pay. It is no
/// part of OpenCL C, and compilers that make SPIR-V end the whole program over it (Mesa's rusticl does).
fn prefetches(device: &DeviceInfo) -> bool {
    device.platform == "Portable Computing Language" && device.kind == "cpu"
}

#[cfg(test)]
mod tests {
    /// What is no part of OpenCL C stands behind `PREFETCH`, which is on for one driver alone.
    #[test]
    fn other_drivers_see_no_builtins() {
        for text in [super::text(), super::probe_text(), super::pattern_text()] {
            let mut hidden = false;
            for line in text.lines() {
                hidden = (hidden || line == "#if PREFETCH") && line != "#endif";
                assert!(hidden || !line.contains("__builtin"), "{line}");
            }
        }
    }

    #[test]
    fn chosen_lanes_are_moved_together() {
        let text = super::lanes_of_bits();
        let entries: Vec<&str> = text[text.find('{').unwrap() + 1..].split(", ").collect();
        assert_eq!((entries.len(), entries[0], entries[1]), (256, "0x0ul", "0x0ul"));
        assert_eq!(entries[0b1010_0110], "0x7050201ul");
        assert!(entries[255].starts_with("0x706050403020100ul"));
    }
}
