//! The menu that controllers open: how frames are made now, and what the controllers do.

use std::time::{Duration, Instant};

use super::super::fault::Outcome;
use super::Session;

/// How long what it says stays before it is written anew.
const STEADY: Duration = Duration::from_secs(1);

/// What the menu says, while it is open.
#[derive(Default)]
pub(super) struct Menu {
    /// How the newest picture was made.
    pub status: String,
    left_handed: bool,
    open: Option<Page>,
}

struct Page {
    text: String,
    written: Instant,
}

impl Menu {
    /// A closed one, for who turns, points and teleports with the left hand or the right.
    pub fn new(left_handed: bool) -> Self {
        Menu { left_handed, ..Menu::default() }
    }

    /// Opens, or closes.
    pub fn press(&mut self) {
        self.open = if self.open.is_some() { None } else { Some(self.page()) };
    }

    /// What stands on it, if it is open.
    pub fn text(&mut self) -> Option<&str> {
        if self.open.as_ref()?.written.elapsed() > STEADY {
            self.open = Some(self.page());
        }
        self.open.as_ref().map(|page| page.text.as_str())
    }

    fn page(&self) -> Page {
        let [goes, turns] = if self.left_handed { ["right", "left"] } else { ["left", "right"] };
        let text = format!(
            "foveate: {}. The {goes} stick goes, pressed it resets the eyes' height. The {turns} stick turns, pressed it \
             leads back to the start. The {turns} hand's first button teleports. The menu button closes this.",
            self.status
        );
        Page { text, written: Instant::now() }
    }
}

impl Session {
    /// Writes the menu onto the board, if it is open; whether the board is to be shown.
    pub(super) fn show_menu(&mut self) -> Outcome<bool> {
        let Some(text) = self.menu.text() else { return Ok(false) };
        self.notices.write(&self.session, self.formats.color, text, &self.located, &mut self.notes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_menu_tells_the_newest_status_and_the_hands() {
        let mut menu = Menu { status: "quality 40 %".into(), ..Menu::default() };
        assert_eq!(menu.text(), None);
        menu.press();
        let text = menu.text().unwrap().to_string();
        assert!(text.contains("quality 40 %") && text.contains("left stick goes"), "{text}");
        // Every word fits on the board.
        assert!(text.len() < 600);
        menu.status = "quality 50 %".into();
        assert_eq!(menu.text(), Some(text.as_str()), "it is not written in every frame");
        menu.open.as_mut().unwrap().written -= STEADY;
        assert!(menu.text().unwrap().contains("quality 50 %"));
        menu.press();
        assert_eq!(menu.text(), None);
        let mut menu = Menu::new(true);
        menu.press();
        assert!(menu.text().unwrap().contains("right stick goes"));
    }
}
