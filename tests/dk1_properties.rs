//! Nothing that a device, a recording or a file can say breaks the reader.
//!
//! `cargo test --test dk1_properties` runs some ten thousand inputs. Ten million reports:
//!
//! PROPTEST_CASES=200000 cargo test --test dk1_properties any_stream

use foveate::headset::rift_dk1::clock::{DeviceClock, HostClock};
use foveate::headset::rift_dk1::fusion::{Fusion, Keepsake, MagneticCalibration};
use foveate::headset::rift_dk1::recording::Reader;
use foveate::headset::rift_dk1::report::{
    Calibration, Configuration, DisplayInfo, IN_REPORT_BYTES, KeepAlive, Range, RawSample, SensorReport,
    SerialNumber,
};
use glam::{DMat3, DQuat, DVec3};
use proptest::collection::vec;
use proptest::prelude::*;

/// Reports that are mostly well-formed, so that the fusion gets to see their wild contents.
fn report() -> impl Strategy<Value = [u8; IN_REPORT_BYTES]> {
    (any::<[u8; 31]>(), any::<[u8; 31]>(), prop_oneof![20 => Just(1_u8), 1 => any::<u8>()], 0_u8..8).prop_map(
        |(a, b, id, count)| {
            let mut bytes = [0; IN_REPORT_BYTES];
            bytes[..31].copy_from_slice(&a);
            bytes[31..].copy_from_slice(&b);
            bytes[0] = id;
            // Every other report follows closely on the one before and has few samples.
            if count < 4 {
                bytes[1] = count;
                bytes[3] = 0;
            }
            bytes
        },
    )
}

fn host_time() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![2 => Just(None), 4 => (0.0..1e5).prop_map(Some), 1 => any::<f64>().prop_map(Some)]
}

fn assert_sound(fusion: &Fusion, ahead: f64) {
    let orientation = fusion.orientation();
    assert!((orientation.length() - 1.0).abs() < 1e-9, "{orientation}");
    assert!((fusion.predicted(ahead).length() - 1.0).abs() < 1e-9);
    assert!(fusion.angular_velocity().is_finite());
    let (tilt, yaw) = fusion.doubt();
    assert!(tilt.is_finite() && yaw.is_finite(), "{tilt} {yaw}");
}

#[test]
fn a_head_that_turns_by_2000_degrees_a_second_is_followed() {
    let mut fusion = Fusion::new();
    let mut time = 0u16;
    for rate in [0.0, 2000f64.to_radians()] {
        for _ in 0..1000 {
            let sample = RawSample { accel: [0, 98_066, 0], gyro: [0, (rate * 1e4) as i32, 0] };
            fusion.update(
                &SensorReport {
                    sample_count: 1,
                    timestamp: time,
                    samples: [sample; 3],
                    ..Default::default()
                },
                None,
            );
            time += 1;
        }
    }
    assert_sound(&fusion, 1e6);
    // Five turns and 200 degrees.
    let off = fusion.orientation().angle_between(DQuat::from_rotation_y(200f64.to_radians())).to_degrees();
    assert!(off < 5.0, "{off}");
}

