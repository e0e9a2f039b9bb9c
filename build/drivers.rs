// Included by build.rs and by that of tests/fake_runtime: drivers that scripts/unpack-drivers.sh has unpacked.

/// Has programs and tests start by the loader of the unpacked C library and look for libraries there first, where
/// `.cargo/config.toml` names such a folder. Elsewhere programs are the system's, as usual.
fn link_with_unpacked_drivers(root: &str) {
    let configuration = format!("{root}/.cargo");
    // In what cargo has packaged for others there is no such folder, and a missing file would count as changed.
    if std::path::Path::new(&configuration).exists() {
        println!("cargo:rerun-if-changed={configuration}");
    }
    println!("cargo:rerun-if-env-changed=FOVEATE_DRIVERS");
    let folder = std::env::var("FOVEATE_DRIVERS").ok().filter(|folder| !folder.is_empty());
    let Some(folder) = folder else { return };
    let list = format!("{folder}/paths");
    let paths = std::fs::read_to_string(&list)
        .unwrap_or_else(|error| panic!("{list}: {error}; run scripts/install-packages.sh again"));
    println!("cargo:rustc-link-arg=-Wl,--dynamic-linker={folder}/loader");
    // The older kind of path, which holds for what drivers load too.
    println!("cargo:rustc-link-arg=-Wl,--disable-new-dtags,-rpath,{}", paths.trim());
    for name in ["FOVEATE_OCL_ICD_VENDORS", "FOVEATE_VK_DRIVER_FILES"] {
        if let Ok(value) = std::env::var(name) {
            println!("cargo:rustc-env={name}={value}");
        }
    }
}
