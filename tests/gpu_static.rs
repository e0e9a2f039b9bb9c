//! What kernels would take of graphics cards, by the compilers of their drivers: registers, stacks and spills of the
//! variant for GPUs. No card is needed; `make gpu-static` brings the compilers and runs this.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use foveate::scene::Features;
use foveate::trace::{registers, source};

/// The depth of the demo scene's tree.
const DEPTH: u32 = 8;
const NVIDIA: [&str; 2] = ["sm_86", "sm_90"];
const AMD: [&str; 2] = ["gfx1030", "gfx1100"];

/// What a work-item of a kernel takes: registers (NVIDIA's, or AMD's vector registers), bytes of memory of its own, and
/// bytes of registers that are put there for want of room.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cost {
    registers: u32,
    stack: u32,
    spills: u32,
}

impl Cost {
    fn is_within(self, limit: Cost) -> bool {
        self.registers <= limit.registers && self.stack <= limit.stack
    }
}

/// At most so much on NVIDIA's and on AMD's cards, whatever the features.
struct Limit {
    kernel: &'static str,
    nvidia: Cost,
    amd: Cost,
}

const fn limit(kernel: &'static str, nvidia: [u32; 2], amd: [u32; 2]) -> Limit {
    const fn cost([registers, stack]: [u32; 2]) -> Cost {
        Cost { registers, stack, spills: 0 }
    }
    Limit { kernel, nvidia: cost(nvidia), amd: cost(amd) }
}

/// What kernels may take: those that do nothing but trace, those of rays in hardware that trace what is left, and the others.
const LIMITS: [Limit; 5] = [
    limit("trace_", [64, 256], [128, 256]),
    limit("intersect_", [64, 256], [128, 256]),
    limit("resolve_pixel_", [128, 416], [128, 256]),
    limit("resolve_sample_", [128, 416], [128, 256]),
    limit("", [128, 256], [128, 256]),
];

fn features() -> [(&'static str, Features); 3] {
    let demo = Features { textures: true, normal_maps: true, alpha: true, sun: true, ..Features::default() };
    let demo = Features { emitters: true, glass: true, glossy: true, ..demo };
    let all = Features { vertex_colors: true, layers: true, ..demo };
    [("none", Features::default()), ("demo scene", demo), ("all", all)]
}

/// A tool or a folder that the environment names.
fn named(variable: &str) -> PathBuf {
    let path = std::env::var_os(variable);
    PathBuf::from(path.unwrap_or_else(|| panic!("{variable} is not set; run this by `make gpu-static`")))
}

/// What a program said on standard error.
fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{command:?}: {said}");
    said
}

/// Clang for a target, with a file of kernels and the options that drivers get.
fn clang(target: &str, text: &Path, options: &str) -> Command {
    let mut command = Command::new(named("CLANG"));
    command.args(["-target", target, "-x", "cl", "-O3", "-Xclang", "-finclude-default-header", "-S"]);
    // "-D NAME=VALUE" is two arguments.
    command.args(options.split_whitespace()).arg(text);
    command
}

fn number(text: &str) -> u32 {
    text.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap()
}

/// Each kernel's cost as ptxas tells it, with the limits of registers that NVIDIA's driver is given; patterns have none.
fn nvidia(text: &Path, options: &str, arch: &str) -> BTreeMap<String, Cost> {
    if !options.contains("SINGLE_RAYS=1") {
        return ptxas(text, options, &[format!("-arch={arch}")]);
    }
    let parts = registers::limited(&std::fs::read_to_string(text).unwrap());
    let costs = parts.map(|part| {
        let most = part.registers.map(|most| format!("-maxrregcount={most}"));
        let path = text.with_extension("part.cl");
        std::fs::write(&path, part.text).unwrap();
        ptxas(&path, options, &[format!("-arch={arch}")].into_iter().chain(most).collect::<Vec<_>>())
    });
    costs.into_iter().flatten().collect()
}

fn ptxas(text: &Path, options: &str, limits: &[String]) -> BTreeMap<String, Cost> {
    let assembly = text.with_extension("ptx");
    let mut command = clang("nvptx64-nvidia-nvcl", text, options);
    for argument in ["-target-cpu", "sm_80", "-target-feature", "+ptx75", "-mlink-builtin-bitcode"] {
        command.args(["-Xclang", argument]);
    }
    said(command.arg("-Xclang").arg(named("LIBCLC")).arg("-o").arg(&assembly));
    let mut command = Command::new(named("PTXAS"));
    command.args(limits).args(["-v", "-O3", "-o"]).arg(text.with_extension("cubin")).arg(&assembly);
    of_ptxas(&said(&mut command))
}

fn of_ptxas(said: &str) -> BTreeMap<String, Cost> {
    let (mut costs, mut kernel, mut cost) = (BTreeMap::new(), None, Cost::default());
    for line in said.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        if line.contains("Compiling entry function") {
            kernel = line.split('\'').nth(1).map(str::to_string);
        } else if line.contains("bytes stack frame") {
            (cost.stack, cost.spills) = (number(words[0]), number(words[4]));
        } else if let Some(used) = words.iter().position(|word| *word == "Used")
            && let Some(kernel) = kernel.take()
        {
            cost.registers = number(words[used + 1]);
            costs.insert(kernel, cost);
        }
    }
    costs
}

