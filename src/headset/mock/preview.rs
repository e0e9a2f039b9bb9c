//! Thumbnails of a run of pictures, and a contact sheet of them.

use image::{Rgba, RgbaImage, imageops};

/// Pixels along a thumbnail's longer side at most.
pub const THUMBNAIL_SIDE: u32 = 480;
/// Thumbnails that are kept at most; longer runs keep every second, fourth, ... picture.
pub const MOST_THUMBNAILS: usize = 96;
/// Thumbnails on a contact sheet at most.
pub const SHEET_THUMBNAILS: usize = 20;
/// Pixels around each thumbnail of a contact sheet.
pub const MARGIN: u32 = 6;

/// A contact sheet's background.
const BACKGROUND: Rgba<u8> = Rgba([24, 24, 26, 255]);

/// Thumbnails of evenly spaced pictures of a run of any length, all of the first one's size.
#[derive(Debug, Default)]
pub struct Thumbnails {
    kept: Vec<RgbaImage>,
    /// Pictures seen so far.
    seen: usize,
    /// Every which picture is kept, as a power of two.
    doublings: u32,
}

impl Thumbnails {
    /// Takes the next picture.
    pub fn push(&mut self, picture: &RgbaImage) {
        let stride = 1usize << self.doublings;
        if self.seen & (stride - 1) == 0 {
            let (width, height) = self.kept.first().map_or_else(|| fitted(picture), RgbaImage::dimensions);
            let mut thumbnail = imageops::thumbnail(picture, width, height);
            thumbnail.pixels_mut().for_each(|pixel| pixel.0[3] = 255);
            self.kept.push(thumbnail);
        }
        self.seen += 1;
        if self.kept.len() > MOST_THUMBNAILS {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.doublings += 1;
        }
    }

    /// At most [`SHEET_THUMBNAILS`] of them in rows, from the first picture to the last.
    pub fn contact_sheet(&self) -> RgbaImage {
        let shown = self.kept.len().min(SHEET_THUMBNAILS);
        let (width, height) = self.kept.first().map_or((1, 1), RgbaImage::dimensions);
        let (columns, rows) = grid(shown as u32, width, height);
        let (across, down) = (width + MARGIN, height + MARGIN);
        let mut sheet = RgbaImage::from_pixel(columns * across + MARGIN, rows * down + MARGIN, BACKGROUND);
        for cell in 0..shown {
            let chosen = cell * (self.kept.len() - 1) / (shown - 1).max(1);
            let (column, row) = (cell as u32 % columns, cell as u32 / columns);
            let (x, y) = (MARGIN + column * across, MARGIN + row * down);
            imageops::replace(&mut sheet, &self.kept[chosen], i64::from(x), i64::from(y));
        }
        sheet
    }

    /// All of them in order, all of one size.
    pub fn all(&self) -> &[RgbaImage] {
        &self.kept
    }
}

/// The size of a picture's thumbnail.
fn fitted(picture: &RgbaImage) -> (u32, u32) {
    let (width, height) = picture.dimensions();
    let shrunk = (f64::from(THUMBNAIL_SIDE) / f64::from(width.max(height))).min(1.0);
    let side = |side: u32| ((f64::from(side) * shrunk).round() as u32).max(1);
    (side(width), side(height))
}

/// Columns and rows of that many thumbnails, for a sheet of about 4:3.
fn grid(count: u32, width: u32, height: u32) -> (u32, u32) {
    let columns = (f64::from(count) * f64::from(height) / f64::from(width) * 4.0 / 3.0).sqrt().round();
    let columns = (columns as u32).clamp(1, count.max(1));
    (columns, count.max(1).div_ceil(columns))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run of pictures that tell their number by their red.
    fn run(count: usize, width: u32, height: u32) -> Thumbnails {
        let mut thumbnails = Thumbnails::default();
        for i in 0..count {
            thumbnails.push(&RgbaImage::from_pixel(width, height, Rgba([(i % 256) as u8, 0, 0, 7])));
        }
        thumbnails
    }

    #[test]
    fn long_runs_keep_evenly_spaced_thumbnails() {
        for count in [1, 95, 96, 97, 192, 193, 1000] {
            let kept = run(count, 2, 2).kept;
            assert!(kept.len() <= MOST_THUMBNAILS && kept.len() >= count.min(MOST_THUMBNAILS / 2), "{count}");
            let reds: Vec<u8> = kept.iter().map(|thumbnail| thumbnail.get_pixel(0, 0).0[0]).collect();
            let step = reds.get(1).map_or(0, |second| second.wrapping_sub(reds[0]));
            assert!(reds.windows(2).all(|pair| pair[1].wrapping_sub(pair[0]) == step), "{count}: {reds:?}");
        }
    }

    #[test]
    fn sheets_have_room_for_every_cell() {
        for (count, width, height) in
            [(1, 480, 300), (20, 480, 300), (7, 480, 300), (20, 480, 1), (20, 1, 480)]
        {
            let (columns, rows) = grid(count, width, height);
            assert!(columns * rows >= count && columns * (rows - 1) < count, "{count}: {columns} x {rows}");
        }
        assert_eq!(grid(20, 480, 300), (4, 5));
        let sheet = run(50, 10, 6).contact_sheet();
        let (columns, rows) = grid(20, 10, 6);
        assert_eq!(sheet.dimensions(), (columns * (10 + MARGIN) + MARGIN, rows * (6 + MARGIN) + MARGIN));
        assert_eq!(sheet.get_pixel(0, 0), &BACKGROUND);
        assert_eq!(sheet.get_pixel(MARGIN, MARGIN).0, [0, 0, 0, 255]);
        let last = (MARGIN + (columns - 1) * (10 + MARGIN), MARGIN + (rows - 1) * (6 + MARGIN));
        let expected = if columns * rows == 20 { [49, 0, 0, 255] } else { BACKGROUND.0 };
        assert_eq!(sheet.get_pixel(last.0, last.1).0, expected);
    }

    #[test]
    fn extreme_shapes_keep_at_least_a_pixel() {
        for (size, expected) in
            [((1, 1), (1, 1)), ((9000, 1), (480, 1)), ((1280, 800), (480, 300)), ((3, 960), (2, 480))]
        {
            assert_eq!(fitted(&RgbaImage::new(size.0, size.1)), expected);
        }
    }
}
