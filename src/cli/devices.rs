//! `foveate devices`: what this machine offers, what is used, and why not the rest.

mod parts;

use std::time::Duration;

use serde::Serialize;

use super::machine;
use super::options::ConfigOptions;
use super::output;
use crate::bench::Choice;
use crate::config::{Config, Layers, Samples};
use crate::error::{Error, Result};
use crate::frame::{Loaded, Output, Plan, RaysBy, Renderer};
use crate::gpu::interop::{self, Sharing};
use crate::gpu::opencl::{Device, DeviceInfo, choose, device};
use crate::gpu::vulkan::{self, Context, ContextOptions};
use crate::isolated;
use crate::math::view::View;
use crate::scene::{default_viewpoint, generate};
use crate::trace::State;

use super::options::eye_fov;
use parts::{KERNELS, OPENCL, Parts, RAYS, SHARES, SHARING, VULKAN};

/// Arguments of `foveate devices`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub(super) options: ConfigOptions,
    /// Ask drivers in this very process, but not for these parts, each with what happened to it: this program starts
    /// itself so.
    #[arg(long, hide = true, value_name = "PART=WHY")]
    without: Option<Vec<String>>,
}

#[derive(Serialize)]
struct Report {
    opencl: Vec<OpenClDevice>,
    vulkan: Vec<VulkanDevice>,
    sharing: Option<String>,
    /// Why they are shared so.
    sharing_reason: Option<String>,
    /// Who traces rays, and why, where devices can.
    rays: Option<String>,
    /// What each device that traces takes of a small frame; one device takes all.
    shares: Vec<Share>,
    presenters: Vec<Presenter>,
    problems: Vec<String>,
}

#[derive(Serialize)]
struct OpenClDevice {
    #[serde(flatten)]
    info: DeviceInfo,
    used: bool,
    reason: String,
    /// The variants of the kernels that it uses, where it traces.
    kernels: Option<Choice>,
}

/// A device's part of a small frame.
#[derive(Serialize)]
struct Share {
    name: String,
    /// Of the samples, 0..1.
    share: f64,
    /// Why it is left out.
    left_out: Option<String>,
}

#[derive(Serialize)]
struct VulkanDevice {
    name: String,
    kind: String,
    api_version: String,
    /// The first extension or feature that it lacks for ray queries; `null` where it has them.
    lacks_ray_queries: Option<String>,
    used: bool,
    reason: String,
}

#[derive(Serialize)]
struct Presenter {
    name: &'static str,
    used: bool,
    reason: String,
}

/// Runs the command: in processes of their own, as many as drivers end, so that it always has a report.
pub fn run(args: &Args) -> Result<()> {
    let config = args.options.layers(Layers::default())?.finish()?;
    if let Some(without) = &args.without {
        isolated::work_for_others();
        let report = report(&config, &Parts::without(without))?;
        let told = (text_of(&report, args.options.json)?, report.lacks());
        isolated::answer(&serde_json::to_string(&told).expect("text"));
        return Ok(());
    }
    let Some(program) = isolated::program() else {
        let report = report(&config, &Parts::default())?;
        return tell(&text_of(&report, args.options.json)?, report.lacks());
    };
    let given: Vec<String> =
        std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
    let mut parts = Parts::default();
    loop {
        match isolated::run(program, &[&given[..], &parts.arguments()].concat(), DEVICES_PATIENCE) {
            Ok(answer) => {
                let (text, lacks): (String, Option<String>) =
                    serde_json::from_str(&answer).unwrap_or_default();
                return tell(&text, lacks.as_deref());
            }
            Err(failure) if parts.lose(&failure) => {}
            Err(failure) => {
                let problem = format!("{failure}; update this machine's drivers");
                return Err(Error::NoDevice { kind: "OpenCL or Vulkan", problem });
            }
        }
    }
}

/// Prints the report. Where nothing can be rendered, that is this command's failure too, and the report says why.
fn tell(text: &str, lacks: Option<&str>) -> Result<()> {
    output::print_line(text)?;
    let problem = "see the problems that are listed".to_string();
    match lacks {
        None => Ok(()),
        Some("OpenCL") => Err(Error::NoDevice { kind: "OpenCL", problem }),
        Some(_) => Err(Error::NoDevice { kind: "Vulkan", problem }),
    }
}

impl Report {
    /// The kind of device that is missing for anything to be rendered.
    fn lacks(&self) -> Option<&'static str> {
        if !self.opencl.iter().any(|device| device.used) {
            return Some("OpenCL");
        }
        (!self.vulkan.iter().any(|device| device.used)).then_some("Vulkan")
    }
}

