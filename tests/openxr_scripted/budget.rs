//! Frames whose time is held, in a headset.

use std::path::Path;

use fake_runtime::script::{FrameRule, Script, Session};
use foveate::config::{Config, OperatingPoint};

use serde_json::{Value, json};

use super::{Run, run, run_with};

/// Writes a front of two points that says of itself how long its frames take, and the flag that uses it.
fn front(folder: &Path, milliseconds: [f64; 2]) -> String {
    let point = |samples: f64, rays: u32, ms: f64| OperatingPoint {
        samples,
        rays,
        ..OperatingPoint::of(&Config::default(), 1, ms, 4.0 + samples)
    };
    let points = [point(0.02, 1, milliseconds[0]), point(0.5, 64, milliseconds[1])];
    let path = folder.join("front.toml");
    std::fs::write(&path, toml::to_string(&json!({ "budget": { "front": points } })).unwrap()).unwrap();
    format!("--config {}", path.display())
}

fn budget(run: &Run) -> Value {
    run.is_clean().told()["budget"].clone()
}

/// Samples times rays.
fn work(held: &Value) -> f64 {
    held["samples"].as_f64().unwrap() * held["rays"].as_f64().unwrap()
}

#[test]
fn settings_move_to_where_frames_take_their_time() {
    let folder = tempfile::tempdir().unwrap();
    // Frames are far slower than the front says, and far slower than they may be.
    let slower = front(folder.path(), [1e-4, 2e-4]) + " --target-ms 0.1";
    let Some(down) = run(&Script::default(), 10, &slower) else { return };
    let told = budget(&down);
    assert_eq!(
        (told["first"]["position"].as_f64(), told["last"]["position"].as_f64()),
        (Some(1.0), Some(0.0))
    );
    assert!(work(&told["last"]) < work(&told["first"]) / 100.0, "{told}");
    assert_eq!(told["within"], 0.0, "{told}");
    // Frames are far faster than the front says.
    let faster = front(folder.path(), [1e4, 2e4]) + " --target-ms 2000";
    let told = budget(&run(&Script::default(), 20, &faster).unwrap());
    assert_eq!(told["first"]["position"], 0.0, "{told}");
    assert!(work(&told["last"]) > 1.2 * work(&told["first"]), "{told}");
    assert_eq!((told["within"].as_f64(), told["last"]["target_ms"].as_f64()), (Some(1.0), Some(2000.0)));
}

#[test]
fn the_display_sets_the_time_and_may_change_it() {
    let folder = tempfile::tempdir().unwrap();
    let script = |frames| Script {
        period_ms: 20.0,
        sessions: vec![Session { frames, ..Session::default() }],
        ..Script::default()
    };
    let flags = front(folder.path(), [1e4, 2e4]) + " --target-ms display";
    let Some(plain) = run(&script(Vec::new()), 12, &flags) else { return };
    let target = |held: &Value| held["target_ms"].as_f64().unwrap();
    let told = budget(&plain);
    assert!((target(&told["first"]) - 18.0).abs() < 1e-9 && told["last"]["target_ms"] == 18.0, "{told}");
    // At first the runtime tells a period that is not the display's.
    let wrong = FrameRule { from: 1, to: 6, display_period: Some(5_000_000), ..FrameRule::default() };
    let told = budget(&run(&script(vec![wrong]), 12, &flags).unwrap());
    assert!((target(&told["first"]) - 4.5).abs() < 1e-9 && target(&told["last"]) == 18.0, "{told}");
}

#[test]
fn the_display_is_kept_up_with_unless_settings_say_otherwise() {
    let script = Script { period_ms: 20.0, ..Script::default() };
    let folder = tempfile::tempdir().unwrap();
    let front = front(folder.path(), [1e4, 2e4]);
    let note = "however long frames take";
    // Without being asked to: along the preset's front, or a measured one.
    for front in ["", &front] {
        let Some(usual) = run_with(&script, 6, front) else { return };
        let told = budget(&usual);
        assert_eq!((&told["first"]["target_ms"], &told["last"]["target_ms"]), (&json!(18.0), &json!(18.0)));
        assert_eq!(told["first"]["position"], 0.0, "{told}");
        assert!(!usual.said.contains(note), "{}", usual.said);
        // A processor does not keep up: that is told once.
        assert!(usual.said.matches("out of reach").count() <= 1, "{}", usual.said);
    }
    // Whoever says what frames are made with gets that, and is told.
    for (flags, key) in [
        ("--samples 300", "foveation.samples"),
        ("--set trace.rays=2", "trace.rays"),
        ("--reconstruct k-nn", "reconstruction.method"),
        ("--preset fast", "foveation.law"),
    ] {
        let fixed = run_with(&script, 3, flags).unwrap();
        assert!(budget(&fixed).is_null(), "{flags}");
        let notes: Vec<&str> = fixed.said.lines().filter(|line| line.contains(note)).collect();
        assert!(notes.len() == 1 && notes[0].contains(key), "{flags}: {}", fixed.said);
    }
    // Whoever says what to hold has the last word.
    let unheld = run_with(&script, 3, "--target-ms none").unwrap();
    assert!(budget(&unheld).is_null() && !unheld.said.contains(note), "{}", unheld.said);
    let both = run_with(&script, 3, "--samples 300 --target-ms display").unwrap();
    assert_eq!(budget(&both)["last"]["target_ms"], 18.0);
}
