//! How bright frames are shown: metered on what is seen, smooth over time, the same for both eyes.
//!
//! What is metered is luminance in nits (cd/m²), which glTF's units make of radiance: lights in lux and candela,
//! emission in nits. Exposure is in stops (EV): radiance times two to their power is what the tone mapper gets.

/// What the root mean square of what is metered is brought to, before tone mapping. The demo scene at noon is there
/// already.
const KEY: f64 = 0.25;
/// The part of all luminances, in the order of their size, beyond which they count as the last of it: lamps and the
/// sun's reflections may be of any brightness.
const CAPPED: f64 = 0.98;

/// Seconds in which half of a change is followed, when it gets brighter and when it gets darker. Eyes take longer
/// for the dark, too.
const HALF_LIVES: [f64; 2] = [0.1, 0.3];
/// Changes below this many stops are noise of the samples.
const NOISE: f64 = 0.02;

/// The exposure that shows these luminances well: their root mean square comes to a middle grey. What is bright
/// counts for more than what is dark, so that things in light are not white before a black sky. `None` where all is
/// black. Values that are not finite do not count.
pub fn stops_for(mut luminances: Vec<f32>) -> Option<f64> {
    luminances.retain(|l| l.is_finite() && *l >= 0.0);
    luminances.sort_unstable_by(f32::total_cmp);
    let most = f64::from(*luminances.get((CAPPED * luminances.len().saturating_sub(1) as f64) as usize)?);
    let squares: f64 = luminances.iter().map(|&l| (f64::from(l).min(most) / most).powi(2)).sum();
    let rms = (squares / luminances.len() as f64).sqrt() * most;
    (most > 0.0).then(|| (KEY / rms).log2())
}

/// The exposure of a sequence of frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposure {
    range: [f64; 2],
    shown: Option<f64>,
    locked: bool,
}

impl Exposure {
    /// Automatic exposure that stays within `range`, in stops.
    pub fn within(range: [f64; 2]) -> Self {
        Exposure { range, shown: None, locked: false }
    }

    /// The stops that the next frame is shown with; `None` before anything was metered.
    pub fn shown(&self) -> Option<f64> {
        self.shown
    }

    /// Takes what a frame should have been shown with ([`stops_for`]), `seconds` after the one before. The first
    /// is followed at once, later ones smoothly; a frame that is all black changes nothing.
    pub fn observe(&mut self, metered: Option<f64>, seconds: f64) {
        let Some(wanted) = metered.map(|stops| stops.clamp(self.range[0], self.range[1])) else { return };
        let Some(shown) = self.shown else { return self.shown = Some(wanted) };
        let change = wanted - shown;
        if self.locked || change.abs() < NOISE {
            return;
        }
        let half_life = HALF_LIVES[usize::from(change > 0.0)];
        self.shown = Some(wanted - change * (-seconds.max(0.0) / half_life).exp2());
    }

    /// Keeps the exposure as it is from now on, or lets it go on.
    pub fn lock(&mut self, locked: bool) {
        self.locked = locked;
    }

    /// Whether it is kept as it is.
    pub fn is_locked(&self) -> bool {
        self.locked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: f32) -> Vec<f32> {
        vec![value; 100]
    }

    #[test]
    fn an_even_picture_comes_to_middle_grey_at_any_scale() {
        for value in [1e-30f32, 1e-3, 0.25, 1.0, 4e4, 1e30] {
            let stops = stops_for(grey(value)).unwrap();
            assert!((f64::from(value) * stops.exp2() / KEY - 1.0).abs() < 1e-4, "{value}: {stops}");
        }
    }

    #[test]
    fn lamps_do_not_matter_and_black_skies_matter_little() {
        let plain = stops_for(grey(0.3)).unwrap();
        let mut lamp = grey(0.3);
        lamp[98..].fill(1e6);
        assert!((stops_for(lamp).unwrap() - plain).abs() < 1e-6);
        let mut night = grey(0.3);
        night[..50].fill(0.0);
        assert!((stops_for(night).unwrap() - plain - 0.5).abs() < 1e-6);
        // Nine tenths in the dark: what is lit is bright, and not white.
        let mut cellar = grey(0.0);
        cellar[90..].fill(0.3);
        let shown = 0.3 * stops_for(cellar).unwrap().exp2();
        assert!(shown > KEY && shown < 0.8, "{shown}");
    }

    #[test]
    fn nothing_to_meter_is_none_and_nonsense_does_not_count() {
        assert_eq!(stops_for(Vec::new()), None);
        assert_eq!(stops_for(grey(0.0)), None);
        assert_eq!(stops_for(grey(f32::NAN)), None);
        let mut some = grey(0.3);
        some.extend([f32::NAN, f32::INFINITY, -1.0]);
        assert_eq!(stops_for(some), stops_for(grey(0.3)));
        assert!(stops_for(vec![2.0]).is_some());
    }

    #[test]
    fn the_first_frame_is_followed_at_once_and_others_smoothly() {
        let mut exposure = Exposure::within([-10.0, 10.0]);
        assert_eq!(exposure.shown(), None);
        exposure.observe(None, 0.0);
        assert_eq!(exposure.shown(), None);
        exposure.observe(Some(-3.0), 0.0);
        assert_eq!(exposure.shown(), Some(-3.0));
        // Darker: half of the way after its half-life, in any number of frames.
        let follow = |mut exposure: Exposure, wanted: f64, seconds: f64, frames: u32| {
            (0..frames).for_each(|_| exposure.observe(Some(wanted), seconds / f64::from(frames)));
            exposure.shown().unwrap()
        };
        for frames in [1, 7, 90] {
            assert!((follow(exposure.clone(), 1.0, HALF_LIVES[1], frames) + 1.0).abs() < 1e-9);
            assert!((follow(exposure.clone(), -7.0, HALF_LIVES[0], frames) + 5.0).abs() < 1e-9);
        }
        assert_eq!(follow(exposure.clone(), -3.0 + 0.5 * NOISE, 1.0, 100), -3.0, "noise is not followed");
        exposure.observe(None, 1.0);
        assert_eq!(exposure.shown(), Some(-3.0));
    }

    #[test]
    fn limits_and_the_lock_hold() {
        let mut exposure = Exposure::within([-1.0, 2.0]);
        exposure.observe(Some(50.0), 0.0);
        assert_eq!(exposure.shown(), Some(2.0));
        exposure.lock(true);
        exposure.observe(Some(-50.0), 100.0);
        assert_eq!((exposure.shown(), exposure.is_locked()), (Some(2.0), true));
        exposure.lock(false);
        exposure.observe(Some(-50.0), 100.0);
        assert!((exposure.shown().unwrap() + 1.0).abs() < 1e-9);
    }
}
