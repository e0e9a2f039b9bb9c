//! The sweep: references, then every candidate at every pose and gaze, each kept as soon as it is done.

mod fingerprint;
mod meter;
mod pictures;
mod place;
mod sequences;

use glam::DVec2;

use super::candidate::{Candidate, Means, RIVAL, TRAVERSAL, candidates};
use super::effort::Effort;
use super::judge::{Judge, Scores, split};
use super::provenance::Provenance;
use super::reference::{Making, Reference, matched, obtain};
use super::report::{LeftOut, Point, Report};
use super::rivals::{AT_EQUAL_COST, adjusted, plan, rivals, shoot};
use super::spread;
use super::store::Store;
use crate::config::{Config, OperatingPoint, Stereo};
use crate::error::Result;
use crate::frame::{FrameReport, Loaded, Renderer};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::metrics::metric::Viewing;
use crate::metrics::stats::{median, percentile};
use crate::trace::Traversal;
use fingerprint::fingerprint;
use meter::Meter;
use pictures::jpeg;
use place::Place;

/// What is measured.
pub struct Subject<'a> {
    /// The scene's name.
    pub scene: String,
    /// The scene.
    pub loaded: &'a Loaded,
    /// The settings around which is swept.
    pub config: &'a Config,
    /// Where the head rests, how far it may go from there in metres, and how many frames a second it sees.
    pub rest: (Pose, f64, f64),
    /// Whether the scene or its sky moves.
    pub moves: bool,
    /// The eyes' views from a head's pose; one or two.
    pub views: &'a dyn Fn(Pose) -> Vec<View>,
    /// Heads a frame apart, three or more each time. The last two are judged; those before are what frames know of
    /// earlier ones, and the last of them is where late pictures of the first that is judged are traced.
    pub heads: &'a [Vec<Pose>],
    /// The kernels' variants that the devices do not use with the given settings.
    pub traversals: &'a [Traversal],
    /// Makes a renderer with other settings, which the kernels' variants need.
    pub open: &'a dyn Fn(&Config) -> Result<Renderer>,
    /// What traces and what reconstructs.
    pub device: String,
    /// Their drivers with versions.
    pub drivers: Vec<String>,
    /// How much work it may be.
    pub effort: Effort,
    /// Only the given settings are measured, and their sequences.
    pub in_motion: bool,
}

/// Everything that stays the same for all candidates.
struct Bench<'a> {
    subject: &'a Subject<'a>,
    places: Vec<Place>,
    /// For each number of bounces, each pose and each step.
    references: Vec<(u32, usize, [Reference; 2])>,
    viewing: Viewing,
    store: Store,
}

/// Work done and work in all, in rays or what costs as much.
pub type Progress<'a> = &'a dyn Fn(u64, u64);

/// Measures everything, or what is left of it since a run before, and writes it to `out`.
///
/// # Errors
/// Where a device fails or a file cannot be written.
pub fn sweep(
    subject: &Subject<'_>,
    renderer: &mut Renderer,
    out: &std::path::Path,
    progress: Progress<'_>,
) -> Result<Report> {
    let key = fingerprint(subject);
    let store = Store::open(out, &key)?;
    let (mut own, mut others) = (
        candidates(subject.config, subject.effort, subject.traversals),
        rivals(subject.config, subject.effort != Effort::Quick),
    );
    if subject.in_motion {
        own.truncate(1);
        others.clear();
    }
    let mut meter = Meter::new(subject, &own, &others, progress);
    let mut bench = prepare(subject, renderer, store, &own, &mut meter)?;

    let mut points: Vec<Point> = Vec::new();
    let mut pulse = None;
    for candidate in own.into_iter().chain(others) {
        let work = meter.cost(&candidate);
        let point = match bench.store.read(&candidate.name) {
            Some(point) => {
                pulse = None;
                meter.skip(work);
                point
            }
            None => {
                let before = pulse.map_or_else(|| bench.pulse(renderer), Ok)?;
                let target = points.first().map_or(0.0, |p| p.frame_ms * before / p.pulse_ms);
                let candidate = bench.priced(renderer, candidate, target)?;
                let mut point = match (candidate.config(), candidate.axis) {
                    (Some(config), TRAVERSAL) => bench.measure(&mut (subject.open)(config)?, &candidate)?,
                    _ => bench.measure(renderer, &candidate)?,
                };
                let after = bench.pulse(renderer)?;
                point.pulse_ms = (before + after) / 2.0;
                pulse = Some(after);
                bench.store.write(&candidate.name, &point)?;
                meter.add(work);
                point
            }
        };
        points.push(point);
    }
    let sequences = bench.sequences(renderer, &mut meter)?;
    let mut report = Report { sequences, ..bench.report(points, key)? };
    report.steady();
    report.find_errors();
    report.find_costs();
    report.mark_front();
    let pictures = |name: &str| {
        Some([
            bench.store.bytes(&format!("{name} picture"), "jpg")?,
            bench.store.bytes(&format!("{name} error"), "jpg")?,
        ])
    };
    let reference = bench.references.first_mut().map(|(_, _, pair)| &pair[0].display);
    let reference = reference.map(|display| jpeg(&split(display, bench.places[0].at(0))[0]));
    report.write(out, &pictures, reference)?;
    Ok(report)
}

