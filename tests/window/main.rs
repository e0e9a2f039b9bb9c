//! `foveate demo` in a window of a display that exists in memory only: what stands on the screen is what the
//! lens model says.

#[path = "../common/mod.rs"]
mod common;

mod keys;
mod lens;
mod screen;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::builder::Builder;
use lens::{Eye, Model};
use screen::{Screen, Screenshot};
use serde_json::{Value, json};

/// Metres: a bright upright bar to the left, a level one above, and a small mark at the lower right.
const BAR: [f64; 3] = [-0.7, 0.0, -1.5];
const BEAM: [f64; 3] = [0.0, 0.8, -1.5];
const MARK: [f64; 3] = [0.9, -0.8, -1.5];
const IPD: f64 = 0.064;

/// Three bright rectangles in the dark, and a camera at the origin that looks along -Z.
fn bars(folder: &Path) {
    let mut builder = Builder::new();
    let corners = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let glow = json!({
        "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1] }, "emissiveFactor": [1, 1, 1],
        "doubleSided": true
    });
    let material = builder.push("materials", glow);
    for (place, scale) in [(BAR, [0.03, 0.6, 1.0]), (BEAM, [0.6, 0.03, 1.0]), (MARK, [0.06, 0.06, 1.0])] {
        let primitive =
            json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
        builder.place(primitive, json!({ "translation": place, "scale": scale }));
    }
    let camera = json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } });
    let camera = builder.push("cameras", camera);
    let node = builder.push("nodes", json!({ "camera": camera }));
    builder.show(node);
    builder.write_glb(folder);
}

/// Settings for pictures that are quick and sharp: every pixel sampled, no light but the bars' own.
const SETTINGS: &str = "--json --set foveation.samples=full --set trace.rays=1 --set environment.exposure=-40 \
                        --set reconstruction.k=1 --set reconstruction.method=k-nn --set view.ipd=0.064";

/// The program with quick and sharp pictures. Settings are given, so that no frame time is held.
fn start(screen: &Screen, folder: &Path, arguments: &str) -> Child {
    start_with(screen, folder, &format!("{arguments} {SETTINGS}"))
}

