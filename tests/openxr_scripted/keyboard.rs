//! The terminal's keys, typed into a pseudo-terminal.

use std::fs::File;
use std::io::Write;
use std::process::Stdio;
use std::time::{Duration, Instant};

use fake_runtime::script::{Head, Script};
use nix::pty::{OpenptyResult, openpty};
use nix::sys::termios::{LocalFlags, tcgetattr};

use super::extras::first_eye;
use super::{Run, await_frames, command, ended, finished, possible};

/// What is typed while frames go on.
enum Type {
    /// A key, again and again for so long.
    Hold(&'static str, Duration),
    /// A key, once, and nothing for a while after.
    Tap(&'static str),
}

const ESCAPE: &str = "\x1b";
const RIGHT: &str = "\x1b[C";

/// Runs the program on a terminal in which that is typed after its first frames, and then Escape. Nothing
/// where there is no runtime.
fn typed(script: &Script, more: &str, keys: &[Type]) -> Option<Run> {
    if !possible() {
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command(folder.path(), script, 100_000, more);
    let OpenptyResult { master, slave } = openpty(None, None).unwrap();
    let mut keyboard = File::from(master);
    let before = tcgetattr(&slave).unwrap();
    command.stdin(Stdio::from(slave.try_clone().unwrap())).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    await_frames(&mut child, folder.path(), 4);
    let meanwhile = tcgetattr(&slave).unwrap().local_flags;
    assert!(
        !meanwhile.intersects(LocalFlags::ICANON | LocalFlags::ECHO) && meanwhile.contains(LocalFlags::ISIG)
    );
    for key in keys {
        match key {
            Type::Hold(key, duration) => {
                let end = Instant::now() + *duration;
                while Instant::now() < end {
                    keyboard.write_all(key.as_bytes()).unwrap();
                    std::thread::sleep(Duration::from_millis(25));
                }
            }
            Type::Tap(key) => keyboard.write_all(key.as_bytes()).unwrap(),
        }
        // Until the key counts no longer, and some frames have seen that.
        std::thread::sleep(Duration::from_millis(300));
        let seen = ended(folder.path()) + 4;
        await_frames(&mut child, folder.path(), seen);
    }
    keyboard.write_all(ESCAPE.as_bytes()).unwrap();
    let run = finished(child.wait_with_output().unwrap(), setup.log(), folder);
    assert_eq!(tcgetattr(&slave).unwrap().local_flags, before.local_flags, "the terminal is as it was");
    Some(run)
}

#[test]
fn keys_walk_turn_and_go_back() {
    let long = Duration::from_millis(500);
    let Some(run) = typed(&Script::default(), "", &[Type::Hold("w", long)]) else { return };
    let (ahead, yaw) = first_eye(&run);
    assert!(ahead[2] < -0.1 && yaw.abs() < 0.1, "{ahead:?} {yaw}");
    assert!((ahead[0] + 0.0315).abs() < 1e-3 && (ahead[1] - 1.6).abs() < 1e-3, "{ahead:?}");

    let (right, up) = (Type::Hold("d", long), Type::Hold("e", long));
    let (place, yaw) = first_eye(&typed(&Script::default(), "", &[right, up, Type::Tap(RIGHT)]).unwrap());
    assert!(place[0] > 0.1 && place[1] > 1.7 && (yaw + 30.0).abs() < 0.1, "{place:?} {yaw}");

    // Back to the start, whatever the head did meanwhile.
    let head = Head { position: [0.3, 0.1, -0.2], yaw_rate: 0.0, ..Head::default() };
    let script = Script { head, ..Script::default() };
    let keys = [Type::Hold("s", long), Type::Tap(RIGHT), Type::Tap("r")];
    let (place, yaw) = first_eye(&typed(&script, "", &keys).unwrap());
    assert!((place[0] + 0.0315).abs() < 1e-3 && (place[1] - 1.7).abs() < 1e-3, "{place:?}");
    assert!(place[2].abs() < 1e-3 && yaw.abs() < 0.1, "{place:?} {yaw}");
}

#[test]
fn keys_are_left_alone_where_nobody_wants_them() {
    if !possible() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, setup) = command(folder.path(), &Script::default(), 20, "--set headset.keyboard=false");
    let OpenptyResult { master, slave } = openpty(None, None).unwrap();
    let mut keyboard = File::from(master);
    keyboard.write_all(b"wwwwd\x1b\n").unwrap();
    let output = command.stdin(Stdio::from(slave)).output().unwrap();
    let run = finished(output, setup.log(), folder);
    assert_eq!(run.is_clean().told()["frames"], 20);
    assert!(first_eye(&run).0[2].abs() < 1e-3);
}
