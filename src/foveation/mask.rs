//! Pixels that nobody sees.

/// One bit for each pixel of an image; set where the headset hides the pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitMask {
    width: u32,
    height: u32,
    words: Vec<u64>,
}

impl BitMask {
    /// A mask with no bit set.
    pub fn new(width: u32, height: u32) -> Self {
        let bits = width as usize * height as usize;
        BitMask { width, height, words: vec![0; bits.div_ceil(64)] }
    }

    /// A mask of the pixels for which `hidden(x, y)` holds.
    pub fn from_fn(width: u32, height: u32, hidden: impl Fn(u32, u32) -> bool) -> Self {
        let mut mask = BitMask::new(width, height);
        for y in 0..height {
            for x in (0..width).filter(|&x| hidden(x, y)) {
                mask.set(x, y);
            }
        }
        mask
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Hides a pixel of the image; x < width and y < height.
    pub fn set(&mut self, x: u32, y: u32) {
        let bit = self.bit(x, y);
        self.words[bit / 64] |= 1 << (bit % 64);
    }

    /// Whether a pixel of the image is hidden; x < width and y < height.
    pub fn get(&self, x: u32, y: u32) -> bool {
        let bit = self.bit(x, y);
        self.words[bit / 64] >> (bit % 64) & 1 == 1
    }

    /// Its bits, row after row, the first in the lowest.
    pub(crate) fn words(&self) -> &[u64] {
        &self.words
    }

    /// Number of hidden pixels.
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    fn bit(&self, x: u32, y: u32) -> usize {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) is outside the mask");
        y as usize * self.width as usize + x as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_set_one_by_one() {
        let mask = BitMask::from_fn(13, 11, |x, y| x * y % 7 == 3);
        let mut count = 0;
        for y in 0..11 {
            for x in 0..13 {
                assert_eq!(mask.get(x, y), x * y % 7 == 3);
                count += usize::from(mask.get(x, y));
            }
        }
        assert_eq!(mask.count(), count);
        assert_eq!((mask.width(), mask.height()), (13, 11));
    }
}
