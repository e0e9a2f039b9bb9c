//! Keys and mouse, as a user of the display would press them.

use std::io::Read;
use std::process::Child;
use std::time::{Duration, Instant};

use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    BUTTON_PRESS_EVENT, BUTTON_RELEASE_EVENT, ConnectionExt, EventMask, GrabMode, GrabStatus, InputFocus,
    KEY_PRESS_EVENT, KEY_RELEASE_EVENT, MOTION_NOTIFY_EVENT, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

use super::screen::Screen;

/// Who sits before the display.
pub struct User {
    connection: RustConnection,
    root: Window,
}

impl User {
    /// Sits down.
    pub fn at(screen: &Screen) -> User {
        let (connection, number) = x11rb::connect(Some(screen.name())).unwrap();
        let root = connection.setup().roots[number].root;
        User { connection, root }
    }

    /// Has keys go to the window below the upper left corner.
    pub fn choose_window(&self) {
        let children = self.connection.query_tree(self.root).unwrap().reply().unwrap().children;
        let seen = |window: &Window| {
            let place = self.connection.get_geometry(*window).unwrap().reply();
            place.is_ok_and(|place| place.width > 100)
        };
        let window = children.into_iter().find(seen).unwrap();
        self.connection.set_input_focus(InputFocus::PARENT, window, 0u32).unwrap().check().unwrap();
    }

    fn send(&self, kind: u8, detail: u8, [x, y]: [i16; 2]) {
        self.connection.xtest_fake_input(kind, detail, 0, self.root, x, y, 0).unwrap().check().unwrap();
    }

    /// Clicks at a place.
    pub fn click(&self, place: [i16; 2]) {
        self.send(MOTION_NOTIFY_EVENT, 0, place);
        self.send(BUTTON_PRESS_EVENT, 1, place);
        self.send(BUTTON_RELEASE_EVENT, 1, place);
    }

    /// Presses Escape: key 9 of every PC's keyboard under X.
    pub fn press_escape(&self) {
        self.send(KEY_PRESS_EVENT, 9, [0, 0]);
        self.send(KEY_RELEASE_EVENT, 9, [0, 0]);
    }

    /// Whether another program has the mouse for itself.
    pub fn mouse_is_taken(&self) -> bool {
        let (mode, none) = (GrabMode::ASYNC, EventMask::NO_EVENT);
        let grab = self.connection.grab_pointer(false, self.root, none, mode, mode, 0u32, 0u32, 0u32);
        let taken = grab.unwrap().reply().unwrap().status == GrabStatus::ALREADY_GRABBED;
        self.connection.ungrab_pointer(0u32).unwrap().check().unwrap();
        taken
    }

    /// Clicks until the mouse is taken: looking takes it for a moment, in which nobody else can.
    pub fn click_until_taken(&self, place: [i16; 2], child: &mut Child) {
        self.until(child, || {
            self.click(place);
            std::thread::sleep(Duration::from_millis(300));
            self.mouse_is_taken()
        });
    }

    /// Waits until the mouse is free.
    pub fn await_freedom(&self, child: &mut Child) {
        self.until(child, || !self.mouse_is_taken());
    }

    fn until(&self, child: &mut Child, good: impl Fn() -> bool) {
        let begun = Instant::now();
        while !good() {
            assert!(child.try_wait().unwrap().is_none(), "the program has ended");
            assert!(begun.elapsed() < Duration::from_secs(60), "the mouse stays as it is");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

/// The first line that a program prints.
pub fn first_line(child: &mut Child) -> String {
    let (mut line, mut byte) = (Vec::new(), [0]);
    let out = child.stdout.as_mut().unwrap();
    while out.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
        line.push(byte[0]);
    }
    String::from_utf8(line).unwrap()
}
