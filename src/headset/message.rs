//! A sentence as a small picture, for a wearer who sees no terminal.

mod pass;

use embedded_graphics::Drawable;
use embedded_graphics::framebuffer::{Framebuffer, buffer_size};
use embedded_graphics::geometry::Point;
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::iso_8859_1::FONT_10X20;
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::pixelcolor::raw::LittleEndian;
use embedded_graphics::text::{Baseline, Text};

pub use pass::MessagePass;
#[cfg(feature = "window")]
pub use pass::middles;

/// Pixels across and down of the largest picture; the former are whole words of 32.
pub const SIZE: (u32, u32) = (640, 240);
/// Pixels of a letter with the space to its neighbours.
const LETTER: (u32, u32) = (10, 20);

const BYTES: usize = buffer_size::<BinaryColor>(SIZE.0 as usize, SIZE.1 as usize);
type Bits = Framebuffer<
    BinaryColor,
    embedded_graphics::pixelcolor::raw::RawU1,
    LittleEndian,
    { SIZE.0 as usize },
    { SIZE.1 as usize },
    BYTES,
>;

/// A picture of words: a bit for each pixel, set where there is ink.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Pixels across and down.
    size: (u32, u32),
    /// Rows of [`SIZE`]'s width, the left pixel in a byte's highest bit.
    bits: Vec<u8>,
}

impl Message {
    /// A text in the middle of a picture of `size`, or of [`SIZE`] where that is less. What does not fit is cut,
    /// which dots tell.
    pub fn new(text: &str, size: (u32, u32)) -> Message {
        let size = (size.0.min(SIZE.0), size.1.min(SIZE.1));
        let (columns, rows) = (size.0 / LETTER.0, size.1 / LETTER.1);
        // A letter's width stays free on both sides.
        let lines = wrapped(text, columns.saturating_sub(2) as usize, rows as usize);
        let style = MonoTextStyle::new(&FONT_10X20, BinaryColor::On);
        let mut picture = Bits::new();
        let top = (size.1 - lines.len() as u32 * LETTER.1) / 2;
        for (row, line) in (0u32..).zip(&lines) {
            let left = (size.0 - line.chars().count() as u32 * LETTER.0) / 2;
            let at = Point::new(left as i32, (top + row * LETTER.1) as i32);
            let Ok(_) = Text::with_baseline(line, at, style, Baseline::Top).draw(&mut picture);
        }
        Message { size, bits: picture.data().to_vec() }
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Whether there is ink on a pixel of the picture.
    pub fn ink(&self, x: u32, y: u32) -> bool {
        let byte = self.bits[(y * SIZE.0 + x) as usize / 8];
        byte >> (7 - x % 8) & 1 == 1
    }
}

/// A text in lines of so many letters at most.
fn wrapped(text: &str, columns: usize, rows: usize) -> Vec<String> {
    if columns == 0 {
        return Vec::new();
    }
    let mut lines: Vec<String> = Vec::new();
    let letters: Vec<Vec<char>> = text.split_whitespace().map(|word| word.chars().collect()).collect();
    // A word that is longer than a line is broken.
    for word in letters.iter().flat_map(|word| word.chunks(columns)) {
        match lines.last_mut().filter(|line| line.chars().count() + 1 + word.len() <= columns) {
            Some(line) => line.extend([' '].iter().chain(word)),
            None => lines.push(word.iter().collect()),
        }
    }
    let cut = lines.len() > rows;
    lines.truncate(rows);
    if let Some(last) = lines.last_mut().filter(|_| cut) {
        let kept: String = last.chars().take(columns.saturating_sub(3)).collect();
        *last = kept + "...";
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rows and columns with ink: the first and the last of each.
    fn inked(message: &Message) -> Option<[u32; 4]> {
        let (width, height) = message.size();
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let inked: Vec<_> = places.filter(|&(x, y)| message.ink(x, y)).collect();
        let of = |axis: fn(&(u32, u32)) -> u32| (inked.iter().map(axis).min(), inked.iter().map(axis).max());
        let ((left, right), (top, bottom)) = (of(|at| at.0), of(|at| at.1));
        Some([left?, right?, top?, bottom?])
    }

    #[test]
    fn lines_are_broken_between_words_and_cut_where_they_are_too_many() {
        assert_eq!(wrapped("one two  three\nfour", 9, 4), ["one two", "three", "four"]);
        assert_eq!(wrapped("incomprehensible", 6, 9), ["incomp", "rehens", "ible"]);
        assert_eq!(wrapped("one two three four", 9, 2), ["one two", "three..."]);
        assert_eq!(wrapped("abcdefghij k", 10, 1), ["abcdefg..."]);
        assert!(wrapped("", 10, 3).is_empty() && wrapped("a b", 0, 3).is_empty());
        assert!(wrapped("a b", 3, 0).is_empty());
    }

    #[test]
    fn words_stand_in_the_middle_and_inside() {
        for size in [SIZE, (320, 200), (96, 80), (1, 1), (9, 300), (3000, 3000)] {
            for text in
                ["I", "waiting for the OpenCL device", &"long words ".repeat(200), "Zürich \u{4e16}", ""]
            {
                let message = Message::new(text, size);
                let (width, height) = message.size();
                assert!(width <= SIZE.0 && height <= SIZE.1);
                let Some([left, right, top, bottom]) = inked(&message) else { continue };
                assert!(right < width && bottom < height, "{text} {size:?}");
                let off = |before: u32, after: u32| (f64::from(before) - f64::from(after)).abs();
                assert!(off(left, width - 1 - right) < 12.0 || text.len() > 20, "{text} {size:?}");
                assert!(off(top, height - 1 - bottom) < 24.0, "{text} {size:?}: {top} {bottom}");
            }
        }
        let ink = |text| {
            let message = Message::new(text, SIZE);
            (0..SIZE.0 * SIZE.1).filter(|&at| message.ink(at % SIZE.0, at / SIZE.0)).count()
        };
        assert_eq!(ink(""), 0);
        assert!(ink("mm") == 2 * ink("m") && ink("m") > 20 && ink("i") < ink("m"));
    }
}
