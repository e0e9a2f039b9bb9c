//! The terminal that the program was started from, as a keyboard for someone who stands beside the wearer, or
//! wears the headset over a known keyboard.
//!
//! Only line editing and echo are switched off: Ctrl-C still interrupts, and lines still end where they end.
//! On Windows the console is asked for its keys, which become what a terminal would send.

use std::time::Instant;

#[cfg(windows)]
#[path = "terminal/console.rs"]
mod system;

use super::keys::Pressed;
use crate::headset::Keys;

/// The keyboard of a terminal. What was switched off is on again when this ends.
pub struct Terminal {
    pressed: Pressed,
}

impl Terminal {
    /// Listens to the terminal on standard input; `None` where that is none, or other programs have its keys.
    pub fn open() -> Option<Terminal> {
        system::listen().then(|| Terminal { pressed: Pressed::default() })
    }

    /// What keys ask for now.
    pub fn keys(&mut self) -> Keys {
        let now = Instant::now();
        self.pressed.take(&system::typed(), now);
        self.pressed.keys(now)
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        restore();
    }
}

/// Brings the terminal back to what it was, if it is listened to: before the program ends in whatever way.
pub fn restore() {
    system::restore();
}

#[cfg(unix)]
mod system {
    use std::io::stdin;
    use std::os::fd::AsFd;
    use std::sync::Mutex;

    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    use nix::sys::termios::{LocalFlags, SetArg, Termios, tcgetattr, tcsetattr};
    use nix::unistd::{getpgrp, read, tcgetpgrp};

    /// As it was before.
    static BEFORE: Mutex<Option<Termios>> = Mutex::new(None);

    /// Whether this program is in the foreground; where nobody else can be, it is. A shell that has taken the
    /// terminal back has its keys too, and stops whoever reads them.
    fn has_keys() -> bool {
        tcgetpgrp(stdin()).map_or(true, |group| group == getpgrp())
    }

    pub fn listen() -> bool {
        let Ok(before) = tcgetattr(stdin()) else { return false };
        let mut raw = before.clone();
        raw.local_flags.remove(LocalFlags::ICANON | LocalFlags::ECHO);
        let listens = has_keys() && tcsetattr(stdin(), SetArg::TCSANOW, &raw).is_ok();
        if let Ok(mut kept) = BEFORE.lock() {
            *kept = Some(before).filter(|_| listens);
        }
        listens
    }

    /// What has come since the last time.
    pub fn typed() -> Vec<u8> {
        let input = stdin();
        let mut waiting = [PollFd::new(input.as_fd(), PollFlags::POLLIN)];
        let mut bytes = [0; 256];
        let ready = has_keys() && poll(&mut waiting, PollTimeout::ZERO) == Ok(1);
        let count = if ready { read(&input, &mut bytes).unwrap_or(0) } else { 0 };
        bytes[..count].to_vec()
    }

    pub fn restore() {
        if let Some(before) = BEFORE.lock().ok().and_then(|mut kept| kept.take()) {
            let _ = tcsetattr(stdin(), SetArg::TCSANOW, &before);
        }
    }
}
