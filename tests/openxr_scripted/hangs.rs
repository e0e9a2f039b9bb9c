//! A runtime that hangs, or shows nothing, keeps neither the program nor its summary, and not the reason.

use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fake_runtime::order::State::{Idle, Ready, Synchronized};
use fake_runtime::script::{Fault, FrameRule, Hang, Script, Session, Step, View, When};

use super::{Run, await_frames, command, finished, possible, run, sessions};

/// Longer than any test waits.
const FOR_EVER: u64 = 3_600_000;

fn hang(call: &str, from: u64, ms: u64) -> Hang {
    Hang { call: call.into(), from, to: u64::MAX, ms }
}

fn interrupt(child: &Child) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
}

/// Starts a run that does not end by itself, waits for some frames and at least for a session, and does
/// something.
fn meddled(script: &Script, frames: usize, meddle: impl FnOnce(&mut Child)) -> Option<Run> {
    if !possible() {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command(folder.path(), script, 1_000_000, "");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    await_frames(&mut child, folder.path(), frames);
    while !folder.path().join(&script.log).exists() || setup.log().calls("xrCreateSession").is_empty() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(Duration::from_millis(50));
    }
    meddle(&mut child);
    Some(finished(child.wait_with_output().unwrap(), setup.log(), folder))
}

#[test]
fn one_ctrl_c_ends_a_run_whose_runtime_hangs_in_any_call() {
    for call in ["xrWaitFrame", "xrLocateViews", "xrEndFrame", "xrPollEvent", "xrWaitSwapchainImage"] {
        // Calls are counted differently, so that frames are shown before.
        let from = if call == "xrPollEvent" { 60 } else { 20 };
        let script = Script { hangs: vec![hang(call, from, FOR_EVER)], ..Script::default() };
        let Some(run) = meddled(&script, 2, |child| {
            std::thread::sleep(Duration::from_millis(2500));
            interrupt(child);
        }) else {
            return;
        };
        assert_eq!(run.code, Some(0), "{call}: {}", run.said);
        assert!(run.told()["frames"].as_u64().unwrap() > 0, "{call}: {}", run.out);
    }
}

#[test]
fn a_runtime_that_hangs_in_the_end_loses_no_summary() {
    for call in ["xrDestroySession", "xrDestroySwapchain", "xrDestroyInstance", "xrEndSession"] {
        let script = Script { hangs: vec![hang(call, 1, FOR_EVER)], ..Script::default() };
        let Some(run) = meddled(&script, 3, |child| interrupt(child)) else { return };
        assert_eq!(run.code, Some(0), "{call}: {}", run.said);
        assert!(run.told()["frames"].as_u64().unwrap() > 0, "{call}: {}", run.out);
    }
}

#[test]
fn signals_that_come_together_are_one_wish() {
    let Some(run) = meddled(&Script::default(), 3, |child| (0..3).for_each(|_| interrupt(child))) else {
        return;
    };
    assert!(run.is_clean().told()["frames"].as_u64().unwrap() > 0);
}

#[test]
fn a_session_that_is_lost_while_xr_wait_frame_hangs_is_followed_by_another() {
    // The wait outlasts the session; only one may live at a time.
    let lost = Fault { call: "xrEndFrame".into(), from: 6, to: 0, result: "ERROR_SESSION_LOST".into() };
    let slow = FrameRule { from: 7, to: 0, wait_ms: 3000, ..FrameRule::default() };
    let script = sessions(vec![Session { faults: vec![lost], frames: vec![slow], ..Session::default() }]);
    let Some(run) = run(&script, 12, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((&told["frames"], &told["losses"]), (&12.into(), &1.into()), "{}", run.said);
}

/// A run that is interrupted once it has ended so many frames.
pub fn interrupted_after(script: &Script, frames: usize) -> Option<Run> {
    meddled(script, frames, |child| interrupt(child))
}

#[test]
fn nothing_is_shown_for_a_reason_that_is_told() {
    let step = |at, go: &[_]| Step { at, go: go.to_vec() };
    let idle = Session { steps: vec![step(When::Created, &[Idle])], ..Session::default() };
    let hidden = vec![step(When::Created, &[Idle, Ready]), step(When::Frame(1), &[Synchronized])];
    let hidden = Session { steps: hidden, ..Session::default() };
    let kept = Fault {
        call: "xrWaitSwapchainImage".into(),
        from: 1,
        to: u64::MAX,
        result: "TIMEOUT_EXPIRED".into(),
    };
    let flat = View { fov: [-45.0, 45.0, -40.0, 40.0], ..View::default() };
    for (script, frames, reason) in [
        (sessions(vec![idle]), 0, "put the headset on"),
        (sessions(vec![hidden]), 5, "shows no pictures of this program"),
        (Script { views: vec![flat.clone(), flat], ..Script::default() }, 5, "fields of view"),
        (Script { faults: vec![kept], ..Script::default() }, 5, "gives no image back"),
    ] {
        let wait = |child: &mut Child| {
            std::thread::sleep(Duration::from_secs(8));
            interrupt(child);
        };
        let Some(run) = meddled(&script, frames, wait) else { return };
        let told = run.said.lines().filter(|line| line.contains("nothing is shown")).collect::<Vec<_>>();
        assert!(told.len() == 1 && told[0].contains(reason), "{reason}: {}", run.said);
        assert_eq!((run.code, &run.told()["frames"]), (Some(0), &0.into()), "{reason}: {}", run.said);
    }
}

#[test]
fn views_without_a_size_get_one() {
    let unsized_view = |x| View { size: [0, 0], ..View::eye(x) };
    let script = Script { views: vec![unsized_view(-0.03), unsized_view(0.03)], ..Script::default() };
    let Some(run) = run(&script, 2, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(told["views"][0]["width"], 1024, "{told}");
    assert!(run.said.contains("recommends no size"), "{}", run.said);
}

#[test]
fn a_runtime_that_comes_later_is_waited_for_where_that_is_asked() {
    let away = |call: &str, result: &str| Fault { call: call.into(), from: 1, to: 3, result: result.into() };
    let script = Script {
        faults: vec![
            away("xrCreateInstance", "ERROR_RUNTIME_UNAVAILABLE"),
            away("xrGetSystem", "ERROR_FORM_FACTOR_UNAVAILABLE"),
            Fault { to: 6, ..away("xrCreateSession", "ERROR_INITIALIZATION_FAILED") },
        ],
        ..Script::default()
    };
    let Some(run) = run(&script, 3, "--wait") else { return };
    assert_eq!(run.is_clean().told()["frames"], 3, "{}", run.said);
    assert!(run.said.contains("finds no headset") && run.said.contains("waiting for it"), "{}", run.said);
    // Without the wish the reason ends it at once.
    let script = Script { faults: vec![away("xrGetSystem", "ERROR_FORM_FACTOR_UNAVAILABLE")], ..script };
    let run = super::run(&script, 3, "").unwrap();
    assert!(run.code == Some(1) && run.said.contains("finds no headset"), "{}", run.said);
}
