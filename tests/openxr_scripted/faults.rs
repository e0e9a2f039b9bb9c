//! Every call that a running session makes times every code that it may give, once and for good: nothing ends
//! the program but the last resort's sentence, and the summary is always told.

use fake_runtime::order::State::LossPending;
use fake_runtime::script::{Fault, Script, Session, Step, When};

use super::{Run, run, sessions};

/// What a call may give besides losses, which `losses.rs` is about: the specification's codes, of which no two
/// are treated alike by accident.
const CODES: [&str; 5] = [
    "ERROR_VALIDATION_FAILURE",
    "ERROR_OUT_OF_MEMORY",
    "ERROR_RUNTIME_FAILURE",
    "ERROR_LIMIT_REACHED",
    "ERROR_CALL_ORDER_INVALID",
];

/// Calls of a session, each with one that comes when pictures are shown, and codes of its own.
const CALLS: [(&str, u64, &[&str]); 14] = [
    ("xrWaitFrame", 5, &["ERROR_SESSION_NOT_RUNNING"]),
    ("xrBeginFrame", 5, &["ERROR_SESSION_NOT_RUNNING"]),
    ("xrEndFrame", 5, &["ERROR_TIME_INVALID", "ERROR_LAYER_LIMIT_EXCEEDED", "ERROR_POSE_INVALID"]),
    ("xrLocateViews", 9, &["ERROR_TIME_INVALID", "ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED"]),
    ("xrSyncActions", 3, &["ERROR_ACTIONSET_NOT_ATTACHED"]),
    ("xrLocateSpace", 3, &["ERROR_TIME_INVALID"]),
    ("xrGetActionStatePose", 3, &["ERROR_ACTION_TYPE_MISMATCH", "ERROR_PATH_UNSUPPORTED"]),
    ("xrAcquireSwapchainImage", 5, &[]),
    ("xrWaitSwapchainImage", 5, &["TIMEOUT_EXPIRED"]),
    ("xrReleaseSwapchainImage", 5, &[]),
    ("xrCreateSwapchain", 1, &["ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED", "ERROR_FEATURE_UNSUPPORTED"]),
    ("xrCreateActionSpace", 1, &["ERROR_POSE_INVALID"]),
    ("xrAttachSessionActionSets", 1, &["ERROR_ACTIONSETS_ALREADY_ATTACHED"]),
    ("xrBeginSession", 1, &["ERROR_SESSION_NOT_READY"]),
];

fn fault(call: &str, from: u64, to: u64, result: &str) -> Fault {
    Fault { call: call.into(), from, to, result: result.into() }
}

/// A headset whose eyes are tracked, so that those calls are made too.
fn headset(script: Script) -> Script {
    let gaze = vec![fake_runtime::script::Gaze { frame: 1, yaw: 10.0, ..Default::default() }];
    Script { eye_tracker: true, gaze, ..script }
}

/// A session in which a call fails once, and which is lost after some frames if that has not lost it.
fn failing(call: &str, nth: u64, code: &str) -> Session {
    let usual = Session::default();
    let last = Step { at: When::Frame(12), go: vec![LossPending] };
    let steps = usual.steps.iter().cloned().chain([last]).collect();
    Session { faults: vec![fault(call, nth, 0, code)], steps, ..usual }
}

/// Runs through such sessions one after the other, and one more.
fn assert_nothing_ends(failing: Vec<Session>, what: &str) {
    let (count, frames) = (failing.len(), 12 * failing.len() as u32);
    let Some(run) = run(&headset(sessions(failing)), frames, "") else { return };
    assert_orderly(&run, what);
    let told = run.told();
    assert_eq!((run.code, &told["frames"]), (Some(0), &frames.into()), "{what}: {}", run.said);
    assert_eq!(told["losses"], count, "{what}: {}", run.said);
    let scripted = run.log.0.iter().filter(|record| record.0["scripted"] == true).count();
    assert_eq!(scripted, count, "{what}: not every call that was to fail was made");
}

