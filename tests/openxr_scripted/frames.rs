//! Frames that are not to be rendered, come late, or have times that are none.

use fake_runtime::script::{FrameRule, Head, Script, Session};

use super::{run, sessions};

fn with_frames(frames: Vec<FrameRule>) -> Script {
    sessions(vec![Session { frames, ..Session::default() }])
}

fn rule(from: u64, to: u64) -> FrameRule {
    FrameRule { from, to, ..FrameRule::default() }
}

#[test]
fn nothing_is_shown_where_nothing_is_to_be_rendered() {
    let hidden = FrameRule { should_render: Some(false), ..rule(5, 8) };
    let Some(run) = run(&with_frames(vec![hidden]), 10, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 10, "frames without a picture do not count");
    let mut hidden = 0;
    for frame in run.frames() {
        let (layers, wanted) = (&frame.0["layers"], frame.0["should_render"] == true);
        if !wanted {
            hidden += 1;
            assert_eq!(layers.as_array().unwrap().len(), 0, "{frame:?}");
        }
    }
    assert!(hidden >= 5, "{hidden}: the first frame, and four by the script");
}

#[test]
fn times_that_are_none_stand_still_or_go_back_do_no_harm() {
    let rules = vec![
        FrameRule { display_time: Some(-5), ..rule(4, 5) },
        FrameRule { display_time: Some(0), ..rule(7, 0) },
        FrameRule { display_time: Some(i64::MIN), ..rule(9, 0) },
        FrameRule { offset_ms: -35.0, ..rule(11, 12) },
        FrameRule { offset_ms: -1e7, ..rule(14, 0) },
        FrameRule { display_time: Some(i64::MAX), ..rule(16, 0) },
        FrameRule { display_period: Some(-1), ..rule(2, 18) },
        FrameRule { display_period: Some(0), ..rule(19, 22) },
        FrameRule { display_period: Some(i64::MAX), ..rule(23, 25) },
    ];
    let Some(run) = run(&with_frames(rules), 24, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(24), Some(0)), "{told}");
    // What is asked of the runtime, and what is said to it, are times.
    for call in ["xrLocateViews", "xrEndFrame"] {
        for record in run.log.calls(call) {
            let time = record.0["time"].as_i64().or(record.0["display_time"].as_i64()).unwrap();
            assert!(time > 0 && record.result() == "SUCCESS", "{record:?}");
        }
    }
}

/// What a runtime leaves in poses that it says are invalid is anything: views stay where they were, and are turned as
/// is known.
#[test]
fn poses_that_are_undefined_are_not_believed() {
    let first = vec![FrameRule { unplaced: true, ..rule(1, 4) }, FrameRule { unturned: true, ..rule(7, 9) }];
    let lost = FrameRule { unplaced: true, unturned: true, ..rule(11, 13) };
    let script = Script {
        head: Head { position: [0.3, 0.1, -0.2], ..Head::default() },
        ..with_frames(first.into_iter().chain([lost]).collect())
    };
    let Some(run) = run(&script, 16, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 16, "{}", run.said);
    for (frame, views) in run.layers() {
        let number = frame.0["frame"].as_u64().unwrap();
        let pose: Vec<f64> =
            views[0]["pose"].as_array().unwrap().iter().map(|part| part.as_f64().unwrap()).collect();
        // Before anything is known, the space's origin; then where it was.
        // Frame 5 may be waited for already while the poses of the fourth are asked for.
        if number == 4 {
            continue;
        }
        let right = if number < 4 { [0.0; 3] } else { [0.3 - 0.0315, 0.1, -0.2] };
        let off = (0..3).map(|axis| (pose[4 + axis] - right[axis]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3 && (pose[3] - 1.0).abs() < 1e-3, "{number}: {pose:?}");
    }
    // Nothing is shown as long as it is not even known which way the head looks.
    let never = with_frames(vec![FrameRule { unturned: true, ..rule(1, 6) }]);
    let run = super::run(&never, 4, "").unwrap();
    assert_eq!(run.is_clean().told()["frames"], 4);
    assert!(run.layers().iter().all(|(frame, _)| frame.0["frame"].as_u64() > Some(5)), "{:?}", run.layers());
}

#[test]
fn a_runtime_that_is_slow_is_waited_for() {
    let slow = vec![FrameRule { wait_ms: 400, ..rule(3, 4) }, FrameRule { wait_ms: 1500, ..rule(6, 0) }];
    let Some(run) = run(&with_frames(slow), 10, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(10), Some(0)), "{told}");
    assert!(told["dropped"].as_u64().unwrap() > 0, "the display went on meanwhile: {told}");
}

#[test]
fn frames_that_nobody_sees_come_no_faster_than_the_display_shows_some() {
    let hidden = FrameRule { should_render: Some(false), at_once: true, ..rule(3, 60) };
    let Some(run) = run(&with_frames(vec![hidden]), 4, "") else { return };
    let frames = run.frames();
    let ended = |number: u64| {
        let frame = frames.iter().find(|frame| frame.0["frame"] == number).unwrap();
        frame.0["ns"].as_i64().unwrap()
    };
    // The display's period is 10 ms.
    assert!(ended(60) - ended(4) > 56 * 7_000_000, "{} ns for 56 frames", ended(60) - ended(4));
}
