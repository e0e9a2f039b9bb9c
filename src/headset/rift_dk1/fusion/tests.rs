//! The fusion on streams made by hand.

use super::*;
use crate::headset::rift_dk1::report::RawSample;
use crate::headset::rift_dk1::simulate::{Faults, HeadMotion, Stream, Surroundings, Unit};

const LEVEL: [i32; 3] = [0, 98_067, 0];

fn sample(gyro: DVec3) -> RawSample {
    RawSample { accel: LEVEL, gyro: (gyro * 1e4).round().as_ivec3().to_array() }
}

fn report(timestamp: u32, count: u8, gyro: [DVec3; 3]) -> SensorReport {
    SensorReport {
        sample_count: count,
        timestamp: timestamp as u16,
        samples: gyro.map(sample),
        ..SensorReport::default()
    }
}

/// Reports of two samples at a constant rate from one ms to another.
fn turn(fusion: &mut Fusion, rate: DVec3, milliseconds: std::ops::Range<u32>) {
    for timestamp in milliseconds.step_by(2) {
        fusion.update(&report(timestamp, 2, [rate; 3]), None);
    }
}

fn yaw_of(fusion: &Fusion) -> f64 {
    fusion.orientation().to_scaled_axis().y
}

#[test]
fn each_slot_is_integrated_over_its_own_time() {
    let mut fusion = Fusion::new();
    let rates = [0.5, 0.6, 0.61].map(|rate| DVec3::Y * rate);
    let update = fusion.update(&report(100, 40, rates), None);
    assert!(update.averaged);
    let expected = 0.5 * 0.038 + 0.6e-3 + 0.61e-3;
    assert!((yaw_of(&fusion) - expected).abs() < 1e-12, "{}", yaw_of(&fusion));
}

#[test]
fn a_wrap_and_a_repeat_change_nothing_and_a_hole_is_filled() {
    let mut fusion = Fusion::new();
    turn(&mut fusion, DVec3::Y, 65_000..66_000);
    assert!((yaw_of(&fusion) - 1.0).abs() < 1e-9, "{}", yaw_of(&fusion));
    let repeated = fusion.update(&report(65_998, 2, [DVec3::Y; 3]), None);
    assert_eq!(repeated.placement.continuity, Continuity::Repeated);
    assert!((yaw_of(&fusion) - 1.0).abs() < 1e-9);
    turn(&mut fusion, DVec3::Y, 66_200..66_202);
    assert!((yaw_of(&fusion) - 1.202).abs() < 1e-9, "{}", yaw_of(&fusion));
    assert_eq!(fusion.lost_milliseconds(), 200);
}

#[test]
fn a_slot_without_accelerometer_is_missing() {
    let mut fusion = Fusion::new();
    turn(&mut fusion, DVec3::Y, 0..100);
    let mut zeroed = report(100, 3, [DVec3::ZERO, DVec3::Y, DVec3::Y]);
    zeroed.samples[0] = RawSample::default();
    fusion.update(&zeroed, None);
    assert!((yaw_of(&fusion) - 0.103).abs() < 1e-9, "{}", yaw_of(&fusion));
}

#[test]
fn a_report_of_no_samples_changes_nothing() {
    let mut fusion = Fusion::new();
    turn(&mut fusion, DVec3::Y, 0..100);
    fusion.update(&report(100, 0, [DVec3::Y; 3]), None);
    assert!((yaw_of(&fusion) - 0.1).abs() < 1e-9);
}

/// Slow, perfectly steady turns must not be taken for an error of the gyroscopes.
#[test]
fn a_turntable_keeps_turning() {
    for degrees in [2.0_f64, 10.0, 18.0] {
        let mut fusion = Fusion::new();
        turn(&mut fusion, DVec3::ZERO, 0..4_000);
        turn(&mut fusion, DVec3::Y * degrees.to_radians(), 4_000..12_000);
        let expected = (8.0 * degrees).to_radians();
        let turned = 2.0 * fusion.orientation().y.atan2(fusion.orientation().w);
        assert!((turned - expected).abs() < 0.01 * expected, "{degrees}: {turned} {expected}");
    }
}

#[test]
fn the_first_report_gives_tilt_and_recentring_yaw() {
    let mut fusion = Fusion::new();
    let tilted = DQuat::from_rotation_z(0.5);
    let mut first = report(0, 1, [DVec3::ZERO; 3]);
    first.samples[0].accel = (tilted.conjugate() * DVec3::Y * 98_067.0).round().as_ivec3().to_array();
    fusion.update(&first, None);
    assert!(fusion.orientation().angle_between(tilted) < 1e-4);

    let mut fusion = Fusion::new();
    turn(&mut fusion, DVec3::Y, 0..700);
    fusion.recentre();
    assert!(fusion.orientation().angle_between(DQuat::IDENTITY) < 1e-6);
}

#[test]
fn a_constant_turn_is_predicted() {
    let mut fusion = Fusion::new();
    turn(&mut fusion, DVec3::Y, 0..1_000);
    let ahead = fusion.orientation().conjugate() * fusion.predicted(0.1);
    assert!((ahead.to_scaled_axis() - DVec3::Y * 0.1).length() < 2e-4);
    assert_eq!(fusion.predicted(5.0), fusion.predicted(0.1));
    assert_eq!(fusion.predicted(f64::NAN), fusion.predicted(0.0));
}

/// Without errors of the sensors there is next to none of the orientation.
#[test]
fn an_ideal_unit_is_tracked_exactly() {
    let seconds = 60.0;
    let motion = HeadMotion::everyday(9, seconds);
    let mut fusion = Fusion::new();
    let mut start = None;
    for frame in
        Stream::new(9, Unit::ideal(), motion, Surroundings::undisturbed(), Faults::none()).seconds(seconds)
    {
        fusion.update(&frame.report, None);
        let offset = *start.get_or_insert(frame.truth * fusion.orientation().conjugate());
        let error = (offset * fusion.orientation()).angle_between(frame.truth).to_degrees();
        assert!(error < 0.7, "{error} at {}", frame.time);
    }
}

/// The quirk of the HMC5983 is left out rather than taken for a disturbance.
#[test]
fn magnetometer_dropouts_are_left_out() {
    let seconds = 60.0;
    let unit = Unit { mag_dropouts: 0.1, ..Unit::real(3) };
    let motion = HeadMotion::everyday(3, seconds).after_rest(5.0);
    let mut fusion = Fusion::new();
    for frame in Stream::new(3, unit, motion, Surroundings::undisturbed(), Faults::none()).seconds(seconds) {
        fusion.update(&frame.report, None);
    }
    assert_eq!(fusion.yaw_source(), YawSource::Magnetometer);
}
