//! `foveate measure`: what speed costs in accuracy, on this scene and these devices.

use std::path::{Path, PathBuf};

use indicatif::ProgressBar;

use super::mock;
use super::options::{Options, PictureOptions};
use super::stop::end_now;
use super::{output, render};
use crate::config::{Config, Layers, Stereo};
use crate::error::{Error, Result};
use crate::frame::Output;
use crate::headset::mock::Script;
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::trace::{Traversal, Traversals};
use crate::tradeoff::{Effort, Report, Subject, check_reports, sweep};
use crate::whole_file;

/// Arguments of `foveate measure`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    /// Folder for report.html, report.json, points.csv, sequences.csv, front.toml and comparison.md. A run that was
    /// interrupted goes on where it was.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A first impression: small pictures, few points, two motions, some minutes on two cores.
    #[arg(long, conflicts_with = "thorough")]
    quick: bool,
    /// More poses, gazes, passes and points: for figures that are written down.
    #[arg(long)]
    thorough: bool,
    /// Only the given settings, and their sequences of frames: nothing is swept, and files of an earlier sweep in the folder
    /// are replaced.
    #[arg(long)]
    in_motion: bool,
    /// The headset whose eyes see the pictures: dk1 or generic.
    #[arg(long, value_name = "NAME", default_value = "generic")]
    headset: String,
    #[command(flatten)]
    pub(super) options: PictureOptions,
}

/// The script's length in seconds, along which the head's poses are taken.
const SCRIPT_SECONDS: f64 = 8.0;

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let effort = match (args.quick, args.thorough) {
        (true, _) => Effort::Quick,
        (_, true) => Effort::Thorough,
        _ => Effort::Usual,
    };
    let mut defaults = mock::stereo_defaults();
    let shrunk = |pixels: u32| (f64::from(pixels) / effort.shrink() / 2.0).round() as u32 * 2;
    defaults.view.width = shrunk(defaults.view.width);
    defaults.view.height = shrunk(defaults.view.height);
    // What is given is compared with a reference of as many bounces of light.
    defaults.trace.indirect = crate::config::Indirect::Paths;
    let config = args.options.config_over(Layers::over(defaults))?;
    let profile = mock::fitted(mock::profile(&args.headset)?, &config, args.options.view.fov_y());
    whole_file::check_folder(&args.out)?;
    check_reports(&args.out)?;
    let bar = output::progress_share("measuring");
    on_interrupt(&bar, &args.out)?;
    let (machine, loaded) = render::open_with(&config, || render::load_moving(&args.scene, &config))?;
    output::print_warnings(&loaded.warnings);
    let (rest, _) = args.options.view.viewpoint(&loaded.scene, &config)?;
    let script = Script::demo(rest, SCRIPT_SECONDS).with_reach(mock::reach(&loaded));
    let heads = heads(&script, effort, 1.0 / profile.refresh_hz);
    let views = |head: Pose| -> Vec<View> {
        let eyes = profile.views(head);
        if config.view.stereo == Stereo::Mono { vec![eyes[0]] } else { eyes.to_vec() }
    };
    let open = |config: &Config| Ok(machine.renderer(&loaded, config, Output::Radiance)?.0);
    let mut renderer = open(&config)?;
    let used: Vec<Traversals> =
        machine.devices.iter().map(|device| config.trace.traversal.on(device).traversals).collect();
    let used =
        |traversal: &Traversal| used.iter().all(|traversals| *traversals == Traversals::from(*traversal));
    let traversals: Vec<Traversal> =
        Traversal::ALL.into_iter().filter(|traversal| !used(traversal)).collect();
    let subject = Subject {
        scene: args.scene.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        loaded: &loaded,
        config: &config,
        rest: (rest, mock::reach(&loaded), profile.refresh_hz),
        moves: renderer.moves(),
        views: &views,
        heads: &heads,
        traversals: &traversals,
        open: &open,
        drivers: machine.drivers(),
        device: format!("{}, samples {}", machine.describe(), renderer.sharing()),
        effort,
        in_motion: args.in_motion,
    };
    let report = sweep(&subject, &mut renderer, &args.out, &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    if args.options.config.json {
        return output::print_json(&report);
    }
    print(&report, &args.out)
}

/// Has Ctrl-C say, before it ends the run, that nothing is lost: each part is kept as soon as it is measured.
fn on_interrupt(bar: &ProgressBar, out: &Path) -> Result<()> {
    let (bar, out) = (bar.clone(), out.display().to_string());
    let handler = move || {
        bar.finish_and_clear();
        super::complain(&format!(
            "stopped; {out} keeps what was measured, and the same command goes on from there"
        ));
        end_now(130);
    };
    ctrlc::set_handler(handler)
        .map_err(|e| Error::setting("Ctrl-C", format!("it cannot be listened to ({e}); start again")))
}

/// Heads along the script in frames `step` seconds apart: those that are judged, one before, and their history.
fn heads(script: &Script, effort: Effort, step: f64) -> Vec<Vec<Pose>> {
    let count = effort.poses();
    let frames = -1 - effort.history() as i32..=1;
    (0..count)
        .map(|i| {
            // The head is under way in both directions, never at a turning point.
            let time = SCRIPT_SECONDS * (i as f64 + 0.3) / count as f64;
            frames.clone().map(|frame| script.head_at(time + f64::from(frame) * step)).collect()
        })
        .collect()
}

fn print(report: &Report, out: &std::path::Path) -> Result<()> {
    output::print_line(&format!(
        "{}: {} at {}x{}, {} places; the reference is within {:.1} dB",
        report.scene,
        match report.points.len() {
            1 => "1 point".to_string(),
            points => format!("{points} points"),
        },
        report.size[0],
        report.size[1],
        report.places.iter().product::<usize>(),
        report.reference_error.psnr,
    ))?;
    output::print_line("the Pareto front, fastest first: frame time, foveated score of 10, PSNR, FLIP")?;
    for p in report.front() {
        output::print_line(&format!(
            "  {:8.1} ms  {:5.2}  {:5.1} dB  {:.4}  {}",
            p.frame_ms, p.foveated_score, p.psnr, p.flip, p.name
        ))?;
    }
    print_rivals(report)?;
    print_sequences(report)?;
    output::print_line(&format!(
        "{}: report.html, report.json, points.csv, sequences.csv, front.toml, comparison.md",
        out.display()
    ))
}

/// What others' methods reach at the cost of the given settings, where they were measured.
fn print_rivals(report: &Report) -> Result<()> {
    if report.at_equal_cost().next().is_none() {
        return Ok(());
    }
    let given = &report.points[0];
    output::print_line(&format!(
        "at the cost of the given settings ({:.1} ms, score {:.2}):",
        given.frame_ms, given.foveated_score
    ))?;
    for p in report.at_equal_cost() {
        output::print_line(&format!(
            "  {:8.1} ms  {:5.2}  {:5.1} dB  {:.4}  {}",
            p.frame_ms,
            p.foveated_score,
            p.psnr,
            p.flip,
            p.title()
        ))?;
    }
    Ok(())
}

fn print_sequences(report: &Report) -> Result<()> {
    output::print_line("in motion: frame time, foveated score, flicker (codes of 255, low-pass)")?;
    for s in &report.sequences {
        output::print_line(&format!(
            "  {:8.1} ms  {:5.2}  {:6.3}  {}, {}",
            s.frame_ms,
            s.foveated_score,
            s.low_pass_flicker,
            s.motion.name(),
            s.name
        ))?;
    }
    Ok(())
}
