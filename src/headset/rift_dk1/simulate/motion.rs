//! How a head moves: turns between gaze targets with the minimum-jerk profile of human movement
//! (Flash and Hogan 1985), pauses, sway, leaning, and now and then something ruder.

use super::Random;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};

/// The tracker's place from the neck's pivot in metres, head frame.
const LEVER: DVec3 = DVec3::new(0.0, 0.10, -0.12);

/// A turn from one gaze target to the next.
#[derive(Clone, Copy, Debug)]
struct Turn {
    start: f64,
    length: f64,
    /// Yaw, pitch, roll in radians, before and after.
    angles: [DVec3; 2],
    /// Position of the neck's pivot in metres, before and after.
    base: [DVec3; 2],
}

/// Whole turns about the vertical, as on a swivel chair.
#[derive(Clone, Copy, Debug)]
pub struct Spin {
    /// Device seconds.
    pub start: f64,
    /// Seconds.
    pub length: f64,
    /// Turns to the left; negative to the right.
    pub turns: f64,
}

/// Seconds of a knock's rotation.
const JOLT: f64 = 0.06;
/// Seconds of a knock's acceleration.
const PULSE: f64 = 0.008;

/// A head's motion as a function of time.
#[derive(Clone, Debug, Default)]
pub struct HeadMotion {
    turns: Vec<Turn>,
    spins: Vec<Spin>,
    /// Start and peak acceleration in m/s^2, body frame.
    knocks: Vec<(f64, DVec3)>,
    /// 1 for a worn headset; 0 lies on a table.
    sway: f64,
    /// The greatest acceleration of a vehicle around the wearer, m/s^2.
    vehicle: f64,
    /// Seconds on the table before all of it begins.
    delay: f64,
}

impl HeadMotion {
    /// A headset that lies on a table.
    pub fn still() -> Self {
        HeadMotion::default()
    }

    /// A wearer who looks straight ahead, with the sway of a living head.
    pub fn attentive() -> Self {
        HeadMotion { sway: 1.0, ..HeadMotion::default() }
    }

    /// A seated wearer who looks around: turns of up to 75 degrees at up to some 200 deg/s, between
    /// them pauses of 0.2 to 3 s, leaning of up to 15 cm.
    pub fn everyday(seed: u64, seconds: f64) -> Self {
        Self::looking_around(seed, seconds, [0.2, 3.0], 0.22)
    }

    /// The same without rest: hardly a pause, and faster.
    pub fn restless(seed: u64, seconds: f64) -> Self {
        Self::looking_around(seed, seconds, [0.0, 0.3], 0.12)
    }

    fn looking_around(seed: u64, seconds: f64, pause: [f64; 2], least_length: f64) -> Self {
        let mut random = Random::new(seed ^ 0x4ead);
        let mut motion = HeadMotion::attentive();
        let (mut time, mut angles, mut base) = (3.0, DVec3::ZERO, DVec3::ZERO);
        let limits = DVec3::new(75.0, 30.0, 12.0) * 1_f64.to_radians();
        while time < seconds {
            let next = (random.vector() * limits * 0.5).clamp(-limits, limits);
            let next_base = (random.vector() * 0.05).clamp(DVec3::splat(-0.15), DVec3::splat(0.15));
            let amplitude = (next - angles).length().to_degrees();
            let length = least_length + amplitude / random.between(90.0, 180.0);
            motion.turns.push(Turn { start: time, length, angles: [angles, next], base: [base, next_base] });
            (angles, base) = (next, next_base);
            time += length + random.between(pause[0], pause[1]);
        }
        motion
    }

    /// The same in a vehicle that speeds up, brakes and sways with up to `acceleration` m/s^2.
    pub fn in_a_vehicle(self, acceleration: f64) -> Self {
        HeadMotion { vehicle: acceleration, ..self }
    }

    /// The same after `seconds` on a table.
    pub fn after_rest(self, seconds: f64) -> Self {
        HeadMotion { delay: seconds, ..self }
    }

    /// Adds spins.
    pub fn with_spins(mut self, spins: impl IntoIterator<Item = Spin>) -> Self {
        self.spins.extend(spins);
        self
    }

