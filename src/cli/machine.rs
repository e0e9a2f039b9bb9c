//! Opening the devices that the configuration asks for.

use crate::config::{Config, DevicesConfig, HardwareRaysConfig};
use crate::error::Result;
use crate::frame::{Loaded, Output, Renderer, Step};
use crate::free_memory;
use crate::gpu::opencl::{Device, DeviceInfo, choose, device};
use crate::gpu::vulkan::{Context, ContextOptions};
use crate::waiting::{self, Limits};

/// Options with what settings ask of the Vulkan device.
pub fn vulkan_options(config: &Config, options: ContextOptions) -> ContextOptions {
    let wanted = (!config.devices.vulkan.is_empty()).then(|| config.devices.vulkan.clone());
    let ray_queries = config.trace.hardware_rays != HardwareRaysConfig::Off;
    ContextOptions { device: wanted, ray_queries, ..options }
}

/// The devices that a frame needs.
pub struct Machine {
    /// The first of those that trace.
    pub device: Device,
    /// All that trace.
    pub devices: Vec<Device>,
    /// Reconstructs.
    pub context: Context,
}

impl Machine {
    /// Opens them.
    ///
    /// # Errors
    /// [`crate::Error::NoDevice`] where one is missing, with the next step.
    pub fn open(config: &Config) -> Result<Machine> {
        Self::open_with(config, ContextOptions::default())
    }

    /// Opens both, the Vulkan device with what a window needs.
    ///
    /// # Errors
    /// As [`Machine::open`].
    pub fn open_with(config: &Config, options: ContextOptions) -> Result<Machine> {
        note_tight_memory();
        let options = vulkan_options(config, options);
        let opened =
            waiting::ask("Vulkan", "Vulkan's driver", Limits::MOMENTS, move || Context::new(&options));
        Self::presenting(opened??, &config.devices)
    }

    /// Opens the devices that trace for one that presents.
    ///
    /// # Errors
    /// [`crate::Error::NoDevice`] where there is none, with the next step.
    pub fn presenting(context: Context, config: &DevicesConfig) -> Result<Machine> {
        let all = waiting::ask("OpenCL", "an OpenCL driver", Limits::MOMENTS, device::list)?;
        let devices = open(&all, config, &context.report().uuid)?;
        Ok(Machine { device: devices[0].clone(), devices, context })
    }

    /// A renderer that uses all of them; tells what each step took.
    ///
    /// # Errors
    /// Where no device can be used.
    pub fn renderer(
        &self,
        loaded: &Loaded,
        config: &Config,
        output: Output,
    ) -> Result<(Renderer, Vec<Step>)> {
        Renderer::with_devices(&self.devices, &self.context, loaded, config, output)
    }

    /// The drivers of all devices, with their versions.
    pub fn drivers(&self) -> Vec<String> {
        let mut list: Vec<String> = Vec::new();
        for info in self.devices.iter().map(Device::info) {
            let driver = format!("OpenCL: {} {}", info.platform, info.driver);
            if !list.contains(&driver) {
                list.push(driver);
            }
        }
        let report = self.context.report();
        list.push(format!("Vulkan: {} (API {})", report.name, report.api_version));
        list
    }

    /// One line: what traces and what reconstructs.
    pub fn describe(&self) -> String {
        let names: Vec<&str> = self.devices.iter().map(|d| d.info().name.as_str()).collect();
        format!("{} (OpenCL), {} (Vulkan)", names.join(" and "), self.context.report().name)
    }
}

/// Drivers that find too little memory may end the program without a word, so it is told before.
fn note_tight_memory() {
    if let Some(limit) = free_memory::tight_limit() {
        let limit = limit >> 20;
        super::complain(&format!(
            "note: this process may use {limit} MiB of memory, and drivers may end it without a word where that is too \
             little; raise the limit (ulimit -v)"
        ));
    }
}

/// Opens the OpenCL devices that are to trace, divided as the settings say; at least one.
///
/// # Errors
/// [`crate::Error::NoDevice`] where there is none, [`crate::Error::Device`] where one that was asked for refuses.
pub fn open(all: &[DeviceInfo], config: &DevicesConfig, presenting: &[u8; 16]) -> Result<Vec<Device>> {
    let mut infos = Vec::new();
    for index in choose(all, &config.opencl, presenting)? {
        match all[index].kind {
            "cpu" if !config.subdivide.is_empty() => {
                infos.extend(device::subdivide(&all[index], &config.subdivide)?);
            }
            _ => infos.push(all[index].clone()),
        }
    }
    let open = if config.profile || infos.len() > 1 { Device::open } else { Device::open_untimed };
    // One that refuses is an error where it was asked for, and no loss where others are.
    let opening = move || infos.iter().map(open).collect::<Vec<_>>();
    let opened = waiting::ask("OpenCL", "an OpenCL driver", Limits::MOMENTS, opening)?;
    if !config.opencl.is_empty() || opened.iter().all(Result::is_err) {
        return opened.into_iter().collect();
    }
    Ok(opened.into_iter().flatten().collect())
}
