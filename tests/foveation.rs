//! Patterns against the laws that they follow, and against what a viewer would notice.

use foveate::foveation::pattern::TILE;
use foveate::foveation::{Law, Pattern};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const LAWS: [&str; 5] = ["paper", "linear-mar", "log-polar", "uniform", "full"];

/// A view with another angle to each side, as headsets have.
fn view(width: u32, height: u32) -> View {
    let fov = FieldOfView { left: -1.6, right: 1.2, up: 0.95, down: -0.8 };
    View { world_from_eye: Pose::IDENTITY, fov, width, height, spacing: Default::default() }
}

fn law(name: &str) -> Law {
    name.parse().unwrap()
}

fn pixels(pattern: &Pattern) -> impl Iterator<Item = (u32, u32)> + '_ {
    pattern.samples.iter().map(|s| (s & 0xffff, s >> 16))
}

fn centres(pattern: &Pattern) -> Vec<DVec2> {
    pixels(pattern).map(|(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).collect()
}

/// What holds of every pattern: samples in the image, no two in a pixel, each in its tile's range.
fn check_form(pattern: &Pattern) {
    let mut taken = vec![false; pattern.width as usize * pattern.height as usize];
    assert_eq!(pattern.tiles.len(), (pattern.tiles_x() * pattern.tiles_y()) as usize);
    let mut covered = 0;
    for (index, &[start, count]) in (0..).zip(&pattern.tiles) {
        let tile = (index % pattern.tiles_x(), index / pattern.tiles_x());
        for sample in &pattern.samples[start as usize..(start + count) as usize] {
            let (x, y) = (sample & 0xffff, sample >> 16);
            assert!(x < pattern.width && y < pattern.height);
            assert_eq!((x / TILE, y / TILE), tile);
            let pixel = &mut taken[y as usize * pattern.width as usize + x as usize];
            assert!(!*pixel, "two samples in pixel ({x}, {y})");
            *pixel = true;
        }
        covered += count as usize;
    }
    assert_eq!(covered, pattern.samples.len());
}

#[test]
fn there_are_exactly_as_many_samples_as_asked_for() {
    let gazes = [
        DVec2::splat(0.5),
        DVec2::ZERO,
        DVec2::ONE,
        DVec2::new(0.3, 0.9),
        DVec2::new(-3.0, 1.5),
        DVec2::new(1e300, f64::NEG_INFINITY),
        DVec2::NAN,
    ];
    for (width, height) in [(1, 1), (2, 1), (17, 16), (160, 100), (1, 8192), (8192, 1), (257, 300)] {
        let view = view(width, height);
        for count in [0, 1, 2, 55, 1000, view.pixels() - 1, view.pixels(), view.pixels() + 1, usize::MAX] {
            for name in LAWS {
                for gaze in gazes {
                    let pattern = Pattern::new(&view, &law(name), gaze, count);
                    let expected = if name == "full" { view.pixels() } else { count.clamp(1, view.pixels()) };
                    assert_eq!(pattern.samples.len(), expected, "{name} {width}x{height} {gaze} {count}");
                    check_form(&pattern);
                }
            }
        }
    }
}

#[test]
fn a_very_large_view_works() {
    for (name, count) in [("paper", 1_000_003), ("linear-mar", 1)] {
        let pattern = Pattern::new(&view(8192, 4096), &law(name), DVec2::new(1.0, 0.0), count);
        assert_eq!(pattern.samples.len(), count);
        check_form(&pattern);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_request_is_met(
        width in 1u32..300, height in 1u32..300, count in 0usize..100_000,
        x in -2.0..3.0f64, y in -2.0..3.0f64, exponent in -4.0..=0.0f64, centre_area in 0.0..=1.0f64,
    ) {
        let view = view(width, height);
        let pattern = Pattern::new(&view, &Law::Paper { exponent, centre_area }, DVec2::new(x, y), count);
        prop_assert_eq!(pattern.samples.len(), count.clamp(1, view.pixels()));
        check_form(&pattern);
    }
}

#[test]
fn patterns_are_the_same_each_time() {
    let make = || Pattern::new(&view(640, 400), &Law::default(), DVec2::new(0.2, 0.6), 14_000);
    assert_eq!(make(), make());
}

/// Chance of a sample at each pixel: density times a factor, at most 1, with `count` as the sum.
fn chances(view: &View, count: usize, density: impl Fn(DVec2) -> f64) -> Vec<f64> {
    let centre = |i: u32| DVec2::new(f64::from(i % view.width) + 0.5, f64::from(i / view.width) + 0.5);
    let densities: Vec<f64> = (0..view.pixels() as u32).map(|i| density(centre(i))).collect();
    let greatest = densities.iter().fold(0.0f64, |a, &b| a.max(b));
    let densities: Vec<f64> = densities.iter().map(|d| d / greatest).collect();
    let sum = |factor: f64| densities.iter().map(|d| (d * factor).min(1.0)).sum::<f64>();
    let (mut low, mut high) = (0.0, 1e9);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if sum(middle) < count as f64 { low = middle } else { high = middle }
    }
    densities.iter().map(|d| (d * low).min(1.0)).collect()
}

/// Chi-square per critical value at a level of 0.1 %, over 24 annuli of 8 sectors around a point: above 1
/// the samples do not follow the chances.
fn misfit(view: &View, samples: &[DVec2], around: DVec2, chances: &[f64]) -> f64 {
    let radius = DVec2::new(f64::from(view.width), f64::from(view.height)).length() * 0.6;
    let cell = |p: DVec2| {
        let offset = p - around;
        let annulus = (offset.length() / radius * 24.0).min(23.0) as usize;
        let turn = offset.y.atan2(offset.x) / std::f64::consts::TAU + 0.5;
        annulus * 8 + (turn * 8.0).min(7.0) as usize
    };
    let (mut expected, mut observed) = (vec![0.0; 192], vec![0.0; 192]);
    for (i, chance) in (0u32..).zip(chances) {
        expected[cell(DVec2::new(f64::from(i % view.width) + 0.5, f64::from(i / view.width) + 0.5))] +=
            chance;
    }
    samples.iter().for_each(|&p| observed[cell(p)] += 1.0);
    // Cells with few expected samples are counted together, as the approximation demands.
    let (mut sum, mut cells, mut rest) = (0.0, 0.0f64, (0.0, 0.0));
    let mut add = |e: f64, o: f64| {
        sum += (o - e) * (o - e) / e;
        cells += 1.0;
    };
    for (e, o) in expected.into_iter().zip(observed) {
        if e >= 10.0 { add(e, o) } else { rest = (rest.0 + e, rest.1 + o) }
    }
    if rest.0 > 0.0 {
        add(rest.0, rest.1);
    }
    let freedom = cells - 1.0;
    // Wilson and Hilferty 1931; 3.0902 is the normal quantile of 0.999.
    let spread = 2.0 / (9.0 * freedom);
    sum / (freedom * (1.0 - spread + 3.0902 * spread.sqrt()).powi(3))
}

/// What [`misfit`] must stay below for a pattern: samples that are spread evenly follow their law more
/// closely than chance would let them, so much less than the critical value is asked.
const EVEN: f64 = 0.15;

/// The laws once more, written from their sources and not from the program.
fn paper(view: &View, gaze: DVec2, exponent: f64) -> impl Fn(DVec2) -> f64 {
    let centre = (f64::from(view.width) * f64::from(view.height) / 15.0 / std::f64::consts::PI).sqrt();
    move |p| p.distance(gaze).max(centre).powf(exponent)
}

fn linear_mar(view: View, gaze: DVec2) -> impl Fn(DVec2) -> f64 {
    move |p| {
        let to = |x, y| view.eye_direction(p + DVec2::new(x, y)).normalize();
        let (a, b, c, d) = (to(-0.5, -0.5), to(0.5, -0.5), to(0.5, 0.5), to(-0.5, 0.5));
        let triangle = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a).length() * 0.5;
        let solid_angle = triangle(a, b, c) + triangle(a, c, d);
        let eccentricity = to(0.0, 0.0).angle_between(view.eye_direction(gaze)).to_degrees();
        solid_angle / (1.0 / 48.0 + 0.022 * eccentricity).powi(2)
    }
}

