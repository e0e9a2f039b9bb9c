//! What `foveate devices` asks of drivers, in parts that can be left out.

use crate::error::{Error, Result};
use crate::isolated::{self, Failure};

/// What is asked of drivers one after the other; a part that ends the process is left out of the next.
#[derive(Debug, Default)]
pub struct Parts {
    lost: Vec<(String, String)>,
}

/// Every part that is asked for, as its stage is called.
pub const VULKAN: &str = "asking Vulkan";
pub const OPENCL: &str = "asking OpenCL's drivers for devices";
pub const KERNELS: &str = "choosing kernels";
pub const SHARING: &str = "sharing memory";
pub const RAYS: &str = "choosing who traces rays";
pub const SHARES: &str = "rendering small frames";
pub const OPENXR: &str = "asking OpenXR";

impl Parts {
    /// Leaves out what earlier processes ended over.
    pub fn without(told: &[String]) -> Parts {
        let split =
            |text: &String| text.split_once('=').map(|(part, why)| (part.to_string(), why.to_string()));
        Parts { lost: told.iter().filter_map(split).collect() }
    }

    /// The arguments that tell the next process so.
    pub fn arguments(&self) -> Vec<String> {
        let lost = self.lost.iter().map(|(part, why)| format!("--without={part}={why}"));
        lost.chain([String::from("--without=")]).collect()
    }

    /// Leaves out what was being done when a process ended; false where that is no help.
    pub fn lose(&mut self, failure: &Failure) -> bool {
        let all = [VULKAN, OPENCL, KERNELS, SHARING, RAYS, SHARES, OPENXR];
        // Trials and kernels tell stages of their own.
        let part = all.into_iter().find(|part| failure.stage == *part).unwrap_or(KERNELS);
        let new = self.lost.iter().all(|(lost, _)| lost != part);
        self.lost.push((part.to_string(), failure.to_string()));
        new
    }

    /// Does a part, or says why not.
    pub fn ask<T>(&self, part: &str, ask: impl FnOnce() -> T) -> Result<T> {
        match self.lost.iter().find(|(lost, _)| lost == part) {
            Some((_, why)) => Err(Error::NoDevice { kind: kind_of(part), problem: why.clone() }),
            None => {
                isolated::stage(part);
                Ok(ask())
            }
        }
    }
}

/// What is missing without a part.
fn kind_of(part: &str) -> &'static str {
    match part {
        VULKAN => "Vulkan",
        OPENXR => "OpenXR",
        _ => "OpenCL",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_ended_a_process_is_left_out_of_the_next() {
        let mut parts = Parts::default();
        let failure = |stage: &str| Failure {
            stage: stage.into(),
            how: "crashed (SIGSEGV)".into(),
            last_words: String::new(),
        };
        assert!(parts.lose(&failure(OPENCL)) && parts.lose(&failure(OPENXR)));
        assert!(!parts.lose(&failure(OPENCL)), "once is enough");
        let told: Vec<String> = parts
            .arguments()
            .iter()
            .map(|argument| argument.trim_start_matches("--without=").into())
            .collect();
        let next = Parts::without(&told);
        assert_eq!(next.ask(VULKAN, || 7).unwrap(), 7);
        let why = next.ask(OPENCL, || 7).unwrap_err().to_string();
        assert_eq!(why, format!("no usable OpenCL device: its driver crashed (SIGSEGV) while {OPENCL}"));
    }
}
