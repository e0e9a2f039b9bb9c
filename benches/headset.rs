//! What a headset asks of the program beside tracing:
//! `cargo bench --bench headset [-- --runs 3 --frames 300 --width 128 --height 64 --target-ms 10]`.
//!
//! Runs the program on Monado with its simulated headset, whose head moves, and its real compositor at 60 Hz on a
//! screen in memory. The program tells the times of poses and pictures; the CPU time of its threads is the
//! kernel's (/proc, Linux), counted after the first pictures. Prints a table in Markdown, and how much of the
//! machine the compositor took. Needs what `scripts/install-packages.sh test` installs.

// The tests use more of both.
#[path = "../tests/openxr/monado.rs"]
#[allow(dead_code)]
mod monado;
#[path = "../tests/openxr/window.rs"]
#[allow(dead_code)]
mod window;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use monado::Monado;
use serde_json::Value;
use window::Screen;

/// Pictures that do not count: kernels and patterns are made for them.
const FIRST: usize = 30;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str, usual: &str| {
        let at = arguments.iter().position(|argument| argument == flag);
        at.and_then(|at| arguments.get(at + 1)).map_or(usual, String::as_str).to_string()
    };
    if !monado::installed() || !window::installed() {
        return;
    }
    let runs: usize = value("--runs", "3").parse().expect("a number of runs");
    let flags = [
        ("--frames", value("--frames", "300")),
        ("--width", value("--width", "128")),
        ("--height", value("--height", "64")),
        ("--target-ms", value("--target-ms", "10")),
    ];
    let said: Vec<String> = flags.iter().map(|(flag, value)| format!("{flag} {value}")).collect();
    println!("foveate run demo.glb {}, Monado's compositor at 60 Hz\n", said.join(" "));
    println!(
        "| run | on time | dropped | frame ms: p50, p99 | pose to end ms: p50, p99 | loop CPU ms a frame | waiting CPU ms a frame | all CPU ms a frame | last samples x rays |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for number in 1..=runs {
        println!("| {number} | {} |", run(&flags));
    }
}

/// One run; the cells of its line.
fn run(flags: &[(&str, String)]) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    let screen = Screen::start();
    let settings = [
        ("SIMULATED_ENABLE", "1".to_string()),
        ("XRT_COMPOSITOR_FORCE_XCB", "1".to_string()),
        ("XRT_COMPOSITOR_DEFAULT_FRAMERATE", "60".to_string()),
        ("DISPLAY", screen.name().to_string()),
        ("IPC_LOG", "trace".to_string()),
    ];
    let monado = Monado::start(folder.path(), &settings);
    let foveate = || Command::new(env!("CARGO_BIN_EXE_foveate"));
    let made =
        foveate().args(["scene", "generate", "demo", "--out"]).arg(folder.path().join("demo.glb")).output();
    assert!(made.expect("the program").status.success(), "the demo scene is made");
    let mut client = foveate();
    client.current_dir(folder.path()).args(["run", "demo.glb", "--json"]).stdin(Stdio::null());
    client.args(flags.iter().flat_map(|(flag, value)| [*flag, value]));
    monado.serve(&mut client);
    let mut child = client.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program");
    let (mut first, mut last) = (None, None);
    while child.try_wait().expect("the program's state").is_none() {
        let shown = monado.calls("compositor_layer_sync");
        let seen = (shown, threads(child.id()));
        // At the end threads go, and what they took goes with them.
        if shown >= FIRST && seen.1.contains_key(WAITING) {
            last = Some(seen.clone());
            first = first.or(Some(seen));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let output = child.wait_with_output().expect("the program's output");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let (first, last) = first.zip(last).expect("more pictures: give --frames");
    let frames = (last.0 - first.0) as f64;
    let spent = |name: &str| {
        let of = |threads: &BTreeMap<String, f64>| {
            threads
                .iter()
                .filter(|(thread, _)| name.is_empty() || *thread == name)
                .map(|(_, ms)| ms)
                .sum::<f64>()
        };
        (of(&last.1) - of(&first.1)) / frames
    };
    let pair = |key: &str| format!("{:.1}, {:.1}", number(&told[key]["p50"]), number(&told[key]["p99"]));
    let share = 100.0 * number(&told["on_time"]) / number(&told["frames"]);
    let held = &told["budget"]["last"];
    let made = if held.is_null() { "-".into() } else { format!("{} x {}", told["samples"], held["rays"]) };
    format!(
        "{share:.0} % | {} | {} | {} | {:.2} | {:.2} | {:.1} | {made}",
        told["dropped"],
        pair("frame_ms"),
        pair("pose_ms"),
        spent(LOOP),
        spent(WAITING),
        spent(""),
    )
}

/// The name under which the program's first thread, the loop, is counted.
const LOOP: &str = "loop";
/// That of the one that waits for the runtime's frames.
const WAITING: &str = "xr-wait";

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// Milliseconds of CPU time that threads of a process have taken, by name; none where it has ended.
fn threads(process: u32) -> BTreeMap<String, f64> {
    let mut spent = BTreeMap::new();
    let Ok(tasks) = std::fs::read_dir(format!("/proc/{process}/task")) else { return spent };
    for task in tasks.flatten() {
        let read = |file: &str| std::fs::read_to_string(task.path().join(file));
        let (Ok(name), Ok(times)) = (read("comm"), read("schedstat")) else { continue };
        let nanoseconds: f64 = times.split(' ').next().and_then(|ns| ns.parse().ok()).unwrap_or(0.0);
        let first = task.path().ends_with(Path::new(&process.to_string()));
        let name = if first { LOOP } else { name.trim() };
        *spent.entry(name.to_string()).or_default() += nanoseconds * 1e-6;
    }
    spent
}
