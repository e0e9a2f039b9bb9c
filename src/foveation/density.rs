//! A law made ready for a view and a gaze: exactly, for points one by one, and as single numbers for whole rows, by the host or
//! by `kernels/pattern.cl`, with the same results to the bit.

use glam::{DVec2, DVec3, Vec2};

use super::law::Law;
use super::lens::Lens;
use super::vectorised::{arc_sine, log2, power_of};
use crate::layout::{LAW_LEVEL, LAW_LINEAR_MAR, LAW_LOG_POLAR, LAW_POWER, SampleLaw};
use crate::math::view::View;

/// How far outside the image a gaze is followed, in image sizes; beyond, densities hardly change.
const FARTHEST_GAZE: f64 = 8.0;

/// The distance in pixels within which the laws that grow without bound towards the gaze stay level:
/// pixels nearer than this get a sample anyway.
const LEAST_DISTANCE: f64 = 2.0;

/// The gaze in 0..1 that patterns use: one that is not a number becomes the view's optical centre, one
/// that is very far outside is brought nearer.
pub(super) fn usable_gaze(view: &View, gaze: DVec2) -> DVec2 {
    let gaze = if gaze.is_nan() { view.optical_centre() } else { gaze };
    let gaze = if gaze.is_nan() { DVec2::splat(0.5) } else { gaze };
    gaze.clamp(DVec2::splat(-FARTHEST_GAZE), DVec2::splat(1.0 + FARTHEST_GAZE))
}

/// A law made ready for one view and one gaze.
#[derive(Clone, Copy, Debug)]
pub struct Density {
    view: View,
    /// The gaze in pixels.
    gaze: DVec2,
    form: Form,
}

#[derive(Clone, Copy, Debug)]
enum Form {
    /// (max(r², least) / least)^half_exponent.
    Power {
        least: f64,
        half_exponent: f64,
    },
    /// (1 + per_radian e)^-2 over the solid angle of a pixel; the gaze as a unit vector.
    LinearMar {
        per_radian: f64,
        gaze: DVec3,
    },
    /// ln(r)^(1/alpha - 1) / r².
    LogPolar {
        power: f64,
    },
    Level,
}

impl Density {
    /// Makes a law ready for the picture that a view shows; parameters are expected to be valid.
    pub fn new(law: &Law, view: &View, gaze: DVec2) -> Self {
        let view = &view.picture();
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let gaze = usable_gaze(view, gaze) * size;
        let form = match *law {
            Law::Paper { exponent, centre_area } => {
                let squared = centre_area * size.x * size.y / std::f64::consts::PI;
                let least = squared.max(LEAST_DISTANCE * LEAST_DISTANCE);
                Form::Power { least, half_exponent: exponent * 0.5 }
            }
            Law::LinearMar { slope, w0 } => {
                let per_radian = slope / w0.to_radians();
                Form::LinearMar { per_radian, gaze: view.eye_direction(gaze).normalize() }
            }
            Law::LogPolar { alpha } => Form::LogPolar { power: 1.0 / alpha - 1.0 },
            Law::Uniform | Law::Full => Form::Level,
        };
        Density { view: *view, gaze, form }
    }

    /// The gaze in pixels from the upper left corner, always finite.
    pub fn gaze(&self) -> DVec2 {
        self.gaze
    }

    /// Relative density at a point of the image in pixels.
    pub fn at(&self, pixel: DVec2) -> f64 {
        let squared = (pixel - self.gaze).length_squared();
        match self.form {
            Form::Power { least, half_exponent } => (squared.max(least) / least).powf(half_exponent),
            Form::LinearMar { per_radian, gaze } => {
                let direction = self.view.eye_direction(pixel);
                let unit = direction.normalize();
                let eccentricity = 2.0 * ((unit - gaze).length() * 0.5).min(1.0).asin();
                // A pixel of a plane image at unit distance fills a solid angle of cos³ of its angle.
                let solid_angle = direction.length_squared().powf(-1.5);
                solid_angle / (1.0 + per_radian * eccentricity).powi(2)
            }
            Form::LogPolar { power } => {
                let squared = squared.max(LEAST_DISTANCE * LEAST_DISTANCE);
                (squared.ln() * 0.5).powf(power) / squared
            }
            Form::Level => 1.0,
        }
    }

    /// Relative densities at points (x, y) of a row of the picture, in pixels, to some six digits.
    pub fn row(&self, columns: &[f32], y: f64, out: &mut [f32]) {
        fill_row(&self.packed(None), None, columns, self.row_value(y, None), out);
    }

