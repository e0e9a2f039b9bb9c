//! The test vectors that describe the DK1's reports.

use foveate::headset::rift_dk1::report::{
    Configuration, DisplayInfo, KeepAlive, Range, ReportError, SensorReport,
};
use serde_json::Value;

fn vectors() -> Option<Value> {
    let root = std::env::var("FOVEATE_TEST_DATA").unwrap_or_else(|_| "../shared/data".to_string());
    let path = std::path::Path::new(&root).join("dk1/vectors.json");
    let Ok(text) = std::fs::read_to_string(&path) else {
        println!("not run: {} is missing", path.display());
        return None;
    };
    Some(serde_json::from_str(&text).unwrap())
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().unwrap();
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn triple(value: &Value) -> [i32; 3] {
    std::array::from_fn(|axis| value[axis].as_i64().unwrap() as i32)
}

#[test]
fn input_reports_decode_to_their_fields_and_encode_to_their_bytes() {
    let Some(vectors) = vectors() else { return };
    let reports = vectors["in_reports"].as_array().unwrap();
    assert_eq!(reports.len(), 7);
    for expected in reports {
        let name = &expected["name"];
        let wire = bytes(&expected["hex"]);
        let report = SensorReport::decode(&wire).unwrap();
        assert_eq!(u64::from(report.sample_count), expected["sample_count"], "{name}");
        assert_eq!(u64::from(report.timestamp), expected["timestamp"], "{name}");
        assert_eq!(u64::from(report.last_command_id), expected["last_command_id"], "{name}");
        assert_eq!(i64::from(report.temperature), expected["temperature_cC"], "{name}");
        assert_eq!(report.mag.map(i32::from), triple(&expected["mag"]), "{name}");
        let samples = expected["samples"].as_array().unwrap();
        assert_eq!(report.slots().len(), samples.len(), "{name}");
        for (slot, sample) in report.slots().iter().zip(samples) {
            assert_eq!(slot.accel, triple(&sample["accel"]), "{name}");
            assert_eq!(slot.gyro, triple(&sample["gyro"]), "{name}");
        }
        assert_eq!(report.encode()[..], wire[..], "{name}");
        assert_eq!(report.slot_milliseconds().iter().sum::<u32>(), u32::from(report.sample_count), "{name}");
    }
}

#[test]
fn feature_reports_decode_and_encode() {
    let Some(vectors) = vectors() else { return };
    let wire = |name: &str| bytes(&vectors["feature_reports"][name]);
    let display = DisplayInfo::decode(&wire("display_info_default_get")).unwrap();
    assert_eq!((display.resolution, display.size), ([1280, 800], [149_760, 93_600]));
    assert_eq!((display.vertical_centre, display.lens_separation), (46_800, 63_500));
    assert_eq!((display.lens_distance, display.distortion_type), ([49_800; 2], 1));
    assert_eq!(display.encode()[..], wire("display_info_default_get"));
    let read = Configuration::decode(&wire("config_default_get_no_flags_readback")).unwrap();
    assert_eq!((read.flags, read.packet_interval, read.sample_rate), (0x2c, 1, 1000));
    let set = wire("config_set_1000Hz_calib_autocal_cmdkeepalive");
    assert_eq!(Configuration { packet_interval: 0, ..read }.encode()[..], set);
    let range = Range::decode(&wire("range_default_get")).unwrap();
    assert_eq!((range.accel, range.gyro, range.mag), (2, 2000, 1300));
    assert_eq!(range.encode()[..], wire("range_default_get"));
    assert_eq!(KeepAlive { command_id: 0, interval: 10_000 }.encode()[..], wire("keepalive_set_10s"));
}

#[test]
fn odd_inputs_are_refused_or_cut() {
    let Some(vectors) = vectors() else { return };
    let decoded: Vec<_> = vectors["odd_inputs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|odd| SensorReport::decode(&bytes(&odd["hex"])).map(|report| report.timestamp))
        .collect();
    let expected = [
        Err(ReportError::Short { got: 61, expected: 62 }),
        Err(ReportError::Short { got: 0, expected: 62 }),
        Err(ReportError::Id { got: 11, expected: 1 }),
        Ok(0x1234),
        Err(ReportError::SampleCount(255)),
    ];
    assert_eq!(decoded, expected);
}