/// The program ended as it should: by itself, with a summary, and where it gave up with the reason.
fn assert_orderly(run: &Run, what: &str) {
    let given_up = run.code == Some(1);
    assert!(given_up || run.code == Some(0), "{what}: {:?} {}", run.code, run.said);
    let last = run.said.trim_end().lines().last().unwrap_or_default();
    assert!(!given_up || (last.starts_with("foveate: ") && last.len() > 40), "{what}: {}", run.said);
    let opened = run.log.calls("session").len();
    assert_eq!(opened > 0, !run.out.is_empty(), "{what}: {}", run.said);
    if opened > 0 {
        assert!(run.told()["frames"].is_u64(), "{what}: {}", run.out);
    }
    assert_eq!(run.log.leftovers(), Vec::<String>::new(), "{what}");
}

#[test]
fn a_call_that_fails_once_ends_nothing() {
    for code in CODES {
        assert_nothing_ends(CALLS.iter().map(|(call, nth, _)| failing(call, *nth, code)).collect(), code);
    }
    let own = CALLS.iter().flat_map(|(call, nth, own)| own.iter().map(|code| failing(call, *nth, code)));
    assert_nothing_ends(own.collect(), "codes of their own");
}

#[test]
fn a_session_that_does_not_let_itself_be_ended_is_left() {
    let session = Session {
        faults: vec![fault("xrEndSession", 1, 0, "ERROR_SESSION_NOT_STOPPING")],
        ..Session::default()
    };
    let Some(run) = run(&sessions(vec![session]), 3, "") else { return };
    assert_orderly(&run, "xrEndSession");
    assert_eq!((run.code, &run.told()["frames"]), (Some(0), &3.into()), "{}", run.said);
}

#[test]
fn what_is_refused_for_good_is_gone_without() {
    for (call, says) in [
        ("xrLocateSpace", "gaze"),
        ("xrGetActionStatePose", "gaze"),
        ("xrSyncActions", "not followed"),
        ("xrCreateActionSpace", "not used"),
        ("xrAttachSessionActionSets", "not"),
    ] {
        let script = headset(Script {
            faults: vec![fault(call, 1, 100_000, "ERROR_VALIDATION_FAILURE")],
            ..Script::default()
        });
        let Some(run) = run(&script, 8, "") else { return };
        let told = run.is_clean().told();
        assert_eq!((&told["frames"], &told["losses"]), (&8.into(), &0.into()), "{call}: {}", run.said);
        let mut notes: Vec<&str> = run.said.lines().filter(|line| line.contains(call)).collect();
        assert!(notes[0].contains(says), "{call}: {}", run.said);
        // Hands and eyes make some calls each.
        notes.sort_unstable();
        assert!(notes.windows(2).all(|pair| pair[0] != pair[1]), "{call} is told once: {}", run.said);
    }
    // Depths alone, then the favourite format, are refused: those that are left are used.
    for (refused, format) in [(vec![2], "R8G8B8A8_SRGB"), (vec![1, 2], "B8G8R8A8_SRGB")] {
        let code = "ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED";
        let faults = refused.iter().map(|&nth| fault("xrCreateSwapchain", nth, 0, code)).collect();
        let session = Session { faults, ..Session::default() };
        let Some(run) = run(&sessions(vec![session]), 4, "") else { return };
        let told = run.is_clean().told();
        assert_eq!((&told["losses"], &told["format"]), (&0.into(), &format.into()), "{}", run.said);
    }
}

#[test]
#[ignore = "takes minutes"]
fn long_every_call_that_fails_for_good_ends_in_order() {
    for (call, nth, _) in CALLS {
        for code in ["ERROR_VALIDATION_FAILURE", "ERROR_RUNTIME_FAILURE", "ERROR_SESSION_LOST"] {
            let script =
                headset(Script { faults: vec![fault(call, nth, u64::MAX, code)], ..Script::default() });
            let Some(run) = run(&script, 6, "") else { return };
            assert_orderly(&run, &format!("{call} {code}"));
        }
    }
}
