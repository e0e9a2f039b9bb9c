//! The wearer's hands, as pictures show them.

use std::path::Path;

use fake_runtime::script::{Dump, HandMove, Input, Script, SeenHand, Session, View};

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
    let width = View::default().size[0] as usize;
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

/// Hands without controllers, which are held where these would be.
#[test]
fn hands_that_are_seen_are_drawn_by_their_joints_where_they_hold_no_controller() {
    let shows = |profile: Option<&str>, seen_hands: Vec<SeenHand>| {
        let folder = tempfile::tempdir().unwrap();
        let script = Script {
            profile: profile.map(|name| format!("/interaction_profiles/{name}")),
            inputs: Vec::new(),
            seen_hands,
            hands: vec![HandMove { frame: AIMING - 1, left: true, shift: [0.0, 0.5, -0.2], lost: false }],
            ..script(folder.path(), false)
        };
        let run = run(&script, AIMING as u32 + 2, "")?;
        run.is_clean();
        Some([PLAIN, AIMING].map(|frame| pixels(folder.path(), frame)))
    };
    let Some(bare) = shows(None, Vec::new()) else { return };
    let seen = |frame, left, lost| SeenHand { frame, left, lost, ..SeenHand::default() };
    let both = || vec![seen(1, false, false), seen(1, true, false), seen(AIMING - 1, false, true)];
    let with = shows(None, both()).unwrap();
    let View { size: [width, height], .. } = View::default();
    let (width, height) = (width as usize, height as usize);
    let sides = |found: &[usize]| {
        let left = found.iter().filter(|&&at| at % width < width / 2).count();
        [left, found.len() - left]
    };
    let first = differing(&bare[0], &with[0]);
    assert!(sides(&first).iter().all(|&count| count > 20), "{:?}", sides(&first));
    assert!(first.iter().all(|&at| at / width > height / 2), "hands above the horizon");
    // The left one has risen, and the right one is no longer seen.
    let later = differing(&bare[1], &with[1]);
    assert!(sides(&later)[0] > 20 && sides(&later)[1] == 0, "{:?}", sides(&later));
    assert!(later.iter().any(|&at| at / width < height / 2));
    // A hand that pinches is one without a controller; one that has buttons is not, though its fingers are guessed.
    let simple = shows(Some("khr/simple_controller"), both()).unwrap();
    assert!(differing(&with[0], &simple[0]).is_empty());
    let touch = [Vec::new(), both()].map(|hands| shows(Some("oculus/touch_controller"), hands).unwrap());
    assert!(
        differing(&touch[0][0], &touch[1][0]).is_empty() && !differing(&touch[0][0], &with[0]).is_empty()
    );
}
