//! The Khronos layers that stand between a program and its runtime or driver and find what is wrong.

use std::path::Path;

/// Environment variables that put both layers in, with OpenXR's messages in a file of that folder.
pub fn environment(folder: &Path) -> Vec<(&'static str, String)> {
    let file = folder.join(FILE).display().to_string();
    let settings = [
        ("XR_ENABLE_API_LAYERS", "XR_APILAYER_LUNARG_core_validation"),
        ("XR_CORE_VALIDATION_EXPORT_TYPE", "text"),
        ("XR_CORE_VALIDATION_FILE_NAME", &file),
        ("VK_INSTANCE_LAYERS", VULKAN),
        // The loader says which layers it takes, which proves that this one is there.
        ("VK_LOADER_DEBUG", "layer"),
    ];
    settings.map(|(name, value)| (name, value.to_string())).to_vec()
}

/// What the layers have found: in OpenXR's file, and in what the program printed.
///
/// # Panics
/// Where one of the layers was not there.
pub fn messages(folder: &Path, printed: &str) -> Vec<String> {
    let found = std::fs::read_to_string(folder.join(FILE)).unwrap_or_default();
    assert!(
        found.contains("Core Validation Layer is initialized"),
        "OpenXR's core validation layer was not there: {printed}"
    );
    assert!(
        printed.lines().any(|line| line.contains("LAYER") && line.contains(VULKAN)),
        "Vulkan's validation layer was not there: {printed}"
    );
    let openxr =
        found.lines().filter(|line| line.contains("VALID_") && !line.contains("| VUID-CoreValidation-"));
    let vulkan = printed.lines().filter(|line| line.contains("VUID") || line.contains("Validation Error"));
    openxr.chain(vulkan).map(str::to_string).collect()
}

/// Whether both layers are installed; says so where one is not. A failure where CI=true promises them.
pub fn installed() -> bool {
    let any = |folders: &[&str], name: &str| {
        let files = folders.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
        files.map(|file| file.file_name()).any(|file| file.to_string_lossy().contains(name))
    };
    let unpacked = std::env::var("XR_API_LAYER_PATH").unwrap_or_default();
    let openxr =
        ["/usr/share/openxr/1/api_layers/explicit.d", "/etc/openxr/1/api_layers/explicit.d", &unpacked];
    let vulkan = ["/usr/share/vulkan/explicit_layer.d", "/etc/vulkan/explicit_layer.d"];
    let there = any(&openxr, "core_validation") && any(&vulkan, "khronos_validation");
    if !there {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "validation layers are not installed");
        println!("not run: validation layers are not installed (scripts/install-packages.sh test)");
    }
    there
}

const FILE: &str = "openxr-validation.txt";
const VULKAN: &str = "VK_LAYER_KHRONOS_validation";
