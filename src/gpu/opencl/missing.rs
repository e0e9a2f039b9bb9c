//! Why there is no OpenCL device: what the loader keeps to itself.

use std::path::PathBuf;

/// One sentence for the operator, with the next step.
pub fn why_none() -> String {
    let drivers = drivers();
    if drivers.is_empty() {
        return "no OpenCL driver is installed; install your GPU's, or PoCL (pocl-opencl-icd) to trace on the CPU".into();
    }
    let drivers = drivers.join(", ");
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    match limited(&limits) {
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

/// The limit of a process' address space in bytes, where it is one that drivers can feel: their compilers alone take
/// hundreds of megabytes.
fn limited(limits: &str) -> Option<u64> {
    const PLENTY: u64 = 8 << 30;
    let line = limits.lines().find(|line| line.starts_with("Max address space"))?;
    let soft = line.trim_start_matches("Max address space").split_whitespace().next()?;
    soft.parse().ok().filter(|&bytes| bytes < PLENTY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tight_limit_is_seen() {
        let limits = |soft: &str| {
            limited(&format!(
                "Limit                     Soft Limit           Hard Limit           Units\n\
                 Max cpu time              unlimited            unlimited            seconds\n\
                 Max address space         {soft}            unlimited            bytes\n"
            ))
        };
        assert_eq!(limits("614400000"), Some(614_400_000));
        assert_eq!((limits("unlimited"), limits("68719476736"), limited("")), (None, None, None));
    }
}
