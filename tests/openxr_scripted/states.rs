//! Session states in every order that OpenXR allows.

use std::collections::BTreeSet;
use std::process::{Command, Stdio};

use fake_runtime::order::State::{self, *};
use fake_runtime::script::{Script, Session, Step, When};

use super::{await_frames, command, finished, possible, run, sessions};

fn session(steps: &[(When, &[State])]) -> Session {
    let steps = steps.iter().map(|&(at, go)| Step { at, go: go.to_vec() }).collect();
    Session { steps, ..Session::default() }
}

const UP: (When, &[State]) = (When::Frame(1), &[Synchronized, Visible, Focused]);
const START: (When, &[State]) = (When::Created, &[Idle, Ready]);

#[test]
fn sessions_that_are_hidden_stopped_and_begun_again_go_on() {
    let script = sessions(vec![session(&[
        START,
        UP,
        (When::Frame(4), &[Visible]),
        (When::Frame(6), &[Synchronized]),
        (When::Frame(8), &[Visible]),
        (When::Frame(10), &[Synchronized, Stopping]),
        (When::Ended(1), &[Idle, Ready]),
        // The second time it is stopped before any frame.
        (When::Begun(2), &[Synchronized, Stopping]),
        (When::Ended(2), &[Idle, Ready]),
        // A runtime may change its mind at any speed.
        (When::Begun(3), &[Synchronized, Visible, Synchronized, Visible, Focused, Visible]),
        (When::Ended(3), &[Idle, Exiting]),
    ])]);
    let Some(run) = run(&script, 12, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((told["frames"].as_u64(), told["losses"].as_u64()), (Some(12), Some(0)), "{told}");
    assert_eq!(run.log.calls("xrBeginSession").len(), 3);
    assert_eq!(run.log.calls("xrEndSession").len(), 3);
    assert_eq!(run.log.calls("xrCreateSession").len(), 1);
    // The wearer is shown nothing while the session is hidden.
    let hidden = run.frames().into_iter().filter(|frame| frame.0["should_render"] == false);
    assert!(hidden.map(|frame| assert!(frame.0["layers"][0].is_null(), "{frame:?}")).count() >= 3);
}

#[test]
fn a_runtime_that_asks_the_program_to_leave_is_obeyed() {
    let leaves: [&[State]; 3] = [&[Visible, Synchronized, Stopping], &[Visible], &[]];
    let scripts = [
        session(&[START, UP, (When::Frame(6), leaves[0]), (When::Ended(1), &[Idle, Exiting])]),
        // Not even begun.
        session(&[(When::Created, &[Idle, Exiting])]),
        session(&[START, (When::Begun(1), &[Synchronized, Stopping]), (When::Ended(1), &[Idle, Exiting])]),
    ];
    for (index, script) in scripts.into_iter().enumerate() {
        let Some(run) = run(&sessions(vec![script]), 1000, "") else { return };
        let shown = run.is_clean().told()["frames"].as_u64().unwrap();
        assert_eq!(shown > 0, index == 0, "script {index}: {shown} frames");
        assert_eq!(run.log.calls("xrCreateSession").len(), 1, "script {index}");
    }
}

#[test]
fn ctrl_c_asks_the_runtime_to_let_the_program_leave() {
    if !possible() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command(folder.path(), &Script::default(), 100_000, "");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    await_frames(&mut child, folder.path(), 4);
    assert!(setup.log().calls("xrRequestExitSession").is_empty());
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let run = finished(child.wait_with_output().unwrap(), setup.log(), folder);
    assert!(run.is_clean().told()["frames"].as_u64() >= Some(3));
    // The runtime then stops the session, and takes it away.
    for call in ["xrRequestExitSession", "xrEndSession", "xrDestroySession"] {
        assert_eq!(run.log.calls(call).len(), 1, "{call}");
    }
}

#[test]
fn a_session_that_will_be_lost_is_replaced_from_every_state() {
    let all = vec![
        session(&[(When::Created, &[Idle, LossPending])]),
        session(&[(When::Created, &[Idle, Ready, LossPending])]),
        session(&[START, (When::Frame(2), &[Synchronized, LossPending])]),
        session(&[START, (When::Frame(2), &[Synchronized, Visible]), (When::Frame(4), &[LossPending])]),
        session(&[START, UP, (When::Frame(4), &[LossPending])]),
        session(&[START, UP, (When::Frame(4), &[Visible, Synchronized, Stopping, LossPending])]),
        session(&[
            START,
            UP,
            (When::Frame(4), &[Visible, Synchronized, Stopping]),
            (When::Ended(1), &[Idle, LossPending]),
        ]),
    ];
    let lost = all.len();
    let Some(run) = run(&sessions(all), 20, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(told["frames"], 20, "{told}");
    assert_eq!(told["losses"], lost, "{told}");
    assert_eq!(run.log.calls("xrCreateSession").len(), lost + 1);
}

/// A walk along the specification's arrows while frames are made, which ends where frames go on.
fn walk(mut seed: u64) -> Session {
    let mut choose = |choices: &[State]| {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        choices[(seed >> 33) as usize % choices.len()]
    };
    let mut steps = vec![(When::Created, vec![Idle, Ready])];
    let (mut state, mut frame, mut ends) = (Ready, 0, 0);
    for _ in 0..24 {
        frame += 1;
        let next = match state {
            Ready => choose(&[Synchronized]),
            Synchronized => choose(&[Visible, Visible, Stopping]),
            Visible => choose(&[Focused, Focused, Synchronized]),
            _ => Visible,
        };
        assert!(state.may_become(next));
        steps.push((When::Frame(frame), vec![next]));
        state = next;
        if next == Stopping {
            ends += 1;
            steps.push((When::Ended(ends), vec![Idle, Ready]));
            // Frames that are still waited for while it stops count.
            frame += 5;
            state = Ready;
        }
    }
    if state == Ready || state == Synchronized {
        let up = if state == Ready { vec![Synchronized, Visible] } else { vec![Visible] };
        steps.push((When::Frame(frame + 1), up));
    }
    let steps = steps.into_iter().map(|(at, go)| Step { at, go }).collect();
    Session { steps, ..Session::default() }
}

#[test]
fn random_walks_along_all_arrows_are_followed() {
    let mut arrows = BTreeSet::new();
    for seed in 0..4 {
        let Some(run) = run(&sessions(vec![walk(seed)]), 24, "") else { return };
        assert_eq!(run.is_clean().told()["frames"], 24, "walk {seed}");
        let polled = run.log.calls("xrPollEvent");
        let states: Vec<&str> = polled.iter().filter_map(|r| r.0["state"].as_str()).collect();
        arrows.extend(states.windows(2).map(|pair| format!("{} {}", pair[0], pair[1])));
    }
    for arrow in [
        "IDLE READY",
        "READY SYNCHRONIZED",
        "SYNCHRONIZED VISIBLE",
        "VISIBLE FOCUSED",
        "FOCUSED VISIBLE",
        "VISIBLE SYNCHRONIZED",
        "SYNCHRONIZED STOPPING",
        "STOPPING IDLE",
        "IDLE EXITING",
    ] {
        assert!(arrows.contains(arrow), "{arrow} was not walked: {arrows:?}");
    }
}
