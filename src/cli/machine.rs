//! Opening the devices that the configuration asks for.

use crate::config::{Config, DevicesConfig, HardwareRaysConfig};
use crate::error::{Error, Result};
use crate::frame::{Loaded, Output, Renderer, Step};
use crate::free_memory;
use crate::gpu::opencl::{Device, DeviceInfo, device, why_none};
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
    /// [`Error::NoDevice`] where one is missing, with the next step.
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
    /// [`Error::NoDevice`] where there is none, with the next step.
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
/// [`Error::NoDevice`] where there is none, [`Error::Device`] where one that was asked for refuses.
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
    // One that refuses is an error where it was asked for, and no loss where others are.
    let opening = move || infos.iter().map(Device::open).collect::<Vec<_>>();
    let opened = waiting::ask("OpenCL", "an OpenCL driver", Limits::MOMENTS, opening)?;
    if !config.opencl.is_empty() || opened.iter().all(Result::is_err) {
        return opened.into_iter().collect();
    }
    Ok(opened.into_iter().flatten().collect())
}

/// The OpenCL devices to trace with, by their indices: those asked for, else all usable ones, each once where
/// two drivers offer it. The best one is first; among equals it is the device that presents, since its
/// memory can be shared.
pub fn choose(devices: &[DeviceInfo], wanted: &str, presenting: &[u8; 16]) -> Result<Vec<usize>> {
    let missing = |problem: String| Err(Error::NoDevice { kind: "OpenCL", problem });
    if devices.is_empty() {
        return missing(why_none());
    }
    let presenting: String = presenting.iter().map(|byte| format!("{byte:02x}")).collect();
    let rank = |&index: &usize| {
        let d = &devices[index];
        let kind = ["gpu", "cpu", "accelerator"].iter().position(|k| *k == d.kind);
        (kind, d.uuid.as_deref() != Some(&presenting), std::cmp::Reverse(d.compute_units))
    };
    let mut chosen: Vec<usize> = Vec::new();
    if wanted.trim().is_empty() {
        chosen.extend((0..devices.len()).filter(|&index| devices[index].unusable.is_none()));
        chosen.sort_by_key(rank);
        let mut seen = std::collections::BTreeSet::new();
        chosen.retain(|&index| devices[index].uuid.as_ref().is_none_or(|uuid| seen.insert(uuid.clone())));
        if chosen.is_empty() {
            return missing("none of those installed can be used; `foveate devices` tells why".into());
        }
        return Ok(chosen);
    }
    for name in wanted.split(',').map(str::trim).filter(|name| !name.is_empty()) {
        match find(devices, name) {
            Some(index) if !chosen.contains(&index) => chosen.push(index),
            Some(_) => {}
            None => return missing(format!("none is called {name:?}; `foveate devices` lists them")),
        }
    }
    if chosen.is_empty() {
        return missing(format!("{wanted:?} names none; `foveate devices` lists them"));
    }
    chosen.sort_by_key(rank);
    Ok(chosen)
}

/// A device by its number, its UUID or a part of its name.
fn find(devices: &[DeviceInfo], name: &str) -> Option<usize> {
    // A number beyond the last is not a part of a name.
    if name.len() <= 2 && name.bytes().all(|byte| byte.is_ascii_digit()) {
        return name.parse().ok().filter(|&index: &usize| index < devices.len());
    }
    let lower = name.to_lowercase();
    let plain: String = lower.chars().filter(|c| *c != '-').collect();
    let by_uuid = || devices.iter().position(|d| d.uuid.as_deref() == Some(&plain));
    let by_name = || devices.iter().position(|d| d.name.to_lowercase().contains(&lower));
    by_uuid().or_else(by_name)
}