/// A little longer than a trial of kernels, which has a patience of its own.
const DEVICES_PATIENCE: Duration = Duration::from_secs(isolated::PATIENCE.as_secs() + 60);

/// Asks drivers for everything.
fn report(config: &Config, parts: &Parts) -> Result<Report> {
    let mut problems = Vec::new();
    let mut keep = |result: Result<()>| {
        let problem = result.err().map(|e| e.to_string());
        problems.extend(problem.filter(|problem| !problems.contains(problem)));
    };

    let asked = || Context::new(&machine::vulkan_options(config, ContextOptions::default()));
    let context = parts.ask(VULKAN, asked).and_then(|context| context);
    let presenting = context.as_ref().map_or([0; 16], |c| c.report().uuid);
    let listed = parts.ask(OPENCL, device::list);
    let infos = listed.as_deref().unwrap_or_default().to_vec();
    let opened = match listed {
        Ok(_) => machine::open(&infos, &config.devices, &presenting),
        Err(error) => Err(error),
    };
    let chosen = choose(&infos, &config.devices.opencl, &presenting);
    let tracing: &[Device] = opened.as_deref().unwrap_or_default();
    let sharing = match (tracing.first(), &context) {
        (Some(device), Ok(context)) => match parts.ask(SHARING, || interop::explain(device, context)) {
            Ok(sharing) => Some(sharing),
            Err(error) => {
                keep(Err(error));
                None
            }
        },
        _ => None,
    };
    let rays = match (tracing.first(), &context, &sharing) {
        (Some(device), Ok(context), Some((sharing, _))) => {
            let asked =
                parts.ask(RAYS, || RaysBy::of(config, device, context, *sharing == Sharing::ZeroCopy));
            asked.map_err(|error| keep(Err(error))).ok().map(|by| by.describe())
        }
        _ => None,
    };
    // What a device is divided into is measured by itself when it is used.
    let kernels = |info: &DeviceInfo| {
        let device = tracing.iter().find(|device| device.info().is(info))?;
        Some(config.trace.traversal.on(device))
    };
    let kernels: Vec<Option<Choice>> = match parts.ask(KERNELS, || infos.iter().map(kernels).collect()) {
        Ok(kernels) => kernels,
        Err(error) => {
            keep(Err(error));
            vec![None; infos.len()]
        }
    };
    let shares = match &context {
        Ok(context) if tracing.len() > 1 => {
            parts.ask(SHARES, || shares(tracing, context, config)).and_then(|shares| shares)
        }
        _ => Ok(tracing.iter().map(whole).collect()),
    };
    let used_uuid = context.as_ref().ok().map(|c| (c.report().uuid, c.report().name.clone()));
    let vulkan = match parts.ask(VULKAN, vulkan::devices).and_then(|devices| devices) {
        Ok(reports) => reports.into_iter().map(|r| describe_vulkan(r, used_uuid.as_ref())).collect(),
        Err(error) => {
            keep(Err(error));
            Vec::new()
        }
    };
    keep(context.map(drop));
    let chosen = if opened.is_ok() { chosen.unwrap_or_default() } else { Vec::new() };
    keep(opened.map(drop));
    let shares = shares.unwrap_or_else(|error| {
        keep(Err(error));
        Vec::new()
    });
    let described = infos.into_iter().zip(kernels).enumerate();
    let opencl = described.map(|(at, (info, kernels))| describe_opencl(info, chosen.contains(&at), kernels));
    let (sharing, sharing_reason) = sharing.map(|(way, why)| (way.to_string(), why)).unzip();
    let presenters = presenters(parts);
    Ok(Report {
        opencl: opencl.collect(),
        vulkan,
        sharing,
        sharing_reason,
        rays,
        shares,
        presenters,
        problems,
    })
}

/// What a device has that traces alone.
fn whole(device: &Device) -> Share {
    Share { name: device.info().name.clone(), share: 1.0, left_out: None }
}

fn describe_opencl(info: DeviceInfo, used: bool, kernels: Option<Choice>) -> OpenClDevice {
    let reason = match (&info.unusable, used) {
        (Some(why), _) => why.clone(),
        (None, true) => "traces".to_string(),
        (None, false) => {
            "usable, but not chosen, or there by another driver too; choose it with --devices".to_string()
        }
    };
    OpenClDevice { info, used, reason, kernels }
}

/// Frames after which shares have settled, and their size.
const FRAMES: u32 = 6;
const SIZE: [u32; 2] = [320, 200];