    /// The law in single precision. Behind a lens laws of distances in pixels hold on the panel, so that what the lens shows
    /// smaller gets fewer samples. Laws of angles hold as they are, since a lens undoes in angle what it does to the panel.
    pub(crate) fn packed(&self, lens: Option<&Lens>) -> SampleLaw {
        let picture = (self.view.width, self.view.height);
        let mut law = SampleLaw {
            width: picture.0,
            height: picture.1,
            picture_width: picture.0,
            gaze: [self.gaze.x as f32, 0.0, 0.0],
            ..SampleLaw::default()
        };
        match self.form {
            Form::Power { least, half_exponent } => {
                law.form = LAW_POWER;
                (law.least, law.scale, law.power) =
                    (least as f32, (1.0 / least) as f32, half_exponent as f32);
            }
            Form::LinearMar { per_radian, gaze } => {
                law.form = LAW_LINEAR_MAR;
                let across = self.view.fov.right - self.view.fov.left;
                (law.start, law.step) = (self.view.fov.left as f32, (across / f64::from(picture.0)) as f32);
                (law.power, law.gaze) = (per_radian as f32, gaze.as_vec3().to_array());
                return law;
            }
            Form::LogPolar { power } => {
                law.form = LAW_LOG_POLAR;
                (law.least, law.power) = ((LEAST_DISTANCE * LEAST_DISTANCE) as f32, power as f32);
            }
            Form::Level => law.form = LAW_LEVEL,
        }
        if let Some(lens) = lens {
            let gaze = lens.shown((self.gaze - lens.centre()).as_vec2()).0;
            (law.start, law.step, law.gaze) = (-lens.centre().x as f32, lens.steps(), [gaze.x, gaze.y, 0.0]);
        }
        law
    }

    /// What a row of the picture has all its densities' second coordinate from: y in pixels.
    pub(crate) fn row_value(&self, y: f64, lens: Option<&Lens>) -> f32 {
        match (self.form, lens) {
            (Form::LinearMar { .. }, _) => self.view.eye_direction(DVec2::new(0.0, y)).y as f32,
            (_, Some(lens)) => (y - lens.centre().y) as f32,
            (_, None) => (y - self.gaze.y) as f32,
        }
    }
}

/// Relative densities at columns of a row with a [`Density::row_value`].
pub(super) fn fill_row(law: &SampleLaw, lens: Option<&Lens>, columns: &[f32], row: f32, out: &mut [f32]) {
    let points = columns.iter().zip(out.iter_mut());
    if law.form == LAW_LINEAR_MAR {
        return points.for_each(|(&x, d)| *d = by_angle(law, x, row));
    }
    if let Some(lens) = lens {
        return points.for_each(|(&x, d)| {
            let (shown, area) = lens.shown(Vec2::new(law.start + x, row));
            *d = at_distance(law, shown.distance_squared(Vec2::new(law.gaze[0], law.gaze[1]))) * area;
        });
    }
    let squared = |x: f32| {
        let dx = x - law.gaze[0];
        dx * dx + row * row
    };
    // Each form has a loop of its own, which compiles to vector instructions.
    match law.form {
        LAW_POWER => points.for_each(|(&x, d)| *d = power(law, squared(x))),
        LAW_LOG_POLAR => points.for_each(|(&x, d)| *d = log_polar(law, squared(x))),
        _ => out.fill(1.0),
    }
}

/// Relative density at a squared distance from the gaze in pixels.
fn at_distance(law: &SampleLaw, squared: f32) -> f32 {
    match law.form {
        LAW_POWER => power(law, squared),
        LAW_LOG_POLAR => log_polar(law, squared),
        _ => 1.0,
    }
}

fn power(law: &SampleLaw, squared: f32) -> f32 {
    power_of(squared.max(law.least) * law.scale, law.power)
}

fn log_polar(law: &SampleLaw, squared: f32) -> f32 {
    let squared = squared.max(law.least);
    power_of(log2(squared) * (0.5 * std::f32::consts::LN_2), law.power) / squared
}

fn by_angle(law: &SampleLaw, x: f32, y: f32) -> f32 {
    let x = law.start + law.step * x;
    let inverse = 1.0 / (x * x + y * y + 1.0).sqrt();
    let [gaze_x, gaze_y, gaze_z] = law.gaze;
    let (ex, ey, ez) = (x * inverse - gaze_x, y * inverse - gaze_y, -inverse - gaze_z);
    let half_chord = 0.5 * (ex * ex + ey * ey + ez * ez).sqrt();
    let blur = 1.0 + law.power * 2.0 * arc_sine(half_chord);
    inverse * inverse * inverse / (blur * blur)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    #[test]
    fn rows_agree_with_points() {
        let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
        let spacing = Default::default();
        let view = View { world_from_eye: Pose::IDENTITY, fov, width: 700, height: 500, spacing };
        let mut row = vec![0.0; 700];
        let columns: Vec<f32> = (0..700u16).map(|x| f32::from(x) + 0.5).collect();
        for name in ["paper", "linear-mar", "log-polar", "uniform", "full"] {
            for gaze in [DVec2::splat(0.5), DVec2::new(-7.0, 3.0), DVec2::NAN, DVec2::new(0.001, 0.999)] {
                let density = Density::new(&name.parse().unwrap(), &view, gaze);
                for y in [0, 250, 499] {
                    density.row(&columns, f64::from(y) + 0.5, &mut row);
                    for (x, &value) in row.iter().enumerate() {
                        let exact = density.at(DVec2::new(x as f64 + 0.5, f64::from(y) + 0.5));
                        let error = f64::from(value) / exact - 1.0;
                        assert!(exact > 0.0 && error.abs() < 1e-4, "{name} {gaze} ({x}, {y}): {error}");
                    }
                }
            }
        }
    }
}
