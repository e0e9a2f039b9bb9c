//! The menu that controllers open: how frames are made now, and what the controllers do.

use std::time::{Duration, Instant};

use super::super::fault::Outcome;
use super::Session;

/// How long what it says stays before it is written anew.
const STEADY: Duration = Duration::from_secs(1);

/// What controllers do for the wearer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Controls {
    /// The left hand turns, points and teleports.
    pub left_handed: bool,
    /// The other hand's stick walks.
    pub walks: bool,
    /// The pointing hand teleports.
    pub teleports: bool,
    /// Its stick turns.
    pub turns: bool,
}

/// What the menu says, while it is open.
pub(super) struct Menu {
    /// How the newest picture was made; empty before there was one.
    pub status: String,
    controls: Controls,
    open: Option<Page>,
}

struct Page {
    text: String,
    written: Instant,
}

impl Menu {
    /// A closed one.
    pub fn new(controls: Controls) -> Self {
        Menu { status: String::new(), controls, open: None }
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
        let Controls { left_handed, walks, teleports, turns } = self.controls;
        let [other, points] = if left_handed { ["right", "left"] } else { ["left", "right"] };
        let told = |told: bool, sentence: String| if told { sentence } else { String::new() };
        let text = [
            told(!self.status.is_empty(), format!("foveate: {}.", self.status)),
            told(walks, format!("The {other} stick or pad walks.")),
            format!("Pressed, a {other} stick resets the height of the eyes."),
            told(turns, format!("The {points} stick or pad turns.")),
            format!("Pressed, a {points} stick leads back to the start."),
            told(
                teleports,
                format!("The {points} hand's first button or trigger teleports as it is let go."),
            ),
            "The menu button closes this.".to_string(),
        ];
        Page { text: text.join(" "), written: Instant::now() }
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

    const ALL: Controls = Controls { left_handed: false, walks: true, teleports: true, turns: true };

    #[test]
    fn the_menu_tells_the_newest_status_once_a_second() {
        let mut menu = Menu::new(ALL);
        menu.status = "quality 40 %".into();
        assert_eq!(menu.text(), None);
        menu.press();
        let text = menu.text().unwrap().to_string();
        assert!(text.contains("quality 40 %"), "{text}");
        menu.status = "quality 50 %".into();
        assert_eq!(menu.text(), Some(text.as_str()));
        menu.open.as_mut().unwrap().written -= STEADY;
        assert!(menu.text().unwrap().contains("quality 50 %"));
        menu.press();
        assert_eq!(menu.text(), None);
    }

    #[test]
    fn the_menu_tells_what_controllers_do_and_no_more() {
        let text = |controls: Controls| Menu::new(controls).page().text;
        let all = text(ALL);
        assert!(all.contains("left stick or pad walks") && all.contains("right stick or pad turns"), "{all}");
        assert!(
            all.contains("right hand's first button or trigger teleports as it is let go")
                && !all.contains("foveate:")
        );
        assert!(text(Controls { left_handed: true, ..ALL }).contains("right stick or pad walks"));
        for (controls, word) in [
            (Controls { walks: false, ..ALL }, "walks"),
            (Controls { teleports: false, ..ALL }, "teleports"),
            (Controls { turns: false, ..ALL }, "turns"),
        ] {
            assert!(!text(controls).contains(word), "{word}");
        }
    }
}
