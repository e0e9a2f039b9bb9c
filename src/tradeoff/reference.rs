//! What pictures are compared with: many passes with a sample at each pixel, and how far they may be off.

use serde::{Deserialize, Serialize};

use super::store::Store;
use crate::config::{Config, Method, Samples, Stereo};
use crate::error::Result;
use crate::foveation::Law;
use crate::frame::{Plan, Renderer};
use crate::math::view::View;
use crate::metrics::metric::{Viewing, compare, psnr_up_to_white};
use crate::metrics::pairs::{Match, matches};
use crate::metrics::{Display, Picture};

/// How far a reference is expected to be from the truth that it would reach with endless passes, from
/// how far its two halves are apart: the mean of both has half of their difference's deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceError {
    /// Passes that were averaged.
    pub passes: u32,
    /// Light rays for each pixel, in all passes together.
    pub rays_per_pixel: u32,
    /// Expected PSNR of the reference in linear light up to white, in decibels; scores near it say nothing.
    pub psnr: f64,
    /// The same of what a screen shows.
    pub psnr_display: f64,
    /// Expected relative squared error.
    pub relmse: f64,
    /// FLIP between the halves: above what the reference adds to a picture's FLIP.
    pub flip_of_halves: f64,
}

/// A reference of both eyes, side by side.
pub struct Reference {
    pub picture: Picture,
    pub display: Display,
    pub error: ReferenceError,
}

/// How a reference is made.
pub struct Making<'a> {
    pub base: &'a Config,
    pub passes: u32,
    pub rays: u32,
    pub bounces: u32,
    pub viewing: Viewing,
}

/// A sample at each pixel, and nothing reconstructed or known before.
pub fn full(base: &Config, rays: u32, bounces: u32) -> Config {
    let mut config = base.clone().without_reuse();
    config.foveation.samples = Samples::Full;
    config.foveation.law = Law::Full;
    config.reconstruction.method = Method::KNearest;
    config.reconstruction.k = 1;
    config.trace.rays = rays;
    config.trace.bounces = bounces;
    if config.view.stereo != Stereo::Mono {
        config.view.stereo = Stereo::PerEye;
    }
    config
}

/// The reference of a plan: from the store, or rendered and stored. `tick` is called for each pass, with
/// whether it was made now.
pub fn obtain(
    renderer: &mut Renderer,
    plan: &Plan,
    making: &Making<'_>,
    store: &Store,
    name: &str,
    tick: &mut dyn FnMut(bool),
) -> Result<Reference> {
    let exposure = making.viewing.exposure;
    let with = |picture: Picture, error| {
        let display = Display::from_picture(&picture, exposure);
        Reference { picture, display, error }
    };
    if let Some(error) = store.read::<ReferenceError>(name)
        && let Ok(picture) = Picture::read_exr(&store.path(name, "exr"))
        && (picture.width, picture.height) == (plan.width, plan.height)
    {
        (0..making.passes).for_each(|_| tick(false));
        return Ok(with(picture, error));
    }
    let [first, second] = halves(renderer, plan, making, tick)?;
    let mean = |a: &[f32; 3], b: &[f32; 3]| [0, 1, 2].map(|c| 0.5 * (a[c] + b[c]));
    let pixels = first.pixels.iter().zip(&second.pixels).map(|(a, b)| mean(a, b)).collect();
    let picture = Picture::new(plan.width, plan.height, pixels)?;
    let apart = compare(&first, &second, making.viewing)?;
    // A quarter of the mean square is 6.02 dB.
    let quarter = 10.0 * 4f64.log10();
    let error = ReferenceError {
        passes: making.passes,
        rays_per_pixel: making.passes * making.rays,
        psnr: (psnr_up_to_white(&first, &second, exposure)? + quarter).min(200.0),
        psnr_display: (apart.psnr + quarter).min(200.0),
        relmse: apart.relmse / 4.0,
        flip_of_halves: apart.flip,
    };
    store.write_picture(name, &picture)?;
    store.write(name, &error)?;
    Ok(with(picture, error))
}

/// The means of the even and of the odd passes.
fn halves(
    renderer: &mut Renderer,
    plan: &Plan,
    making: &Making<'_>,
    tick: &mut dyn FnMut(bool),
) -> Result<[Picture; 2]> {
    renderer.apply(&full(making.base, making.rays, making.bounces))?;
    renderer.set_jitter(true);
    let pixels = plan.width as usize * plan.height as usize;
    let mut sums = [vec![[0.0f64; 3]; pixels], vec![[0.0f64; 3]; pixels]];
    for pass in 0..making.passes {
        // Far from the seeds of the frames that are judged.
        renderer.frame(plan, &[], 0x5eed_0000 + pass)?;
        let picture = taken(renderer, plan)?;
        for (sum, pixel) in sums[pass as usize % 2].iter_mut().zip(picture.pixels) {
            (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
        }
        tick(true);
    }
    renderer.set_jitter(false);
    let scale = 2.0 / f64::from(making.passes);
    let half = |sum: &[[f64; 3]]| {
        let pixels = sum.iter().map(|p| p.map(|c| (c * scale) as f32)).collect();
        Picture::new(plan.width, plan.height, pixels)
    };
    Ok([half(&sums[0])?, half(&sums[1])?])
}

/// The renderer's last picture.
pub fn taken(renderer: &Renderer, plan: &Plan) -> Result<Picture> {
    let bytes = renderer.picture()?;
    let floats: &[f32] = bytemuck::cast_slice(&bytes);
    Picture::new(plan.width, plan.height, floats.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect())
}

/// Pixels of both eyes that show the same point.
pub fn matched(renderer: &mut Renderer, eyes: &[View; 2], base: &Config) -> Result<Vec<Match>> {
    let [left, right] = [distances(renderer, &eyes[0], base)?, distances(renderer, &eyes[1], base)?];
    Ok(matches([&eyes[0], &eyes[1]], [&left, &right]))
}

/// The distance along each pixel's ray, infinite where nothing is hit.
pub fn distances(renderer: &mut Renderer, eye: &View, base: &Config) -> Result<Vec<f32>> {
    // Guided tracing leaves a hit for each pixel; how samples are shaded does not matter.
    let mut config = base.clone();
    config.reconstruction.method = Method::Guided;
    config.foveation.samples = Samples::Count(64);
    config.foveation.visibility_slope = 0.0;
    config.trace.rays = 1;
    renderer.apply(&config)?;
    renderer.frame(&Plan::mono(*eye), &[], 0)?;
    let depths = renderer.depths(0);
    let distance = |(pixel, depth): (usize, f32)| {
        let width = eye.width as usize;
        let at = glam::DVec2::new((pixel % width) as f64, (pixel / width) as f64) + 0.5;
        // Depths are along the view's axis, distances along the pixel's ray.
        if depth > 0.0 { depth * eye.eye_direction(at).length() as f32 } else { f32::INFINITY }
    };
    Ok(depths.into_iter().enumerate().map(distance).collect())
}
