//! How far from the moment at which a picture is seen its poses were asked for:
//! `cargo bench --bench pose_age [-- --frames 60 --load 2]`.
//!
//! Runs the program on the tests' scripted OpenXR runtime, which knows when each picture is truly seen, whatever it
//! tells the program. Ages are those of the late correction's poses, in periods of the display; recovery is how many
//! frames after a fault's end were not yet within one period. With a load as many threads keep processors busy
//! meanwhile. Prints a table in Markdown.

// The tests use more of it.
#[path = "../tests/openxr_scripted/times.rs"]
#[allow(dead_code)]
mod times;

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

use fake_runtime::Setup;
use fake_runtime::script::{FrameRule, Head, Script, Session};
use foveate::metrics::stats::percentile;
use serde_json::Value;
use times::Shown;

/// Pictures that do not count: kernels and patterns are made for them.
const FIRST: usize = 5;

/// Frames in which a script goes wrong, the period of its display in milliseconds, and more flags.
struct Case {
    name: &'static str,
    period_ms: f64,
    rules: Vec<FrameRule>,
    flags: &'static str,
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str, usual: &str| {
        let at = arguments.iter().position(|argument| argument == flag);
        at.and_then(|at| arguments.get(at + 1)).map_or(usual, String::as_str).to_string()
    };
    let frames: u32 = value("--frames", "60").parse().expect("a number of frames");
    let load: usize = value("--load", "0").parse().expect("a number of threads");
    let folder = tempfile::tempdir().expect("a folder");
    let scene = folder.path().join("demo.glb");
    let mut made = Command::new(env!("CARGO_BIN_EXE_foveate"));
    made.args(["scene", "generate", "demo", "--out"]);
    assert!(made.arg(&scene).output().expect("the program").status.success(), "the demo scene is made");
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..load {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    std::hint::spin_loop()
                }
            });
        }
        println!(
            "foveate run demo.glb {FEW} --frames {frames}, two views of 96x80, {load} threads of load\n"
        );
        println!(
            "| case | period ms | frame ms p50 | age in periods: p50 | worst | within a period | recovery, frames |"
        );
        println!("| --- | --- | --- | --- | --- | --- | --- |");
        // What frames take here says how short eight periods are.
        let took = row(&light(), frames, &scene);
        for case in cases(took) {
            row(&case, frames, &scene);
        }
        over.store(true, Ordering::Relaxed);
    });
}

/// Periods that count as one: clocks are read some microseconds apart.
const NEAR: f64 = 1.005;

/// Few samples, whose number is not moved for the display's period.
const FEW: &str = "--samples 300 --rays 1";

/// A display that shows a picture for longer than frames take.
const SLOW: f64 = 60.0;

fn light() -> Case {
    Case { name: "light load", period_ms: SLOW, rules: Vec::new(), flags: FEW }
}

fn rule(from: u64, to: u64) -> FrameRule {
    FrameRule { from, to, ..FrameRule::default() }
}

/// What a runtime may do, where frames take so many milliseconds.
fn cases(took: f64) -> Vec<Case> {
    let case = |name, rules| Case { name, rules, ..light() };
    let shifted = |from, to, offset_ms| FrameRule { offset_ms, ..rule(from, to) };
    let outliers = |offsets: &[f64]| {
        let each = offsets.iter().enumerate();
        each.map(|(at, ms)| shifted(10 + 4 * at as u64, 0, *ms)).collect::<Vec<_>>()
    };
    let none = [0, -1, -5_000_000_000, i64::MIN];
    let none = none
        .iter()
        .enumerate()
        .map(|(at, time)| FrameRule { display_time: Some(*time), ..rule(10 + 4 * at as u64, 0) });
    let drift =
        (0..10).map(|at| FrameRule { should_render: Some(false), ..shifted(10 + at, 0, 400.0 * at as f64) });
    let slower = FrameRule { period_ms: Some(1000.0 / 15.0), ..rule(20, 100_000) };
    vec![
        Case { name: "frames of 8 periods", period_ms: (took / 8.0).max(1.0), ..light() },
        Case { name: "a held target", period_ms: 30.0, flags: "--target-ms display", ..light() },
        case("one time ahead by 0.3, 1, 2, 10 s", outliers(&[300.0, 1000.0, 2000.0, 10_000.0])),
        case("one time back by 0.3, 1, 2, 10 s", outliers(&[-300.0, -1000.0, -2000.0, -10_000.0])),
        case("a jump ahead by 0.5 s that lasts", vec![shifted(10, 100_000, 500.0)]),
        case("a jump back by 0.5 s that lasts", vec![shifted(10, 100_000, -500.0)]),
        case("drift by 4 s while hidden", drift.collect()),
        case("times of zero and less", none.collect()),
        Case { period_ms: 1000.0 / 22.5, ..case("90 to 60 Hz, four times as slow", vec![slower]) },
    ]
}

/// Runs a case and prints its line; how long its frames took, in milliseconds.
fn row(case: &Case, frames: u32, scene: &std::path::Path) -> f64 {
    let folder = tempfile::tempdir().expect("a folder");
    let script = Script {
        period_ms: case.period_ms,
        head: Head { yaw_rate: 40.0, ..Head::default() },
        sessions: vec![Session { frames: case.rules.clone(), ..Session::default() }],
        ..Script::default()
    };
    let setup = Setup::new(folder.path(), &script);
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.arg("run").arg(scene).args(["--json", "--frames", &frames.to_string()]);
    let output = setup.apply(command.args(case.flags.split(' '))).output().expect("the program");
    assert!(output.status.success(), "{}: {}", case.name, String::from_utf8_lossy(&output.stderr));
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let took = told["frame_ms"]["p50"].as_f64().unwrap_or(f64::NAN);
    let shown = times::shown(&setup.log());
    let counted = &shown[FIRST.min(shown.len())..];
    // A clock that has jumped for good is the display's own from then on.
    let lasting = case.rules.iter().any(|rule| rule.to >= 100_000 && rule.offset_ms != 0.0);
    let ages: Vec<f64> = counted.iter().map(|frame| age(frame, lasting)).collect();
    let sizes: Vec<f64> = ages.iter().map(|age| age.abs()).collect();
    let within = sizes.iter().filter(|age| **age < NEAR).count();
    println!(
        "| {} | {:.1} | {took:.1} | {:.2} | {:.2} | {within} of {} | {} |",
        case.name,
        case.period_ms,
        percentile(&ages, 50.0).unwrap_or(f64::NAN),
        sizes.iter().copied().fold(0.0, f64::max),
        sizes.len(),
        recovery(case, counted, &ages),
    );
    took
}

/// By how many periods the late correction's poses are too new (too old where less than 0).
fn age(frame: &Shown, lasting: bool) -> f64 {
    let seen = if lasting { frame.seen() + frame.told - frame.truth } else { frame.seen() };
    let (time, _) = frame.asked.last().expect("poses were asked for");
    (time - seen) as f64 / frame.period as f64
}

/// Frames from the end of the last fault, or the beginning of one that lasts, to the last that is off.
fn recovery(case: &Case, counted: &[Shown], ages: &[f64]) -> String {
    let Some(last) = case.rules.last() else { return "-".into() };
    let end = if last.to >= 100_000 { last.from } else { last.to.max(last.from) + 1 };
    let off = counted.iter().zip(ages).filter(|(frame, age)| frame.number >= end && age.abs() >= NEAR);
    let after = off.map(|(frame, _)| frame.number - end + 1).max();
    after.unwrap_or(0).to_string()
}