proptest! {
    #[test]
    fn any_stream_leaves_a_unit_quaternion(
        reports in vec((report(), host_time()), 50),
        ahead in any::<f64>(),
    ) {
        let mut fusion = Fusion::new();
        for (index, (bytes, host)) in reports.iter().enumerate() {
            if let Ok(report) = SensorReport::decode(bytes) {
                fusion.update(&report, *host);
            }
            if index == 25 {
                fusion.recentre();
                fusion.restart();
            }
        }
        assert_sound(&fusion, ahead);
    }

    #[test]
    fn any_bytes_decode_or_are_refused(bytes in vec(any::<u8>(), 0..80), id in 0_u8..12) {
        let mut bytes = bytes;
        if let Some(first) = bytes.first_mut() {
            *first = id;
        }
        if let Ok(report) = SensorReport::decode(&bytes) {
            prop_assert_eq!(SensorReport::decode(&report.encode()), Ok(report));
            prop_assert_eq!(report.slot_milliseconds().iter().sum::<u32>(), u32::from(report.sample_count));
            // Bit 0 of each packed word is unused.
            let mut wire = bytes[..IN_REPORT_BYTES].to_vec();
            (0..6).for_each(|word| wire[15 + 8 * word] &= 0xfe);
            prop_assert_eq!(report.encode().to_vec(), wire);
        }
        if let Ok(configuration) = Configuration::decode(&bytes) {
            prop_assert_eq!(Configuration::decode(&configuration.encode()), Ok(configuration));
        }
        if let Ok(range) = Range::decode(&bytes) {
            prop_assert_eq!(Range::decode(&range.encode()), Ok(range));
        }
        if let Ok(keep_alive) = KeepAlive::decode(&bytes) {
            prop_assert_eq!(KeepAlive::decode(&keep_alive.encode()), Ok(keep_alive));
        }
        if let Ok(display) = DisplayInfo::decode(&bytes) {
            prop_assert_eq!(DisplayInfo::decode(&display.encode()), Ok(display));
        }
        if let Ok(calibration) = Calibration::decode(&bytes) {
            prop_assert!(calibration.gyro_matrix.iter().flatten().all(|entry| entry.is_finite()));
        }
        if let Ok(serial) = SerialNumber::decode(&bytes) {
            prop_assert_eq!(SerialNumber::decode(&serial.encode()), Ok(serial));
        }
    }

    #[test]
    fn any_values_pack_to_what_21_bits_hold(values in any::<[i32; 18]>()) {
        let mut report = SensorReport { sample_count: 3, ..SensorReport::default() };
        for (slot, sample) in report.samples.iter_mut().enumerate() {
            sample.accel.copy_from_slice(&values[6 * slot..6 * slot + 3]);
            sample.gyro.copy_from_slice(&values[6 * slot + 3..6 * slot + 6]);
        }
        let decoded = SensorReport::decode(&report.encode()).unwrap();
        for (slot, sample) in decoded.samples.iter().enumerate() {
            let clamp = |at: usize| values[at].clamp(-(1 << 20), (1 << 20) - 1);
            prop_assert_eq!(sample.accel, std::array::from_fn(|axis| clamp(6 * slot + axis)));
            prop_assert_eq!(sample.gyro, std::array::from_fn(|axis| clamp(6 * slot + 3 + axis)));
        }
    }

    #[test]
    fn device_time_never_goes_back(
        reports in vec((any::<u16>(), 0_u8..=254, host_time(), prop::bool::weighted(0.1)), 1..100),
    ) {
        let mut clock = DeviceClock::default();
        let mut newest = 0;
        for (timestamp, count, host, restart) in reports {
            if restart {
                clock.restart();
            }
            let placement = clock.place(timestamp, count, host);
            prop_assert!(placement.newest_ms >= newest, "{placement:?} after {newest}");
            newest = placement.newest_ms;
        }
    }

    #[test]
    fn the_hosts_clock_stays_finite(times in vec((-1e9..1e9, any::<f64>()), 1..300)) {
        let mut clock = HostClock::default();
        for (device, host) in times {
            clock.observe(device, host);
            prop_assert!(clock.host(0.0).is_none_or(|time| !time.is_nan()));
            prop_assert!(clock.drift().abs() <= 0.02);
        }
    }

    #[test]
    fn a_wild_keepsake_does_no_harm(
        values in any::<[f64; 19]>(),
        bytes in vec(report(), 30),
    ) {
        let calibration = MagneticCalibration {
            hard_iron: DVec3::from_slice(&values[..3]),
            soft_iron: DMat3::from_cols_slice(&values[3..12]),
            hard_iron_doubt: DVec3::from_slice(&values[12..15]),
            soft_iron_doubt: values[15],
        };
        let gyro_bias = DVec3::from_slice(&values[16..19]);
        let mut fusion = Fusion::resume(&Keepsake { gyro_bias, magnetometer: Some(calibration) });
        for report in bytes.iter().filter_map(|bytes| SensorReport::decode(bytes).ok()) {
            fusion.update(&report, None);
        }
        assert_sound(&fusion, 0.04);
    }

    #[test]
    fn any_file_is_read_to_its_end(bytes in vec(any::<u8>(), 0..400), timed in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording");
        let magic: &[u8] = if timed { b"foveate dk1 1.0\n" } else { b"" };
        std::fs::write(&path, [magic, &bytes].concat()).unwrap();
        let record = if timed { 70 } else { 62 };
        if let Ok(mut reader) = Reader::open(&path) {
            prop_assert_eq!(reader.by_ref().filter(Result::is_ok).count(), bytes.len() / record);
            prop_assert_eq!(reader.cut_off(), bytes.len() % record);
        }
    }
}