/// Each kernel's cost as LLVM tells it in its assembly for AMD.
fn amd(text: &Path, options: &str, cpu: &str) -> BTreeMap<String, Cost> {
    let assembly = text.with_extension("s");
    let mut command = clang("amdgcn-amd-amdhsa", text, options);
    command.arg(format!("-mcpu={cpu}"));
    command.arg(format!("--rocm-device-lib-path={}", named("ROCM").display()));
    said(command.arg("-o").arg(&assembly));
    of_llvm(&std::fs::read_to_string(&assembly).unwrap())
}

fn of_llvm(assembly: &str) -> BTreeMap<String, Cost> {
    let (mut costs, mut kernel, mut cost) = (BTreeMap::new(), None, Cost::default());
    for line in assembly.lines() {
        let line = line.trim();
        if let Some(name) = line.strip_prefix(".amdhsa_kernel ") {
            kernel = Some(name.to_string());
        } else if let Some(vgprs) = line.strip_prefix("; NumVgprs: ") {
            cost.registers = number(vgprs);
        } else if let Some(scratch) = line.strip_prefix("; ScratchSize: ") {
            cost.stack = number(scratch);
        } else if line.starts_with("; Occupancy: ")
            && let Some(kernel) = kernel.take()
        {
            costs.insert(kernel, cost);
        }
    }
    costs
}

/// What a kernel is held to: the first limit whose name it begins with.
fn held(kernel: &str) -> &'static Limit {
    LIMITS.iter().find(|limit| kernel.starts_with(limit.kernel)).unwrap()
}

/// Compiles the variant for GPUs for two generations of NVIDIA's and AMD's cards, prints what each kernel takes, and fails where one
/// takes more than it may.
#[test]
#[ignore = "needs compilers for GPUs: make gpu-static"]
fn kernels_take_no_more_of_gpus_than_they_are_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let (frames, patterns) =
        (write("kernels.cl", source::text()), write("pattern.cl", source::pattern_text()));
    let of_frames = |(name, features): (&'static str, Features)| {
        (name.to_string(), &frames, source::options_of_gpus(&features, DEPTH), "shade_light_hits")
    };
    let of_patterns = ("patterns".to_string(), &patterns, source::pattern_options(256), "list_samples");
    println!("| kernel | features | {} | {} |", NVIDIA.join(" | "), AMD.join(" | "));
    println!("| --- | --- | --- | --- | --- | --- |");
    let mut over = Vec::new();
    let of_kernels = features().map(of_frames);
    let in_hardware = of_kernels.clone().map(|(name, text, options, expected)| {
        (format!("{name}, rays in hardware"), text, source::options_for_hardware_rays(&options), expected)
    });
    let others = of_kernels.into_iter().chain([of_patterns]);
    for (name, text, options, expected) in others.chain(in_hardware) {
        let mut rows: BTreeMap<String, Vec<String>> = BTreeMap::new();
        let mut take = |costs: BTreeMap<String, Cost>, card: &str, of: fn(&Limit) -> Cost| {
            assert!(costs.contains_key(expected), "{card}: {costs:?}");
            for (kernel, cost) in costs {
                if !cost.is_within(of(held(&kernel))) {
                    over.push(format!("{kernel} ({name}) on {card}: {cost:?}"));
                }
                let spills =
                    if cost.spills > 0 { format!(", {} spilled", cost.spills) } else { String::new() };
                let cell = format!("{}, {} B{spills}", cost.registers, cost.stack);
                rows.entry(kernel).or_default().push(cell);
            }
        };
        for arch in NVIDIA {
            take(nvidia(text, &options, arch), arch, |limit| limit.nvidia);
        }
        for cpu in AMD {
            take(amd(text, &options, cpu), cpu, |limit| limit.amd);
        }
        for (kernel, cells) in rows {
            println!("| {kernel} | {name} | {} |", cells.join(" | "));
        }
    }
    assert!(over.is_empty(), "more than is allowed: {over:#?}");
}

#[test]
fn what_compilers_tell_is_read() {
    let said = "ptxas info    : 0 bytes gmem\n\
        ptxas info    : Compiling entry function 'trace_pixels' for 'sm_90'\n\
        ptxas info    : Function properties for trace_pixels\n    \
        720 bytes stack frame, 12 bytes spill stores, 8 bytes spill loads\n\
        ptxas info    : Used 71 registers, used 0 barriers, 720 bytes cumulative stack size\n";
    let cost = Cost { registers: 71, stack: 720, spills: 12 };
    assert_eq!(of_ptxas(said), BTreeMap::from([("trace_pixels".to_string(), cost)]));
    let assembly = "\t.amdhsa_kernel trace_pixels\n; NumVgprs: 128\n; ScratchSize: 200\n; Occupancy: 8\n";
    let cost = Cost { registers: 128, stack: 200, spills: 0 };
    assert_eq!(of_llvm(assembly), BTreeMap::from([("trace_pixels".to_string(), cost)]));
    let may = |kernel, cost: Cost| cost.is_within(held(kernel).nvidia);
    assert!(may("shade_light_hits", Cost { registers: 128, stack: 256, spills: 4 }));
    assert!(!may("trace_pixels", Cost { registers: 65, stack: 0, spills: 0 }));
    assert!(!may("trace_pixels", Cost { registers: 64, stack: 257, spills: 0 }));
}