fn log_polar(gaze: DVec2) -> impl Fn(DVec2) -> f64 {
    // Columns of the log-polar buffer per pixel of radius times rows per pixel along the circle, by
    // finite differences of the mapping u = (ln r)^(1/4).
    move |p| {
        let r = p.distance(gaze).max(2.0);
        let u = |r: f64| r.ln().powf(0.25);
        (u(r + 1e-4) - u(r - 1e-4)) / r
    }
}

#[test]
fn samples_follow_the_laws() {
    let view = view(1280, 800);
    for gaze in [DVec2::splat(0.5), DVec2::new(0.1, 0.95), DVec2::new(1.3, 0.4)] {
        let at = gaze * DVec2::new(1280.0, 800.0);
        for (name, count) in [
            ("paper", 55_000),
            ("paper", 400_000),
            ("linear-mar", 55_000),
            ("log-polar", 20_000),
            ("uniform", 9_000),
        ] {
            let expected = match name {
                "paper" => chances(&view, count, paper(&view, at, -2.0 / 3.0)),
                "linear-mar" => chances(&view, count, linear_mar(view, at)),
                "log-polar" => chances(&view, count, log_polar(at)),
                _ => chances(&view, count, |_| 1.0),
            };
            let samples = centres(&Pattern::new(&view, &law(name), gaze, count));
            let misfit = misfit(&view, &samples, at, &expected);
            assert!(misfit < EVEN, "{name} {count} at {gaze}: {misfit}");
        }
    }
}

