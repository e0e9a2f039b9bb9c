//! Orders that keep neighbours in the image near each other in a list.

/// Interleaves the bits of x (even places) and y (odd places), four bits each.
const fn morton_16x16(x: u32, y: u32) -> u32 {
    let (x, y) = ((x | x << 2) & 0x33, (y | y << 2) & 0x33);
    ((x | x << 1) & 0x55) | ((y | y << 1) & 0x55) << 1
}

/// For each set of eight pixels of a row, bit x for pixel x, the bits of their Morton codes.
const ROWS: [u64; 256] = {
    let mut rows = [0; 256];
    let mut set = 0;
    while set < 256 {
        let mut x = 0;
        while x < 8 {
            if set >> x & 1 == 1 {
                rows[set] |= 1 << morton_16x16(x, 0);
            }
            x += 1;
        }
        set += 1;
    }
    rows
};

/// Marks those pixels of a row of 16 x 16, bit x for pixel x, by their Morton codes.
pub(super) fn mark_row(codes: &mut [u64; 4], y: u32, pixels: u32) {
    let code = morton_16x16(0, y);
    for (half, set) in [pixels & 0xff, pixels >> 8 & 0xff].into_iter().enumerate() {
        codes[code as usize / 64 + half] |= ROWS[set as usize] << (code % 64);
    }
}

/// Undoes [`morton_16x16`].
pub(super) fn from_morton_16x16(code: u32) -> (u32, u32) {
    let gather = |v: u32| {
        let v = v & 0x55;
        let v = (v | v >> 1) & 0x33;
        (v | v >> 2) & 0x0f
    };
    (gather(code), gather(code >> 1))
}

/// The cells of a grid, x + y * width, along the Hilbert curve of the smallest square that holds it.
pub(crate) fn hilbert(width: u32, height: u32) -> Vec<u32> {
    let mut cells = Vec::with_capacity(width as usize * height as usize);
    let side = width.max(height).max(1).next_power_of_two();
    let start = Square { corner: (0, 0), across: (side as i32, 0), down: (0, side as i32) };
    start.walk(side, (width, height), &mut cells);
    cells
}

/// A square of the curve: where it begins, and the two sides that it spans.
#[derive(Clone, Copy)]
struct Square {
    corner: (i32, i32),
    across: (i32, i32),
    down: (i32, i32),
}

impl Square {
    /// Appends the square's cells that lie in the grid, along the curve that begins at `corner` and
    /// ends at the corner `across` from it.
    fn walk(self, side: u32, grid: (u32, u32), cells: &mut Vec<u32>) {
        let far = (self.corner.0 + self.across.0 + self.down.0, self.corner.1 + self.across.1 + self.down.1);
        let (left, top) = (self.corner.0.min(far.0), self.corner.1.min(far.1));
        if left >= grid.0 as i32 || top >= grid.1 as i32 {
            return;
        }
        if side == 1 {
            cells.push(left as u32 + top as u32 * grid.0);
            return;
        }
        let half = |v: (i32, i32)| (v.0 / 2, v.1 / 2);
        let add = |a: (i32, i32), b: (i32, i32)| (a.0 + b.0, a.1 + b.1);
        let minus = |v: (i32, i32)| (-v.0, -v.1);
        let (a, d) = (half(self.across), half(self.down));
        let (first, second) = (self.corner, add(self.corner, d));
        let last = add(add(first, self.across), d);
        Square { corner: first, across: d, down: a }.walk(side / 2, grid, cells);
        Square { corner: second, across: a, down: d }.walk(side / 2, grid, cells);
        Square { corner: add(second, a), across: a, down: d }.walk(side / 2, grid, cells);
        Square { corner: last, across: minus(d), down: minus(a) }.walk(side / 2, grid, cells);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morton_codes_are_a_bijection() {
        let mut seen = [false; 256];
        for y in 0..16 {
            for x in 0..16 {
                let code = morton_16x16(x, y);
                assert_eq!(from_morton_16x16(code), (x, y));
                seen[code as usize] = true;
                let mut codes = [0; 4];
                mark_row(&mut codes, y, 1 << x);
                let code = morton_16x16(x, y) as usize;
                assert!((0..256).all(|bit| (codes[bit / 64] >> (bit % 64) & 1 == 1) == (bit == code)));
            }
        }
        let mut codes = [0; 4];
        (0..16).for_each(|y| mark_row(&mut codes, y, 0xffff));
        assert_eq!(codes, [u64::MAX; 4]);
        assert!(seen.iter().all(|&s| s));
        assert_eq!((morton_16x16(1, 0), morton_16x16(0, 1), morton_16x16(2, 0)), (1, 2, 4));
    }

    #[test]
    fn the_curve_visits_each_cell_once_and_steps_to_neighbours() {
        for (width, height) in [(1, 1), (16, 16), (80, 50), (512, 1), (1, 7), (3, 64)] {
            let cells = hilbert(width, height);
            let mut sorted = cells.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..width * height).collect::<Vec<_>>(), "{width}x{height}");
            let at = |c: u32| ((c % width) as i32, (c / width) as i32);
            let steps = cells.windows(2).map(|w| (at(w[0]), at(w[1])));
            let jumps = steps.filter(|(a, b)| (a.0 - b.0).abs() + (a.1 - b.1).abs() != 1).count();
            // A full square has none; elsewhere the curve leaves the grid and comes back now and then.
            let allowed = if width == height { 0 } else { (width + height) as usize };
            assert!(jumps <= allowed, "{width}x{height}: {jumps} jumps");
        }
    }
}
