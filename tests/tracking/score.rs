//! Errors against the truth.

use crate::rivals::{LibOvr, OpenHmd};
use foveate::headset::rift_dk1::fusion::Fusion;
use foveate::headset::rift_dk1::simulate::{Frame, HeadMotion, Unit};
use glam::{DQuat, DVec3};
use std::fmt;

/// Seconds ahead at which predictions are scored.
pub const AHEAD: [f64; 4] = [0.02, 0.04, 0.06, 0.1];

/// One report in so many is scored.
const EVERY: usize = 5;
/// Drift is counted from the mean yaw of so many scores: about five seconds.
const START_SAMPLES: u32 = 500;
/// Drift as distinct from errors that come and go with the pose is the mean of so many: ten seconds.
const DRIFT_SAMPLES: u32 = 1000;

/// Angles in degrees.
#[derive(Clone, Copy, Debug, Default)]
pub struct Series {
    squares: f64,
    count: f64,
    max: f64,
}

impl Series {
    pub fn add(&mut self, degrees: f64) {
        assert!(degrees.is_finite());
        self.squares += degrees * degrees;
        self.count += 1.0;
        self.max = self.max.max(degrees.abs());
    }

    pub fn rms(&self) -> f64 {
        assert!(self.count > 0.0, "nothing was scored");
        (self.squares / self.count).sqrt()
    }

    pub fn max(&self) -> f64 {
        assert!(self.count > 0.0, "nothing was scored");
        self.max
    }
}

/// One filter's errors, all seeds together.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    pub tilt: Series,
    pub after_motion: Series,
    /// Yaw's drift at each moment.
    pub yaw: Series,
    /// The means of yaw's drift over [`DRIFT_SAMPLES`].
    pub drift: Series,
    pub predicted: [Series; 4],
    /// Sum and number of the yaws that the drift is counted from.
    start: (f64, u32),
    /// The same of the drifts that the next mean is taken of.
    recent: (f64, u32),
}

/// The angle between where gravity is and where it is thought to be, degrees.
pub fn tilt(estimate: DQuat, truth: DQuat) -> f64 {
    (estimate.conjugate() * DVec3::Y).angle_between(truth.conjugate() * DVec3::Y).to_degrees()
}

/// The error's rotation about the vertical, degrees.
pub fn yaw(estimate: DQuat, truth: DQuat) -> f64 {
    let error = estimate * truth.conjugate();
    let degrees = 2.0 * error.y.atan2(error.w).to_degrees();
    degrees - 360.0 * (degrees / 360.0).round()
}

impl Errors {
    pub fn begin(&mut self) {
        (self.start, self.recent) = ((0.0, 0), (0.0, 0));
    }

    pub fn score(&mut self, estimate: DQuat, truth: DQuat, after_motion: bool) {
        let tilt = tilt(estimate, truth);
        self.tilt.add(tilt);
        if after_motion {
            self.after_motion.add(tilt);
        }
        let yaw = yaw(estimate, truth);
        if self.start.1 < START_SAMPLES {
            self.start = (self.start.0 + yaw, self.start.1 + 1);
            return;
        }
        let drift = yaw - self.start.0 / f64::from(START_SAMPLES);
        let drift = drift - 360.0 * (drift / 360.0).round();
        self.yaw.add(drift);
        self.recent = (self.recent.0 + drift, self.recent.1 + 1);
        if self.recent.1 == DRIFT_SAMPLES {
            self.drift.add(self.recent.0 / f64::from(DRIFT_SAMPLES));
            self.recent = (0.0, 0);
        }
    }

    fn score_prediction(&mut self, which: usize, predicted: DQuat, truth: DQuat) {
        self.predicted[which].add(predicted.angle_between(truth).to_degrees());
    }
}

/// Knows when the head has just come to rest after a turn.
#[derive(Default)]
struct AfterMotion {
    moved: f64,
    last: Option<(f64, DQuat)>,
}

impl AfterMotion {
    fn look(&mut self, frame: &Frame) -> bool {
        let Some((time, truth)) = self.last.replace((frame.time, frame.truth)) else { return false };
        let rate = truth.angle_between(frame.truth).to_degrees() / (frame.time - time);
        if rate > 60.0 {
            self.moved = frame.time;
        }
        rate < 10.0 && frame.time - self.moved < 0.5
    }
}

/// The three filters' errors.
#[derive(Default)]
pub struct Contest {
    pub ours: Errors,
    pub libovr: Errors,
    pub openhmd: Errors,
}

/// What a wearer's calibration ritual gives LibOVR: the centre of the sphere through four samples.
pub fn ritual(unit: &Unit) -> DVec3 {
    let field = DVec3::new(0.0, -0.453, -0.211);
    let turns = [
        DQuat::IDENTITY,
        DQuat::from_rotation_y(2.1),
        DQuat::from_rotation_x(1.6),
        DQuat::from_rotation_z(1.6),
    ];
    let [a, b, c, d] = turns.map(|turn| unit.soft_iron * (turn.conjugate() * field) + unit.hard_iron);
    let rows = glam::DMat3::from_cols(b - a, c - a, d - a).transpose() * 2.0;
    let square = |p: DVec3| p.length_squared() - a.length_squared();
    rows.inverse() * DVec3::new(square(b), square(c), square(d))
}

impl Contest {
    pub fn run(
        &mut self,
        hard_iron: Option<DVec3>,
        motion: &HeadMotion,
        frames: impl Iterator<Item = Frame>,
        scored_from: f64,
    ) {
        let (mut ours, mut openhmd) = (Fusion::new(), OpenHmd::default());
        let mut libovr = LibOvr::new(hard_iron);
        let mut after_motion = AfterMotion::default();
        for errors in [&mut self.ours, &mut self.libovr, &mut self.openhmd] {
            errors.begin();
        }
        for (index, frame) in frames.enumerate() {
            ours.update(&frame.report, None);
            libovr.report(&frame.report);
            openhmd.report(&frame.report);
            let after = after_motion.look(&frame);
            if frame.time < scored_from || index % EVERY != 0 {
                continue;
            }
            self.ours.score(ours.orientation(), frame.truth, after);
            self.libovr.score(libovr.orientation, frame.truth, after);
            self.openhmd.score(openhmd.orientation, frame.truth, after);
            for (which, seconds) in AHEAD.into_iter().enumerate() {
                let truth = frame.truth.conjugate() * motion.pose(frame.time + seconds).rotation;
                let ahead = ours.orientation().conjugate() * ours.predicted(seconds);
                self.ours.score_prediction(which, ahead, truth);
                self.libovr.score_prediction(which, libovr.ahead(seconds), truth);
                self.openhmd.score_prediction(which, DQuat::IDENTITY, truth);
            }
        }
    }

    pub fn filters(&self) -> [&Errors; 3] {
        [&self.ours, &self.libovr, &self.openhmd]
    }
}

/// A line of the table: ours, LibOVR 0.2.3, OpenHMD.
pub struct Row {
    pub name: String,
    pub figures: [f64; 3],
    pub limit: Option<f64>,
}

impl Row {
    pub fn holds(&self) -> bool {
        let [ours, libovr, openhmd] = self.figures;
        ours < libovr && ours < openhmd && self.limit.is_none_or(|limit| ours < limit)
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [ours, libovr, openhmd] = self.figures;
        let limit = self.limit.map_or("-".to_string(), |limit| format!("{limit}"));
        write!(f, "| {} | {limit} | {ours:.3} | {libovr:.3} | {openhmd:.3} |", self.name)
    }
}
