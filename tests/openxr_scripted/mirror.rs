//! `foveate run --mirror`: what spectators see in a window of a display in memory, compared with what the headset gets.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fake_runtime::script::{Dump, Fault, Script, Session, View};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ClientMessageEvent, ConnectionExt, EventMask, Window};

use super::screen::{Screen, Screenshot};
use super::{await_frames, command, ended, finished, possible, sessions};

/// Pixels of a view.
const SIZE: [u32; 2] = [240, 180];
/// The frame whose pictures are written out.
const DUMPED: u64 = 5;
/// Pictures that do not change from frame to frame.
const FIXED: &str = "--mirror --exposure=0 --set time.reuse=false --set headset.late_correction=false";

/// Eyes so far apart that neither can be taken for the other.
fn script(folder: &Path) -> Script {
    let eye = |x| View { size: SIZE, ..View::eye(x) };
    let dumps = vec![Dump { frame: DUMPED, folder: folder.join("dump") }];
    let session = Session { dumps, ..Session::default() };
    Script { views: vec![eye(-0.4), eye(0.4)], formats: vec![43, 126], ..sessions(vec![session]) }
}

fn start(screen: &Screen, mut command: Command) -> Child {
    command.env("DISPLAY", screen.name()).env_remove("WAYLAND_DISPLAY");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// How far what stands on the screen is from a view's picture: the share of bytes that differ by more than rounding.
fn difference(shot: &Screenshot, folder: &Path, view: usize) -> f64 {
    let bytes = std::fs::read(folder.join("dump").join(format!("view{view}.raw"))).unwrap();
    let (width, height) = (SIZE[0] as usize, SIZE[1] as usize);
    assert_eq!(bytes.len(), width * height * 4);
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| shot.pixel(x, y)));
    let off = pixels
        .zip(bytes.chunks(4))
        .flat_map(|(shown, handed)| (0..3).map(move |channel| shown[channel].abs_diff(handed[channel]) > 2));
    off.filter(|off| *off).count() as f64 / (3 * width * height) as f64
}

/// Waits until the screen shows something that will do.
fn await_screen(screen: &Screen, child: &mut Child, what: &str, good: impl Fn(&Screenshot) -> bool) {
    let begun = Instant::now();
    while !good(&screen.shot()) {
        assert!(child.try_wait().unwrap().is_none(), "it ended before {what}");
        assert!(begun.elapsed() < Duration::from_secs(120), "{what} does not come");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Closes the only window on the screen as a window manager does.
fn close_window(screen: &Screen) {
    let (connection, number) = x11rb::connect(Some(screen.name())).unwrap();
    let atom = |name: &str| connection.intern_atom(false, name.as_bytes()).unwrap().reply().unwrap().atom;
    let (protocols, delete) = (atom("WM_PROTOCOLS"), atom("WM_DELETE_WINDOW"));
    let root = connection.setup().roots[number].root;
    let children = connection.query_tree(root).unwrap().reply().unwrap().children;
    let titled = |window: &Window| {
        let name = connection.get_property(false, *window, atom("WM_PROTOCOLS"), 4u32, 0, 9).unwrap();
        name.reply().is_ok_and(|reply| reply.value_len > 0)
    };
    let windows: Vec<Window> = children.into_iter().filter(titled).collect();
    assert_eq!(windows.len(), 1, "one window is there");
    let event = ClientMessageEvent::new(32, windows[0], protocols, [delete, 0, 0, 0, 0]);
    // Waits for the server: what is sent just before a connection ends may be lost.
    connection.send_event(false, windows[0], EventMask::NO_EVENT, event).unwrap().check().unwrap();
}

#[test]
fn spectators_see_what_the_left_eye_sees_until_they_close_the_window() {
    if !possible() {
        return;
    }
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    let (command, setup) = command(&at, &script(&at), 1_000_000, FIXED);
    let mut child = start(&screen, command);
    await_frames(&mut child, &at, DUMPED as usize + 1);
    // Where the window has not been drawn yet it differs.
    await_screen(&screen, &mut child, "the picture", |shot| difference(shot, &at, 0) == 0.0);
    let shot = screen.shot();
    let other = difference(&shot, &at, 1);
    assert!(other > 0.004, "the right eye sees something else: {other}");
    // The window is as large as the picture: beside it there is nothing.
    assert_eq!(shot.pixel(SIZE[0] as usize + 5, 5), [0; 3]);
    close_window(&screen);
    await_screen(&screen, &mut child, "the window's end", |shot| shot.brightest() == 0);
    // The headset runs on.
    await_frames(&mut child, &at, ended(&at) + 10);
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let run = finished(child.wait_with_output().unwrap(), setup.log(), folder);
    run.is_clean();
    assert!(!run.said.contains("mirror"), "{}", run.said);
}

/// Bit of xrCreateSwapchain's usage by which images may be copied from.
const TRANSFER_SRC: u64 = 8;

#[test]
fn images_that_cannot_be_copied_leave_the_mirror_empty() {
    if !possible() {
        return;
    }
    let Some(screen) = Screen::start() else { return };
    for (flags, refused, note) in [(FIXED, 2, true), (FIXED, 0, false), ("", 0, false)] {
        let folder = tempfile::tempdir().unwrap();
        let mut script = script(folder.path());
        // With depths and without: the third time it is not to be copied.
        let result = "ERROR_FEATURE_UNSUPPORTED".to_string();
        let fault = Fault { call: "xrCreateSwapchain".into(), from: 1, to: refused, result };
        script.faults.extend((refused > 0).then_some(fault));
        let (command, setup) = command(folder.path(), &script, 6, flags);
        let output = start(&screen, command).wait_with_output().unwrap();
        let run = finished(output, setup.log(), folder);
        assert_eq!(run.is_clean().told()["frames"], 6, "{}", run.said);
        assert_eq!(run.said.contains("the mirror stays empty"), note, "{}", run.said);
        let made = run.log.calls("xrCreateSwapchain");
        let usage = |index: usize| made[index].0["usage"].as_u64().unwrap();
        let copied = usage(refused as usize) & TRANSFER_SRC != 0;
        assert_eq!(copied, !flags.is_empty() && refused == 0, "{flags} {refused}: {}", run.said);
    }
}

#[test]
fn without_a_display_the_headset_is_not_touched() {
    if !possible() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut command, _) = command(folder.path(), &script(folder.path()), 3, FIXED);
    command.env("DISPLAY", ":4999").env_remove("WAYLAND_DISPLAY");
    let output = command.output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), said.lines().count()), (Some(1), 1), "{said}");
    assert!(said.contains("no desktop answers") && said.contains("leave --mirror out"), "{said}");
    assert!(!folder.path().join(Script::default().log).exists(), "the runtime was asked");
}
