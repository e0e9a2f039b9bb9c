//! What others do, rendered with this program's own tracer, so that methods are compared and not
//! implementations.
//!
//! **Rivals in the same house.** Others' methods are rendered with this program's tracer, so that methods are
//! compared and not implementations: what they would gain from hardware made for them is not in the figures.
//! `foveate measure` sweeps on one renderer, whose settings change between frames (`Renderer::apply`); only
//! the kernels' other variant gets one of its own. Between any two points some frames of the given settings
//! are timed, and what a machine's clock or neighbours did to them is taken out of all times
//! (`Report::steady`): a sweep takes many minutes, and points are compared with each other. Late correction
//! is judged apart: its pictures are traced from where the head was a frame before, and compared with what is
//! seen from where it is then.

use glam::{DVec2, DVec3};

use super::candidate::{Candidate, Means, RIVAL};
use super::reference::{full, taken};
use crate::config::{Config, Method, Samples, Stereo, WeightsConfig};
use crate::error::Result;
use crate::foveation::Law;
use crate::frame::{Cut, FrameReport, Plan, Renderer};
use crate::gpu::vulkan::Rect;
use crate::math::view::{FieldOfView, View};
use crate::metrics::Picture;

/// Eccentricities in degrees up to which the first and the second zone reach.
const ZONES: [f64; 2] = [10.0, 20.0];
/// Rays of the zones (Mohanto, Kluge and Staadt 2024, arXiv 2406.07981); where their zones end is not
/// given in degrees, so [`ZONES`] is this project's choice.
const ZONE_RAYS: [u32; 3] = [32, 16, 8];
/// Quad views with usual settings: the periphery at 0.4 of the resolution, a focus of half the width and
/// height at all of it (defaults of Quad-Views-Foveated, which sharpens the focus by another 1.1).
const PERIPHERY: f64 = 0.4;
const FOCUS: f64 = 0.5;

/// Others' methods as they are usually run. Those that are named last can be made to cost what is wanted.
pub fn rivals(base: &Config, as_published: bool) -> Vec<Candidate> {
    let rival = |name: &str, means| Candidate { name: name.to_string(), axis: RIVAL, means };
    let mut paper = base.clone().without_reuse();
    paper.foveation.law = Law::default();
    paper.foveation.samples = Samples::Share(55_000.0 / 1_024_000.0);
    paper.trace.rays = 32;
    paper.trace.bounces = base.trace.bounces;
    paper.reconstruction.method = Method::KNearest;
    paper.reconstruction.k = 4;
    paper.reconstruction.weights = WeightsConfig::Shepard;
    if paper.view.stereo != Stereo::Mono {
        paper.view.stereo = Stereo::Shared;
    }
    let methods = [
        ("the paper's settings", Means::Own(Box::new(paper))),
        ("zones of 32/16/8 rays", Means::Zones { rays: ZONE_RAYS }),
        ("foveated inset", Means::Inset { scale: 1.0 }),
        ("lower resolution", Means::Coarse { scale: 0.5 }),
    ];
    let mut list =
        vec![rival(EVERY_PIXEL, Means::Own(Box::new(full(base, base.trace.rays, base.trace.bounces))))];
    if as_published {
        list.extend(methods.iter().map(|(name, means)| rival(name, means.clone())));
    }
    list.extend(methods.map(|(name, means)| rival(&format!("{name}{AT_EQUAL_COST}"), means)));
    list
}

/// The name of a sample in each pixel with as many rays as given.
pub const EVERY_PIXEL: &str = "every pixel";
/// Names of rivals that are made to cost what the given settings do end like this.
pub const AT_EQUAL_COST: &str = ", at equal cost";