/// Loads or renders the references.
fn prepare<'a>(
    subject: &'a Subject<'a>,
    renderer: &mut Renderer,
    store: Store,
    own: &[Candidate],
    meter: &mut Meter<'_>,
) -> Result<Bench<'a>> {
    let places: Vec<Place> = subject
        .heads
        .iter()
        .map(|pair| {
            let eyes: Vec<Vec<View>> = pair.iter().map(|head| (subject.views)(*head)).collect();
            let matches = match eyes[eyes.len() - 2].as_slice() {
                [left, right] => matched(renderer, &[*left, *right], subject.config)?,
                _ => Vec::new(),
            };
            Ok(Place { eyes, matches })
        })
        .collect::<Result<_>>()?;
    let viewing = Viewing {
        exposure: subject.config.view.exposure.fixed() as f32,
        pixels_per_degree: pixels_per_degree(&places[0].at(0)[0]),
    };
    let given = subject.config.trace.bounces;
    let mut wanted: Vec<(u32, usize)> = (0..places.len()).map(|pose| (given, pose)).collect();
    for candidate in own {
        if let Some(config) = candidate.config()
            && wanted.iter().all(|(bounces, _)| *bounces != config.trace.bounces)
        {
            wanted.push((config.trace.bounces, 0));
        }
    }
    let mut references = Vec::new();
    for (bounces, pose) in wanted {
        let making = Making {
            base: subject.config,
            passes: subject.effort.passes(),
            rays: subject.effort.reference_rays(),
            bounces,
            viewing,
        };
        let mut step = |step: usize| -> Result<Reference> {
            let plan = plan(places[pose].at(step), Stereo::PerEye)?;
            let name = format!("reference {pose} {step} bounces {bounces}");
            let work = meter.pass;
            let mut tick = |made: bool| if made { meter.add(work) } else { meter.skip(work) };
            obtain(renderer, &plan, &making, &store, &name, &mut tick)
        };
        references.push((bounces, pose, [step(0)?, step(1)?]));
    }
    Ok(Bench { subject, places, references, viewing, store })
}

/// Pixels per degree on the axis.
fn pixels_per_degree(view: &View) -> f64 {
    let step = (view.fov.up - view.fov.down) / f64::from(view.height);
    1.0 / step.atan().to_degrees()
}

/// Milliseconds that repetitions of one point may take together, with at least two of them.
const REPETITIONS_MS: f64 = 20_000.0;

/// How often a rival is changed at most until it costs what the given settings do.
const PRICING: u32 = 6;

/// Frames of the given settings that are timed between points.
const PULSES: u32 = 2;

