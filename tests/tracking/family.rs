//! Streams that are hard in one way each, seeded, beside the other filters: gaps, warming, noise, forces, magnets.

use crate::gaps::{Gaps, Settling, TILT_LIMIT, YAW_LIMIT, settle};
use crate::score::{Series, yaw};
use crate::{Course, DRIFT, EVERYDAY, Figure, MINUTE, REST, TILT, YAW, YAW_RMS, judge, seeds};
use foveate::headset::rift_dk1::fusion::Fusion;
use foveate::headset::rift_dk1::simulate::{Faults, HeadMotion, Stream, Surroundings, Unit};

/// The gyroscopes' zero by which a unit warms up, rad/s in ten minutes: twenty times a usual unit's.
const WARMING: f64 = 0.03;

/// Told, without a limit: the goal of these streams is the error as a whole.
const DRIFT_TOLD: Figure = (DRIFT.0, None, DRIFT.2);

fn warming(seed: u64) -> Unit {
    let unit = Unit::real(seed);
    let ramp = unit.gyro_bias_ramp.normalize() * WARMING / (10.0 * MINUTE);
    Unit { gyro_bias_ramp: ramp, ..unit }
}

fn noisy(seed: u64) -> Unit {
    let unit = Unit::real(seed);
    Unit {
        gyro_noise: 3.0 * unit.gyro_noise,
        accel_noise: 3.0 * unit.accel_noise,
        mag_noise: 3.0 * unit.mag_noise,
        ..unit
    }
}

#[test]
fn a_unit_that_warms_up() {
    let course = Course { unit: warming, ..EVERYDAY };
    judge("zero drifts by 0.03 rad/s in 10 min", &course, &[TILT, DRIFT_TOLD, YAW_RMS, YAW]);
}

#[test]
fn half_an_hour_with_a_unit_that_warms_up() {
    let course = Course { unit: warming, seconds: 30.0 * MINUTE, ..EVERYDAY };
    judge("zero drifts by 0.03 rad/s in 10 min, 30 min", &course, &[TILT, DRIFT_TOLD, YAW_RMS, YAW]);
}

/// The mean of yaw over the whole stream, counted from where it began.
#[test]
fn the_mean_of_yaw_stays() {
    for seed in seeds() {
        let seconds = 10.0 * MINUTE;
        let motion = HeadMotion::everyday(seed, seconds).after_rest(REST);
        let stream = Stream::new(seed, warming(seed), motion, Surroundings::undisturbed(), Faults::none());
        let mut fusion = Fusion::new();
        let (mut start, mut rest, mut after) = ((0.0, 0.0), (0.0, 0.0), Series::default());
        for frame in stream.seconds(seconds) {
            fusion.update(&frame.report, None);
            let yaw = yaw(fusion.orientation(), frame.truth);
            let sum = match frame.time {
                time if time < 10.0 => continue,
                time if time < 15.0 => &mut start,
                _ => &mut rest,
            };
            *sum = (sum.0 + yaw, sum.1 + 1.0);
            after.add(yaw);
        }
        let mean = rest.0 / rest.1 - start.0 / start.1;
        println!("unit {seed}, zero drifts by 0.03 rad/s in 10 min: yaw's mean is off by {mean:.3}");
        assert!(mean.abs() < 1.0, "{mean}");
    }
}

#[test]
fn three_times_the_noise() {
    let course = Course { unit: noisy, ..EVERYDAY };
    judge("three times the noise, 10 min", &course, &[TILT, DRIFT_TOLD, YAW_RMS, YAW]);
}

/// A vehicle that speeds up, brakes and sways with up to 1.5 m/s^2.
#[test]
fn linear_acceleration() {
    let course = Course {
        motion: |seed, seconds| HeadMotion::everyday(seed, seconds).in_a_vehicle(1.5).after_rest(REST),
        ..EVERYDAY
    };
    judge(
        "in a vehicle, up to 1.5 m/s^2, 10 min",
        &course,
        &[("tilt, RMS", None, TILT.2), DRIFT_TOLD, YAW_RMS, YAW],
    );
}

/// Everyday gaps settle as docs/tracking.md says: every one of yaw, and of tilt all but what a unit's own
/// accelerometer and a head in motion hold up.
#[test]
fn after_gaps_tilt_and_yaw_are_found_soon() {
    let usual = Gaps { length: 2.0, turned: [130.0, 180.0], restless: false, count: 8 };
    let rows = [
        ("0.3 s, body turns 60 to 90 degrees", Gaps { length: 0.3, turned: [60.0, 90.0], ..usual }, 1.5),
        ("2 s, body turns 130 to 180 degrees", usual, 1.0),
        ("the same, restless head", Gaps { restless: true, ..usual }, 2.5),
        ("20 s, any turn", Gaps { length: 20.0, turned: [0.0, 360.0], count: 4, ..usual }, 1.5),
        ("80 s, any turn", Gaps { length: 80.0, turned: [0.0, 360.0], count: 2, ..usual }, 1.5),
    ];
    for (name, gaps, tilt_within) in rows {
        let mut all = Settling::default();
        for seed in seeds() {
            let one = settle(&gaps, seed, Unit::real(seed));
            all.tilt.extend(one.tilt);
            all.yaw.extend(one.yaw);
            all.jump = all.jump.max(one.jump);
        }
        let late = all.tilt.iter().filter(|&&seconds| seconds > 1.0).count();
        let (tilt, yaw) = (Settling::worst(&all.tilt), Settling::worst(&all.yaw));
        println!(
            "| gap of {name} | tilt under {TILT_LIMIT} after {tilt:.2} s at most, {late} of {} after 1 s | \
             yaw under {YAW_LIMIT} after {yaw:.2} s | fastest correction {:.1} degrees in 10 ms |",
            all.tilt.len(),
            all.jump
        );
        assert!(!all.tilt.is_empty() && tilt <= tilt_within, "{name}: {tilt}");
        assert!(yaw <= 3.0, "{name}: {yaw}");
        assert!(all.jump < 15.0, "{name}: a jump of {}", all.jump);
    }
}
