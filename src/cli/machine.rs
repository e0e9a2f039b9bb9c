//! Opening the devices that the configuration asks for.

use crate::config::DevicesConfig;
use crate::error::{Error, Result};
use crate::gpu::opencl::{Device, DeviceInfo, device};
use crate::gpu::vulkan::{Context, ContextOptions};

/// The devices that a frame needs.
pub struct Machine {
    /// Traces.
    pub device: Device,
    /// Reconstructs.
    pub context: Context,
}

impl Machine {
    /// Opens both.
    ///
    /// # Errors
    /// [`Error::NoDevice`] where one is missing, with the next step.
    pub fn open(config: &DevicesConfig) -> Result<Machine> {
        Self::open_with(config, ContextOptions::default())
    }

    /// Opens both, the Vulkan device with what a window needs.
    ///
    /// # Errors
    /// As [`Machine::open`].
    pub fn open_with(config: &DevicesConfig, options: ContextOptions) -> Result<Machine> {
        let wanted = (!config.vulkan.is_empty()).then(|| config.vulkan.clone());
        Self::presenting(Context::new(&ContextOptions { device: wanted, ..options })?, config)
    }

    /// Opens the device that traces for one that presents.
    ///
    /// # Errors
    /// [`Error::NoDevice`] where there is none, with the next step.
    pub fn presenting(context: Context, config: &DevicesConfig) -> Result<Machine> {
        let devices = device::list();
        let chosen = choose(&devices, &config.opencl, &context.report().uuid)?;
        Ok(Machine { device: Device::open(&devices[chosen])?, context })
    }

    /// One line: what traces and what reconstructs.
    pub fn describe(&self) -> String {
        format!("{} (OpenCL), {} (Vulkan)", self.device.info().name, self.context.report().name)
    }
}

/// The index of the OpenCL device to trace with: the one asked for, else the best usable one. The
/// device that presents is preferred among equals, since its memory can be shared.
pub fn choose(devices: &[DeviceInfo], wanted: &str, presenting: &[u8; 16]) -> Result<usize> {
    let missing = |problem: String| Err(Error::NoDevice { kind: "OpenCL", problem });
    if devices.is_empty() {
        return missing(
            "no OpenCL driver is installed; install your GPU's, or PoCL (pocl-opencl-icd) to trace on the CPU".into(),
        );
    }
    if !wanted.is_empty() {
        let lower = wanted.to_lowercase();
        let by_number = wanted.parse().ok().filter(|&index: &usize| index < devices.len());
        let by_name = || devices.iter().position(|d| d.name.to_lowercase().contains(&lower));
        return match by_number.or_else(by_name) {
            Some(index) => Ok(index),
            None => missing(format!("none is called {wanted:?}; `foveate devices` lists them")),
        };
    }
    let presenting: String = presenting.iter().map(|byte| format!("{byte:02x}")).collect();
    let rank = |d: &DeviceInfo| {
        let kind = ["gpu", "cpu", "accelerator"].iter().position(|k| *k == d.kind);
        (kind, d.uuid.as_deref() != Some(&presenting), std::cmp::Reverse(d.compute_units))
    };
    let usable = devices.iter().enumerate().filter(|(_, d)| d.unusable.is_none());
    match usable.min_by_key(|(_, d)| rank(d)) {
        Some((index, _)) => Ok(index),
        None => missing("none of those installed can be used; `foveate devices` tells why".into()),
    }
}
