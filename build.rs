//! Translates the shaders, `kernels/*.wgsl`, to SPIR-V, tells the linker of unpacked drivers, and the program what
//! it was built from.
//!
//! Two directives, each a line of its own, stand in for a preprocessor:
//! - `//#include shared/NAME.wgsl` is replaced by that file, and so are those in it;
//! - `//#variants NAME A B ...` makes one module for each value, `STEM_A.spv`, with `const NAME = Au;`.

use std::path::{Path, PathBuf};
use std::{env, fs};

use naga::back::spv;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::{Capabilities, ValidationFlags, Validator};

include!("build/drivers.rs");
include!("build/version.rs");

fn main() {
    link_with_unpacked_drivers(".");
    tell_version();
    println!("cargo:rerun-if-changed=build");
    println!("cargo:rerun-if-changed=kernels");
    println!("cargo:rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let mut shaders: Vec<PathBuf> = fs::read_dir("kernels")
        .expect("kernels/ stands beside build.rs")
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "wgsl"))
        .collect();
    shaders.sort();
    for path in &shaders {
        translate(path, &out);
    }
}

/// Writes every variant of one shader.
fn translate(path: &Path, out: &Path) {
    let stem = path.file_stem().expect("a shader has a name").to_string_lossy().into_owned();
    let text = read(path);
    let (source, variants) = expand(&text);
    let Some((name, values)) = variants else {
        fs::write(out.join(format!("{stem}.spv")), compile(path, &source)).expect("OUT_DIR is writable");
        return;
    };
    for value in values {
        let source = format!("const {name} = {value}u;\n{source}");
        let file = out.join(format!("{stem}_{value}.spv"));
        fs::write(file, compile(path, &source)).expect("OUT_DIR is writable");
    }
}

/// Replaces the includes, and returns the variants if the shader names some.
fn expand(text: &str) -> (String, Option<(String, Vec<String>)>) {
    let mut source = String::new();
    let mut variants = None;
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("//#include ") {
            source.push_str(&expand(&read(&Path::new("kernels").join(name.trim()))).0);
        } else if let Some(list) = line.strip_prefix("//#variants ") {
            let mut words = list.split_whitespace().map(str::to_string);
            variants = words.next().map(|name| (name, words.collect()));
        } else {
            source.push_str(line);
            source.push('\n');
        }
    }
    (source, variants)
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// WGSL to SPIR-V words, as bytes.
fn compile(path: &Path, source: &str) -> Vec<u8> {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{}: {}", path.display(), error.emit_to_string(source)));
    let traces_rays = source.contains("enable wgpu_ray_query;");
    let needs = if traces_rays { Capabilities::RAY_QUERY } else { Capabilities::empty() };
    let info = Validator::new(ValidationFlags::all(), Capabilities::IMMEDIATES | needs)
        .validate(&module)
        .unwrap_or_else(|error| panic!("{}: {}", path.display(), error.emit_to_string(source)));
    // Every index comes from a table whose range the host has checked, and every loop ends. Ray queries take SPIR-V 1.4.
    let options = spv::Options {
        lang_version: if traces_rays { (1, 4) } else { (1, 3) },
        flags: spv::WriterFlags::empty(),
        bounds_check_policies: BoundsCheckPolicies {
            index: BoundsCheckPolicy::Unchecked,
            buffer: BoundsCheckPolicy::Unchecked,
            ..BoundsCheckPolicies::default()
        },
        zero_initialize_workgroup_memory: spv::ZeroInitializeWorkgroupMemoryMode::None,
        force_loop_bounding: false,
        ray_query_initialization_tracking: false,
        emit_int_div_checks: false,
        ..spv::Options::default()
    };
    spv::write_vec(&module, &info, &options, None)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .collect()
}
