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
