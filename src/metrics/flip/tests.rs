//! Golden numbers come from NVIDIA's own implementation (flip-evaluator 1.7, LDR, no colour map) for the
//! same generated pictures.

use super::*;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;

fn picture(value: impl Fn(u32, u32, usize) -> f64) -> Display {
    let pixel = |i: u32| [0, 1, 2].map(|c| value(i % WIDTH, i / WIDTH, c).clamp(0.0, 1.0) as f32);
    Display { width: WIDTH, height: HEIGHT, pixels: (0..WIDTH * HEIGHT).map(pixel).collect() }
}

fn wave(x: u32, y: u32, c: usize) -> f64 {
    0.5 + 0.45 * (0.11 * (c as f64 + 1.0) * f64::from(x) + 0.07 * (3.0 - c as f64) * f64::from(y)).sin()
}

fn noise(x: u32, y: u32, c: usize) -> f64 {
    let mixed = (u64::from(x) * 73_856_093) ^ (u64::from(y) * 19_349_663) ^ (c as u64 * 83_492_791);
    (mixed % 1000) as f64 / 1000.0
}

fn board(x: u32, y: u32, c: usize) -> f64 {
    [1.0, 0.2, 0.1][c] * f64::from((x / 8 + y / 8) % 2)
}

/// Compares the mean and three pixels of the map at both resolutions.
fn assert_golden(test: &Display, reference: &Display, golden: [[f64; 4]; 2]) {
    for (pixels_per_degree, golden) in [DEFAULT_PIXELS_PER_DEGREE, 12.0].iter().zip(golden) {
        let map = error_map(test, reference, *pixels_per_degree);
        let at = |x: usize, y: usize| f64::from(map[y * WIDTH as usize + x]);
        let found = [mean(&map), at(50, 30), at(0, 0), at(95, 63)];
        for (found, golden) in found.iter().zip(golden) {
            assert!((found - golden).abs() < 1e-4, "{pixels_per_degree}: {found} is not {golden}");
        }
    }
}

#[test]
fn shifted_waves_are_as_far_apart_as_nvidia_finds() {
    assert_golden(
        &picture(|x, y, c| 0.9 * wave(x + 1, y, c)),
        &picture(wave),
        [[0.448_860_8, 0.727_301, 0.285_915, 0.270_373], [0.445_478_7, 0.792_101, 0.266_139, 0.056_925]],
    );
}

#[test]
fn noise_is_as_far_as_nvidia_finds() {
    let ramp = |x: u32| f64::from(x) / 95.0;
    assert_golden(
        &picture(|x, y, c| ramp(x) + 0.4 * (noise(x, y, c) - 0.5)),
        &picture(|x, _, _| ramp(x)),
        [[0.221_075_0, 0.160_072, 0.190_937, 0.235_538], [0.509_006_9, 0.708_346, 0.319_505, 0.398_748]],
    );
}

#[test]
fn moved_edges_are_as_far_as_nvidia_finds() {
    assert_golden(
        &picture(|x, y, c| board(x + 2, y, c)),
        &picture(board),
        [[0.457_442_9, 0.068_164, 0.061_466, 0.978_822], [0.321_095_9, 0.0, 0.0, 0.971_415]],
    );
}

#[test]
fn one_wrong_pixel_is_noticed_as_nvidia_does() {
    assert_golden(
        &picture(|x, y, c| if (x, y) == (50, 30) { 1.0 } else { wave(x, y, c) }),
        &picture(wave),
        [[0.001_040_7, 0.417_283, 0.0, 0.0], [0.000_418_4, 0.987_429, 0.0, 0.0]],
    );
}

#[test]
fn equal_pictures_do_not_differ_and_tiny_ones_are_handled() {
    let waves = picture(wave);
    assert!(error_map(&waves, &waves, 67.0).iter().all(|&error| error == 0.0));
    let dot = |value: f32| Display { width: 1, height: 1, pixels: vec![[value; 3]] };
    let map = error_map(&dot(1.0), &dot(0.0), 0.5);
    assert!(map.len() == 1 && map[0] > 0.5 && map[0] <= 1.0, "{map:?}");
}