impl Bench<'_> {
    /// What a frame of the given settings takes now: how fast the machine is at the moment.
    fn pulse(&self, renderer: &mut Renderer) -> Result<f64> {
        let means = Means::Own(Box::new(self.subject.config.clone()));
        let sight = self.places[0].sight(0, self.subject.effort.gazes()[0]);
        let mut times = Vec::new();
        for seed in 0..=PULSES {
            let report = shoot(renderer, self.subject.config, &means, sight, seed)?.report;
            times.push(report.frame_ms - report.pattern_ms);
        }
        // The first frame after other settings has cold caches, and may have had shaders built.
        Ok(median(&times[1..]).unwrap_or(0.0).max(1e-3))
    }

    /// A rival that is to cost as much as the given settings, changed until it nearly does.
    fn priced(&self, renderer: &mut Renderer, mut candidate: Candidate, target_ms: f64) -> Result<Candidate> {
        if !candidate.name.ends_with(AT_EQUAL_COST) || target_ms <= 0.0 {
            return Ok(candidate);
        }
        let sight = self.places[0].sight(0, self.subject.effort.gazes()[0]);
        for _ in 0..PRICING {
            let mut times = Vec::new();
            for seed in 0..3 {
                let shot = shoot(renderer, self.subject.config, &candidate.means, sight, seed)?;
                times.push(shot.report.frame_ms - shot.report.pattern_ms);
            }
            let factor = target_ms / median(&times).unwrap_or(target_ms).max(1e-3);
            // Nearer than what is asked for, since the machine's speed changes until it is measured.
            if (factor - 1.0).abs() < spread::EQUAL / 2.0 {
                break;
            }
            candidate.means = adjusted(&candidate.means, factor);
        }
        Ok(candidate)
    }

    /// Renders, judges and times a candidate.
    fn measure(&self, renderer: &mut Renderer, candidate: &Candidate) -> Result<Point> {
        let bounces = candidate.config().unwrap_or(self.subject.config).trace.bounces;
        let mut reports: Vec<FrameReport> = Vec::new();
        let mut scores = Vec::new();
        let mut last = None;
        for (_, pose, references) in self.references.iter().filter(|(of, ..)| *of == bounces) {
            let place = &self.places[*pose];
            for &gaze in self.subject.effort.gazes() {
                let mut pictures = Vec::new();
                self.run_up(renderer, candidate, place, gaze)?;
                for step in 0..2 {
                    let seed = 2 * scores.len() as u32 + step as u32 + 1;
                    let sight = place.sight(step, gaze);
                    let shot = shoot(renderer, self.subject.config, &candidate.means, sight, seed)?;
                    reports.push(shot.report);
                    pictures.push(shot.picture);
                }
                let judge = Judge {
                    eyes: place.at(0),
                    gazes: &plan(place.at(0), Stereo::PerEye)?.gaze_points(DVec2::from_array(gaze)),
                    references: [&references[0], &references[1]],
                    matches: &place.matches,
                    viewing: self.viewing,
                };
                let found = judge.judge([&pictures[0], &pictures[1]])?;
                if scores.is_empty() {
                    self.keep_pictures(&candidate.name, &pictures[0], references, place.at(0))?;
                }
                scores.push(found);
                last = Some([place.sight(1, gaze), place.sight(0, gaze)]);
            }
        }
        if let Some(sights) = last {
            let mut spent = 0.0;
            for seed in 0..self.subject.effort.repetitions() {
                if seed >= 2 && spent > REPETITIONS_MS {
                    break;
                }
                // To and fro: at rest a frame may send fewer rays.
                let sight = sights[(seed as usize + 1) % 2];
                let shot = shoot(renderer, self.subject.config, &candidate.means, sight, 1000 + seed)?;
                spent += shot.report.frame_ms;
                reports.push(shot.report);
            }
        }
        Ok(self.point(candidate, &reports, &scores))
    }

    /// Frames that lead to those that are judged, where these know of them.
    fn run_up(
        &self,
        renderer: &mut Renderer,
        candidate: &Candidate,
        place: &Place,
        gaze: [f64; 2],
    ) -> Result<()> {
        renderer.forget();
        if candidate.config().is_some_and(Config::reuses) {
            for frame in 1..place.run_up() {
                let (sight, seed) = (place.seen(frame, gaze), 500 + frame as u32);
                shoot(renderer, self.subject.config, &candidate.means, sight, seed)?;
            }
        }
        Ok(())
    }

    fn point(&self, candidate: &Candidate, reports: &[FrameReport], scores: &[Scores]) -> Point {
        // The first frame may have had drivers finish their kernels.
        let reports = &reports[1..];
        let settled: Vec<f64> = reports.iter().filter(|r| r.pattern_ms == 0.0).map(|r| r.frame_ms).collect();
        let patterns: Vec<f64> =
            reports.iter().filter(|r| r.pattern_ms > 0.0).map(|r| r.pattern_ms).collect();
        let at = |p| percentile(&settled, p).unwrap_or(0.0);
        let found = Scores::mean(scores);
        let frame_ms = at(50.0);
        let eye = self.places[0].at(0);
        let (config, operating) = match &candidate.means {
            Means::Own(config) => {
                let pixels = eye[0].pixels();
                let point = OperatingPoint::of(config, pixels, frame_ms.max(1e-3), found.foveated_score);
                // What frames cannot move to from one to the next is not on the front.
                let competes = ![RIVAL, TRAVERSAL].contains(&candidate.axis)
                    && config.view.stereo == self.subject.config.view.stereo;
                (effective(config, None), competes.then_some(point))
            }
            Means::Late { config, corrected } => (effective(config, Some(*corrected)), None),
            Means::Zones { rays } => (serde_json::json!({ "zones": { "rays": rays } }), None),
            Means::Inset { scale } => (serde_json::json!({ "inset": { "scale": scale } }), None),
            Means::Coarse { scale } => (serde_json::json!({ "resolution": { "scale": scale } }), None),
        };
        let first = reports.first().cloned().unwrap_or_default();
        Point {
            name: candidate.name.clone(),
            axis: candidate.axis.to_string(),
            config,
            frame_ms,
            frame_ms_p10: at(10.0),
            frame_ms_p90: at(90.0),
            frames: settled.len(),
            pulse_ms: 0.0,
            pattern_ms: median(&patterns).unwrap_or(0.0),
            samples: first.samples,
            rays: first.rays,
            psnr: found.psnr,
            psnr_display: found.psnr_display,
            relmse: found.relmse,
            flip: found.flip,
            foveated_score: found.foveated_score,
            foveated_thresholds: found.foveated_thresholds,
            foveated_scores: scores.iter().map(|s| s.foveated_score).collect(),
            foveated_score_error: 0.0,
            flicker: found.flicker,
            disagreement: (eye.len() == 2).then_some(found.disagreement),
            on_front: false,
            cost: 0.0,
            at_equal_cost: None,
            operating,
        }
    }

    /// Judges the references with fewer bounces of light against those with the most.
    fn light_left_out(&self) -> Result<Vec<LeftOut>> {
        let at_first = || self.references.iter().filter(|(_, pose, _)| *pose == 0);
        let Some((most, _, truth)) = at_first().max_by_key(|(bounces, ..)| *bounces) else {
            return Ok(Vec::new());
        };
        let place = &self.places[0];
        let gaze = DVec2::from_array(self.subject.effort.gazes()[0]);
        let judge = Judge {
            eyes: place.at(0),
            gazes: &plan(place.at(0), Stereo::PerEye)?.gaze_points(gaze),
            references: [&truth[0], &truth[1]],
            matches: &place.matches,
            viewing: self.viewing,
        };
        let mut list = Vec::new();
        for (bounces, _, pair) in at_first().filter(|(bounces, ..)| bounces < most) {
            let found = judge.judge([&pair[0].picture, &pair[1].picture])?;
            let Scores { psnr, relmse, flip, foveated_score, .. } = found;
            list.push(LeftOut { bounces: *bounces, of: *most, psnr, relmse, flip, foveated_score });
        }
        list.sort_by_key(|left_out| left_out.bounces);
        Ok(list)
    }

    fn report(&self, points: Vec<Point>, key: String) -> Result<Report> {
        let eyes = self.places[0].at(0);
        let worst = self
            .references
            .iter()
            .flat_map(|(_, _, pair)| pair)
            .map(|reference| reference.error)
            .min_by(|a, b| a.psnr.total_cmp(&b.psnr))
            .expect("there is a reference for the given settings");
        Ok(Report {
            scene: self.subject.scene.clone(),
            triangles: self.subject.loaded.scene.triangles(),
            provenance: Provenance::now(self.subject.drivers.clone(), key),
            device: self.subject.device.clone(),
            size: [eyes.iter().map(|e| e.width).sum(), eyes[0].height],
            pixels_per_degree: self.viewing.pixels_per_degree,
            places: [self.places.len(), self.subject.effort.gazes().len(), 2],
            history: if self.subject.config.reuses() { self.places[0].run_up() - 1 } else { 0 },
            effort: self.subject.effort,
            reference_error: worst,
            light_left_out: self.light_left_out()?,
            sequences: Vec::new(),
            points,
        })
    }
}

/// What decides about a frame, without what is the same for all points.
fn effective(config: &Config, late_correction: Option<bool>) -> serde_json::Value {
    let mut value = serde_json::json!({
        "foveation": config.foveation,
        "trace": config.trace,
        "reconstruction": config.reconstruction,
        "stereo": config.view.stereo,
    });
    if let Some(late_correction) = late_correction {
        value["headset"] = serde_json::json!({ "late_correction": late_correction });
    }
    value
}
