//! foveate: see `foveate --help`.
//!
//! Drivers that the system lacks may be unpacked beside it (`scripts/unpack-drivers.sh`). Those of a newer
//! Debian need its C library, and a process has one: so what is built in a checkout with such drivers names
//! the unpacked loader as its interpreter and the folder as its path for libraries (`build/drivers.rs`), and
//! this file tells the loaders of OpenCL and Vulkan where drivers are. Nothing of it is in the environment of
//! other programs, and a checkout without them links as usual.
//!
//! What is unsafe here keeps OpenXR's loader quiet, names unpacked drivers and a place for caches, and has glibc give
//! large memory back.
#![allow(unsafe_code)]

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

/// Where loaders find the drivers that `scripts/unpack-drivers.sh` has unpacked for this program, if it has: the
/// variables that loaders read.
const UNPACKED: [(&str, Option<&str>); 2] = [
    ("OCL_ICD_VENDORS", option_env!("FOVEATE_OCL_ICD_VENDORS")),
    ("VK_DRIVER_FILES", option_env!("FOVEATE_VK_DRIVER_FILES")),
];

fn main() -> ExitCode {
    give_memory_back();
    // OpenXR's loader complains on standard error wherever there is no runtime, which is no fault here.
    let mut defaults: Vec<(&str, OsString)> = vec![("XR_LOADER_DEBUG", "none".into())];
    defaults.extend(UNPACKED.into_iter().filter_map(|(name, value)| Some((name, value?.into()))));
    defaults.retain(|(name, _)| std::env::var_os(name).is_none());
    let cli = foveate::cli::Cli::parse();
    let json = cli.json();
    foveate::progress::show();
    foveate::cli::end_with(end_at_once);
    if let Some((folder, note)) = foveate::cli::caches::elsewhere().filter(|_| cli.uses_drivers()) {
        foveate::cli::complain(&format!("note: {note}"));
        defaults.push(("XDG_CACHE_HOME", folder.into()));
    }
    for (name, value) in defaults {
        // SAFETY: no other thread runs yet that could read the environment meanwhile.
        unsafe { std::env::set_var(name, value) };
    }
    // What drivers may spoil is tried in processes of their own, which run this program.
    if let Ok(program) = std::env::current_exe() {
        foveate::isolated::use_program(program);
    }
    let done = cli.run();
    if let Err(error) = &done {
        foveate::cli::fail(error, json);
    }
    if foveate::waiting::has_given_up() {
        end_at_once(i32::from(done.is_err()));
    }
    if done.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Has glibc give parts of large scenes back to the system as soon as they are let go of. By itself it raises the size
/// from which it does so to 32 MiB, and keeps a gigabyte of what loading a large scene took; a frame's memory stays
/// below this size.
fn give_memory_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: no other thread runs yet.
    unsafe {
        nix::libc::mallopt(nix::libc::M_MMAP_THRESHOLD, 16 << 20);
    }
}

/// Ends without what drivers do at a program's end: one that does not answer would keep it, and one that is at work
/// may crash.
fn end_at_once(code: i32) -> ! {
    let _ = std::io::Write::flush(&mut std::io::stdout());
    #[cfg(unix)]
    // SAFETY: nothing is left to be done in this process.
    unsafe {
        nix::libc::_exit(code);
    }
    #[cfg(windows)]
    // SAFETY: as above; the process' own handle is not to be closed.
    unsafe {
        use windows_sys::Win32::System::Threading::{GetCurrentProcess, TerminateProcess};
        TerminateProcess(GetCurrentProcess(), code as u32);
    }
    #[cfg(not(unix))]
    std::process::exit(code);
}
