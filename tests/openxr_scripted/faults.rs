//! Every call that the program makes times every code that OpenXR lists for it (`codes.rs`), once and for good:
//! what is done is what the table says, nothing ends the program but the last resort's sentence, nothing is silent,
//! and the summary is always told.
//!
//! Here some of the codes that cost a new instance are left out, and most that are given for good; `make test-long`
//! tries them all.

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use fake_runtime::order::State::{self, Exiting, Idle, LossPending, Stopping, Synchronized, Visible};
use fake_runtime::script::{Fault, Gaze, Head, Script, SeenHand, Session, Step, When};

use super::codes::{BEFORE, Call, ENDS, Part, Remedy, SESSIONS};
use super::{Run, command, finished, possible, run, sessions};

/// A call and what it says.
type Case = (&'static Call, &'static str);

fn fault(call: &str, from: u64, to: u64, result: &str) -> Fault {
    Fault { call: call.into(), from, to, result: result.into() }
}

/// A headset of which everything is asked: eyes and hands are tracked, which act as the simple controller does.
fn headset(script: Script) -> Script {
    let gaze = vec![Gaze { frame: 1, yaw: 10.0, ..Gaze::default() }];
    let profile = Some("/interaction_profiles/khr/simple_controller".into());
    let seen_hands = [true, false].map(|left| SeenHand { frame: 1, left, ..SeenHand::default() }).to_vec();
    Script { eye_tracker: true, gaze, profile, seen_hands, period_ms: 5.0, ..script }
}

/// What makes the program ask for a rate too.
const ASKING: &str = "--set headset.refresh_hz=52";

/// As many as no test sees: the script ends its runs.
const NO_END: u32 = 1_000_000;

/// A session that goes through more states than usual at a frame.
fn leading(frame: u64, go: &[State]) -> Session {
    let usual = Session::default();
    let step = Step { at: When::Frame(frame), go: go.to_vec() };
    Session { steps: usual.steps.iter().cloned().chain([step]).collect(), ..usual }
}

/// A session in which a call fails once, and which is lost after some frames if that has not lost it.
fn failing((call, code): Case) -> Session {
    let Part::Session(nth) = call.part else {
        // Its end is what fails.
        let ending = leading(5, &[Visible, Synchronized, Stopping]);
        return Session { faults: vec![fault(call.name, 1, 0, code)], ..ending };
    };
    Session { faults: vec![fault(call.name, nth, 0, code)], ..leading(7, &[LossPending]) }
}

/// A session that the wearer leaves.
fn last() -> Session {
    let mut session = leading(5, &[Visible, Synchronized, Stopping]);
    session.steps.retain(|step| step.at != When::Ended(1));
    session.steps.push(Step { at: When::Ended(1), go: vec![Idle, Exiting] });
    session
}

/// Whether the default run leaves a case out: every new instance costs a second.
fn is_dear(index: usize, (call, code): Case) -> bool {
    call.remedy(code) == Remedy::Instance && !index.is_multiple_of(6)
}

/// Each call with each of its codes, code by code, so that calls take turns.
fn cases(calls: impl Iterator<Item = &'static Call>) -> Vec<Case> {
    let mut cases: Vec<Case> =
        calls.flat_map(|call| call.codes().into_iter().map(move |code| (call, code))).collect();
    cases.sort_by_key(|(_, code)| *code);
    cases
}

/// Cases of sessions, each in one of its own.
fn in_sessions() -> Vec<Case> {
    let counted = |call: &&Call| matches!(call.part, Part::Session(_));
    cases(SESSIONS.iter().filter(counted).chain([&ENDS]))
}

/// Runs through sessions in each of which one thing fails.
fn assert_remedies(cases: &[Case]) {
    let scripted = cases.iter().copied().map(failing).chain([last()]).collect();
    let Some(run) = run(&headset(sessions(scripted)), NO_END, ASKING) else { return };
    assert_eq!(run.log.leftovers(), Vec::<String>::new());
    let hit = run.log.0.iter().filter(|record| record.0["scripted"] == true);
    let hit: Vec<_> = hit.map(|record| (record.call(), record.result())).collect();
    let wanted: Vec<_> = cases.iter().map(|(call, code)| (call.name, *code)).collect();
    assert_eq!(hit, wanted, "{}", run.said);
    // Each session is followed by another one, and by a new instance where that is the remedy.
    let instances = cases.iter().filter(|(call, code)| call.remedy(code) == Remedy::Instance).count();
    let told = run.told();
    assert_eq!((run.code, &told["losses"]), (Some(0), &cases.len().into()), "{}", run.said);
    assert_eq!(run.log.calls("xrCreateInstance").len(), 1 + instances, "{}", run.said);
    // Without what was refused, a session shows as many frames as any other.
    let goes_on = cases.iter().filter(|(call, code)| call.remedy(code) == Remedy::GoesOn).count();
    assert!(told["frames"].as_u64().unwrap() >= 3 * goes_on as u64, "{told}");
}

