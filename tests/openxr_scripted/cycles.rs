//! What is built anew again and again leaves nothing behind.

use fake_runtime::order::State::{Idle, LossPending, Ready, Stopping, Synchronized, Visible};
use fake_runtime::script::{Fault, Session, Step, When};

use super::{Run, run, sessions};

/// What comes before the first picture, one picture, and then the session is about to be lost.
fn short() -> Session {
    let step = |at, go: &[_]| Step { at, go: go.to_vec() };
    let steps = vec![
        step(When::Created, &[Idle, Ready]),
        step(When::Frame(1), &[Synchronized, Visible]),
        step(When::Frame(3), &[LossPending]),
    ];
    Session { steps, ..Session::default() }
}

/// File descriptors, threads and memory (KiB) of the program at each call of a kind.
fn held(run: &Run, call: &str) -> Vec<[u64; 3]> {
    let calls = run.log.calls(call);
    calls.iter().map(|r| ["fds", "threads", "memory_kib"].map(|key| r.0[key].as_u64().unwrap())).collect()
}

/// Whether later sessions hold more than those that came when all was warm; memory may creep by `slack` KiB. Drivers
/// take memory once for what was never needed before, such as a shader for the first late frame: the two largest
/// steps do not count, while what each session leaves behind comes in many.
fn assert_steady(held: &[[u64; 3]], warm: usize, slack: i64) {
    // A thread of the session before may just be ending; what is left behind is still there in the next ones.
    let least = |kind: usize| held[held.len() - 3..].iter().map(|held| held[kind]).min();
    assert!(least(0) <= Some(held[warm][0]) && least(1) <= Some(held[warm][1]), "{held:?}");
    let steps = held[warm..].windows(2).map(|pair| pair[1][2] as i64 - pair[0][2] as i64);
    let mut steps: Vec<i64> = steps.collect();
    steps.sort_unstable();
    let crept: i64 = steps[..steps.len().saturating_sub(2)].iter().sum();
    assert!(crept <= slack, "{crept} KiB: {held:?}");
}

#[test]
fn what_each_session_leaves_behind_is_found() {
    let held = |leak: u64, once: u64| -> Vec<[u64; 3]> {
        (0..101).map(|at| [7, 14, 200_000 + leak * at + if at > 50 { once } else { 0 }]).collect()
    };
    assert_steady(&held(0, 32_000), 20, 6 << 10);
    assert!(std::panic::catch_unwind(|| assert_steady(&held(175, 0), 20, 6 << 10)).is_err());
}

#[test]
fn a_hundred_sessions_leave_nothing_behind() {
    let Some(run) = run(&sessions(vec![short(); 100]), 120, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(told["losses"], 100, "{told}");
    let held = held(&run, "xrCreateSession");
    assert_eq!(held.len(), 101);
    // The images of 80 sessions alone would be 14 MiB.
    assert_steady(&held, 20, 6 << 10);
}

#[test]
fn a_hundred_stops_and_starts_of_one_session_leave_nothing_behind() {
    let step = |at, go: &[_]| Step { at, go: go.to_vec() };
    let mut steps = vec![step(When::Created, &[Idle, Ready]), step(When::Frame(1), &[Synchronized, Visible])];
    for time in 1..100 {
        steps.push(step(When::Begun(time), &[Synchronized, Stopping]));
        steps.push(step(When::Ended(time), &[Idle, Ready]));
    }
    let session = Session { steps, ..Session::default() };
    let Some(run) = run(&sessions(vec![session]), 4, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 4);
    let held = held(&run, "xrBeginSession");
    assert_eq!(held.len(), 100);
    assert_steady(&held, 20, 6 << 10);
}

#[test]
fn twelve_instances_leave_nothing_behind() {
    let fault = Fault { call: "xrLocateViews".into(), from: 16, to: 0, result: "ERROR_INSTANCE_LOST".into() };
    let lost = Session { faults: vec![fault], ..Session::default() };
    let Some(run) = run(&sessions(vec![lost; 12]), 40, "") else { return };
    let told = run.is_clean().told();
    assert_eq!(told["losses"], 12, "{told}");
    assert_steady(&held(&run, "xrCreateSession"), 4, 32 << 10);
}

#[test]
#[should_panic]
fn a_leak_is_noticed() {
    assert_steady(&[[9, 4, 5000], [9, 4, 5010], [10, 4, 5010], [11, 4, 5010], [12, 4, 5010]], 1, 100);
}
