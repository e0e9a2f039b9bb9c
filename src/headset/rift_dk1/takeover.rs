//! Whose orientation is rendered: the tracker's, its last one, or the simulated head's.
//!
//! Losing the tracker never stops a frame. The last orientation holds for [`HOLD`] seconds; then the
//! simulated head goes on from there; a tracker that is back is taken up again. No change of source makes
//! the picture jump: what the two differ by at the change fades away.

use glam::DQuat;

/// Seconds for which a lost tracker's last orientation holds.
pub const HOLD: f64 = 2.0;
/// Seconds in which a difference between two sources falls to 1/e.
const FADE: f64 = 0.15;

/// Where an orientation came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The tracker.
    Tracker,
    /// The tracker's last orientation, since it was lost.
    Held,
    /// The simulated head.
    Simulated,
}

/// Chooses the orientation of each frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Takeover {
    source: Source,
    /// What was rendered last, and when.
    last: DQuat,
    time: f64,
    /// When the tracker was lost.
    lost: f64,
    /// From the source's orientation to what is rendered.
    offset: DQuat,
    /// The simulated head when it took over, and what was rendered then.
    start: (DQuat, DQuat),
}

impl Default for Takeover {
    /// The simulated head, until there is a tracker.
    fn default() -> Self {
        let identity = DQuat::IDENTITY;
        Takeover {
            source: Source::Simulated,
            last: identity,
            time: f64::NEG_INFINITY,
            lost: 0.0,
            offset: identity,
            start: (identity, identity),
        }
    }
}

impl Takeover {
    /// The orientation to render, body to world, and its source. `time` in seconds never goes back; `tracker`
    /// is absent while there is none, or while it is not heard; `simulated` is always there.
    pub fn next(&mut self, time: f64, tracker: Option<DQuat>, simulated: DQuat) -> (DQuat, Source) {
        let first = self.time == f64::NEG_INFINITY;
        let step = if first { 0.0 } else { (time - self.time).max(0.0) };
        self.time = time;
        match (tracker, self.source) {
            (Some(orientation), Source::Tracker) => self.fade(orientation, step),
            (Some(orientation), _) => {
                self.source = Source::Tracker;
                // The first picture of all has nothing to fade from.
                self.offset = if first { DQuat::IDENTITY } else { self.last * orientation.conjugate() };
                self.fade(orientation, step);
            }
            (None, Source::Tracker) => (self.source, self.lost) = (Source::Held, time),
            (None, Source::Held) if time - self.lost < HOLD => {}
            (None, Source::Held) => {
                (self.source, self.start) = (Source::Simulated, (simulated, self.last));
            }
            (None, Source::Simulated) if first => self.last = simulated,
            (None, Source::Simulated) => self.last = self.onwards(simulated),
        }
        (self.last, self.source)
    }

    /// Renders an orientation with what is left of the difference to what was rendered before.
    fn fade(&mut self, orientation: DQuat, step: f64) {
        self.offset = DQuat::IDENTITY.slerp(self.offset, (-step / FADE).exp());
        self.last = (self.offset * orientation).normalize();
    }

    /// Where the simulated head would be if it had stood as what was rendered when it took over: it is turned
    /// on by as much as it has turned since then, heading about the vertical and pitch about the head's X.
    fn onwards(&self, simulated: DQuat) -> DQuat {
        let (then, rendered) = self.start;
        let heading = |q: DQuat| {
            let ahead = q * glam::DVec3::NEG_Z;
            DQuat::from_rotation_y((-ahead.x).atan2(-ahead.z))
        };
        let (old, new) = (heading(then), heading(simulated));
        let level = |q: DQuat, heading: DQuat| heading.conjugate() * q;
        let pitch = level(then, old).conjugate() * level(simulated, new);
        ((new * old.conjugate()) * rendered * pitch).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    const FRAME: f64 = 1.0 / 60.0;

    fn turn(degrees: f64) -> DQuat {
        DQuat::from_rotation_y(degrees.to_radians())
    }

    fn apart(a: DQuat, b: DQuat) -> f64 {
        a.angle_between(b).to_degrees()
    }

    #[test]
    fn a_lost_tracker_holds_then_the_simulated_head_goes_on_and_the_tracker_comes_back() {
        let mut takeover = Takeover::default();
        let mut previous = None;
        let mut sources = Vec::new();
        for frame in 0..600 {
            let time = f64::from(frame) * FRAME;
            let tracker = match time {
                t if t < 2.0 => Some(turn(20.0 * t)),
                t if t < 7.0 => None,
                t => Some(turn(-10.0 + t)),
            };
            let (orientation, source) = takeover.next(time, tracker, turn(10.0 * time));
            assert!(orientation.is_normalized());
            if let Some(previous) = previous {
                assert!(apart(orientation, previous) < 10.0, "frame {frame} jumps");
            }
            previous = Some(orientation);
            if sources.last() != Some(&source) {
                sources.push(source);
            }
            let truth = match time {
                t if t < 2.0 => Some(turn(20.0 * t)),
                t if t < 4.0 => Some(turn(40.0 - 20.0 * FRAME)),
                t if t > 8.5 => Some(turn(-10.0 + t)),
                _ => None,
            };
            assert!(truth.is_none_or(|truth| apart(orientation, truth) < 0.5), "frame {frame}");
        }
        assert_eq!(sources, [Source::Tracker, Source::Held, Source::Simulated, Source::Tracker]);
    }

    #[test]
    fn without_a_tracker_the_simulated_head_is_what_is_seen() {
        let mut takeover = Takeover::default();
        for frame in 0..100 {
            let simulated = turn(f64::from(frame)) * DQuat::from_rotation_x(0.002 * f64::from(frame));
            let (orientation, source) = takeover.next(f64::from(frame) * FRAME, None, simulated);
            assert!(apart(orientation, simulated) < 1e-5 && source == Source::Simulated);
        }
    }

    #[test]
    fn the_simulated_head_goes_on_from_where_the_tracker_was() {
        let mut takeover = Takeover::default();
        let tracked = turn(70.0) * DQuat::from_rotation_x(0.3);
        takeover.next(0.0, Some(tracked), turn(5.0));
        takeover.next(0.1, None, turn(5.0));
        takeover.next(3.0, None, turn(5.0));
        assert!(apart(takeover.next(3.1, None, turn(5.0)).0, tracked) < 1e-5);
        let later = takeover.next(3.2, None, turn(15.0) * DQuat::from_rotation_x(0.1)).0;
        assert!(apart(later, turn(80.0) * DQuat::from_rotation_x(0.4)) < 1e-5);
    }

    #[test]
    fn a_tracker_that_flickers_or_flips_is_followed() {
        let mut takeover = Takeover::default();
        for frame in 0..300 {
            let time = f64::from(frame) * FRAME;
            let tracker = (frame % 3 != 0).then(|| if frame % 2 == 0 { turn(9.0) } else { -turn(9.0) });
            let (orientation, source) = takeover.next(time, tracker, DQuat::from_rotation_y(FRAC_PI_2));
            assert!(orientation.is_finite());
            assert!(frame < 2 || source != Source::Simulated);
            assert!(frame < 100 || apart(orientation, turn(9.0)) < 0.1, "{frame}");
        }
    }

    #[test]
    fn clocks_that_stop_or_jump_do_no_harm() {
        let mut takeover = Takeover::default();
        for time in [0.0, 0.0, 1e9, -5.0, 1e9] {
            for tracker in [Some(turn(3.0)), None] {
                assert!(takeover.next(time, tracker, turn(1.0)).0.is_normalized());
            }
        }
    }
}
