//! A tracker that does not exist: streams of reports with known truth.
//!
//! A [`HeadMotion`] moves a [`Unit`], with the errors that a real unit has, through a
//! [`Surroundings`] with a magnetic field, and a [`Stream`] delivers what the firmware would have
//! sent: averaged reports when the endpoint was busy, jumps of the timestamp after long stalls,
//! wraps, and holes where reports were lost on the host.

mod auto_zero;
mod motion;
mod random;
mod stream;

pub use motion::{HeadMotion, Spin};
pub use random::Random;
pub use stream::{Faults, Frame, Stream};

use glam::{DMat3, DVec3};

/// Standard gravity in m/s^2.
pub const GRAVITY: f64 = 9.806_65;

/// The errors of one unit's sensors, after the calibration that the tracker applies itself.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Gyroscope zero in rad/s at the start.
    pub gyro_bias: DVec3,
    /// Its steady change, as by warming up, in rad/s^2.
    pub gyro_bias_ramp: DVec3,
    /// Its random walk in rad/s per square root of a second.
    pub gyro_bias_walk: f64,
    /// What the gyroscope makes of an angular velocity: scale and misalignment.
    pub gyro_matrix: DMat3,
    /// Standard deviation of one 1 ms sample in rad/s.
    pub gyro_noise: f64,
    /// Greatest angular velocity that is measured, rad/s.
    pub gyro_range: f64,
    /// Accelerometer zero in m/s^2.
    pub accel_bias: DVec3,
    /// What the accelerometer makes of a specific force.
    pub accel_matrix: DMat3,
    /// Standard deviation of one 1 ms sample in m/s^2.
    pub accel_noise: f64,
    /// Greatest specific force that is measured on an axis, m/s^2.
    pub accel_range: f64,
    /// The firmware corrects the gyroscope's zero when it believes the tracker to be still.
    pub auto_zero: bool,
    /// Field of the headset itself in gauss, body frame.
    pub hard_iron: DVec3,
    /// What the headset and the magnetometer make of a field.
    pub soft_iron: DMat3,
    /// Standard deviation of one magnetometer sample in gauss.
    pub mag_noise: f64,
    /// Share of magnetometer samples at 68 % amplitude, a quirk of the HMC5983.
    pub mag_dropouts: f64,
}

impl Unit {
    /// A unit without errors.
    pub fn ideal() -> Self {
        Unit {
            gyro_bias: DVec3::ZERO,
            gyro_bias_ramp: DVec3::ZERO,
            gyro_bias_walk: 0.0,
            gyro_matrix: DMat3::IDENTITY,
            gyro_noise: 0.0,
            gyro_range: 2000_f64.to_radians(),
            accel_bias: DVec3::ZERO,
            accel_matrix: DMat3::IDENTITY,
            accel_noise: 0.0,
            accel_range: 2.0 * GRAVITY,
            auto_zero: false,
            hard_iron: DVec3::ZERO,
            soft_iron: DMat3::IDENTITY,
            mag_noise: 0.0,
            mag_dropouts: 0.0,
        }
    }

    /// A unit drawn by `seed` with the noise of the DK1's parts.
    ///
    /// White noise from the MPU-6000's data sheet at its widest filter: 0.005 deg/s and 400 ug per
    /// square root of a hertz, over 500 Hz. The HMC5983's: 2 mG. The rest are residues as an
    /// in-tracker calibration leaves them: gyroscope zero of some 0.2 deg/s that warms up by 0.05
    /// deg/s in ten minutes, scale of half a per cent, axes 0.2 degrees off, accelerometer zero of
    /// 0.03 m/s^2. Hard iron of up to 0.25 gauss and soft iron of some per cent.
    pub fn real(seed: u64) -> Self {
        let mut random = Random::new(seed ^ 0x0dd1);
        let matrix = |random: &mut Random, diagonal: f64, other: f64| {
            let mut matrix = DMat3::from_cols(random.vector(), random.vector(), random.vector()) * other;
            matrix += DMat3::from_diagonal(random.vector() * diagonal);
            DMat3::IDENTITY + matrix
        };
        Unit {
            gyro_bias: random.vector() * 0.2_f64.to_radians(),
            gyro_bias_ramp: random.vector() * (0.05 / 600.0_f64).to_radians(),
            gyro_bias_walk: 3e-4_f64.to_radians(),
            gyro_matrix: matrix(&mut random, 0.005, 0.003),
            gyro_noise: 0.11_f64.to_radians(),
            accel_bias: random.vector() * 0.03,
            accel_matrix: matrix(&mut random, 0.002, 0.001),
            accel_noise: 0.088,
            hard_iron: random.vector().clamp(DVec3::splat(-1.6), DVec3::splat(1.6)) * 0.15,
            soft_iron: matrix(&mut random, 0.04, 0.02),
            mag_noise: 0.002,
            mag_dropouts: 0.002,
            ..Unit::ideal()
        }
    }
}

/// A magnetic source that comes and goes.
#[derive(Clone, Copy, Debug)]
pub struct Disturbance {
    /// Device seconds at which it begins to rise.
    pub start: f64,
    /// Seconds until it begins to fall; it takes [`Disturbance::RISE`] for either.
    pub length: f64,
    /// The field that it adds in gauss, world frame.
    pub field: DVec3,
}

impl Disturbance {
    /// Seconds in which a disturbance rises or falls.
    pub const RISE: f64 = 1.0;

    fn at(&self, time: f64) -> DVec3 {
        let rise = ((time - self.start) / Self::RISE).clamp(0.0, 1.0);
        let fall = ((time - self.start - self.length) / Self::RISE).clamp(0.0, 1.0);
        self.field * (rise - fall)
    }
}

/// The magnetic field around the head.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Gauss, world frame.
    pub field: DVec3,
    /// What adds to it at times.
    pub disturbances: Vec<Disturbance>,
}

impl Surroundings {
    /// A field of half a gauss that dips by 65 degrees, as in central Europe, with north ahead.
    pub fn undisturbed() -> Self {
        let dip = 65_f64.to_radians();
        Surroundings { field: DVec3::new(0.0, -dip.sin(), -dip.cos()) * 0.5, disturbances: Vec::new() }
    }

    /// The same with a source of 50 to 300 milligauss for 15 to 45 s about once a minute.
    pub fn disturbed(seed: u64, seconds: f64) -> Self {
        let mut random = Random::new(seed ^ 0xd157);
        let mut surroundings = Self::undisturbed();
        let mut start = 60.0;
        while start < seconds {
            let length = random.between(15.0, 45.0);
            let field = random.vector().normalize_or(DVec3::X) * random.between(0.05, 0.3);
            surroundings.disturbances.push(Disturbance { start, length, field });
            start += length + random.between(15.0, 60.0);
        }
        surroundings
    }

    /// The field at a time in gauss, world frame.
    pub fn field_at(&self, time: f64) -> DVec3 {
        self.field + self.disturbances.iter().map(|disturbance| disturbance.at(time)).sum::<DVec3>()
    }
}
