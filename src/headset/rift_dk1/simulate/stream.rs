//! What the firmware makes of the samples, and what of it reaches the host.

use super::auto_zero::AutoZero;
use super::{GRAVITY, HeadMotion, Random, Surroundings, Unit};
use crate::headset::rift_dk1::report::{
    ACCEL_UNIT, GYRO_UNIT, MAG_UNIT, MAX_SAMPLE_COUNT, RawSample, SensorReport,
};
use glam::{DQuat, DVec3};

/// What goes wrong between tracker and host.
#[derive(Clone, Debug)]
pub struct Faults {
    /// Share of reports that are lost on the host.
    pub losses: f64,
    /// Share of reports before which the endpoint is busy for 3 to 40 ms: the firmware averages.
    pub averages: f64,
    /// Long stalls: device second and length in ms. Beyond 254 ms the firmware drops the mean.
    pub stalls: Vec<(f64, u32)>,
}

impl Faults {
    /// None at all.
    pub fn none() -> Self {
        Faults { losses: 0.0, averages: 0.0, stalls: Vec::new() }
    }

    /// A busy host: one report in 200 lost, one in 100 averaged.
    pub fn busy() -> Self {
        Faults { losses: 0.005, averages: 0.01, stalls: Vec::new() }
    }

    /// A [`Self::busy`] host with a stall of 400 ms every `every` seconds.
    pub fn stalling(every: f64, seconds: f64) -> Self {
        let count = (seconds / every) as u32;
        Faults { stalls: (1..=count).map(|k| (every * f64::from(k), 400)).collect(), ..Self::busy() }
    }
}

/// A report that arrived, with the truth.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// What the host read.
    pub report: SensorReport,
    /// Device seconds of the newest sample, since the stream began.
    pub time: f64,
    /// Host seconds of arrival: a clock that drifts by 40 ppm, 1 to 2 ms of latency.
    pub host: f64,
    /// The true orientation at `time`, body to world.
    pub truth: DQuat,
}

/// An endless stream of reports.
#[derive(Clone, Debug)]
pub struct Stream {
    unit: Unit,
    motion: HeadMotion,
    surroundings: Surroundings,
    faults: Faults,
    random: Random,
    /// Samples of a report when nothing is wrong.
    packet: u32,
    /// The device's counter at time zero.
    origin: u16,
    /// Milliseconds that one computed sample stands for within an average.
    coarseness: u32,
    /// The newest sample's time in ms.
    now: u64,
    bias_walk: DVec3,
    auto_zero: AutoZero,
    mag: [i16; 3],
    mag_due: f64,
    stalls_done: usize,
}

impl Stream {
    /// A stream of 500 reports a second, two samples each.
    pub fn new(
        seed: u64,
        unit: Unit,
        motion: HeadMotion,
        surroundings: Surroundings,
        faults: Faults,
    ) -> Self {
        Stream {
            unit,
            motion,
            surroundings,
            faults,
            random: Random::new(seed),
            packet: 2,
            origin: 0,
            coarseness: 1,
            now: 0,
            bias_walk: DVec3::ZERO,
            auto_zero: AutoZero::default(),
            mag: [0; 3],
            mag_due: 0.0,
            stalls_done: 0,
        }
    }

    /// The same with reports of `packet` samples; those of long reports are computed coarsely, eight
    /// a report, so that a day passes in seconds.
    pub fn coarse(self, packet: u8) -> Self {
        let packet = u32::from(packet.clamp(1, MAX_SAMPLE_COUNT));
        Stream { packet, coarseness: (packet.saturating_sub(2) / 8).max(1), ..self }
    }

    /// The same with the device's counter at `origin` when the stream begins.
    pub fn from_count(self, origin: u16) -> Self {
        Stream { origin, ..self }
    }

    /// The frames of the first `seconds`.
    pub fn seconds(self, seconds: f64) -> impl Iterator<Item = Frame> {
        self.take_while(move |frame| frame.time < seconds)
    }

    fn busy_for(&mut self) -> u32 {
        let time = self.now as f64 * 1e-3;
        if let Some(&(start, length)) = self.faults.stalls.get(self.stalls_done)
            && time >= start
        {
            self.stalls_done += 1;
            return length;
        }
        if self.random.chance(self.faults.averages) {
            return 3 + (self.random.bits() % 38) as u32;
        }
        self.packet
    }

