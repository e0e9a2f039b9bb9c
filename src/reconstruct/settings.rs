//! What can be chosen about reconstruction.

use super::history::Reuse;
use crate::error::{Error, Result};
use crate::reference::reconstruct::WeightKind;
use crate::trace::pattern_maker::NeighbourLists;

/// Most samples that a pixel averages.
pub const MAX_K: u32 = 16;

/// Most samples that a sample is averaged with, itself included.
pub const MAX_NEIGHBOURS: u32 = 25;

/// Bytes of a sample after the first pass.
pub(super) const PREPARED_BYTES: usize = 32;

/// How samples weigh by their distance d from a pixel. R is the distance of the nearest sample that
/// is not among the k, or twice the farthest's where there is none. Weights are scaled to sum to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weights {
    /// `((R - d) / (R d))^2` (Franke and Nielson 1980): falls to zero where a sample leaves the set, so
    /// that nothing jumps between pixels. Where all d are R, all weigh the same.
    #[default]
    Shepard,
    /// `exp(-4.5 (d / R)^2)`: a normal distribution with a deviation of a third of R.
    Gaussian,
    /// `1 / d^2`.
    Inverse,
}

/// How pixels are made from samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Each pixel is the weighted average of its k nearest samples (Fujita and Harada 2014).
    KNearest,
    /// Samples hold what is left when albedo is divided out; they are averaged along surfaces, and
    /// each pixel's own visibility says which surface it is on and what its albedo is.
    Guided(GuidedSettings),
}

impl Default for Mode {
    fn default() -> Self {
        Mode::Guided(GuidedSettings::default())
    }
}

/// How strictly guided reconstruction keeps surfaces apart, and how far it averages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidedSettings {
    /// Samples that each sample is averaged with, itself included: 1 (nothing is averaged) to [`MAX_NEIGHBOURS`]. Where each
    /// pixel has a sample, all but 1 say the same.
    pub neighbours: u32,
    /// Exponent of the cosine between two normals: larger is stricter.
    pub normal_power: f32,
    /// Sine of the angle between a surface and the line to another point at which the point's weight
    /// has fallen to 1/e: smaller is stricter.
    pub plane_tolerance: f32,
    /// Standard deviation of the weights of diffuse light by distance, relative to the farthest neighbour's.
    pub first_deviation: f32,
    /// The same for specular light.
    pub second_deviation: f32,
}

impl Default for GuidedSettings {
    fn default() -> Self {
        GuidedSettings {
            neighbours: 24,
            normal_power: 16.0,
            plane_tolerance: 0.25,
            first_deviation: 0.6,
            second_deviation: 0.25,
        }
    }
}

/// All that can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How pixels are made.
    pub mode: Mode,
    /// Samples that each pixel averages: 1 to [`MAX_K`]; fewer where the pattern has fewer, and 1 where
    /// every pixel has a sample of its own.
    pub k: u32,
    /// Weights by distance.
    pub weights: Weights,
    /// Light that earlier frames and the other eye have found is carried on (guided only); `None`: each frame stands
    /// for itself.
    pub reuse: Option<Reuse>,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { mode: Mode::default(), k: 4, weights: Weights::default(), reuse: None }
    }
}

impl Settings {
    /// # Errors
    /// [`Error::Setting`] for the first value that is out of range.
    pub fn validate(&self) -> Result<()> {
        if !(1..=MAX_K).contains(&self.k) {
            return Err(Error::setting("k", format!("{} is not in 1 to {MAX_K}", self.k)));
        }
        let guided = self.guided();
        if !(1..=MAX_NEIGHBOURS).contains(&guided.neighbours) {
            let problem = format!("{} is not in 1 to {MAX_NEIGHBOURS}", guided.neighbours);
            return Err(Error::setting("neighbours", problem));
        }
        let positive = [
            ("plane_tolerance", guided.plane_tolerance),
            ("first_deviation", guided.first_deviation),
            ("second_deviation", guided.second_deviation),
        ];
        for (key, value) in positive {
            if !(1e-3..=1e3).contains(&value) {
                return Err(Error::setting(key, format!("{value} is not in 0.001 to 1000")));
            }
        }
        if !(0.0..=1e4).contains(&guided.normal_power) {
            let problem = format!("{} is not in 0 to 10000", guided.normal_power);
            return Err(Error::setting("normal_power", problem));
        }
        if let Some(frames) =
            self.reuse.map(|reuse| reuse.frames).filter(|frames| !(1..=256).contains(frames))
        {
            return Err(Error::setting("time.frames", format!("{frames} is not in 1 to 256")));
        }
        Ok(())
    }

    /// The neighbours that patterns are wanted with.
    pub fn lists(&self) -> NeighbourLists {
        let of_sample = match self.mode {
            Mode::Guided(guided) => guided.neighbours,
            Mode::KNearest => 1,
        };
        let weights = match self.weights {
            Weights::Shepard => WeightKind::Shepard,
            Weights::Gaussian => WeightKind::Gaussian,
            Weights::Inverse => WeightKind::Inverse,
        };
        NeighbourLists { of_pixel: self.k, of_sample, weights }
    }

    /// The guided mode's settings, or the default ones, unused, in the other mode.
    pub(super) fn guided(&self) -> GuidedSettings {
        match self.mode {
            Mode::Guided(guided) => guided,
            Mode::KNearest => GuidedSettings::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_by_name() {
        assert!(Settings::default().validate().is_ok());
        for k in [0, 17] {
            let error = Settings { k, ..Settings::default() }.validate().unwrap_err();
            assert!(error.to_string().starts_with("k: "), "{error}");
        }
        let with = |guided| Settings { mode: Mode::Guided(guided), ..Settings::default() }.validate();
        let good = GuidedSettings::default();
        assert!(with(GuidedSettings { neighbours: 0, ..good }).is_err());
        assert!(with(GuidedSettings { neighbours: 26, ..good }).is_err());
        assert!(with(GuidedSettings { normal_power: -1.0, ..good }).is_err());
        assert!(with(GuidedSettings { plane_tolerance: f32::NAN, ..good }).is_err());
        assert!(with(GuidedSettings { second_deviation: 0.0, ..good }).is_err());
    }
}