/// Renders small frames of the demo scene, and tells which part of them each device takes in the end.
fn shares(devices: &[Device], context: &Context, config: &Config) -> Result<Vec<Share>> {
    let mut config = config.clone().without_reuse();
    config.foveation.samples = Samples::Count(16_000);
    let loaded = Loaded::from_glb("the demo scene", &generate::demo::generate(), &config)?;
    let (mut renderer, _) = Renderer::with_devices(devices, context, &loaded, &config, Output::Display)?;
    let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
    let [width, height] = SIZE;
    let fov = eye_fov(eye.fov_y, width, height);
    let plan = Plan::mono(View {
        world_from_eye: eye.world_from_eye,
        fov,
        width,
        height,
        spacing: Default::default(),
    });
    let mut last = renderer.frame(&plan, &[], 0)?;
    for seed in 1..FRAMES {
        last = renderer.frame(&plan, &[], seed)?;
    }
    let fleet = renderer.fleet();
    let share = |(index, name): (usize, &str)| Share {
        name: name.to_string(),
        share: last.devices.get(index).map_or(0.0, |d| d.samples as f64 / last.samples.max(1) as f64),
        left_out: match fleet.state(index) {
            State::Out(why) => Some(why.clone()),
            State::Late => Some("it does not answer; see what its driver says".to_string()),
            State::Opening | State::Ready => None,
        },
    };
    Ok(fleet.names().enumerate().map(share).collect())
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
        lacks_ray_queries: report.lacks_ray_queries,
        used: is_used,
        reason,
    }
}

/// Whether OpenXR has a headset, and why, or why not.
#[cfg(feature = "openxr")]
fn openxr(parts: &Parts) -> (bool, String) {
    use crate::headset::openxr::Runtime;
    let runtime = parts.ask(parts::OPENXR, || Runtime::connect(true));
    let used = matches!(runtime, Ok(Ok(_)));
    let reason = match runtime {
        Ok(Ok(runtime)) => format!("{} has a headset", runtime.name()),
        Ok(Err(fault)) => fault.into_error().to_string(),
        Err(error) => error.to_string(),
    };
    (used, reason)
}

#[cfg(not(feature = "openxr"))]
fn openxr(_: &Parts) -> (bool, String) {
    (false, "this program was built without it; build it with the feature openxr".to_string())
}

/// OpenXR's headset where one answers, else the mock one.
fn presenters(parts: &Parts) -> Vec<Presenter> {
    let (used, reason) = openxr(parts);
    vec![
        Presenter { name: "OpenXR", used, reason },
        Presenter { name: "mock headset", used: !used, reason: "writes pictures; always there".to_string() },
    ]
}

/// The report as it is printed.
fn text_of(report: &Report, json: bool) -> Result<String> {
    if json {
        return output::json(report);
    }
    let mark = |used: bool| if used { '*' } else { ' ' };
    let none = |devices: usize| (devices == 0).then(|| "     none".to_string());
    let mut lines = vec!["OpenCL (traces)".to_string()];
    lines.extend(none(report.opencl.len()));
    for (index, d) in report.opencl.iter().enumerate() {
        lines.push(format!(
            "{} {index}  {} [{}, {} units, {} MiB]  {} {}: {}",
            mark(d.used),
            d.info.name,
            d.info.kind,
            d.info.compute_units,
            d.info.memory >> 20,
            d.info.platform,
            d.info.driver,
            d.reason
        ));
        lines.extend(d.kernels.iter().map(|choice| format!("     {}", choice.describe())));
    }
    if report.shares.len() > 1 {
        lines.push("Shares of a small frame".to_string());
    }
    for share in report.shares.iter().filter(|_| report.shares.len() > 1) {
        let why = share.left_out.as_ref().map_or(String::new(), |why| format!("  left out: {why}"));
        lines.push(format!("{:5.1} % {}{why}", 100.0 * share.share, share.name));
    }
    lines.push("Vulkan (reconstructs)".to_string());
    lines.extend(none(report.vulkan.len()));
    for d in &report.vulkan {
        let rays = match &d.lacks_ray_queries {
            Some(lacks) => format!("without ray queries: it lacks {lacks}"),
            None => "with ray queries".to_string(),
        };
        lines.push(format!(
            "{}    {} [{}, {}]: {}; {rays}",
            mark(d.used),
            d.name,
            d.kind,
            d.api_version,
            d.reason
        ));
    }
    if let (Some(sharing), Some(why)) = (&report.sharing, &report.sharing_reason) {
        lines.push(format!("Samples go from the first to the other {sharing}: {why}."));
    }
    lines.extend(report.rays.clone());
    lines.push("Presenters".to_string());
    lines.extend(report.presenters.iter().map(|p| format!("{}    {}: {}", mark(p.used), p.name, p.reason)));
    lines.extend(report.problems.iter().map(|problem| format!("Problem: {problem}")));
    Ok(lines.join("\n"))
}