#[test]
fn what_fails_once_in_a_session_has_its_remedy() {
    let all = in_sessions();
    let cheap: Vec<Case> = all
        .iter()
        .copied()
        .enumerate()
        .filter(|(at, case)| !is_dear(*at, *case))
        .map(|(_, case)| case)
        .collect();
    assert!(cheap.len() > 120, "{}", cheap.len());
    assert_remedies(&cheap);
}

#[test]
#[ignore = "takes minutes"]
fn long_whatever_fails_once_in_a_session_has_its_remedy() {
    let all = in_sessions();
    let dear: Vec<Case> = all
        .iter()
        .copied()
        .enumerate()
        .filter(|(at, case)| is_dear(*at, *case))
        .map(|(_, case)| case)
        .collect();
    assert!(!dear.is_empty());
    assert_remedies(&dear);
}

/// Calls of the instance that a session makes: one code after the other, as often as they come.
#[test]
fn what_the_instance_refuses_a_session_once_is_done_without() {
    let calls = || SESSIONS.iter().filter(|call| call.part == Part::Open);
    let fails = |call: &'static Call| {
        let codes = call.codes().into_iter().enumerate();
        codes.map(|(at, code)| fault(call.name, at as u64 + 1, 0, code))
    };
    let faults: Vec<Fault> = calls().flat_map(fails).collect();
    let wanted = faults.len();
    let brief = (0..24).map(|_| leading(7, &[LossPending])).chain([last()]).collect();
    let script = headset(Script { faults, ..sessions(brief) });
    let Some(run) = run(&script, NO_END, ASKING) else { return };
    let hit = run.log.0.iter().filter(|record| record.0["scripted"] == true).count();
    assert_eq!((run.code, hit), (Some(0), wanted), "{}", run.said);
    // Only a lost instance is one.
    assert_eq!(run.log.calls("xrCreateInstance").len(), 1 + calls().count(), "{}", run.said);
    assert_eq!(run.told()["losses"], 24, "{}", run.said);
}

/// What fails as a runtime comes back: code after code of call after call, every `nth` of them.
fn assert_waited_for(nth: usize, beside: usize) {
    let mut faults = Vec::new();
    for call in &BEFORE {
        let first = match call.part {
            Part::Connect(times) => times + 1,
            _ if call.name == "xrPollEvent" => 12,
            _ => 2,
        };
        let codes = call.codes().into_iter().enumerate().filter(|(at, _)| at % nth == beside % nth);
        let codes = codes.map(|(_, code)| code).enumerate();
        faults.extend(codes.map(|(at, code)| fault(call.name, first + at as u64, 0, code)));
    }
    let lost =
        Session { faults: vec![fault("xrEndFrame", 3, 0, "ERROR_INSTANCE_LOST")], ..Session::default() };
    let (wanted, script) = (faults.len() + 1, Script { faults, ..sessions(vec![lost]) });
    let Some(run) = run(&headset(script), 12, "--wait") else { return };
    let hit = run.log.0.iter().filter(|record| record.0["scripted"] == true).count();
    assert_eq!((run.code, hit), (Some(0), wanted), "{}", run.said);
    assert_eq!(run.is_clean().told()["frames"], 12, "{}", run.said);
}

#[test]
fn a_runtime_that_comes_back_bit_by_bit_is_waited_for() {
    assert_waited_for(4, 1);
}

#[test]
#[ignore = "takes a minute"]
fn long_a_runtime_that_comes_back_with_every_fault_is_waited_for() {
    for beside in [0, 2, 3] {
        assert_waited_for(4, beside);
    }
}

/// How long a run may take that fails for good, on a machine that is busy.
const LONGEST: Duration = Duration::from_secs(240);
/// How long such a run may say nothing: it says something after 5 s, where the machine lets it.
const SILENT: Duration = Duration::from_secs(30);

/// Runs with a call that fails for good; how long the program said nothing at most, too.
fn for_good((call, code): Case) -> (Run, Duration) {
    let folder = tempfile::tempdir().unwrap();
    let script = headset(Script { faults: vec![fault(call.name, 1, u64::MAX, code)], ..Script::default() });
    let (mut command, setup) = command(folder.path(), &script, 4, ASKING);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let said = std::thread::spawn(move || {
        let (mut text, mut last, mut silent) = (String::new(), Instant::now(), Duration::ZERO);
        for line in lines.map_while(Result::ok) {
            silent = silent.max(last.elapsed());
            last = Instant::now();
            text += &(line + "\n");
        }
        (text, silent.max(last.elapsed()))
    });
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < LONGEST, "{} {code}: it does not end", call.name);
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut output = child.wait_with_output().unwrap();
    let (text, silent) = said.join().unwrap();
    output.stderr = text.into_bytes();
    (finished(output, setup.log(), folder), silent)
}