/// The same means at about `factor` times the cost.
pub fn adjusted(means: &Means, factor: f64) -> Means {
    match means {
        Means::Own(config) => {
            let mut config = config.clone();
            if let Samples::Share(share) = &mut config.foveation.samples {
                *share = (*share * factor).clamp(1e-4, 1.0);
            }
            Means::Own(config)
        }
        Means::Late { .. } => means.clone(),
        Means::Zones { rays } => {
            let most = f64::from(rays[0]) * factor;
            // Ratios are kept as well as whole rays can.
            let zone = |share: f64| (most * share).round().clamp(1.0, 4096.0) as u32;
            Means::Zones { rays: [zone(1.0), zone(0.5), zone(0.25)] }
        }
        Means::Inset { scale } => Means::Inset { scale: (scale * factor.sqrt()).clamp(0.02, 2.0) },
        Means::Coarse { scale } => Means::Coarse { scale: (scale * factor.sqrt()).clamp(0.02, 1.0) },
    }
}

/// A frame of one pose and gaze.
pub struct TimedPictures {
    /// The eyes' pictures side by side, in the size of the views.
    pub picture: Picture,
    /// What it cost: of several frames for one picture, each counts with its share.
    pub report: FrameReport,
}

/// What a frame is to show.
#[derive(Clone, Copy)]
pub struct Sight<'a> {
    /// The eyes' views when it is shown.
    pub eyes: &'a [View],
    /// The same a frame earlier.
    pub before: &'a [View],
    /// Where the eyes look, in 0..1 of the first one's picture.
    pub gaze: DVec2,
}

/// Renders a frame by any means.
pub fn shoot(
    renderer: &mut Renderer,
    base: &Config,
    means: &Means,
    sight: Sight<'_>,
    seed: u32,
) -> Result<TimedPictures> {
    let Sight { eyes, before, gaze } = sight;
    let (rays, bounces) = (base.trace.rays, base.trace.bounces);
    match means {
        Means::Own(config) => {
            renderer.apply(config)?;
            let plan = plan(eyes, config.view.stereo)?;
            let report = renderer.frame(&plan, &plan.gaze_points(gaze), seed)?;
            Ok(TimedPictures { picture: taken(renderer, &plan)?, report })
        }
        Means::Late { config, corrected } => {
            renderer.apply(config)?;
            let (traced, shown) = (plan(before, config.view.stereo)?, plan(eyes, config.view.stereo)?);
            let mut late = |view: usize| corrected.then(|| shown.views[view].0.world_from_eye);
            let report = renderer.late_frame(&traced, &traced.gaze_points(gaze), seed, &mut late)?;
            Ok(TimedPictures { picture: taken(renderer, &traced)?, report })
        }
        Means::Zones { rays } => zones(renderer, base, *rays, eyes, gaze, seed),
        Means::Inset { scale } => {
            renderer.apply(&full(base, rays, bounces))?;
            inset(renderer, *scale, eyes, gaze, seed)
        }
        Means::Coarse { scale } => {
            renderer.apply(&full(base, rays, bounces))?;
            let views: Vec<View> = eyes.iter().map(|eye| sized(eye, eye.fov, *scale)).collect();
            let plan = row(&views);
            let report = renderer.frame(&plan, &[], seed)?;
            let picture = taken(renderer, &plan)?;
            let lookup = |eye: usize, uv: DVec2| bilinear(&picture, plan.views[eye].1[0].rect, uv);
            Ok(TimedPictures { picture: composed(eyes, lookup)?, report })
        }
    }
}

/// The plan of one eye or two.
pub fn plan(eyes: &[View], stereo: Stereo) -> Result<Plan> {
    match eyes {
        [left, right] => Plan::stereo([*left, *right], stereo),
        _ => Ok(Plan::mono(eyes[0])),
    }
}

