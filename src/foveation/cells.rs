//! Samples sorted into square cells, for searches on the device.

use crate::error::{Error, Result};

/// Samples by cell: cells row after row, and in each cell the samples in their own order.
#[derive(Debug)]
pub struct Cells {
    /// Position packed `x | y << 16`, and index of the sample.
    pub sorted: Vec<[u32; 2]>,
    /// The first entry of `sorted` of each cell, and the end.
    pub starts: Vec<u32>,
    /// Cells are `1 << shift` pixels wide.
    pub shift: u32,
    /// Cells in a row.
    pub across: u32,
}

impl Cells {
    /// The width of cells as a power of two: they hold about one sample on average, so that a search visits few that are empty
    /// at any density.
    pub fn shift_for(width: u32, height: u32, samples: usize) -> u32 {
        let area = u64::from(width) * u64::from(height) / samples.max(1) as u64;
        area.max(1).ilog2().div_ceil(2).clamp(1, 15)
    }

    /// Cells across and down a view.
    pub fn counts(width: u32, height: u32, shift: u32) -> [u32; 2] {
        [width.div_ceil(1 << shift), height.div_ceil(1 << shift)]
    }

    /// Sorts samples.
    ///
    /// # Errors
    /// [`Error::Setting`] for a sample outside the view.
    pub fn new(width: u32, height: u32, samples: &[u32]) -> Result<Self> {
        let shift = Self::shift_for(width, height, samples.len());
        let [across, down] = Self::counts(width, height, shift);
        let cells = across as usize * down as usize;
        let cell = |packed: u32| {
            let (x, y) = (packed & 0xffff, packed >> 16);
            (y >> shift) as usize * across as usize + (x >> shift) as usize
        };
        let mut starts = vec![0u32; cells + 1];
        for &packed in samples {
            let (x, y) = (packed & 0xffff, packed >> 16);
            if x >= width || y >= height {
                let problem = format!("sample ({x}, {y}) lies outside a view of {width}x{height} pixels");
                return Err(Error::setting("pattern", problem));
            }
            starts[cell(packed) + 1] += 1;
        }
        for index in 0..cells {
            starts[index + 1] += starts[index];
        }
        let mut next = starts.clone();
        let mut sorted = vec![[0u32; 2]; samples.len()];
        for (index, &packed) in samples.iter().enumerate() {
            let slot = &mut next[cell(packed)];
            sorted[*slot as usize] = [packed, index as u32];
            *slot += 1;
        }
        Ok(Cells { sorted, starts, shift, across })
    }
}

/// For each pixel, row after row, the index of its sample, if every pixel has exactly one.
pub fn one_to_one(width: u32, height: u32, samples: &[u32]) -> Option<Vec<u32>> {
    let pixels = width as usize * height as usize;
    if samples.len() != pixels {
        return None;
    }
    let mut map = vec![u32::MAX; pixels];
    for (index, &packed) in samples.iter().enumerate() {
        let (x, y) = (packed & 0xffff, packed >> 16);
        if x >= width {
            return None;
        }
        let slot = map.get_mut(y as usize * width as usize + x as usize)?;
        if *slot != u32::MAX {
            return None;
        }
        *slot = index as u32;
    }
    Some(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_in_its_cell_once() {
        let samples: Vec<u32> = (0..500u32).map(|i| (i * 37 % 100) | (i * 53 % 70) << 16).collect();
        let grid = Cells::new(100, 70, &samples).unwrap();
        let mut seen = vec![false; samples.len()];
        for cell in 0..grid.starts.len() - 1 {
            for &[packed, index] in &grid.sorted[grid.starts[cell] as usize..grid.starts[cell + 1] as usize] {
                assert_eq!(packed, samples[index as usize]);
                let (x, y) = ((packed & 0xffff) >> grid.shift, (packed >> 16) >> grid.shift);
                assert_eq!(cell as u32, y * grid.across + x);
                assert!(!std::mem::replace(&mut seen[index as usize], true));
            }
        }
        assert!(seen.iter().all(|&seen| seen));
        assert!(Cells::new(100, 70, &[100]).is_err());
    }

    #[test]
    fn only_a_full_pattern_is_one_to_one() {
        let full: Vec<u32> = (0..12u32).rev().map(|i| (i % 4) | (i / 4) << 16).collect();
        assert_eq!(one_to_one(4, 3, &full).unwrap()[0], 11);
        assert!(one_to_one(4, 3, &full[1..]).is_none());
        let mut twice = full;
        twice[0] = twice[1];
        assert!(one_to_one(4, 3, &twice).is_none());
    }
}