/// The program ended as it should: by itself, with a summary, and where it gave up with the reason.
fn assert_orderly(case: Case) {
    let (call, code) = case;
    let what = format!("{} {code}", call.name);
    let (run, silent) = for_good(case);
    assert!(silent < SILENT, "{what}: nothing is said for {silent:?}: {}", run.said);
    // Without views or images there is nothing to show.
    let vital = matches!(call.name, "xrLocateViews" | "xrCreateSwapchain");
    let lives = call.part == Part::End || (call.remedy(code) == Remedy::GoesOn && !vital);
    assert_eq!(run.code, Some(i32::from(!lives)), "{what}: {}", run.said);
    let opened = !run.log.calls("session").is_empty();
    if !lives {
        let last = run.said.trim_end().lines().last().unwrap_or_default();
        let told: serde_json::Value = serde_json::from_str(last).unwrap_or_default();
        let message = told["error"]["message"].as_str().unwrap_or_default();
        assert!(message.len() > 40 && message.contains(';'), "{what}: {}", run.said);
    }
    // A session that could not be set up has nothing to tell of.
    let set_up = opened && !run.out.is_empty();
    assert!(set_up || !lives, "{what}: {}", run.said);
    if set_up {
        let frames = run.told()["frames"].as_u64();
        assert_eq!(frames == Some(4), lives, "{what}: {}", run.out);
    }
    assert_eq!(run.log.leftovers(), Vec::<String>::new(), "{what}");
}

/// All cases, some at a time.
fn assert_all_orderly(cases: &[Case]) {
    assert!(!cases.is_empty());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    assert_orderly(*case);
                }
            });
        }
    });
}

fn all_for_good() -> Vec<Case> {
    cases(BEFORE.iter().chain(&SESSIONS).chain([&ENDS]))
}

#[test]
fn what_fails_for_good_ends_in_order() {
    if possible() {
        let some: Vec<Case> = all_for_good().into_iter().step_by(19).collect();
        assert_all_orderly(&some);
    }
}

#[test]
#[ignore = "takes many minutes"]
fn long_whatever_fails_for_good_ends_in_order() {
    if possible() {
        assert_all_orderly(&all_for_good());
    }
}

#[test]
fn what_is_refused_for_good_is_told_once_and_gone_without() {
    for (call, says) in [
        ("xrLocateSpace", "gaze"),
        ("xrGetActionStatePose", "gaze"),
        ("xrSyncActions", "not followed"),
        ("xrCreateActionSpace", "not used"),
        ("xrAttachSessionActionSets", "not"),
    ] {
        let faults = vec![fault(call, 1, 100_000, "ERROR_VALIDATION_FAILURE")];
        let Some(run) = run(&headset(Script { faults, ..Script::default() }), 8, "") else { return };
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

/// Codes of success that are no plain success change nothing.
#[test]
fn frames_that_are_discarded_and_losses_that_are_announced_change_nothing() {
    let faults = vec![
        fault("xrBeginFrame", 4, 9, "FRAME_DISCARDED"),
        fault("xrSyncActions", 3, 5, "SESSION_NOT_FOCUSED"),
        fault("xrLocateViews", 20, 30, "SESSION_LOSS_PENDING"),
    ];
    let session = Session { faults, ..Session::default() };
    let Some(run) = run(&headset(sessions(vec![session])), 14, "") else { return };
    let told = run.is_clean().told();
    assert_eq!((&told["frames"], &told["losses"]), (&14.into(), &0.into()), "{}", run.said);
    let discarded = run.log.calls("xrBeginFrame").iter().filter(|r| r.result() == "FRAME_DISCARDED").count();
    assert_eq!(discarded, 6);
    // Each of those frames shows its picture.
    let shown: Vec<u64> = run.layers().iter().map(|(frame, _)| frame.0["frame"].as_u64().unwrap()).collect();
    assert!((4..=9).all(|frame| shown.contains(&frame)), "{shown:?}");
}

/// A compositor that keeps its images for a while sees the last picture meanwhile.
#[test]
fn a_picture_stays_where_no_image_can_be_had_for_the_next() {
    let faults = vec![fault("xrWaitSwapchainImage", 14, 16, "TIMEOUT_EXPIRED")];
    let session = Session { faults, ..Session::default() };
    // A head that turns is elsewhere in every new picture.
    let head = Head { yaw_rate: 3.0, ..Head::default() };
    let Some(run) = run(&Script { head, ..sessions(vec![session]) }, 8, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 8, "{}", run.said);
    let frames = run.frames();
    // After the last picture the session ends, soon or later.
    let last = frames.iter().rposition(|frame| frame.0["layers"][0].is_object()).unwrap();
    let wanted: Vec<_> = frames[..=last].iter().filter(|frame| frame.0["should_render"] == true).collect();
    // The first shows that a picture is being made.
    let poses: Vec<_> =
        wanted.iter().skip(1).map(|frame| &frame.0["layers"][0]["views"][0]["pose"]).collect();
    assert!(poses.iter().all(|pose| pose.is_array()), "a frame shows nothing: {wanted:?}");
    // Eight pictures, one of which stays for three more frames; late frames may be of one time besides.
    assert_eq!(poses.len(), 8 + 3, "{poses:?}");
    assert!(poses.windows(2).filter(|pair| pair[0] == pair[1]).count() >= 3, "{poses:?}");
}