    /// Adds a knock of 30 to 80 m/s^2, from a random side, every `every` seconds or so.
    pub fn with_knocks(mut self, seed: u64, every: f64, seconds: f64) -> Self {
        let mut random = Random::new(seed ^ 0x0c);
        let mut time = every;
        while time < seconds {
            let direction = random.vector().normalize_or(DVec3::Z);
            self.knocks.push((time, direction * random.between(30.0, 80.0)));
            time += every * random.between(0.5, 1.5);
        }
        self
    }

    /// The head at a time: orientation, and the tracker's position.
    pub fn pose(&self, time: f64) -> Pose {
        let rests = self.delay > 0.0;
        let sway = if rests { self.sway * smooth(time - self.delay) } else { self.sway };
        let time = if rests { (time - self.delay).max(0.0) } else { time };
        let (mut angles, mut base) = self.turned(time);
        angles += sway * sway_angles(time);
        base += sway * sway_base(time);
        let spins = self.spins.iter().map(|spin| spin.turns * smooth((time - spin.start) / spin.length));
        angles.x += std::f64::consts::TAU * spins.sum::<f64>();
        for &(start, peak) in current(&self.knocks, time, JOLT) {
            let phase = std::f64::consts::TAU * (time - start) / JOLT;
            angles += peak.normalize() * 0.01 * (1.0 - phase.cos());
        }
        let rotation = DQuat::from_euler(EulerRot::YXZ, angles.x, angles.y, angles.z);
        Pose { rotation, position: base + rotation * LEVER + self.vehicle * vehicle(time) }
    }

    /// What a knock adds to the specific force, m/s^2, body frame.
    pub fn knock(&self, time: f64) -> DVec3 {
        let time = time - self.delay;
        let knocks = current(&self.knocks, time, PULSE).iter();
        knocks.map(|&(start, peak)| peak * (std::f64::consts::PI * (time - start) / PULSE).sin()).sum()
    }

    fn turned(&self, time: f64) -> (DVec3, DVec3) {
        let index = self.turns.partition_point(|turn| turn.start <= time);
        let Some(turn) = index.checked_sub(1).map(|last| &self.turns[last]) else {
            return (DVec3::ZERO, DVec3::ZERO);
        };
        let s = smooth((time - turn.start) / turn.length);
        (turn.angles[0].lerp(turn.angles[1], s), turn.base[0].lerp(turn.base[1], s))
    }
}

/// The knocks that have begun and, after `length` seconds, not yet ended.
fn current(knocks: &[(f64, DVec3)], time: f64, length: f64) -> &[(f64, DVec3)] {
    let first = knocks.partition_point(|knock| knock.0 + length < time);
    let end = knocks.partition_point(|knock| knock.0 <= time);
    &knocks[first.min(end)..end]
}

/// The minimum-jerk profile from 0 to 1.
fn smooth(phase: f64) -> f64 {
    let phase = phase.clamp(0.0, 1.0);
    phase * phase * phase * (10.0 + phase * (6.0 * phase - 15.0))
}

/// Yaw, pitch and roll of a head that means to be still, in radians.
fn sway_angles(time: f64) -> DVec3 {
    let wave = |hertz: f64, phase: f64| (std::f64::consts::TAU * hertz * time + phase).sin();
    let slow = DVec3::new(0.4 * wave(0.23, 0.3), 0.3 * wave(0.31, 1.1), 0.2 * wave(0.17, 2.0));
    let tremor = DVec3::new(0.02 * wave(4.7, 0.0), 0.03 * wave(5.3, 1.0), 0.02 * wave(6.1, 2.0));
    (slow + tremor) * 1_f64.to_radians()
}

/// Where a vehicle is whose acceleration is at most 1 m/s^2, in metres from its mean: speed along two axes and sway.
fn vehicle(time: f64) -> DVec3 {
    let wave = |hertz: f64, phase: f64, share: f64| {
        let rate = std::f64::consts::TAU * hertz;
        share * ((rate * time + phase).sin() - phase.sin()) / (rate * rate)
    };
    DVec3::new(wave(0.31, 0.4, 0.4), wave(0.9, 1.3, 0.2), wave(0.12, 0.0, 0.5) + wave(0.43, 2.1, 0.3))
}

/// The neck's pivot of a seated body, in metres.
fn sway_base(time: f64) -> DVec3 {
    let wave = |hertz: f64, phase: f64| (std::f64::consts::TAU * hertz * time + phase).sin();
    DVec3::new(0.008 * wave(0.19, 0.7), 0.003 * wave(0.25, 0.0), 0.010 * wave(0.13, 1.9))
}
