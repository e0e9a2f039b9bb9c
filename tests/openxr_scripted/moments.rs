//! Poses are asked for the time at which the picture is seen, whatever the runtime says or does.

use fake_runtime::script::{FrameRule, Script, Session};
use serde_json::Value;

use super::times::{Shown, in_time, shown};
use super::{Run, run, sessions};

/// Frames that a machine can keep up with, however much else it does, last this long: milliseconds.
const LONG: f64 = 400.0;

fn with_frames(period_ms: f64, frames: Vec<FrameRule>) -> Script {
    Script { period_ms, ..sessions(vec![Session { frames, ..Session::default() }]) }
}

fn rule(from: u64, to: u64) -> FrameRule {
    FrameRule { from, to, ..FrameRule::default() }
}

/// Runs until so many frames are shown, with a head that moves so that late corrections are asked for.
fn frames_of(script: &Script, frames: u32) -> Option<(Run, Vec<Shown>)> {
    let run = run(script, frames, "")?;
    let shown = shown(&run.log);
    assert_eq!(shown.len(), frames as usize, "{}", run.said);
    // To move the wearer, to trace, and for each eye once more.
    assert!(shown.iter().all(|frame| frame.asked.len() == 4), "{shown:?}");
    Some((run, shown))
}

#[test]
fn poses_are_asked_for_the_display_time_that_is_told() {
    let Some((run, shown)) = frames_of(&with_frames(LONG, Vec::new()), 8) else { return };
    for frame in in_time(&shown) {
        let (told, asked) = (frame.told, &frame.asked);
        assert!(asked.iter().all(|(time, _)| *time == told), "{frame:?}");
    }
    // The last frames were seen as they were to be, unless the machine was busy with something else.
    let ages = &run.is_clean().told()["pose_age_ms"];
    for of in ["begin", "trace", "late"] {
        assert!(ages[of]["p50"].as_f64().unwrap().abs() < LONG, "{ages}");
    }
}

#[test]
fn each_picture_is_written_down_with_the_ages_of_its_poses() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.jsonl");
    let script = with_frames(LONG, Vec::new());
    let Some(run) = run(&script, 5, &format!("--log {}", path.display())) else { return };
    let (told, shown) = (run.is_clean().told(), shown(&run.log));
    let text = std::fs::read_to_string(&path).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 5, "{told}");
    for frame in in_time(&shown) {
        let line = &lines[shown.iter().position(|other| other.number == frame.number).unwrap()];
        let late = frame.asked.last().unwrap().0;
        let (age, seen) = (&line["pose_age_ms"]["late"], line["display_time_s"].as_f64().unwrap());
        assert!((age.as_f64().unwrap() - (late as f64 * 1e-6 - seen * 1e3)).abs() < 0.1, "{line} {frame:?}");
    }
}

#[test]
fn one_wrong_time_spoils_nothing() {
    let wrong = |frame, offset_ms| FrameRule { offset_ms, ..rule(frame, 0) };
    let rules = vec![
        wrong(4, 2000.0),
        wrong(6, -700.0),
        wrong(8, 9000.0),
        FrameRule { display_time: Some(0), ..rule(10, 0) },
        FrameRule { display_time: Some(-5), ..rule(12, 0) },
    ];
    let Some((run, shown)) = frames_of(&with_frames(100.0, rules), 14) else { return };
    let in_time: Vec<u64> = in_time(&shown).iter().map(|frame| frame.number).collect();
    for frame in shown.iter().skip(1) {
        // Late frames are asked for later, by no more than they were late.
        let seen = frame.seen();
        let usual = |off: &f64| *off >= -1.0 && (*off <= 1.0 || !in_time.contains(&frame.number));
        assert!(frame.off(frame.truth).iter().all(usual), "{frame:?}");
        assert!(frame.asked.iter().all(|(time, _)| *time <= seen + 10 * frame.period), "{frame:?}");
    }
    // Nothing is counted that never happened: 2 s ahead would be 20 frames.
    assert!(run.told()["dropped"].as_u64().unwrap() < 20, "{}", run.out);
}

#[test]
fn times_that_stay_shifted_are_followed_after_a_few_frames() {
    for offset_ms in [-1500.0, 1500.0] {
        let shifted = FrameRule { offset_ms, ..rule(4, 100) };
        let Some((_, shown)) = frames_of(&with_frames(LONG, vec![shifted]), 10) else { return };
        for frame in in_time(&shown).into_iter().filter(|frame| frame.number >= 9) {
            assert!(frame.off(frame.told).iter().all(|off| off.abs() <= 1.0), "{offset_ms}: {frame:?}");
        }
    }
}

#[test]
fn a_hidden_spell_with_times_far_ahead_leaves_nothing_behind() {
    let hidden = FrameRule { offset_ms: 4000.0, should_render: Some(false), ..rule(4, 9) };
    let Some((_, shown)) = frames_of(&with_frames(LONG, vec![hidden]), 8) else { return };
    for frame in in_time(&shown).into_iter().filter(|frame| frame.number >= 10) {
        assert!(frame.off(frame.truth).iter().all(|off| off.abs() <= 1.0), "{frame:?}");
    }
}

#[test]
fn frames_that_take_many_periods_are_not_asked_for_moments_that_are_past() {
    // No machine makes a frame in 2 ms here.
    let Some((run, shown)) = frames_of(&with_frames(2.0, Vec::new()), 12) else { return };
    let mut late = 0;
    for frame in &shown {
        late += u32::from(!frame.in_time());
        for (time, when) in &frame.asked {
            assert!(time >= when || *time >= frame.truth, "asked for {} ns ago: {frame:?}", when - time);
        }
    }
    assert!(late > 6, "{shown:?}");
    // The next frame's time is told no longer before its begin than a frame takes.
    assert_eq!(run.is_clean().told()["frames"], 12);
}

#[test]
fn a_display_that_changes_its_period_is_followed() {
    let slower = FrameRule { period_ms: Some(LONG * 1.5), ..rule(5, 100) };
    let Some((_, shown)) = frames_of(&with_frames(LONG, vec![slower]), 9) else { return };
    for frame in in_time(&shown) {
        assert!(frame.off(frame.truth).iter().all(|off| off.abs() < 1e-6), "{frame:?}");
    }
}
