//! What has just come into sight: pixels whose surface was hidden a moment ago, and how wrong they are. What is reused
//! there was found on something else: it shows as a ghost of what stood before.

use glam::DVec2;

use super::Display;
use super::temporal::{difference, soft};
use crate::math::view::View;

/// Ages of [`error_by_age`]: frames since a pixel was uncovered, 0 in the first one that shows it.
pub const AGES: usize = 4;

/// An age that is none: never uncovered, or it was not seen how.
const NEVER: u8 = u8::MAX;

/// Distances of one surface differ by no more than this share from one frame to the next.
const SAME_DISTANCE: f64 = 0.02;

/// Deviation in pixels of the blur before errors are looked at: a ghost is wider than a pixel, noise is not.
const BLUR: f64 = 1.0;

/// For each pixel of a view how many frames ago its surface came into sight from behind another. What comes in at the
/// view's edge was not hidden and has no age.
#[derive(Clone)]
pub struct Ages(Vec<u8>);

impl Ages {
    /// No pixel of so many was uncovered so far.
    pub fn new(pixels: usize) -> Ages {
        Ages(vec![NEVER; pixels])
    }

    /// Goes on by a frame. `distances` are those along each pixel's ray in metres (infinite where nothing is hit), rows
    /// from the top, in the order of time, as `views` are.
    ///
    /// # Panics
    /// If there are not as many distances as pixels.
    pub fn advance(&mut self, views: [&View; 2], distances: [&[f32]; 2]) {
        let [before, now] = views;
        assert_eq!([before.pixels(), now.pixels()], distances.map(<[f32]>::len), "a distance for each pixel");
        let age = |index: usize| match seen_before(before, now, distances, index) {
            Seen::Outside => NEVER,
            Seen::Hidden => 0,
            Seen::At(pixel) => self.0[pixel].saturating_add(1),
        };
        self.0 = (0..now.pixels()).map(age).collect();
    }

    /// Pixels of each age below [`AGES`].
    pub fn counts(&self) -> [usize; AGES] {
        std::array::from_fn(|age| self.0.iter().filter(|a| usize::from(**a) == age).count())
    }
}

/// Where the surface of a pixel was in the frame before.
enum Seen {
    At(usize),
    Hidden,
    Outside,
}

