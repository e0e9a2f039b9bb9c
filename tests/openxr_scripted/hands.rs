//! The wearer's hands, as pictures show them.

use std::path::Path;

use fake_runtime::script::{Dump, Input, Script, Session};

use super::run;

/// Frames whose pictures are looked at: with nothing pressed, and while the wearer aims.
const PLAIN: u64 = 4;
const AIMING: u64 = 8;

fn script(folder: &Path, tracked: bool) -> Script {
    let dump = |frame: u64| Dump { frame, folder: folder.join(frame.to_string()) };
    Script {
        profile: tracked.then(|| "/interaction_profiles/oculus/touch_controller".into()),
        inputs: vec![Input {
            path: "/user/hand/right/input/a/click".into(),
            from: AIMING - 2,
            to: AIMING + 20,
            value: [1.0, 0.0],
        }],
        sessions: vec![Session { dumps: vec![dump(PLAIN), dump(AIMING)], ..Session::default() }],
        ..Script::default()
    }
}

/// The left eye's pixels, and in which quarter of the picture each is: left or right, above or below.
fn pixels(folder: &Path, frame: u64) -> Vec<[u8; 4]> {
    let bytes = std::fs::read(folder.join(frame.to_string()).join("view0.raw")).unwrap();
    bytes.chunks(4).map(|pixel| pixel.try_into().unwrap()).collect()
}

fn differing(a: &[[u8; 4]], b: &[[u8; 4]]) -> Vec<usize> {
    assert!(!a.is_empty() && a.len() == b.len());
    (0..a.len()).filter(|&i| (0..3).any(|c| a[i][c].abs_diff(b[i][c]) > 24)).collect()
}

#[test]
fn controllers_are_drawn_where_they_are_tracked_and_aim_where_they_point() {
    let seen = |tracked: bool, more: &str| {
        let folder = tempfile::tempdir().unwrap();
        let run = run(&script(folder.path(), tracked), AIMING as u32 + 2, more)?;
        run.is_clean();
        Some([PLAIN, AIMING].map(|frame| pixels(folder.path(), frame)))
    };
    let Some(bare) = seen(false, "") else { return };
    let with = seen(true, "").unwrap();
    // Two hands, 0.2 m to either side and 0.3 m below the eyes: in the lower half, both to the left and to the right.
    let width = fake_runtime::script::View::default().size[0] as usize;
    let found = differing(&bare[0], &with[0]);
    let left = found.iter().filter(|&&at| at % width < width / 2).count();
    assert!(left > 10 && found.len() > left + 10, "{left} of {}", found.len());
    assert!(found.iter().all(|at| at / width > bare[0].len() / width / 2), "hands above the horizon");
    // Pressed: a ray, and a spot where it meets the floor.
    let aims = differing(&with[0], &with[1]);
    assert!(aims.len() > 5 && differing(&bare[0], &bare[1]).is_empty(), "{}", aims.len());
    // Who does not want to see them.
    let hidden = seen(true, "--set headset.show_hands=false").unwrap();
    assert!(differing(&bare[0], &hidden[0]).is_empty() && differing(&bare[1], &hidden[1]).is_empty());
}
