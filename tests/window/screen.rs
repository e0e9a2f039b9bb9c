//! An X server without a screen, and pictures of what it shows.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, ImageFormat};

/// A running Xvfb; it ends with this.
pub struct Screen {
    server: Child,
    name: String,
}

impl Screen {
    /// Starts one of 1280 x 800 pixels; says so where it is not installed. On machines that promise it
    /// (CI=true) that is a failure.
    pub fn start() -> Option<Screen> {
        let started = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp", "-noreset"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut server = match started {
            Ok(server) => server,
            Err(error) => {
                assert!(std::env::var("CI").as_deref() != Ok("true"), "Xvfb: {error}");
                println!("not run: no Xvfb ({error})");
                return None;
            }
        };
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb names its display");
        Some(Screen { server, name: format!(":{}", number.trim()) })
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the whole screen shows now.
    pub fn shot(&self) -> Screenshot {
        let (connection, screen) = x11rb::connect(Some(&self.name)).unwrap();
        let root = &connection.setup().roots[screen];
        let (width, height) = (root.width_in_pixels, root.height_in_pixels);
        let image = connection.get_image(ImageFormat::Z_PIXMAP, root.root, 0, 0, width, height, !0);
        let data = image.unwrap().reply().unwrap().data;
        assert_eq!(data.len(), usize::from(width) * usize::from(height) * 4);
        let pixels = data.chunks_exact(4).map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect();
        Screenshot { width: width.into(), height: height.into(), pixels }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // A server that is gone already is as good.
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// A picture of the screen. Not every test looks at it in every way.
#[allow(dead_code)]
pub struct Screenshot {
    pub width: usize,
    pub height: usize,
    pixels: Vec<[u8; 3]>,
}

#[allow(dead_code)]
impl Screenshot {
    /// Red, green and blue as they stand there.
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x]
    }

    pub fn brightest(&self) -> u8 {
        self.pixels.iter().flatten().copied().max().unwrap_or(0)
    }

    /// A channel in linear light, 0 to 1.
    pub fn linear(&self, x: usize, y: usize, channel: usize) -> f64 {
        let value = f64::from(self.pixels[y * self.width + x][channel]) / 255.0;
        if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }

    /// The middle of what is bright in a row between two columns.
    pub fn middle_of_row(&self, y: usize, columns: std::ops::Range<usize>, channel: usize) -> Option<f64> {
        let values = columns.map(|x| (x as f64 + 0.5, self.linear(x, y, channel)));
        let (sum, moment) = values.fold((0.0, 0.0), |(s, m), (x, v)| (s + v, m + v * x));
        (sum > 1.0).then(|| moment / sum)
    }

    fn moved(&self, from: impl Fn(usize, usize) -> (usize, usize)) -> Screenshot {
        let places = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        let pixels = places.map(|(x, y)| from(x, y)).map(|(x, y)| self.pixels[y * self.width + x]).collect();
        Screenshot { pixels, ..*self }
    }

    pub fn mirrored(&self) -> Screenshot {
        self.moved(|x, y| (self.width - 1 - x, y))
    }

    pub fn flipped(&self) -> Screenshot {
        self.moved(|x, y| (x, self.height - 1 - y))
    }
}