fn seen_before(before: &View, now: &View, distances: [&[f32]; 2], index: usize) -> Seen {
    let (x, y) = (index % now.width as usize, index / now.width as usize);
    let direction = now.eye_direction(DVec2::new(x as f64, y as f64) + 0.5).normalize();
    let direction = now.world_from_eye.rotation * direction;
    let distance = f64::from(distances[1][index]);
    let apart = match distance.is_finite() {
        true => now.world_from_eye.position + direction * distance - before.world_from_eye.position,
        false => direction,
    };
    let expected = if distance.is_finite() { apart.length() } else { f64::INFINITY };
    let Some(pixel) = before.project(before.world_from_eye.rotation.conjugate() * apart) else {
        return Seen::Outside;
    };
    let size = [i64::from(before.width), i64::from(before.height)];
    let at = [pixel.x.floor() as i64, pixel.y.floor() as i64];
    if (0..2).any(|axis| at[axis] < 0 || at[axis] >= size[axis]) {
        return Seen::Outside;
    }
    let same = |seen: f64| {
        seen == expected || (expected.is_finite() && (seen - expected).abs() <= SAME_DISTANCE * expected)
    };
    // A surface seen at a flat angle is at another distance a pixel further on, and its edge may be. The pixel itself
    // comes first.
    let around = [[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];
    let around = around.into_iter().map(|[dx, dy]| [at[0] + dx, at[1] + dy]);
    let mut inside = around
        .filter(|[x, y]| (0..size[0]).contains(x) && (0..size[1]).contains(y))
        .map(|[x, y]| (y * size[0] + x) as usize);
    inside.find(|pixel| same(f64::from(distances[0][*pixel]))).map_or(Seen::Hidden, Seen::At)
}

/// The error of the pixels of each age below [`AGES`], and of all that are older or were always in sight: the root of
/// the mean square over pixels and channels, in sRGB codes of 0..255, after a blur of a pixel. None where there is no
/// such pixel.
///
/// # Panics
/// If sizes differ.
pub fn error_by_age(test: &Display, reference: &Display, ages: &Ages) -> [Option<f64>; AGES + 1] {
    let error = soft(&difference(test, reference), test.width as usize, BLUR);
    assert_eq!(error.len(), ages.0.len(), "an age for each pixel");
    let (mut sums, mut counts) = ([0.0f64; AGES + 1], [0u64; AGES + 1]);
    for (error, age) in error.iter().zip(&ages.0) {
        let age = usize::from(*age).min(AGES);
        sums[age] += error.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / 3.0;
        counts[age] += 1;
    }
    std::array::from_fn(|age| (counts[age] > 0).then(|| 255.0 * (sums[age] / counts[age] as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;
    use glam::DVec3;

    const SIZE: u32 = 64;
    /// Metres to the post, and to the wall behind it.
    const NEAR: f64 = 1.0;
    const FAR: f64 = 4.0;

    /// An eye that has stepped aside by so many metres.
    fn eye(x: f64) -> View {
        View {
            world_from_eye: Pose { position: DVec3::X * x, ..Pose::IDENTITY },
            fov: FieldOfView::symmetric(1.0, 1.0),
            width: SIZE,
            height: SIZE,
            spacing: Default::default(),
        }
    }

    /// What that eye sees of a post from x = -0.1 to 0.1 before what is so far: whether it is the post, and how far.
    fn seen(view: &View, index: u32, behind: f64) -> (bool, f32) {
        let pixel = DVec2::new(f64::from(index % SIZE) + 0.5, f64::from(index / SIZE) + 0.5);
        let direction = view.eye_direction(pixel);
        let post = (view.world_from_eye.position.x + direction.x * NEAR).abs() <= 0.1;
        (post, (direction.length() * if post { NEAR } else { behind }) as f32)
    }

    fn distances(view: &View, behind: f64) -> Vec<f32> {
        (0..SIZE * SIZE).map(|i| seen(view, i, behind).1).collect()
    }

    #[test]
    fn what_is_behind_a_passed_post_is_uncovered_once_and_ages() {
        uncovered_behind(FAR);
        uncovered_behind(f64::INFINITY);
    }

    fn uncovered_behind(behind: f64) {
        let views: Vec<View> = (0..4).map(|i| eye(0.12 * f64::from(i))).collect();
        let mut ages = Ages::new(views[0].pixels());
        let mut last = Vec::new();
        for pair in views.windows(2) {
            let before = distances(&pair[0], behind);
            ages.advance([&pair[0], &pair[1]], [&before, &distances(&pair[1], behind)]);
            last = ages.0.clone();
        }
        // The post moves by 7 pixels, the wall by 1.8; a pixel more counts as seen, beside what was.
        let counts = ages.counts();
        for count in &counts[..3] {
            assert!((3..=7).contains(&(count / SIZE as usize)), "{counts:?}");
        }
        assert_eq!(counts[3], 0, "three steps");
        // Right of the post, where the eye has gone to; never on it, nor at the view's edge.
        let row = &last[..SIZE as usize];
        let posts: Vec<usize> =
            (0..SIZE).filter(|x| seen(&views[3], *x, behind).0).map(|x| x as usize).collect();
        let uncovered: Vec<usize> = (0..SIZE as usize).filter(|x| row[*x] < 3).collect();
        assert!(uncovered.iter().all(|x| !posts.contains(x)), "{row:?}");
        assert!(*uncovered.iter().max().unwrap() < SIZE as usize - 8, "{row:?}");
        assert!(uncovered.iter().all(|x| x > posts.last().unwrap()), "{row:?}");
        // Youngest beside the post.
        let next = &row[posts.last().unwrap() + 1..];
        assert!(next.iter().zip(&next[1..]).take(uncovered.len()).all(|(a, b)| a <= b), "{row:?}");
    }

    #[test]
    fn nothing_is_uncovered_by_turning() {
        let turned = View {
            world_from_eye: Pose { rotation: glam::DQuat::from_rotation_y(0.1), ..Pose::IDENTITY },
            ..eye(0.0)
        };
        let still = distances(&eye(0.0), FAR);
        // The same post, seen by the turned eye.
        let far = vec![f32::INFINITY; still.len()];
        let mut ages = Ages::new(still.len());
        ages.advance([&eye(0.0), &turned], [&far, &far]);
        assert_eq!(ages.counts(), [0; AGES]);
    }

    #[test]
    fn errors_belong_to_the_age_of_their_pixels() {
        let mut ages = Ages::new((SIZE * SIZE) as usize);
        for (index, age) in ages.0.iter_mut().enumerate() {
            *age = if index as u32 % SIZE < 32 { 1 } else { NEVER };
        }
        let picture = |left: f32| Display {
            width: SIZE,
            height: SIZE,
            pixels: (0..SIZE * SIZE).map(|i| [if i % SIZE < 32 { left } else { 0.5 }; 3]).collect(),
        };
        let [first, ghost, second, third, old] = error_by_age(&picture(0.6), &picture(0.5), &ages);
        assert_eq!([first, second, third], [None; 3]);
        assert!((ghost.unwrap() - 25.5).abs() < 1.5, "{ghost:?}");
        assert!(old.unwrap() < 4.0, "{old:?}");
    }
}
