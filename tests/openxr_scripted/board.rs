//! What the wearer is told while there are no pictures: a board of its own layer, whose pixels are looked at.

use std::path::Path;

use fake_runtime::script::{Dump, Fault, FrameRule, Head, Script, Session, View};
use serde_json::Value;

use super::views::numbers;
use super::{Run, run, sessions};

/// The pixels of the board.
const SIZE: (usize, usize) = (640, 240);

/// The first frames, whose pictures are written out, each into a folder of its own.
fn dumping(folder: &Path, frames: u64, session: Session) -> Session {
    let dump = |frame| Dump { frame, folder: folder.join(frame.to_string()) };
    Session { dumps: (1..=frames).map(dump).collect(), ..session }
}

/// The boards of all frames, and which frame by xrEndFrame that was; each beside how many other layers.
fn boards(run: &Run) -> Vec<(u64, &Value, usize)> {
    let frames = (1u64..).zip(run.frames());
    let layers = frames.filter_map(|(number, frame)| Some((number, frame.0["layers"].as_array()?)));
    layers
        .filter_map(|(number, layers)| {
            let board = layers.last().filter(|layer| layer["quad"].is_object())?;
            Some((number, board, layers.len() - 1))
        })
        .collect()
}

/// Where there are letters on a board: the inked pixels of each row.
fn letters(folder: &Path, frame: u64) -> Vec<Vec<bool>> {
    let bytes = std::fs::read(folder.join(frame.to_string()).join("quad0.raw")).unwrap();
    assert_eq!(bytes.len(), SIZE.0 * SIZE.1 * 4);
    let pixel = |pixel: &[u8]| {
        // Linear light of 0.8 and 0.01, as sRGB has them.
        assert!([231u8, 25].iter().any(|code| code.abs_diff(pixel[0]) <= 1), "{pixel:?}");
        assert_eq!(pixel[..3], [pixel[0]; 3]);
        assert_eq!(pixel[3], 255);
        pixel[0] > 128
    };
    let row = |row: &[u8]| row.chunks(4).map(pixel).collect();
    bytes.chunks(SIZE.0 * 4).map(row).collect()
}

/// Rows that have letters in them.
fn rows(letters: &[Vec<bool>]) -> Vec<usize> {
    (0..letters.len()).filter(|&row| letters[row].contains(&true)).collect()
}

#[test]
fn the_wearer_is_told_that_the_first_picture_is_being_made() {
    let folder = tempfile::tempdir().unwrap();
    // Half floats come first in the usual list.
    let formats = vec![43, 126, 124];
    let session = dumping(folder.path(), 12, Session::default());
    let script = Script { formats, ..sessions(vec![session]) };
    let Some(run) = run(&script, 6, "") else { return };
    assert_eq!(run.is_clean().told()["frames"], 6, "{}", run.said);
    let boards = boards(&run);
    let [(number, board, others)] = boards[..] else { panic!("one frame has a board: {boards:?}") };
    assert_eq!((others, &board["space"], &board["quad"]["eyes"]), (0, &"LOCAL".into(), &0.into()));
    assert_eq!(board["rect"], serde_json::json!([0, 0, SIZE.0, SIZE.1]));
    // 1.75 m ahead of the eyes, which look along -Z, upright, and as wide as its pixels say.
    let pose = numbers(&board["quad"]["pose"]);
    let near = |value: f64, wanted: f64| (value - wanted).abs() < 1e-5;
    assert!(near(pose[4], 0.0) && near(pose[5], 0.0) && near(pose[6], -1.75), "{pose:?}");
    assert!(pose[..3].iter().all(|part| part.abs() < 1e-6) && near(pose[3], 1.0), "{pose:?}");
    let size = numbers(&board["quad"]["size"]);
    assert!((size[0] / size[1] - SIZE.0 as f64 / SIZE.1 as f64).abs() < 1e-3, "{size:?}");
    // Letters stand in the middle, in two lines.
    let rows = rows(&letters(folder.path(), number));
    assert!((14..40).contains(&rows.len()) && rows[0] > 80 && rows[rows.len() - 1] < 160, "{rows:?}");
    // The first picture comes after it, and no other swapchain than those of views and board was made.
    let first = run.frames().iter().position(|frame| frame.0["layers"][0]["views"].is_array()).unwrap();
    assert!(first as u64 >= number, "{first} {number}");
}