/// Three frames with a sample at each pixel, put together by zones. Shading makes up nearly all of such
/// frames, so each counts with the share of the pixels that is taken from it.
fn zones(
    renderer: &mut Renderer,
    base: &Config,
    rays: [u32; 3],
    eyes: &[View],
    gaze: DVec2,
    seed: u32,
) -> Result<TimedPictures> {
    let plan = plan(eyes, Stereo::PerEye)?;
    let points = plan.gaze_points(gaze);
    let mut zone_of = Vec::new();
    for (eye, point) in eyes.iter().zip(&points) {
        let size = DVec2::new(f64::from(eye.width), f64::from(eye.height));
        let direction = eye.eye_direction(*point * size).normalize();
        zone_of.extend((0..eye.pixels()).map(|i| zone(eye, direction, i)));
    }
    let count = zone_of.len() as f64;
    let mut total = FrameReport::default();
    let mut pictures = Vec::new();
    for (zone, rays) in rays.into_iter().enumerate() {
        renderer.apply(&full(base, rays, base.trace.bounces))?;
        let report = renderer.frame(&plan, &points, seed)?;
        let share = zone_of.iter().filter(|z| usize::from(**z) == zone).count() as f64 / count;
        total.frame_ms += share * (report.frame_ms - report.pattern_ms);
        total.rays += (share * report.rays as f64) as u64;
        total.samples += (share * report.samples as f64).round() as usize;
        pictures.push(taken(renderer, &plan)?);
    }
    let mut picture = pictures[0].clone();
    let mut start = 0;
    let mut left = 0;
    for eye in eyes {
        for index in 0..eye.pixels() {
            let (x, y) = (index as u32 % eye.width, index as u32 / eye.width);
            let at = (y * picture.width + left + x) as usize;
            picture.pixels[at] = pictures[usize::from(zone_of[start + index])].pixels[at];
        }
        start += eye.pixels();
        left += eye.width;
    }
    Ok(TimedPictures { picture, report: total })
}

/// The zone of a pixel: 0 around the gaze.
fn zone(eye: &View, gaze: DVec3, index: usize) -> u8 {
    let (x, y) = (index as u32 % eye.width, index as u32 / eye.width);
    let direction = eye.eye_direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).normalize();
    let degrees = direction.dot(gaze).clamp(-1.0, 1.0).acos().to_degrees();
    ZONES.iter().filter(|limit| degrees > **limit).count() as u8
}

/// Quad views.
fn inset(
    renderer: &mut Renderer,
    scale: f64,
    eyes: &[View],
    gaze: DVec2,
    seed: u32,
) -> Result<TimedPictures> {
    let whole = row(eyes);
    let corners: Vec<DVec2> = whole
        .gaze_points(gaze)
        .iter()
        .map(|gaze| (*gaze - FOCUS / 2.0).clamp(DVec2::ZERO, DVec2::splat(1.0 - FOCUS)))
        .collect();
    let views: Vec<View> = eyes
        .iter()
        .zip(&corners)
        .flat_map(|(eye, corner)| {
            let focus = part(eye.fov, *corner);
            [sized(eye, eye.fov, PERIPHERY * scale), sized(eye, focus, FOCUS * scale)]
        })
        .collect();
    let plan = row(&views);
    let report = renderer.frame(&plan, &[], seed)?;
    let picture = taken(renderer, &plan)?;
    let lookup = |eye: usize, uv: DVec2| {
        let inside = (uv - corners[eye]) / FOCUS;
        let focused = inside.min_element() >= 0.0 && inside.max_element() < 1.0;
        let (view, uv) = if focused { (2 * eye + 1, inside) } else { (2 * eye, uv) };
        bilinear(&picture, plan.views[view].1[0].rect, uv)
    };
    Ok(TimedPictures { picture: composed(eyes, lookup)?, report })
}

/// The field of view of the focus, from its upper left corner in 0..1 of the picture.
fn part(fov: FieldOfView, corner: DVec2) -> FieldOfView {
    let x = |u: f64| fov.left + (fov.right - fov.left) * u;
    let y = |v: f64| fov.up + (fov.down - fov.up) * v;
    FieldOfView { left: x(corner.x), right: x(corner.x + FOCUS), up: y(corner.y), down: y(corner.y + FOCUS) }
}

/// A view with another field of view, with `scale` times the pixels along each side.
fn sized(eye: &View, fov: FieldOfView, scale: f64) -> View {
    let side = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
    View { fov, width: side(eye.width), height: side(eye.height), ..*eye }
}

/// Views side by side.
fn row(views: &[View]) -> Plan {
    let mut x = 0;
    let mut list = Vec::new();
    for view in views {
        let rect = Rect { x, y: 0, width: view.width, height: view.height };
        list.push((*view, vec![Cut { source: [0, 0], rect }]));
        x += view.width;
    }
    Plan { width: x, height: views.iter().map(|v| v.height).max().unwrap_or(1), views: list }
}

