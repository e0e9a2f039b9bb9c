//! Scenes that move, as the program shows them.

use super::*;
use common::moving::world;

const VIEW: &str = "--width 96 --height 64 --samples 0.2 --rays 4 --position 1.5,5,13 --look-at 1.5,2,0";

fn moving() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    world(false).write_glb(folder.path());
    folder
}

/// Pixels that differ by more than noise does.
fn changed(a: &RgbImage, b: &RgbImage) -> usize {
    let far = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|c| a.0[c].abs_diff(b.0[c]) > 60);
    a.pixels().zip(b.pixels()).filter(|&pair| far(pair)).count()
}

#[test]
fn pictures_show_the_time_that_is_asked_for() {
    let folder = moving();
    let picture = |flags: &str| {
        foveate(folder.path(), &format!("render scene.glb --out a.png {VIEW} {flags}")).succeeds();
        std::fs::read(folder.path().join("a.png")).unwrap()
    };
    let start = picture("");
    assert!(start == picture("--time 0") && start == picture("--animation Sway"));
    assert!(start != picture("--time 0.9") && start != picture("--animation none"));
    let told = foveate(folder.path(), "scene info scene.glb --json").succeeds().json();
    let clip = &told["animations"][0];
    assert_eq!(
        (clip["name"].as_str(), clip["seconds"].as_f64(), clip["plays"].as_bool()),
        (Some("Sway"), Some(2.0), Some(true))
    );
    let text = foveate(folder.path(), "scene info scene.glb").succeeds().out;
    assert!(text.contains("animation   0 \"Sway\", 2.000 s, 7 channels"), "{text}");
}

/// What devices need to deform a mesh is among the buffers where they do it.
#[test]
fn buffers_are_told_that_deform_meshes() {
    let folder = moving();
    let told = |flags: &str| {
        let told = foveate(folder.path(), &format!("scene info scene.glb --json {flags}")).succeeds().json();
        let buffers = told["device_buffers"].as_array().unwrap();
        let rest = buffers.iter().find(|buffer| buffer["name"] == "vertices at rest");
        (told["device_bytes"].as_u64().unwrap(), rest.map(|rest| rest["bytes"].as_u64().unwrap()))
    };
    let ((host, none), (device, rest)) = (told("--set trace.deform=host"), told("--set trace.deform=device"));
    // The tube's 396 vertices and the end of their lists.
    assert_eq!((none, rest), (None, Some(397 * 52)));
    assert!(device > host + 397 * 52, "{device} {host}");
    assert_eq!(told("--set trace.deform=device --animation none").1, None);
}

#[test]
fn animations_play_in_frames_at_their_speed() {
    let folder = moving();
    let frames = |flags: &str| {
        let mock = format!(
            "mock scene.glb --still --gaze 0.5,0.5 --frames 3 --out m {VIEW} --set view.stereo=mono {flags}"
        );
        foveate(folder.path(), &mock).succeeds();
        let text = std::fs::read_to_string(folder.path().join("m/frames.jsonl")).unwrap();
        let line = |line: &str| serde_json::from_str::<Value>(line).unwrap()["motion_ms"].as_f64().unwrap();
        let picture = |index: usize| png(folder.path().join(format!("m/frame_000{index}.png")));
        (changed(&picture(0), &picture(2)), text.lines().map(line).collect::<Vec<f64>>())
    };
    let (slow, fast) = (frames("--speed 0"), frames("--speed 30"));
    let still = frames("--animation none");
    assert!(fast.0 > 60 && fast.0 > 4 * slow.0.max(still.0), "{} {} {}", fast.0, slow.0, still.0);
    assert!(fast.1.iter().all(|&ms| ms > 0.0) && still.1.iter().all(|&ms| ms == 0.0), "{fast:?} {still:?}");
}

/// The world at rest, under a sun that moves.
#[test]
fn the_sun_goes_on_in_frames_and_stands_in_pictures() {
    let folder = moving();
    let rest = "--animation none --set environment.day_length=60";
    let picture = |flags: &str| {
        foveate(folder.path(), &format!("render scene.glb --out a.png {VIEW} {flags}")).succeeds();
        png(folder.path().join("a.png"))
    };
    let noon = picture(rest);
    assert!(changed(&noon, &picture("--animation none")) == 0, "a day begins where the sun is said to be");
    let (later, night) = (picture(&format!("{rest} --time 12")), picture(&format!("{rest} --time 30")));
    assert!(changed(&noon, &later) > 100 && changed(&noon, &night) > 1000);
    let frames = |flags: &str| {
        let mock = format!(
            "mock scene.glb --still --gaze 0.5,0.5 --frames 3 --out m {VIEW} --set view.stereo=mono {flags}"
        );
        foveate(folder.path(), &mock).succeeds();
        [0, 1, 2].map(|index: usize| png(folder.path().join(format!("m/frame_000{index}.png"))))
    };
    // Three frames at 90 Hz, in which the sun goes where it has been found in a picture.
    let [first, _, last] = frames(&format!("{rest} --speed 540"));
    assert!(changed(&first, &last) > 100 && changed(&last, &later) < changed(&last, &noon) / 2);
    let [first, _, last] = frames(&format!("{rest} --speed 0"));
    assert!(changed(&first, &last) < 60);
}

#[test]
fn wrong_days_are_told() {
    let folder = moving();
    for (flags, part) in [
        ("environment.day_length=-1", "-1 is no length of a day; give 1 to 1000000000 seconds"),
        ("environment.day_length=0.5", "or 0 for a sun that stands still"),
        ("environment.day_length=nan", "environment.day_length"),
        ("environment.day_length=60 --environment a.hdr", "the light of a map stands still"),
    ] {
        let sentence =
            foveate(folder.path(), &format!("render scene.glb --out a.png --set {flags}")).sentence();
        assert!(sentence.contains(part), "{flags}: {sentence}");
    }
    assert_eq!(names(folder.path()), ["scene.glb"]);
}

#[test]
fn wrong_times_speeds_and_names_are_told() {
    let folder = moving();
    for (flags, part) in [
        ("render scene.glb --out a.png --animation Jump", "no animation \"Jump\"; give one of 0 (\"Sway\")"),
        ("render scene.glb --out a.png --time 1e12", "--time"),
        ("mock scene.glb --out m --speed 1e9", "--speed"),
    ] {
        let sentence = foveate(folder.path(), flags).sentence();
        assert!(sentence.contains(part), "{flags}: {sentence}");
    }
    assert_eq!(names(folder.path()), ["scene.glb"]);
}