fn start_with(screen: &Screen, folder: &Path, arguments: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_foveate"))
        .current_dir(folder)
        .args("demo scene.glb".split(' '))
        .args(arguments.split_whitespace())
        .env("DISPLAY", screen.name())
        .env_remove("WAYLAND_DISPLAY")
        .env("XDG_STATE_HOME", folder.join("state"))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for a picture on the screen.
fn picture(screen: &Screen, child: &mut Child) -> Screenshot {
    let begun = Instant::now();
    loop {
        let shot = screen.shot();
        if shot.brightest() > 100 {
            return shot;
        }
        if let Some(status) = child.try_wait().unwrap() {
            panic!("the program ended before it showed anything ({status}): {}", said(child));
        }
        assert!(begun.elapsed() < Duration::from_secs(300), "nothing is shown");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn said(child: &mut Child) -> String {
    std::io::read_to_string(child.stderr.take().unwrap()).unwrap()
}

/// Ends the program as Ctrl-C does, and reads what it tells.
fn interrupt(mut child: Child) -> (Value, String) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    finish(&mut child)
}

fn finish(child: &mut Child) -> (Value, String) {
    let out = std::io::read_to_string(child.stdout.take().unwrap()).unwrap();
    let err = said(child);
    assert!(child.wait().unwrap().success(), "{out} {err}");
    assert!(!err.contains("panicked"), "{err}");
    (serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out} {err}")), err)
}

/// The tangents at which an eye sees a point.
fn seen(point: [f64; 3], eye: Eye) -> [f64; 2] {
    let x = point[0] - if eye == Eye::Left { -0.5 * IPD } else { 0.5 * IPD };
    [x / -point[2], point[1] / -point[2]]
}

/// How far the bars on a screenshot are from where they must be, by a model of the lenses and of which eye
/// is where: the greatest distance, in tangents, of a point of a bar's middle, over both eyes and colours;
/// infinite where too little is found.
fn error(shot: &Screenshot, model: &Model, eyes: [Eye; 2]) -> f64 {
    let mut worst = 0.0f64;
    for (half, eye) in [Eye::Left, Eye::Right].into_iter().zip(eyes) {
        for colour in 0..3 {
            let tangents = |x: f64, y: f64| model.seen_at(half, [x, y], colour);
            // Only lines that cross a bar well away from its ends: these have their middle on it.
            let inner = |points: Vec<[f64; 2]>, axis: usize| -> Vec<[f64; 2]> {
                points.into_iter().filter(|p| tangents(p[0], p[1])[axis].abs() < 0.25).collect()
            };
            let bar = lens::middles(shot, half, colour, true, |at| tangents(at[0], at[1])[0] < -0.2);
            let beam = lens::middles(shot, half, colour, false, |at| tangents(at[0], at[1])[1] > 0.45);
            let (bar, beam) = (inner(bar, 1), inner(beam, 0));
            if bar.len() < 40 || beam.len() < 40 {
                return f64::INFINITY;
            }
            let off = |points: &[[f64; 2]], axis: usize, right: f64| {
                points.iter().map(|p| (tangents(p[0], p[1])[axis] - right).abs()).fold(0.0, f64::max)
            };
            worst = worst.max(off(&bar, 0, seen(BAR, eye)[0])).max(off(&beam, 1, seen(BEAM, eye)[1]));
        }
    }
    worst
}

/// One pixel of the panel at the lens's centre is 0.0029 in tangents.
const PIXEL: f64 = 2.0 / 640.0 * 0.03744 / 0.041;

#[test]
fn a_straight_line_through_the_distortion_and_the_lens_is_straight_again() {
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    bars(folder.path());
    let mut child = start(&screen, folder.path(), "--headset dk1");
    let shot = picture(&screen, &mut child);
    let (summary, err) = interrupt(child);
    assert!(err.contains("Oculus Rift DK1") && err.contains("simulated head"), "{err}");
    assert!(summary["shown"].as_u64() >= Some(1) && summary["tracked_frames"] == 0, "{summary}");
    assert_eq!((shot.width, shot.height), (1280, 800));

    let (dk1, right) = (Model::dk1(), [Eye::Left, Eye::Right]);
    let good = error(&shot, &dk1, right);
    assert!(good < 1.0 * PIXEL, "off by {} pixels", good / PIXEL);
    // On the panel itself the bar is bent, or the lens would have nothing to undo.
    let bar = lens::middles(&shot, Eye::Left, 1, true, |at| at[0] < 320.0);
    let (least, most) = bar.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p[0]), b.max(p[0])));
    assert!(most - least > 4.0, "the bar spans {least}..{most} on the panel");

    // What is wrong is told from what is right.
    let wrong = [
        ("swapped eyes", error(&shot, &dk1, [Eye::Right, Eye::Left])),
        ("mirrored", error(&shot.mirrored(), &dk1, right)),
        ("upside down", error(&shot.flipped(), &dk1, right)),
        ("no distortion", error(&shot, &Model { k: [1.0, 0.0, 0.0, 0.0], ..dk1 }, right)),
        ("the prototype's lenses", error(&shot, &Model { k: [1.0, 0.18, 0.115, 0.0], ..dk1 }, right)),
        ("one part in ten less", error(&shot, &Model { k: [1.0, 0.198, 0.24, 0.0], ..dk1 }, right)),
        ("no colours", error(&shot, &Model { colours: [[1.0, 0.0]; 3], ..dk1 }, right)),
        ("lenses 3 mm closer", error(&shot, &Model { separation: 0.0605, ..dk1 }, right)),
    ];
    println!("right: {} pixels", good / PIXEL);
    for (what, error) in wrong {
        println!("{what}: {} pixels", error / PIXEL);
        assert!(
            error > 1.5 * good.max(0.6 * PIXEL),
            "{what}: {} pixels, right: {}",
            error / PIXEL,
            good / PIXEL
        );
    }
}

