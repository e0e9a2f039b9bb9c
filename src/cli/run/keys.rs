//! From what a terminal sends for key presses to what they ask of the wearer's place.

use std::time::{Duration, Instant};

use glam::DVec3;

use crate::headset::{Keys, Toggles};

/// Terminals tell presses and repeats, and no releases: a key counts as held for so long after its last press.
/// Repeats come faster than that.
const HELD: Duration = Duration::from_millis(150);
/// What begins a sequence for keys that are no letters; alone it is the key Escape.
const ESCAPE: u8 = 0x1b;
/// Bytes of the longest sequence that is waited for.
const LONGEST: usize = 32;

/// Which keys there are, for the line that the program greets with.
pub const HELP: &str = "WASD, Q and E walk, arrows turn, R goes back to the start, L holds the exposure, O shows how pictures are made, Escape or Ctrl-C ends";

/// What a key does as long as it is held.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Held {
    Go(DVec3),
    Turn(f64),
}

/// What was pressed so far.
#[derive(Clone, Debug, Default)]
pub struct Pressed {
    held: Vec<(Held, Instant)>,
    hurry: bool,
    recentre: bool,
    toggles: Toggles,
    leave: bool,
    /// The beginning of a sequence whose end has not come yet.
    begun: Vec<u8>,
}

impl Pressed {
    /// Takes what the terminal has sent since the last time, which may be nothing.
    pub fn take(&mut self, bytes: &[u8], now: Instant) {
        if bytes.is_empty() {
            // Sequences come at once: an Escape that nothing follows is the key.
            self.leave |= self.begun == [ESCAPE];
            self.begun.clear();
        }
        for &byte in bytes {
            match self.begun.as_slice() {
                [] if byte == ESCAPE => self.begun.push(byte),
                [] => self.letter(byte, now),
                [_] if byte == ESCAPE => self.leave = true,
                [_] if matches!(byte, b'[' | b'O') => self.begun.push(byte),
                // A letter with Alt, which asks for nothing.
                [_] => self.begun.clear(),
                [.., _] if (0x40..0x7f).contains(&byte) || self.begun.len() > LONGEST => {
                    // ECMA-48: parameters, then one byte that says what it is.
                    let hurry = self.begun.ends_with(b";2");
                    self.begun.clear();
                    self.arrow(byte, hurry, now);
                }
                _ => self.begun.push(byte),
            }
        }
    }

    fn letter(&mut self, byte: u8, now: Instant) {
        let held = match byte.to_ascii_lowercase() {
            b'w' => Held::Go(DVec3::NEG_Z),
            b's' => Held::Go(DVec3::Z),
            b'a' => Held::Go(DVec3::NEG_X),
            b'd' => Held::Go(DVec3::X),
            b'q' => Held::Go(DVec3::NEG_Y),
            b'e' => Held::Go(DVec3::Y),
            b'r' => return self.recentre = true,
            b'l' => return self.toggles.exposure = true,
            b'o' => return self.toggles.overlay = true,
            _ => return,
        };
        self.hold(held, byte.is_ascii_uppercase(), now);
    }

    fn arrow(&mut self, last: u8, hurry: bool, now: Instant) {
        let held = match last {
            b'A' => Held::Go(DVec3::NEG_Z),
            b'B' => Held::Go(DVec3::Z),
            b'C' => Held::Turn(1.0),
            b'D' => Held::Turn(-1.0),
            _ => return,
        };
        self.hold(held, hurry, now);
    }

    fn hold(&mut self, held: Held, hurry: bool, now: Instant) {
        self.held.retain(|(other, _)| *other != held);
        self.held.push((held, now));
        self.hurry = hurry;
    }

    /// What all that asks for at a moment.
    pub fn keys(&mut self, now: Instant) -> Keys {
        self.held.retain(|(_, since)| now.saturating_duration_since(*since) < HELD);
        let mut keys = Keys {
            hurry: self.hurry,
            recentre: std::mem::take(&mut self.recentre),
            toggles: std::mem::take(&mut self.toggles),
            leave: self.leave,
            ..Keys::default()
        };
        for (held, _) in &self.held {
            match held {
                Held::Go(go) => keys.go += go,
                Held::Turn(turn) => keys.turn += turn,
            }
        }
        keys
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_count_until_a_while_after_their_last_press() {
        let (mut pressed, start) = (Pressed::default(), Instant::now());
        let at = |ms| start + Duration::from_millis(ms);
        assert_eq!(pressed.keys(start), Keys::default());
        for ms in [0, 100, 200] {
            pressed.take(b"w", at(ms));
            assert_eq!(pressed.keys(at(ms)).go, DVec3::NEG_Z);
        }
        pressed.take(b"d\x1b[C", at(210));
        let both = pressed.keys(at(300));
        assert_eq!((both.go, both.turn, both.hurry), (DVec3::new(1.0, 0.0, -1.0), 1.0, false));
        assert_eq!(pressed.keys(at(355)).go, DVec3::X);
        assert_eq!(pressed.keys(at(400)), Keys::default());
        pressed.take(b"E", at(500));
        let hurried = pressed.keys(at(500));
        assert_eq!((hurried.go, hurried.hurry), (DVec3::Y, true));
    }

    #[test]
    fn sequences_may_come_in_pieces_and_escape_alone_ends() {
        let now = Instant::now();
        let after = |pieces: &[&[u8]]| {
            let mut pressed = Pressed::default();
            pieces.iter().for_each(|piece| pressed.take(piece, now));
            pressed.keys(now)
        };
        let turn = |turn| Keys { turn, ..Keys::default() };
        assert_eq!(after(&[b"\x1b", b"[", b"D"]), turn(-1.0));
        assert_eq!(after(&[b"\x1bOC"]), turn(1.0));
        assert_eq!(after(&[b"\x1b[1;2D"]), Keys { hurry: true, ..turn(-1.0) });
        for ends in [&[&b"\x1b"[..], b""][..], &[b"\x1b\x1b"]] {
            assert!(after(ends).leave, "{ends:?}");
        }
        // Other keys' sequences, letters with Alt, letters that mean nothing, and noise.
        let long = [b'1'; 100];
        for nothing in [&b"\x1b[3~"[..], b"\x1b[15~", b"\x1bw", b"x\t\n\xff\xc3\xa4", b"\x1b[200~\x1b[201~"] {
            assert_eq!(after(&[nothing, b""]), Keys::default(), "{nothing:?}");
        }
        assert_eq!(after(&[b"\x1b[", &long, b""]), Keys::default());
    }

    #[test]
    fn going_back_is_asked_for_once() {
        let (mut pressed, now) = (Pressed::default(), Instant::now());
        pressed.take(b"R", now);
        assert!(pressed.keys(now).recentre && !pressed.keys(now).recentre);
        pressed.take(b"l", now);
        assert!(pressed.keys(now).toggles.exposure && !pressed.keys(now).toggles.exposure);
        pressed.take(b"o", now);
        assert!(pressed.keys(now).toggles.overlay && !pressed.keys(now).toggles.overlay);
    }
}
