//! The lenses: what of an undistorted picture each point of the panel shows, and the reverse.
//!
//! The model is LibOVR 0.2.x's. A point of one eye's half of the panel is measured from the lens's centre,
//! in halves of that half's width, and lies at `r`. Through the lens it is seen where an undistorted
//! picture has the radius `f(r) = r (K0 + K1 r^2 + K2 r^4 + K3 r^6)`, which the eye's distance from the
//! panel turns into the tangent of an angle. Red and blue are bent a little less and more than green.

use glam::DVec2;

use super::report::DisplayInfo;
use crate::foveation::Lens;
use crate::headset::panel::LensWarp;
use crate::math::view::{FieldOfView, View};

/// From the eye to the panel, metres: what LibOVR 0.2.x uses; the device's own figure is poorly measured.
const EYE_TO_PANEL: f64 = 0.041;
/// K0 to K3 of the 7-inch DK1.
const COEFFICIENTS: [f64; 4] = [1.0, 0.22, 0.24, 0.0];
/// Factors on the distorted offset, `a + b r^2`, of red, green and blue.
const COLOURS: [[f64; 2]; 3] = [[0.996, -0.004], [1.0, 0.0], [1.014, 0.0]];
/// Metres by metres of the panel, and metres between the lens centres.
const PANEL: [f64; 2] = [0.149_76, 0.0936];
const LENS_SEPARATION: f64 = 0.0635;
/// Pixels of the panel.
const PIXELS: [u32; 2] = [1280, 800];
/// The eye above and before the neck's pivot, metres: LibOVR 0.3.2's neck.
pub const NECK_TO_EYE: glam::DVec3 = glam::DVec3::new(0.0, 0.15, -0.09);
/// Pictures a second.
pub const REFRESH_HZ: f64 = 60.0;
/// Radii on the panel up to which coefficients must be good: its corners are at 1.8.
const FARTHEST: f64 = 2.5;

/// The largest picture, in halves of the panel, and the most that a lens stretches.
const MOST_SCALE: f64 = 4.0;
const MOST_STRETCH: f64 = 50.0;
/// The most pixels of a panel's side: at the largest scale a picture's sides are as long as devices promise images of.
const MOST_PIXELS: u32 = 4096;

/// One of the two eyes, and the half of the panel before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eye {
    /// The left half.
    Left,
    /// The right half.
    Right,
}

impl Eye {
    /// Both, the left one first.
    pub const BOTH: [Eye; 2] = [Eye::Left, Eye::Right];
}

/// A panel behind two lenses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Pixels across (both eyes) and down.
    pub pixels: [u32; 2],
    /// Width and height of the panel in metres.
    size: [f64; 2],
    /// Metres between the centres of the lenses.
    lens_separation: f64,
    coefficients: [f64; 4],
}

impl Default for Optics {
    /// A DK1 by its known figures.
    fn default() -> Self {
        Optics { pixels: PIXELS, size: PANEL, lens_separation: LENS_SEPARATION, coefficients: COEFFICIENTS }
    }
}

impl Optics {
    /// A DK1 as the device describes itself. What it leaves out, or what cannot be, is taken from the known
    /// figures: a real unit's distortion coefficients are all zero.
    pub fn of_device(info: &DisplayInfo) -> Self {
        let mut optics = Optics::default();
        let kind = info.distortion_type & 0x0f;
        let metres = |micrometres: u32| f64::from(micrometres) * 1e-6;
        let [width, height] = info.size.map(metres);
        let separation = metres(info.lens_separation);
        let sizes = (0.05..0.5).contains(&width) && (0.03..0.5).contains(&height);
        let lenses = (0.25 * width..0.75 * width).contains(&separation);
        if kind >= 1 && sizes && lenses {
            (optics.size, optics.lens_separation) = ([width, height], separation);
        }
        let [across, down] = info.resolution.map(u32::from);
        let sides = (320..=MOST_PIXELS).contains(&across) && (240..=MOST_PIXELS).contains(&down);
        if kind >= 1 && sides && across % 2 == 0 {
            optics.pixels = [across, down];
        }
        let own: [f64; 4] = std::array::from_fn(|i| f64::from(info.distortion[i]));
        let good = Optics { coefficients: own, ..optics };
        if kind == 2 && good.is_monotonous() && good.is_bounded() {
            optics = good;
        }
        optics
    }

