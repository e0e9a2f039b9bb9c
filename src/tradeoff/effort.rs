//! How much work a measurement may be.

use super::sequence::Motion;

/// How many poses, gazes, passes and repetitions, and how fine the sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Effort {
    /// Some minutes on two cores with a small scene: a first impression.
    Quick,
    /// An hour or more on a processor.
    Usual,
    /// For figures that are written down.
    Thorough,
}

impl Effort {
    /// Head poses along the script.
    pub fn poses(self) -> usize {
        [1, 3, 6][self as usize]
    }

    /// Frames at each pose before those that are judged, which these may know of.
    pub fn history(self) -> usize {
        [3, 6, 8][self as usize]
    }

    /// Gaze points at each pose, in 0..1 of the first eye's picture.
    pub fn gazes(self) -> &'static [[f64; 2]] {
        const GAZES: [[f64; 2]; 3] = [[0.5, 0.5], [0.25, 0.65], [0.8, 0.4]];
        &GAZES[..[2, 2, 3][self as usize]]
    }

    /// Passes of a reference; even, since halves are compared.
    pub fn passes(self) -> u32 {
        [4, 16, 64][self as usize]
    }

    /// Light rays for each pixel and pass of a reference.
    pub fn reference_rays(self) -> u32 {
        [48, 64, 64][self as usize]
    }

    /// Frames of each point that are timed with everything warm, besides those that are judged.
    pub fn repetitions(self) -> u32 {
        [3, 7, 15][self as usize]
    }

    /// Motions along which sequences of frames are judged.
    pub fn motions(self) -> &'static [Motion] {
        match self {
            Effort::Quick => &[Motion::Rest, Motion::SlowTurn],
            Effort::Usual | Effort::Thorough => &Motion::ALL,
        }
    }

    /// Frames of a sequence before those that are judged, and these.
    pub fn frames(self) -> [usize; 2] {
        [[6, 2], [16, 4], [32, 10]][self as usize]
    }

    /// What the configured width and height are divided by.
    pub fn shrink(self) -> f64 {
        [8.0 / 3.0, 1.0, 1.0][self as usize]
    }

    /// Shares of the pixels that are sampled.
    pub fn samples(self) -> &'static [f64] {
        match self {
            Effort::Quick => &[0.01, 0.02, 0.15],
            Effort::Usual => &[0.01, 0.02, 0.037, 0.08, 0.15, 0.3],
            Effort::Thorough => &[0.005, 0.01, 0.02, 0.037, 0.08, 0.11, 0.15, 0.22, 0.3, 0.5],
        }
    }

    /// Light rays per sample.
    pub fn rays(self) -> &'static [u32] {
        match self {
            Effort::Quick => &[8, 16, 96],
            Effort::Usual => &[4, 8, 16, 64, 128],
            Effort::Thorough => &[1, 2, 4, 8, 16, 48, 64, 128, 256],
        }
    }
}
