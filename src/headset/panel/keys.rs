//! Keys and mouse to what a frame is told.

use std::collections::BTreeSet;

use glam::DVec3;
use winit::keyboard::KeyCode;

use crate::headset::Toggles;
use crate::headset::mouse_look::Wish;

/// What is held and what has happened since the last frame.
#[derive(Clone, Debug, Default)]
pub struct Keys {
    held: BTreeSet<KeyCode>,
    mouse: [f64; 2],
    recentre: bool,
    toggles: Toggles,
}

impl Keys {
    /// A key goes down or up.
    pub fn key(&mut self, key: KeyCode, down: bool) {
        if down {
            let pressed = !self.held.contains(&key);
            self.recentre |= key == KeyCode::KeyR && pressed;
            self.toggles.exposure ^= key == KeyCode::KeyL && pressed;
            self.toggles.overlay ^= key == KeyCode::KeyO && pressed;
            self.held.insert(key);
        } else {
            self.held.remove(&key);
        }
    }

    /// The mouse moves by that many pixels to the right and down.
    pub fn mouse(&mut self, right: f64, down: f64) {
        self.mouse = [self.mouse[0] + right, self.mouse[1] + down];
    }

    /// The window is no longer the one that keys go to.
    pub fn forget(&mut self) {
        *self = Keys::default();
    }

    /// What is wished for this frame, and whether the wearer looks ahead now.
    pub fn take(&mut self) -> (Wish, bool) {
        use KeyCode::{
            ArrowDown, ArrowLeft, ArrowRight, ArrowUp, KeyA, KeyD, KeyE, KeyQ, KeyS, KeyW, ShiftLeft,
            ShiftRight,
        };
        let held = |keys: [KeyCode; 2]| f64::from(u8::from(keys.iter().any(|key| self.held.contains(key))));
        let go = DVec3::new(
            held([KeyD, ArrowRight]) - held([KeyA, ArrowLeft]),
            held([KeyE, KeyE]) - held([KeyQ, KeyQ]),
            held([KeyS, ArrowDown]) - held([KeyW, ArrowUp]),
        );
        let hurry = held([ShiftLeft, ShiftRight]) > 0.0;
        let wish = Wish { go, mouse: std::mem::take(&mut self.mouse), hurry };
        (wish, std::mem::take(&mut self.recentre))
    }

    /// What was switched since the last frame.
    pub fn take_toggles(&mut self) -> Toggles {
        std::mem::take(&mut self.toggles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_held_and_the_mouse_is_taken() {
        let mut keys = Keys::default();
        keys.key(KeyCode::KeyW, true);
        keys.key(KeyCode::ArrowUp, true);
        keys.key(KeyCode::KeyD, true);
        keys.mouse(3.0, 1.0);
        keys.mouse(-1.0, 1.0);
        let (wish, recentre) = keys.take();
        assert_eq!((wish.go, wish.mouse, recentre), (DVec3::new(1.0, 0.0, -1.0), [2.0, 2.0], false));
        keys.key(KeyCode::KeyR, true);
        keys.key(KeyCode::KeyR, true);
        keys.key(KeyCode::KeyD, false);
        let (wish, recentre) = keys.take();
        assert_eq!((wish.go, wish.mouse, recentre), (DVec3::NEG_Z, [0.0, 0.0], true));
        assert!(!keys.take().1, "a held key recentres once");
        keys.key(KeyCode::KeyL, true);
        keys.key(KeyCode::KeyL, true);
        let exposure = Toggles { exposure: true, overlay: false };
        assert_eq!(
            [keys.take_toggles(), keys.take_toggles()],
            [exposure, Toggles::default()],
            "a held key locks once"
        );
        keys.key(KeyCode::KeyO, true);
        assert!(keys.take_toggles().overlay && !keys.take_toggles().overlay);
        keys.forget();
        assert_eq!(keys.take().0, Wish::default());
    }
}
