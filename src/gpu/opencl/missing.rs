//! Why there is no OpenCL device: what the loader keeps to itself.

use std::path::PathBuf;

use crate::free_memory;

/// One sentence for the operator, with the next step.
pub fn why_none() -> String {
    let drivers = drivers();
    if drivers.is_empty() {
        return "no OpenCL driver is installed; install your GPU's, or PoCL (pocl-opencl-icd) to trace on the CPU".into();
    }
    let drivers = drivers.join(", ");
    match free_memory::tight_limit() {
        Some(limit) => format!(
            "drivers are installed ({drivers}) and none could start with the {} MiB of memory that this process may use; raise the limit (ulimit -v)",
            limit >> 20
        ),
        None => format!(
            "drivers are installed ({drivers}) and none of them offers a device; look for what clinfo says, or install PoCL (pocl-opencl-icd) to trace on the CPU"
        ),
    }
}

/// The drivers that the loader finds: the names of files in its folder.
fn drivers() -> Vec<String> {
    let asked = std::env::var_os("OCL_ICD_VENDORS").map(PathBuf::from).filter(|path| path.is_dir());
    let folder = asked.unwrap_or_else(|| PathBuf::from("/etc/OpenCL/vendors"));
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut names: Vec<String> = files
        .filter(|path| path.extension().is_some_and(|e| e == "icd"))
        .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    names
}