#[test]
fn a_plain_window_shows_both_eyes_side_by_side_and_ends_by_itself() {
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    bars(folder.path());
    let mut child = start(
        &screen,
        folder.path(),
        "--window --frames 3 --target-ms none --stereo per-eye --set view.width=640 --set view.height=320",
    );
    let (summary, err) = finish(&mut child);
    assert_eq!(
        (summary["shown"].as_u64(), summary["presenter"].as_str(), err.as_str()),
        (Some(3), Some("window"), "")
    );
    assert_eq!((summary["width"].as_u64(), summary["height"].as_u64()), (Some(640), Some(320)));

    let window = "--window --set view.width=640 --set view.height=320";
    let mut child = start(&screen, folder.path(), &format!("{window} --stereo per-eye"));
    let shot = picture(&screen, &mut child);
    interrupt(child);
    // 90 degrees across each eye: a tangent of 1 is 160 pixels.
    for (half, eye) in [(0.0, Eye::Left), (320.0, Eye::Right)] {
        let expected = half + 160.0 + 160.0 * seen(BAR, eye)[0];
        let middle = shot.middle_of_row(160, half as usize..half as usize + 160, 1).unwrap();
        assert!((middle - expected).abs() < 0.75, "{eye:?}: {middle}, not {expected}");
    }
    // By default there is one eye, whose picture fills the window.
    let mut child = start(&screen, folder.path(), window);
    let shot = picture(&screen, &mut child);
    let (summary, _) = interrupt(child);
    assert_eq!((summary["width"].as_u64(), summary["height"].as_u64()), (Some(640), Some(320)));
    let (left, right) = (shot.middle_of_row(160, 0..320, 1), shot.middle_of_row(160, 320..640, 1));
    let expected = 320.0 + 320.0 * seen(BAR, Eye::Left)[0];
    assert!((left.unwrap() - expected).abs() < 1.5 && right.is_none(), "{left:?} {right:?}, not {expected}");
}

#[test]
fn keys_are_told_and_escape_frees_the_mouse_before_it_ends() {
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    bars(folder.path());
    let plain = SETTINGS.replace("--json", "");
    let size = "--window --set view.width=320 --set view.height=240";
    let mut child = start_with(&screen, folder.path(), &format!("{size} {plain}"));
    let line = keys::first_line(&mut child);
    assert!(line.contains("WASD") && line.contains("Escape: lets the mouse go, then ends"), "{line}");
    picture(&screen, &mut child);
    let user = keys::User::at(&screen);
    user.choose_window();
    assert!(!user.mouse_is_taken());
    user.click_until_taken([100, 100], &mut child);
    user.press_escape();
    user.await_freedom(&mut child);
    assert!(child.try_wait().unwrap().is_none(), "it ends with the mouse");
    user.press_escape();
    let out = std::io::read_to_string(child.stdout.take().unwrap()).unwrap();
    assert!(child.wait().unwrap().success() && out.contains("frames in a window"), "{out}");
}

#[test]
fn the_displays_period_is_held_where_nothing_else_is_said() {
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    bars(folder.path());
    let told = |arguments: &str| {
        let small = "--json --set view.width=64 --set view.height=32 --set dk1.resolution=0.05";
        finish(&mut start_with(&screen, folder.path(), &format!("{arguments} {small}")))
    };
    // A Rift DK1 shows 60 pictures a second.
    let (dk1, _) = told("--headset dk1 --frames 3");
    assert!((dk1["budget"]["target_ms"].as_f64().unwrap() - 15.0).abs() < 1e-6, "{dk1}");
    // The period of a display in memory may be unknown: then that is said, and 30 Hz are held.
    let (plain, err) = told("--window --frames 12");
    let held = plain["budget"]["target_ms"].as_f64().unwrap();
    assert_eq!((held - 30.0).abs() < 1e-6, err.contains("the desktop does not tell"), "{plain} {err}");
    let (asked, err) = told("--window --frames 12 --target-ms 50");
    assert_eq!((asked["budget"]["target_ms"].as_f64(), err.contains("does not tell")), (Some(50.0), false));
    for (flags, note) in [("--target-ms none", false), ("--set foveation.samples=100", true)] {
        let (fixed, err) = told(&format!("--headset dk1 --frames 3 {flags}"));
        assert!(fixed["budget"].is_null(), "{fixed}");
        assert_eq!(err.contains("foveation.samples is given"), note, "{err}");
    }
}

#[test]
fn without_a_display_it_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    bars(folder.path());
    for display in ["", ":4999"] {
        let output = Command::new(env!("CARGO_BIN_EXE_foveate"))
            .current_dir(folder.path())
            .args(["demo", "--window"])
            .env_remove("WAYLAND_DISPLAY")
            .env("DISPLAY", display)
            .output()
            .unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), err.lines().count()), (Some(1), 1), "{err}");
        assert!(err.contains("desktop") && err.contains("foveate demo"), "{err}");
    }
}