    /// The report that the firmware sends after `pending` samples came due.
    fn firmware(&mut self, pending: u32) -> SensorReport {
        let limit = u32::from(MAX_SAMPLE_COUNT);
        let mut count = pending;
        let mut zeroed = false;
        while count > limit {
            count = count - limit + 2;
            zeroed = true;
        }
        let skipped = if zeroed { u64::from(pending - count) } else { 0 };
        let first = self.now + skipped;
        self.now = first;
        let mut report = SensorReport {
            sample_count: count as u8,
            timestamp: (first as u16).wrapping_add(self.origin),
            temperature: 3000,
            ..SensorReport::default()
        };
        let mean_of = if count > 3 { count - 2 } else { 1 };
        let lost = u32::from(zeroed);
        self.now += u64::from(lost);
        let (accel, gyro) = self.sum(mean_of - lost);
        let scale = 1.0 / f64::from(mean_of);
        report.samples[0] = raw(accel * scale, gyro * scale);
        for slot in 1..count.min(3) as usize {
            let (accel, gyro) = self.sum(1);
            report.samples[slot] = raw(accel, gyro);
        }
        report.mag = self.mag;
        report
    }

    /// The sums of the next `count` samples, and the time moved on.
    fn sum(&mut self, count: u32) -> (DVec3, DVec3) {
        let (mut accel, mut gyro) = (DVec3::ZERO, DVec3::ZERO);
        let mut left = count;
        while left > 0 {
            let step = left.min(self.coarseness);
            let sample = self.sample(step);
            accel += sample.0 * f64::from(step);
            gyro += sample.1 * f64::from(step);
            self.now += u64::from(step);
            left -= step;
        }
        (accel, gyro)
    }

    /// The mean measured specific force and angular velocity over `step` ms up to the sample at the
    /// end of them.
    fn sample(&mut self, step: u32) -> (DVec3, DVec3) {
        let length = f64::from(step) * 1e-3;
        let time = (self.now + u64::from(step) - 1) as f64 * 1e-3;
        let [before, middle, after] = [2.0, 1.0, 0.0].map(|back| self.motion.pose(time - back * length));
        let acceleration = (after.position - 2.0 * middle.position + before.position) / (length * length);
        let force =
            after.rotation.conjugate() * (acceleration + DVec3::Y * GRAVITY) + self.motion.knock(time);
        let rate = (middle.rotation.conjugate() * after.rotation).to_scaled_axis() / length;
        let unit = &self.unit;
        self.bias_walk += self.random.vector() * unit.gyro_bias_walk * length.sqrt();
        let bias = unit.gyro_bias + unit.gyro_bias_ramp * time + self.bias_walk;
        let noise = 1.0 / f64::from(step).sqrt();
        let gyro = unit.gyro_matrix * rate + bias + self.random.vector() * unit.gyro_noise * noise;
        let accel =
            unit.accel_matrix * force + unit.accel_bias + self.random.vector() * unit.accel_noise * noise;
        let (gyro_limit, accel_limit) = (DVec3::splat(unit.gyro_range), DVec3::splat(unit.accel_range));
        let (gyro, accel) = (gyro.clamp(-gyro_limit, gyro_limit), accel.clamp(-accel_limit, accel_limit));
        let gyro = if unit.auto_zero { self.auto_zero.apply(gyro, length) } else { gyro };
        if time >= self.mag_due {
            self.mag_due = (time + 1e-9).max(self.mag_due + 1.0 / 220.0);
            self.mag = self.magnetometer(time, after.rotation);
        }
        (accel, gyro)
    }

    fn magnetometer(&mut self, time: f64, world_from_body: DQuat) -> [i16; 3] {
        let unit = &self.unit;
        let field = world_from_body.conjugate() * self.surroundings.field_at(time);
        let mut field = unit.soft_iron * field + unit.hard_iron + self.random.vector() * unit.mag_noise;
        if self.random.chance(unit.mag_dropouts) {
            field *= 0.68;
        }
        [field.x, field.z, field.y].map(|value| (value / MAG_UNIT).round() as i16)
    }
}

impl Iterator for Stream {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        loop {
            let pending = self.busy_for();
            let report = self.firmware(pending);
            if self.random.chance(self.faults.losses) {
                continue;
            }
            let time = (self.now - 1) as f64 * 1e-3;
            let host = 5.0 + time * (1.0 + 40e-6) + 1e-3 + 1e-3 * self.random.unit();
            return Some(Frame { report, time, host, truth: self.motion.pose(time).rotation });
        }
    }
}

fn raw(accel: DVec3, gyro: DVec3) -> RawSample {
    let wire = |value: DVec3, unit: f64| value.to_array().map(|v| (v / unit).round() as i32);
    RawSample { accel: wire(accel, ACCEL_UNIT), gyro: wire(gyro, GYRO_UNIT) }
}
