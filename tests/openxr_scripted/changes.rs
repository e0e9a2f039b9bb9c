//! What changes while a session runs: where the wearer's space is, and how large views are to be.

use fake_runtime::script::{Event, EventKind, Head, Script, Session};
use serde_json::json;

use super::extras::first_eye;
use super::{REST, Run, run, sessions};

/// A head that stands aside of its space's origin, and what happens at a frame.
fn at_frame_twelve(event: EventKind) -> Script {
    let session = Session { events: vec![Event { frame: 12, event }], ..Session::default() };
    Script { head: Head { position: [0.8, 0.2, 0.5], ..Head::default() }, ..sessions(vec![session]) }
}

/// How far the first eye was from where the wearer starts, in metres: aside, up and back.
fn aside(run: &Run) -> [f64; 3] {
    let (eye, _) = first_eye(run);
    [eye[0] + 0.0315 - REST[0], eye[1] - REST[1], eye[2] - REST[2]]
}

#[test]
fn recentring_by_the_runtime_brings_the_wearer_back_to_the_start() {
    let script = at_frame_twelve(EventKind::Recentred);
    let Some(before) = run(&script, 6, "") else { return };
    let [x, _, z] = aside(&before);
    assert!((x - 0.8).abs() < 1e-3 && (z - 0.5).abs() < 1e-3, "{x} {z}");
    let after = run(&script, 120, "").unwrap();
    let [x, _, z] = aside(&after);
    assert!(x.abs() < 1e-3 && z.abs() < 1e-3, "{x} {z}");
    // The head is where it was above the floor, which is asked for again: the scene's ground stays below it.
    let rise = aside(&after)[1] - aside(&before)[1];
    assert!(rise.abs() < 1e-3, "the wearer rises by {rise} m");
    // Who has walked elsewhere stays there, and faces ahead again.
    let there = run(&script, 120, "--position 3,1.6,-2 --look-at 3,1.6,-9").unwrap();
    let (eye, _) = first_eye(&there);
    assert!((eye[0] + 0.0315 - 3.0).abs() < 1e-3 && (eye[2] + 2.0).abs() < 1e-3, "{eye:?}");
}

#[test]
fn other_sizes_that_are_recommended_are_taken_while_the_session_runs() {
    let script = at_frame_twelve(EventKind::ViewSize { view: 1, size: [72, 120] });
    let sizes = |run: &Run| {
        let told = run.is_clean().told();
        [0, 1].map(|view| [told["views"][view]["width"].clone(), told["views"][view]["height"].clone()])
    };
    let Some(before) = run(&script, 6, "") else { return };
    assert_eq!(json!(sizes(&before)), json!([[96, 80], [96, 80]]));
    let after = run(&script, 100, "").unwrap();
    assert_eq!(json!(sizes(&after)), json!([[96, 80], [72, 120]]));
    // The last frames, while the session ends, show nothing.
    let frames = after.frames();
    let shown =
        frames.iter().rev().map(|f| &f.0["layers"][0]["views"]).find(|views| views.is_array()).unwrap();
    assert_eq!(shown[1]["rect"], json!([0, 0, 72, 120]), "{shown}");
    // Sizes that were given stay.
    let given = run(&script, 100, "--width 128 --height 48").unwrap();
    assert_eq!(json!(sizes(&given)), json!([[64, 48], [64, 48]]));
}
