//! Radiance: means of many seeds of the kernels against means of the reference's own estimator.

use foveate::gpu::opencl::Device;
use foveate::math::view::View;
use foveate::metrics::stats::{level_of_each, z_test};
use foveate::reference::{self, Estimate, Random, Renderer};
use foveate::scene::{Environment, Scene};
use foveate::trace::Settings;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::bench::{Bench, PLAIN, on_every_device, spread, view};

/// The chance that any of a scene's comparisons raises a false alarm. Seeds are fixed: what passes on a
/// device passes there for ever.
const LEVEL: f64 = 1e-4;

/// What rounding may change, relative to the radiance: normals and vertex colours are packed.
const ROUNDING: f64 = 5e-4;

/// The mean over all pixels has at most this relative standard error, or the test is too weak.
const RESOLUTION: f64 = 0.012;

/// Seeds, and light rays of each sample and seed.
const SEEDS: u32 = 48;
const RAYS: u32 = 512;

/// What is compared, and how much work the reference spends on each of the 24 pixels.
pub struct Case {
    pub name: &'static str,
    pub scene: Scene,
    pub light: Environment,
    pub view: View,
    pub bounces: u32,
    pub paths: u32,
    /// Sums on a grid of this size instead of paths: direct light only, exact where it is fine enough.
    pub grid: Option<u32>,
}

impl Case {
    /// Seen from (0, 1.6, 3.5), direct light only.
    pub fn new(name: &'static str, scene: Scene, light: Environment) -> Self {
        let view = view(DVec3::new(0.13, 1.6, 3.5), DVec3::new(0.0, 0.4, 0.0), 45.0, (960, 640));
        Case { name, scene, light, view, bounces: 0, paths: 8000, grid: None }
    }
}

/// The same pixels by both.
pub struct Compared {
    name: &'static str,
    kernel: Vec<Estimate>,
    reference: Vec<Estimate>,
}

fn kernel_means(device: &Device, case: &Case, light: &Environment) -> Vec<Estimate> {
    let pattern = spread(&case.view, 6, 4);
    let mut bench = Bench::new(device, &case.scene, light);
    let pictures: Vec<_> = (0..SEEDS)
        .map(|seed| {
            let settings = Settings { rays: RAYS, bounces: case.bounces, seed, ..PLAIN };
            let picture = bench.trace(&case.view, &settings, &pattern);
            assert_eq!(picture.dropped, 0, "{}", case.name);
            picture.samples
        })
        .collect();
    let radiance = |i: usize| pictures.iter().map(move |p| DVec3::from(p[i].first.map(f64::from)));
    (0..pattern.samples.len()).map(|i| Estimate::of(radiance(i))).collect()
}

fn reference_means(case: &Case) -> Vec<Estimate> {
    let seed: u64 = case.name.bytes().fold(0, |sum, byte| sum.wrapping_mul(131) + u64::from(byte));
    let mut renderer = Renderer::new(&case.scene, &case.light);
    renderer.bounces = case.bounces;
    let mean = |(i, at): (usize, &u32)| {
        let pixel = DVec2::new(f64::from(at & 0xffff), f64::from(at >> 16)) + 0.5;
        let ray = reference::camera_ray(&case.scene, &case.view, pixel);
        match case.grid {
            None => renderer.radiance(&ray, case.paths, &mut Random::new(seed ^ i as u64)),
            Some(grid) => {
                let mean = renderer.direct_by_quadrature(&ray, grid);
                Estimate { mean, standard_error: DVec3::ZERO, samples: 1 }
            }
        }
    };
    spread(&case.view, 6, 4).samples.par_iter().enumerate().map(mean).collect()
}

impl Compared {
    fn of(device: &Device, case: &Case, light: &Environment) -> Self {
        let (kernel, reference) = (kernel_means(device, case, light), reference_means(case));
        Compared { name: case.name, kernel, reference }
    }

    /// Differences with their standard errors: of the mean of all pixels, then of each pixel.
    fn differences(&self) -> Vec<(DVec3, DVec3, DVec3)> {
        let pairs = self.kernel.iter().zip(&self.reference);
        let each: Vec<_> = pairs
            .map(|(k, r)| {
                let variance = k.standard_error.powf(2.0) + r.standard_error.powf(2.0);
                (k.mean - r.mean, variance, r.mean)
            })
            .collect();
        let n = each.len() as f64;
        let total = each.iter().fold((DVec3::ZERO, DVec3::ZERO, DVec3::ZERO), |sum, e| {
            (sum.0 + e.0 / n, sum.1 + e.1 / (n * n), sum.2 + e.2 / n)
        });
        let root = |e: (DVec3, DVec3, DVec3)| (e.0, e.1.map(f64::sqrt), e.2);
        std::iter::once(total).chain(each).map(root).collect()
    }

    /// The first difference that chance and rounding do not explain.
    fn disagreement(&self) -> Option<String> {
        let differences = self.differences();
        let level = level_of_each(LEVEL, 3 * differences.len());
        for (index, (difference, error, expected)) in differences.iter().enumerate() {
            for c in 0..3 {
                let beyond = (difference[c].abs() - ROUNDING * expected[c].abs()).max(0.0);
                if z_test(beyond, error[c]) < level {
                    let place = if index == 0 { "the mean".into() } else { format!("pixel {}", index - 1) };
                    let (off, of, error) = (difference[c], expected[c], error[c]);
                    return Some(format!(
                        "{}: {place}, channel {c}: off by {off:.3e} of {of:.3e}, error {error:.1e}",
                        self.name
                    ));
                }
            }
        }
        None
    }

    /// How well the mean is known, relative to it.
    fn resolution(&self) -> f64 {
        let (_, error, expected) = self.differences()[0];
        if expected.max_element() > 0.0 { error.max_element() / expected.max_element() } else { 0.0 }
    }

    fn print(&self) {
        let (difference, error, expected) = self.differences()[0];
        let relative = (difference / expected.max(DVec3::splat(1e-300)) * 100.0).to_array();
        let error = (error / expected.max(DVec3::splat(1e-300)) * 100.0).max_element();
        println!("{}: mean {:.4?}, kernel off by {relative:.3?} % (error {error:.3} %)", self.name, expected);
    }
}

/// Compares all cases and then fails if any disagree, so that one run tells of all.
pub fn assert_all_agree(cases: impl Fn() -> Vec<Case>) {
    on_every_device(|device| {
        let failed: Vec<String> = cases()
            .iter()
            .filter_map(|case| {
                let compared = Compared::of(device, case, &case.light);
                compared.print();
                let weak = (compared.resolution() >= RESOLUTION)
                    .then(|| format!("{}: an error of {} tells nothing", case.name, compared.resolution()));
                compared.disagreement().or(weak)
            })
            .collect();
        assert!(failed.is_empty(), "{}", failed.join("\n"));
    });
}

/// Guards the guard: light that is 5 % too bright for the kernels alone is noticed.
#[test]
fn wrong_light_is_noticed() {
    on_every_device(|device| {
        let case = crate::cases::floor_under_sky();
        let mut brighter = case.light.clone();
        brighter.texels.iter_mut().for_each(|texel| *texel *= 1.05);
        let compared = Compared::of(device, &case, &brighter);
        let alarm = compared.disagreement().expect("5 % is noticed");
        assert!(alarm.contains("the mean"), "{alarm}");
    });
}