    /// Whether a device describes lenses by coefficients that cannot be, so that the known ones are taken.
    pub fn distrusts(info: &DisplayInfo) -> bool {
        let own: [f64; 4] = std::array::from_fn(|i| f64::from(info.distortion[i]));
        info.distortion_type & 0x0f >= 2 && Optics::of_device(info).coefficients != own
    }

    /// Whether pictures are of a size that a lens can ask for: the DK1's own makes them 1.7 times the panel's half,
    /// and stretches the panel's corners 4 times.
    fn is_bounded(&self) -> bool {
        self.scale() < MOST_SCALE && self.distort(FARTHEST) < MOST_STRETCH * FARTHEST
    }

    /// Whether `f` grows all the way, so that it has an inverse.
    fn is_monotonous(&self) -> bool {
        let near_one = (0.5..2.0).contains(&self.coefficients[0]);
        near_one && (0..=250).all(|i| self.slope(f64::from(i) * FARTHEST / 250.0) > 0.05)
    }

    /// `f(r)`: the radius in the undistorted picture of a radius on the panel.
    pub fn distort(&self, r: f64) -> f64 {
        let [k0, k1, k2, k3] = self.coefficients;
        let square = r * r;
        r * (k0 + square * (k1 + square * (k2 + square * k3)))
    }

    /// `f'(r)`.
    fn slope(&self, r: f64) -> f64 {
        let [k0, k1, k2, k3] = self.coefficients;
        let square = r * r;
        k0 + square * (3.0 * k1 + square * (5.0 * k2 + square * 7.0 * k3))
    }

    /// The inverse of [`Optics::distort`], to some 1e-15; radii whose panel radius would be beyond the
    /// panel's corners by far are brought to 2.5, and what is no radius to 0.
    pub fn undistort(&self, radius: f64) -> f64 {
        if radius.is_nan() || radius <= 0.0 {
            return 0.0;
        }
        let (mut low, mut high) = (0.0, FARTHEST);
        if radius >= self.distort(high) {
            return high;
        }
        // Newton's steps within a bracket that shrinks.
        let mut r = radius.min(high);
        for _ in 0..64 {
            let error = self.distort(r) - radius;
            if error > 0.0 {
                high = r;
            } else {
                low = r;
            }
            let step = r - error / self.slope(r);
            let next = if step > low && step < high { step } else { 0.5 * (low + high) };
            if (next - r).abs() <= 1e-16 * r {
                break;
            }
            r = next;
        }
        r
    }

    /// How far the lens's centre is right of the middle of an eye's half, in halves of that half's width:
    /// 0.151976 before the left eye, and as much to the left before the right eye.
    pub fn centre_offset(&self, eye: Eye) -> f64 {
        let offset = 1.0 - 2.0 * self.lens_separation / self.size[0];
        if eye == Eye::Left { offset } else { -offset }
    }

    /// How many times larger than its half of the panel an undistorted picture is, for the same pixels at
    /// the lens's centre, so that its edge is seen at the half's outer edge: 1.714606.
    pub fn scale(&self) -> f64 {
        let fit = 1.0 + self.centre_offset(Eye::Left).abs();
        self.distort(fit) / fit
    }

    /// Tangents of angles in one unit of the panel.
    fn tangents(&self) -> f64 {
        self.size[0] / 4.0 / EYE_TO_PANEL
    }

    /// Half the height of the panel in its unit: 1.25.
    fn half_height(&self) -> f64 {
        2.0 * self.size[1] / self.size[0]
    }

    /// What the undistorted picture of an eye shows.
    pub fn field_of_view(&self, eye: Eye) -> FieldOfView {
        let unit = self.scale() * self.tangents();
        let (centre, up) = (self.centre_offset(eye), unit * self.half_height());
        FieldOfView { left: -unit * (1.0 + centre), right: unit * (1.0 - centre), up, down: -up }
    }

