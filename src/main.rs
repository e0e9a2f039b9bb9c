//! foveate: see `foveate --help`.
#![allow(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    // OpenXR's loader complains on standard error wherever there is no runtime, which is no fault here.
    if std::env::var_os("XR_LOADER_DEBUG").is_none() {
        // SAFETY: no other thread runs yet that could read the environment meanwhile.
        unsafe { std::env::set_var("XR_LOADER_DEBUG", "none") };
    }
    // What drivers may spoil is tried in processes of their own, which run this program.
    if let Ok(program) = std::env::current_exe() {
        foveate::isolated::use_program(program);
    }
    match foveate::cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            foveate::cli::complain(&error.to_string());
            ExitCode::FAILURE
        }
    }
}