#[test]
fn the_test_of_laws_rejects_wrong_ones_and_passes_chance() {
    let view = view(1280, 800);
    let gaze = DVec2::new(640.0, 400.0);
    let right = chances(&view, 55_000, paper(&view, gaze, -2.0 / 3.0));
    let samples = centres(&Pattern::new(&view, &Law::default(), DVec2::splat(0.5), 55_000));
    for (limit, exponents) in [(1.0, [0.0, -0.4, -1.0, -5.0 / 3.0]), (EVEN, [-0.55, -0.6, -0.75, -0.8])] {
        for exponent in exponents {
            let wrong = chances(&view, 55_000, paper(&view, gaze, exponent));
            let misfit = misfit(&view, &samples, gaze, &wrong);
            assert!(misfit > limit, "exponent {exponent} is taken for -2/3: {misfit}");
        }
    }
    let aside = gaze + DVec2::new(25.0, 0.0);
    let wrong = chances(&view, 55_000, paper(&view, aside, -2.0 / 3.0));
    let shifted = misfit(&view, &samples, gaze, &wrong);
    assert!(shifted > EVEN, "a gaze 25 pixels aside goes unnoticed: {shifted}");
    // Independent samples of the right law pass: the level is not met by being deaf.
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let drawn = (0u32..).zip(&right).filter(|(_, chance)| random() < **chance);
    let drawn: Vec<DVec2> =
        drawn.map(|(i, _)| DVec2::new(f64::from(i % 1280) + 0.5, f64::from(i / 1280) + 0.5)).collect();
    let value = misfit(&view, &drawn, gaze, &right);
    assert!((0.4..1.0).contains(&value), "{value}");
}

/// Distance from each sample to its nearest neighbour over that in a hexagonal lattice of the local
/// density; samples within a few spacings of the image's edge are left out.
fn relative_spacings(view: &View, samples: &[DVec2], chances: &[f64]) -> Vec<f64> {
    let width = view.width as usize;
    let mut taken = vec![false; view.pixels()];
    samples.iter().for_each(|p| taken[p.y as usize * width + p.x as usize] = true);
    let mut spacings = vec![];
    for p in samples {
        let (x, y) = (p.x as i32, p.y as i32);
        let hexagonal = (2.0 / (3.0f64.sqrt() * chances[y as usize * width + x as usize])).sqrt();
        let reach = (hexagonal * 2.0).ceil() as i32;
        if x < reach || y < reach || x + reach >= view.width as i32 || y + reach >= view.height as i32 {
            continue;
        }
        let mut nearest = f64::from(reach * reach);
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                if (dx, dy) != (0, 0) && taken[(y + dy) as usize * width + (x + dx) as usize] {
                    nearest = nearest.min(f64::from(dx * dx + dy * dy));
                }
            }
        }
        spacings.push(nearest.sqrt() / hexagonal);
    }
    spacings.sort_by(f64::total_cmp);
    spacings
}