    /// Pixels across and down of an eye's undistorted picture, with `resolution` of its pixels for one of
    /// the panel's at the lens's centre; at least 16.
    pub fn picture_size(&self, resolution: f64) -> [u32; 2] {
        let scale = self.scale() * resolution;
        [self.pixels[0] / 2, self.pixels[1]].map(|side| ((f64::from(side) * scale).round() as u32).max(16))
    }

    /// The direction, as tangents to the right and up, in which the eye sees a point of its half of the
    /// panel by a colour (0 red, 1 green, 2 blue). The point is in 0..1 from the half's upper left corner.
    pub fn seen_at(&self, eye: Eye, point: DVec2, colour: usize) -> DVec2 {
        let offset = self.offset_at(eye, point);
        let square = offset.length_squared();
        let r = square.sqrt();
        let bent = if r > 0.0 { self.distort(r) / r } else { self.coefficients[0] };
        let [a, b] = COLOURS[colour.min(2)];
        offset * (bent * (a + b * square) * self.tangents())
    }

    /// The reverse of [`Optics::seen_at`] for green.
    pub fn shown_at(&self, eye: Eye, tangents: DVec2) -> DVec2 {
        let away = tangents / self.tangents();
        let length = away.length();
        let shrunk = if length > 0.0 { self.undistort(length) / length } else { 0.0 };
        let place = away * shrunk + DVec2::X * self.centre_offset(eye);
        DVec2::new(0.5 + 0.5 * place.x, 0.5 - 0.5 * place.y / self.half_height())
    }

    /// From the lens's centre to a point of the half, right and up in the panel's unit.
    fn offset_at(&self, eye: Eye, point: DVec2) -> DVec2 {
        let x = 2.0 * point.x - 1.0 - self.centre_offset(eye);
        DVec2::new(x, (1.0 - 2.0 * point.y) * self.half_height())
    }

    /// The lens as foveation sees it: where it shows the pixels of an eye's undistorted picture, on a panel
    /// whose half has as many pixels across.
    pub fn lens(&self, view: &View) -> Lens {
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let pixel = (view.fov.right - view.fov.left) / size.x / self.tangents();
        let panel = 0.5 * size.x;
        Lens::new(view.optical_centre() * size, size.length(), |radius| {
            let r = self.undistort(radius * pixel);
            (r * panel, panel * pixel / self.slope(r))
        })
    }

    /// How the panel's picture is made of both eyes' pictures, which stand side by side and have
    /// `picture` pixels each, in a window of `window` pixels. A window of another shape than the panel's
    /// shows it as large as fits.
    pub fn warps(&self, picture: [u32; 2], window: [u32; 2]) -> [LensWarp; 2] {
        let [across, down] = window.map(f64::from);
        let [panel_across, panel_down] = self.pixels.map(f64::from);
        let scale = (across / panel_across).min(down / panel_down);
        let (half_width, half_height) = (scale * panel_across / 2.0, scale * panel_down / 2.0);
        let middle = window[0] / 2;
        Eye::BOTH.map(|eye| {
            let fov = self.field_of_view(eye);
            let [width, height] = picture.map(f64::from);
            let per_tangent = [width / (fov.right - fov.left), height / (fov.up - fov.down)];
            let (first, end, side, source) = match eye {
                Eye::Left => (0, middle, -0.5, 0),
                Eye::Right => (middle, window[0], 0.5, picture[0]),
            };
            let centre = across / 2.0 + half_width * (side + 0.5 * self.centre_offset(eye));
            LensWarp {
                target: [first, 0, end - first, window[1]],
                source: [source, 0, picture[0], picture[1]],
                target_centre: [centre, down / 2.0],
                units: [2.0 / half_width, self.half_height() / half_height],
                source_centre: [-fov.left * per_tangent[0], fov.up * per_tangent[1]],
                source_units: per_tangent.map(|pixels| pixels * self.tangents()),
                coefficients: self.coefficients,
                colours: COLOURS,
            }
        })
    }
}

#[cfg(test)]
mod tests;