/// The eyes' pictures side by side from a colour for each eye and point of it, in 0..1.
fn composed(eyes: &[View], lookup: impl Fn(usize, DVec2) -> [f32; 3]) -> Result<Picture> {
    let (width, height) = (eyes.iter().map(|e| e.width).sum(), eyes[0].height);
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height {
        for (index, eye) in eyes.iter().enumerate() {
            let point = |x: u32| {
                DVec2::new(
                    (f64::from(x) + 0.5) / f64::from(eye.width),
                    (f64::from(y) + 0.5) / f64::from(height),
                )
            };
            pixels.extend((0..eye.width).map(|x| lookup(index, point(x))));
        }
    }
    Picture::new(width, height, pixels)
}

/// A part of a picture at a point in 0..1 of the part, bilinear between pixel centres.
fn bilinear(picture: &Picture, rect: Rect, uv: DVec2) -> [f32; 3] {
    let along = |t: f64, size: u32| {
        let at = (t * f64::from(size) - 0.5).clamp(0.0, f64::from(size - 1));
        let low = at.floor();
        (low as u32, (low as u32 + 1).min(size - 1), (at - low) as f32)
    };
    let (x0, x1, fx) = along(uv.x, rect.width);
    let (y0, y1, fy) = along(uv.y, rect.height);
    let at = |x: u32, y: u32| picture.pixels[((rect.y + y) * picture.width + rect.x + x) as usize];
    let (a, b, c, d) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
    [0, 1, 2].map(|i| {
        let (top, bottom) = (a[i] + (b[i] - a[i]) * fx, c[i] + (d[i] - c[i]) * fx);
        top + (bottom - top) * fy
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;

    fn eye() -> View {
        let fov = FieldOfView { left: -1.0, right: 1.0, up: 1.0, down: -1.0 };
        View { world_from_eye: Pose::IDENTITY, fov, width: 40, height: 20, spacing: Default::default() }
    }

    #[test]
    fn bilinear_keeps_ramps_and_edges() {
        let pixels = (0..8).map(|i| [i as f32, 0.0, 1.0]).collect();
        let picture = Picture::new(4, 2, pixels).unwrap();
        let rect = Rect { x: 1, y: 0, width: 3, height: 2 };
        assert_eq!(bilinear(&picture, rect, DVec2::new(0.5, 0.5)), [4.0, 0.0, 1.0]);
        assert_eq!(bilinear(&picture, rect, DVec2::ZERO), [1.0, 0.0, 1.0]);
        assert_eq!(bilinear(&picture, rect, DVec2::ONE)[0], 7.0);
    }

    #[test]
    fn zones_follow_the_angle_from_the_gaze() {
        let gaze = DVec3::NEG_Z;
        let at = |degrees: f64| {
            let pixel = eye().project(DVec3::new(degrees.to_radians().tan(), 0.0, -1.0)).unwrap();
            zone(&eye(), gaze, 10 * 40 + pixel.x as usize)
        };
        assert_eq!([at(2.0), at(15.0), at(40.0)], [0, 1, 2]);
    }

    #[test]
    fn costs_are_adjusted_in_proportion() {
        let zones = adjusted(&Means::Zones { rays: [32, 16, 8] }, 0.25);
        assert_eq!(zones, Means::Zones { rays: [8, 4, 2] });
        assert_eq!(adjusted(&zones, 1e-3), Means::Zones { rays: [1, 1, 1] });
        assert_eq!(adjusted(&Means::Coarse { scale: 0.5 }, 0.25), Means::Coarse { scale: 0.25 });
        assert_eq!(adjusted(&Means::Coarse { scale: 0.5 }, 100.0), Means::Coarse { scale: 1.0 });
    }

    #[test]
    fn the_focus_is_the_part_of_the_view_that_it_claims() {
        let fov = part(eye().fov, DVec2::new(0.25, 0.0));
        assert_eq!(fov, FieldOfView { left: -0.5, right: 0.5, up: 1.0, down: 0.0 });
    }
}
