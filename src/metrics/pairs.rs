//! Errors of two pictures that belong together: frames that follow each other, and a pair of eyes.

use glam::DVec2;

use super::Display;
use crate::math::view::View;

/// How much the error changes from one frame to the next: the root of the mean squared change of
/// `test - reference` over pixels and channels, in sRGB codes of 0..1. What moves in both, picture and
/// reference, does not count; noise that is new each frame counts with the square root of 2, and errors
/// that stay where they are do not.
///
/// # Panics
/// If sizes differ.
pub fn flicker(tests: [&Display; 2], references: [&Display; 2]) -> f64 {
    let [first, second] = [error(tests[0], references[0]), error(tests[1], references[1])];
    assert_eq!(first.len(), second.len(), "frames of one size");
    root_mean_square(first.iter().zip(&second).map(|(a, b)| apart(*a, *b)))
}

/// What a pixel of the left eye's picture shows, and where the right eye sees the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// Index of the left eye's pixel.
    pub left: u32,
    /// Index of the right eye's pixel.
    pub right: u32,
}

/// The distances along pixels' rays (infinite where nothing is hit) agree within this share.
const SAME_DISTANCE: f64 = 0.01;

/// Pixels of both eyes that show one point: those of the left eye whose point falls on a pixel of the
/// right eye that sees it at the same distance. `distances` are those along each pixel's ray in metres,
/// rows from the top.
///
/// # Panics
/// If there are not as many distances as pixels.
pub fn matches(eyes: [&View; 2], distances: [&[f32]; 2]) -> Vec<Match> {
    let [left, right] = eyes;
    assert_eq!([left.pixels(), right.pixels()], distances.map(<[f32]>::len), "a distance for each pixel");
    let find = |index: usize| {
        let (x, y) = (index % left.width as usize, index / left.width as usize);
        let direction = left.eye_direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).normalize();
        let direction = left.world_from_eye.rotation * direction;
        let distance = f64::from(distances[0][index]);
        let apart = if distance.is_finite() {
            left.world_from_eye.position + direction * distance - right.world_from_eye.position
        } else {
            direction
        };
        let pixel = right.project(right.world_from_eye.rotation.conjugate() * apart)?;
        let inside = pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(right.width)
            && pixel.y < f64::from(right.height);
        let other = inside.then(|| pixel.y as usize * right.width as usize + pixel.x as usize)?;
        let seen = f64::from(distances[1][other]);
        let expected = if distance.is_finite() { apart.length() } else { f64::INFINITY };
        let same = seen == expected || (seen - expected).abs() <= SAME_DISTANCE * expected;
        same.then_some(Match { left: index as u32, right: other as u32 })
    };
    (0..left.pixels()).filter_map(find).collect()
}

/// How much both eyes' errors differ where they see the same: the root of the mean squared difference of
/// `test - reference` between matched pixels, in sRGB codes of 0..1; 0 without matches. Errors that both
/// eyes share do not count: they look like a part of the scene.
///
/// # Panics
/// If a match is outside a picture.
pub fn disagreement(tests: [&Display; 2], references: [&Display; 2], matches: &[Match]) -> f64 {
    let [left, right] = [error(tests[0], references[0]), error(tests[1], references[1])];
    root_mean_square(matches.iter().map(|m| apart(left[m.left as usize], right[m.right as usize])))
}

fn error(test: &Display, reference: &Display) -> Vec<[f32; 3]> {
    assert_eq!((test.width, test.height), (reference.width, reference.height), "pictures of one size");
    let pixels = test.pixels.iter().zip(&reference.pixels);
    pixels.map(|(a, b)| [a[0] - b[0], a[1] - b[1], a[2] - b[2]]).collect()
}

/// The mean squared difference of two pixels' channels.
fn apart(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 3.0
}

fn root_mean_square(squares: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = squares.fold((0.0, 0u64), |(sum, count), square| (sum + square, count + 1));
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;
    use glam::DVec3;

    fn picture(value: impl Fn(usize) -> f32) -> Display {
        Display { width: 16, height: 8, pixels: (0..128).map(|i| [value(i); 3]).collect() }
    }

    #[test]
    fn only_changing_errors_flicker() {
        let (first, second) = (picture(|i| i as f32 * 1e-3), picture(|i| i as f32 * 2e-3));
        let off = |p: &Display, by: f32| Display {
            pixels: p.pixels.iter().map(|c| c.map(|v| v + by)).collect(),
            ..p.clone()
        };
        let still = flicker([&off(&first, 0.1), &off(&second, 0.1)], [&first, &second]);
        assert!(still < 1e-6, "{still}");
        let changing = flicker([&off(&first, 0.1), &off(&second, 0.15)], [&first, &second]);
        assert!((changing - 0.05).abs() < 1e-6, "{changing}");
    }

    /// Two eyes 64 mm apart.
    fn eyes() -> [View; 2] {
        let fov = FieldOfView::symmetric(1.0, 2.0);
        [-0.032, 0.032].map(|x| View {
            world_from_eye: Pose { position: DVec3::X * x, ..Pose::IDENTITY },
            fov,
            width: 16,
            height: 8,
            spacing: Default::default(),
        })
    }

    #[test]
    fn eyes_match_where_they_see_the_same() {
        let [left, right] = &eyes();
        let nothing = vec![f32::INFINITY; 128];
        let far = matches([left, right], [&nothing, &nothing]);
        assert_eq!(far.len(), 128);
        assert!(far.iter().all(|m| m.left == m.right));
        // A wall ahead: its distance along each ray, and a shift to the left by a pixel in the right eye.
        let step = (left.fov.right - left.fov.left) / 16.0;
        let depth = 0.064 / step;
        let wall: Vec<f32> = (0..128)
            .map(|i| {
                let pixel = DVec2::new(f64::from(i % 16) + 0.5, f64::from(i / 16) + 0.5);
                (left.eye_direction(pixel).length() * depth) as f32
            })
            .collect();
        let near = matches([left, right], [&wall, &wall]);
        assert_eq!(near.len(), 120);
        assert!(near.iter().all(|m| m.left == m.right + 1));
        assert!(matches([left, right], [&wall, &nothing]).is_empty(), "hidden in the right eye");
    }

    #[test]
    fn only_errors_that_differ_disagree() {
        let grey = picture(|_| 0.5);
        let matched = [Match { left: 5, right: 4 }];
        let wrong = |at: usize| picture(move |i| if i == at { 0.6 } else { 0.5 });
        let shared = disagreement([&wrong(5), &wrong(4)], [&grey, &grey], &matched);
        assert!(shared < 1e-6);
        let apart = disagreement([&wrong(5), &wrong(5)], [&grey, &grey], &matched);
        assert!((apart - 0.1).abs() < 1e-6);
        assert_eq!(disagreement([&grey, &grey], [&grey, &grey], &[]), 0.0);
    }
}