/// Sessions end and begin again; what is told differs, and so do the boards.
#[test]
fn the_wearer_is_told_that_a_session_was_lost() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let fault = Fault { call: "xrEndFrame".into(), from: 8, to: 0, result: "ERROR_SESSION_LOST".into() };
    let lost = Session { faults: vec![fault], ..Session::default() };
    let scripted =
        vec![dumping(folders[0].path(), 12, lost), dumping(folders[1].path(), 12, Session::default())];
    let formats = vec![43, 126, 124];
    let Some(run) = run(&Script { formats, ..sessions(scripted) }, 12, "") else { return };
    assert_eq!(run.is_clean().told()["losses"], 1, "{}", run.said);
    let boards = boards(&run);
    assert_eq!(boards.len(), 2, "{boards:?}");
    let written = |folder: &Path| {
        let number = (1..=12).find(|n| folder.join(n.to_string()).join("quad0.raw").exists());
        letters(folder, number.unwrap())
    };
    let [first, second] = [0, 1].map(|index| written(folders[index].path()));
    assert!(first != second, "both say the same");
    let ink = |letters: &[Vec<bool>]| letters.iter().flatten().filter(|ink| **ink).count();
    assert!(ink(&first) > 1000 && ink(&second) > 1000, "{} {}", ink(&first), ink(&second));
}

/// Views that cannot be shown leave no place for a board but the head's own space.
#[test]
fn a_board_without_views_moves_with_the_head() {
    let flat = View { fov: [-45.0, 45.0, -40.0, 40.0], ..View::default() };
    let rule = FrameRule { from: 1, to: 10, ..FrameRule::default() };
    let session = Session { frames: vec![rule], ..Session::default() };
    let script = Script { views: vec![flat.clone(), flat], ..sessions(vec![session]) };
    let Some(run) = super::hangs::interrupted_after(&script, 8) else { return };
    let boards = boards(&run);
    assert!(boards.len() >= 5, "{boards:?}");
    for (_, board, others) in boards {
        assert_eq!((others, &board["space"]), (0, &"VIEW".into()));
        assert!((numbers(&board["quad"]["pose"])[6] + 1.75).abs() < 1e-5, "{board}");
    }
}

/// A runtime without such layers, or without memory for them, gets none, and that is told once.
#[test]
fn a_board_that_is_refused_is_done_without() {
    // The third swapchain of a session with two views and no depths is the board's.
    let refused = [
        ("xrCreateSwapchain", 3, "ERROR_OUT_OF_MEMORY"),
        ("xrEndFrame", 1, "ERROR_LAYER_INVALID"),
        ("xrEndFrame", 1, "ERROR_LAYER_LIMIT_EXCEEDED"),
    ];
    for (call, from, result) in refused {
        let mut fault = Fault { call: call.into(), from, to: 0, result: result.into() };
        if call == "xrEndFrame" {
            // Of the frames it is the first that the wearer sees.
            let Some(plain) = run(&Script::default(), 3, "--set headset.depth=false") else { return };
            fault.from = boards(&plain)[0].0;
        }
        let session = Session { faults: vec![fault], ..Session::default() };
        let head = Head { yaw_rate: 3.0, ..Head::default() };
        let script = Script { head, ..sessions(vec![session]) };
        let Some(run) = run(&script, 5, "--set headset.depth=false") else { return };
        assert!(run.log.violations().is_empty(), "{result}: {:?}", run.log.violations());
        let told = run.told();
        assert_eq!((run.code, &told["frames"], &told["losses"]), (Some(0), &5.into(), &0.into()));
        assert!(boards(&run).is_empty(), "{result}");
        let said = run.said.lines().filter(|line| line.contains(call) && line.contains("messages")).count();
        assert_eq!(said, 1, "{result}: {}", run.said);
    }
}
