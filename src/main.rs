//! foveate: see `foveate --help`.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match foveate::cli::Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("foveate: {error}");
            ExitCode::FAILURE
        }
    }
}