#[test]
fn samples_do_not_clump() {
    let view = view(1280, 800);
    for (gaze, count) in
        [(DVec2::splat(0.5), 55_000), (DVec2::new(0.02, 0.03), 55_000), (DVec2::splat(0.5), 8_000)]
    {
        let chances = chances(&view, count, paper(&view, gaze * DVec2::new(1280.0, 800.0), -2.0 / 3.0));
        let samples = centres(&Pattern::new(&view, &Law::default(), gaze, count));
        let spacings = relative_spacings(&view, &samples, &chances);
        let (least, low) = (spacings[0], spacings[spacings.len() / 100]);
        let (middle, high) = (spacings[spacings.len() / 2], spacings[spacings.len() * 99 / 100]);
        // Independent samples have 0.05 at the first percentile and 0.44 in the middle.
        assert!(least > 0.4 && low > 0.52 && middle > 0.72 && high < 1.1, "{least} {low} {middle} {high}");
    }
}

#[test]
fn neither_rings_nor_the_border_of_the_centre_are_seen() {
    let view = view(1280, 800);
    let gaze = DVec2::new(640.0, 400.0);
    let expected = chances(&view, 55_000, paper(&view, gaze, -2.0 / 3.0));
    let samples = centres(&Pattern::new(&view, &Law::default(), DVec2::splat(0.5), 55_000));
    // Annuli of 10 pixels across the border at 147: a ring or a seam would show as samples too many in
    // one and too few in the next.
    let annulus = |p: DVec2| (p.distance(gaze) / 10.0) as usize;
    let (mut wanted, mut found) = ([0.0; 128], [0.0; 128]);
    for (i, chance) in (0u32..).zip(&expected) {
        wanted[annulus(DVec2::new(f64::from(i % 1280) + 0.5, f64::from(i / 1280) + 0.5)).min(127)] += chance;
    }
    samples.iter().for_each(|&p| found[annulus(p).min(127)] += 1.0f64);
    for ring in 2..39 {
        // Chance alone would allow three times the root of the number.
        let error: f64 = found[ring] - wanted[ring];
        assert!(error.abs() < wanted[ring].sqrt(), "ring {ring}: {} for {}", found[ring], wanted[ring]);
    }
    // All directions alike: 16 sectors of the largest circle within the image.
    let mut sectors = [0.0f64; 16];
    for p in samples.iter().filter(|p| p.distance(gaze) < 400.0) {
        let turn = (p.y - gaze.y).atan2(p.x - gaze.x) / std::f64::consts::TAU + 0.5;
        sectors[(turn * 16.0).min(15.0) as usize] += 1.0;
    }
    let mean = sectors.iter().sum::<f64>() / 16.0;
    for count in sectors {
        assert!((count / mean - 1.0).abs() < 0.02, "{count} in a sector, {mean} on average");
    }
}

/// Share of the samples of `a` that `b` has too.
fn kept(a: &Pattern, b: &Pattern) -> f64 {
    let there: std::collections::HashSet<u32> = b.samples.iter().copied().collect();
    a.samples.iter().filter(|s| there.contains(s)).count() as f64 / a.samples.len() as f64
}

#[test]
fn a_moving_gaze_leaves_most_samples_in_place() {
    let view = view(1280, 800);
    let at = |x: f64| Pattern::new(&view, &Law::default(), DVec2::new(x, 0.5), 55_000);
    let (near, far) = (kept(&at(0.5), &at(0.51)), kept(&at(0.5), &at(0.9)));
    assert!(near > 0.97 && far > 0.7, "{near} {far}");
}

#[test]
fn neighbours_in_the_list_are_neighbours_in_the_image() {
    let pattern = Pattern::new(&view(1280, 800), &Law::default(), DVec2::splat(0.5), 55_000);
    let extent = |stream: &[DVec2]| {
        let low = stream.iter().fold(DVec2::MAX, |a, &b| a.min(b));
        let high = stream.iter().fold(DVec2::MIN, |a, &b| a.max(b));
        (high - low).max_element()
    };
    let samples = centres(&pattern);
    let mean = samples.chunks_exact(32).map(extent).sum::<f64>() / (samples.len() / 32) as f64;
    // 32 samples at this density fill a square of 24 pixels.
    assert!(mean < 60.0, "streams of 32 samples are {mean} pixels wide on average");
}
