//! The filter's constants: what is known beforehand of the sensors, of heads and of rooms.
//!
//! Each has a physical meaning. Those about doubt were settled by looking at generated streams of the
//! some units; `docs/tracking.md` says which, and has the figures of units that were not looked at.

/// Standard gravity in m/s^2.
pub const GRAVITY: f64 = 9.806_65;

/// Doubt about tilt after the first accelerometer sample, rad.
pub const TILT_PRIOR: f64 = 0.1;
/// Doubt about the gyroscope's zero at the start, rad/s: one degree a second.
pub const BIAS_PRIOR: f64 = 0.0175;
/// Doubt about the steady change of the zero, rad/s^2: five times a usual unit's, a sixth of the fastest warming's,
/// which is found all the same; more would let yaw drift while the field is disturbed. Its walk in rad/s^2 per square root of a second; and the greatest change that is believed.
pub const RAMP_PRIOR: f64 = 8e-6;
pub const RAMP_WALK: f64 = 5e-7;
pub const RAMP_LIMIT: f64 = 2e-4;
/// Doubt about a zero that an earlier run found, rad/s: a tenth of a degree a second.
pub const KEPT_BIAS_PRIOR: f64 = 0.001_75;
/// Doubt about whether a tracker shifts its zero by the firmware's rule, when nothing is known of it
/// (none is believed at first) and when it was told to (it is believed).
pub const SHARE_PRIOR: f64 = 0.35;
pub const EXPECTED_SHARE_PRIOR: f64 = 0.3;
/// Doubt that an expected shift of the zero leaves, as a share of it.
pub const SHIFT_DOUBT: f64 = 0.1;
/// No zero is believed beyond this, rad/s: the MPU-6000's data sheet says 20 deg/s.
pub const BIAS_LIMIT: f64 = 0.5;
/// Doubt about the gyroscope's scale: one per cent, half of it the clock of the samples.
pub const SCALE_PRIOR: f64 = 0.01;
/// Doubt about the gyroscope's axes, rad.
pub const SKEW_PRIOR: f64 = 0.005;
/// The gyroscope's angle random walk in rad per square root of a second: twice the data sheet's.
pub const GYRO_WALK: f64 = 1.7e-4;
/// The walk of the gyroscope's zero in rad/s per square root of a second.
pub const BIAS_WALK: f64 = 1.2e-5;
/// What a fast turn adds to the walk, as a share of the rate: the gyroscope's non-linearity.
pub const RATE_SLIP: f64 = 5e-4;
/// The walk of the hard iron in gauss per square root of a second.
pub const IRON_WALK: f64 = 2e-5;

/// Angular velocity at which the gyroscope clips, rad/s, less a little: 2000 deg/s.
pub const GYRO_CLIPS: f64 = 34.8;
/// Specific force at which the accelerometer clips, m/s^2, less a little: 2 g.
pub const ACCEL_CLIPS: f64 = 19.4;
/// Doubt about the rate while the gyroscope clips, rad/s.
pub const CLIPPED_RATE: f64 = 10.0;
/// A hole is filled by the rates before and after it up to this, s.
pub const FILLED_HOLE: f64 = 0.3;
/// Milliseconds of a hole in which a head may have turned by more than the field's doubt.
pub const LONG_HOLE: u64 = 50;
/// A head's angular acceleration in rad/s^2, for the doubt that a hole leaves.
pub const HEAD_ACCELERATION: f64 = 15.0;

/// The range of magnetometer values that are believed, gauss on an axis.
pub const MAG_LIMIT: f64 = 3.2;
