//! `foveate devices`: what this machine offers, what is used, and why not the rest.

use serde::Serialize;

use super::machine::choose;
use super::options::ConfigOptions;
use super::output;
use crate::config::Layers;
use crate::error::Result;
use crate::gpu::interop;
use crate::gpu::opencl::{Device, DeviceInfo, device};
use crate::gpu::vulkan::{self, Context, ContextOptions};
use crate::headset::openxr::Runtime;

/// Arguments of `foveate devices`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    options: ConfigOptions,
}

#[derive(Serialize)]
struct Report {
    opencl: Vec<OpenClDevice>,
    vulkan: Vec<VulkanDevice>,
    sharing: Option<String>,
    presenters: Vec<Presenter>,
    problems: Vec<String>,
}

#[derive(Serialize)]
struct OpenClDevice {
    #[serde(flatten)]
    info: DeviceInfo,
    used: bool,
    reason: String,
}

#[derive(Serialize)]
struct VulkanDevice {
    name: String,
    kind: String,
    api_version: String,
    used: bool,
    reason: String,
}

#[derive(Serialize)]
struct Presenter {
    name: &'static str,
    used: bool,
    reason: String,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let config = args.options.layers(Layers::default())?.finish()?;
    let mut problems = Vec::new();
    let mut keep = |result: Result<()>| {
        let problem = result.err().map(|e| e.to_string());
        problems.extend(problem.filter(|problem| !problems.contains(problem)));
    };

    let wanted = (!config.devices.vulkan.is_empty()).then(|| config.devices.vulkan.clone());
    let context = Context::new(&ContextOptions { device: wanted, ..Default::default() });
    let presenting = context.as_ref().map_or([0; 16], |c| c.report().uuid);
    let infos = device::list();
    let chosen = choose(&infos, &config.devices.opencl, &presenting);
    let tracing = chosen.as_ref().ok().and_then(|&index| Device::open(&infos[index]).ok());
    let sharing = match (&tracing, &context) {
        (Some(device), Ok(context)) => Some(interop::probe(device, context).to_string()),
        _ => None,
    };
    let used_uuid = context.as_ref().ok().map(|c| (c.report().uuid, c.report().name.clone()));
    let vulkan = match vulkan::devices() {
        Ok(reports) => reports.into_iter().map(|r| describe_vulkan(r, used_uuid.as_ref())).collect(),
        Err(error) => {
            keep(Err(error));
            Vec::new()
        }
    };
    keep(context.map(drop));
    let chosen_index = chosen.as_ref().ok().copied();
    keep(chosen.map(drop));
    let opencl = infos
        .into_iter()
        .enumerate()
        .map(|(index, info)| describe_opencl(info, chosen_index == Some(index)))
        .collect();
    let report = Report { opencl, vulkan, sharing, presenters: presenters(), problems };
    if args.options.json { output::print_json(&report) } else { print(&report) }
}

fn describe_opencl(info: DeviceInfo, used: bool) -> OpenClDevice {
    let reason = match (&info.unusable, used) {
        (Some(why), _) => why.clone(),
        (None, true) => "traces".to_string(),
        (None, false) => "usable; choose it with --device".to_string(),
    };
    OpenClDevice { info, used, reason }
}

fn describe_vulkan(report: vulkan::DeviceReport, used: Option<&([u8; 16], String)>) -> VulkanDevice {
    let is_used = used.is_some_and(|(uuid, name)| *uuid == report.uuid && *name == report.name);
    let reason = match (report.unusable, is_used) {
        (Some(why), _) => why,
        (None, true) => "reconstructs".to_string(),
        (None, false) => "usable; choose it with --set devices.vulkan=NAME".to_string(),
    };
    VulkanDevice {
        name: report.name,
        kind: format!("{:?}", report.kind).to_lowercase(),
        api_version: report.api_version,
        used: is_used,
        reason,
    }
}

/// OpenXR's headset where one answers, else the mock one.
fn presenters() -> Vec<Presenter> {
    let runtime = Runtime::connect(true);
    let used = runtime.is_ok();
    let reason = match runtime {
        Ok(runtime) => format!("{} has a headset", runtime.name()),
        Err(fault) => fault.into_error().to_string(),
    };
    vec![
        Presenter { name: "OpenXR", used, reason },
        Presenter { name: "mock headset", used: !used, reason: "writes pictures; always there".to_string() },
    ]
}

fn print(report: &Report) -> Result<()> {
    let mark = |used: bool| if used { '*' } else { ' ' };
    let none = |devices: usize| (devices == 0).then(|| "     none".to_string());
    let mut lines = vec!["OpenCL (traces)".to_string()];
    lines.extend(none(report.opencl.len()));
    for (index, d) in report.opencl.iter().enumerate() {
        lines.push(format!(
            "{} {index}  {} [{}, {} units, {} MiB{}]  {} {}: {}",
            mark(d.used),
            d.info.name,
            d.info.kind,
            d.info.compute_units,
            d.info.memory >> 20,
            if d.info.fp64 { "" } else { ", no double precision" },
            d.info.platform,
            d.info.driver,
            d.reason
        ));
    }
    lines.push("Vulkan (reconstructs)".to_string());
    lines.extend(none(report.vulkan.len()));
    for d in &report.vulkan {
        lines.push(format!("{}    {} [{}, {}]: {}", mark(d.used), d.name, d.kind, d.api_version, d.reason));
    }
    if let Some(sharing) = &report.sharing {
        lines.push(format!("Samples go from one to the other {sharing}."));
    }
    lines.push("Presenters".to_string());
    lines.extend(report.presenters.iter().map(|p| format!("{}    {}: {}", mark(p.used), p.name, p.reason)));
    lines.extend(report.problems.iter().map(|problem| format!("Problem: {problem}")));
    output::print_line(&lines.join("\n"))
}
