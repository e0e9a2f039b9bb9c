//! The lenses as dk1.md's figures have them, written anew: what the program's own optics are held to.

use super::screen::Screenshot;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    Left,
    Right,
}

/// A panel of 1280 x 800 pixels behind two lenses.
#[derive(Clone, Copy)]
pub struct Model {
    pub k: [f64; 4],
    pub colours: [[f64; 2]; 3],
    pub separation: f64,
}

impl Model {
    pub fn dk1() -> Self {
        Model {
            k: [1.0, 0.22, 0.24, 0.0],
            colours: [[0.996, -0.004], [1.0, 0.0], [1.014, 0.0]],
            separation: 0.0635,
        }
    }

    /// Metres from the panel's middle to a lens's centre are half the separation; the eye is 41 mm away. A
    /// pixel is 0.14976 / 1280 m, a unit of radius a quarter of the panel's width.
    pub fn seen_at(&self, eye: Eye, pixel: [f64; 2], colour: usize) -> [f64; 2] {
        let (pitch, unit) = (0.14976 / 1280.0, 0.14976 / 4.0);
        let lens = if eye == Eye::Left { -self.separation / 2.0 } else { self.separation / 2.0 };
        let x = ((pixel[0] - 640.0) * pitch - lens) / unit;
        let y = (400.0 - pixel[1]) * pitch / unit;
        let square = x * x + y * y;
        let bent = self.k[0] + self.k[1] * square + self.k[2] * square.powi(2) + self.k[3] * square.powi(3);
        let [a, b] = self.colours[colour];
        let factor = bent * (a + b * square) * unit / 0.041;
        [x * factor, y * factor]
    }
}

/// Middles of what is bright in an eye's half, by one colour: in each row (`rows`) or column, of the pixels
/// that `among` accepts.
pub fn middles(
    shot: &Screenshot,
    eye: Eye,
    colour: usize,
    rows: bool,
    among: impl Fn([f64; 2]) -> bool,
) -> Vec<[f64; 2]> {
    let columns = if eye == Eye::Left { 0..shot.width / 2 } else { shot.width / 2..shot.width };
    let lines: Vec<Vec<(usize, usize)>> = if rows {
        (0..shot.height).map(|y| columns.clone().map(|x| (x, y)).collect()).collect()
    } else {
        columns.map(|x| (0..shot.height).map(|y| (x, y)).collect()).collect()
    };
    let middle = |line: &Vec<(usize, usize)>| {
        let (mut sum, mut place) = (0.0, [0.0; 2]);
        for &(x, y) in line {
            let at = [x as f64 + 0.5, y as f64 + 0.5];
            if among(at) {
                let value = shot.linear(x, y, colour);
                sum += value;
                place = [place[0] + value * at[0], place[1] + value * at[1]];
            }
        }
        (sum > 1.0).then(|| [place[0] / sum, place[1] / sum])
    };
    lines.iter().filter_map(middle).collect()
}
