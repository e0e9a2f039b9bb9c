//! foveate: see `foveate --help`.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match foveate::cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            foveate::cli::complain(&error.to_string());
            ExitCode::FAILURE
        }
    }
}
