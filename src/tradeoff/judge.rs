//! Scores of the pictures of one pose and gaze.

use glam::DVec2;

use super::reference::Reference;
use crate::error::Result;
use crate::math::view::View;
use crate::metrics::foveated::{self, FoveatedDifference};
use crate::metrics::metric::{Viewing, compare, psnr_up_to_white};
use crate::metrics::pairs::{Match, disagreement, flicker};
use crate::metrics::{Display, Picture};

/// What pictures of one pose and gaze reach.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    pub psnr: f64,
    pub psnr_display: f64,
    pub relmse: f64,
    pub flip: f64,
    pub foveated_score: f64,
    pub foveated_thresholds: f64,
    pub flicker: f64,
    pub disagreement: f64,
}

/// A pose in two steps, with what its pictures should be.
pub struct Judge<'a> {
    pub eyes: &'a [View],
    pub gazes: &'a [DVec2],
    pub references: [&'a Reference; 2],
    pub matches: &'a [Match],
    pub viewing: Viewing,
}

impl Judge<'_> {
    /// Judges the pictures of both steps.
    pub fn judge(&self, pictures: [&Picture; 2]) -> Result<Scores> {
        let exposure = self.viewing.exposure;
        let found = compare(pictures[0], &self.references[0].picture, self.viewing)?;
        let shown = pictures.map(|picture| Display::from_picture(picture, exposure));
        let references = self.references.map(|reference| &reference.display);
        let (tests, truths) = (split(&shown[0], self.eyes), split(references[0], self.eyes));
        let mut foveated = FoveatedDifference { thresholds: 0.0, score: 0.0 };
        for (index, eye) in self.eyes.iter().enumerate() {
            let part = foveated::difference(&tests[index], &truths[index], eye, self.gazes[index]);
            foveated.thresholds += part.thresholds / self.eyes.len() as f64;
        }
        foveated.score = foveated::score(foveated.thresholds);
        let disagreement = match (tests.as_slice(), truths.as_slice()) {
            ([left, right], [left_truth, right_truth]) => {
                disagreement([left, right], [left_truth, right_truth], self.matches)
            }
            _ => 0.0,
        };
        Ok(Scores {
            // Equal pictures have infinitely many decibels, which JSON cannot say.
            psnr: psnr_up_to_white(pictures[0], &self.references[0].picture, exposure)?.min(200.0),
            psnr_display: found.psnr.min(200.0),
            relmse: found.relmse,
            flip: found.flip,
            foveated_score: foveated.score,
            foveated_thresholds: foveated.thresholds,
            flicker: flicker([&shown[0], &shown[1]], references),
            disagreement,
        })
    }
}

/// Each eye's picture.
pub fn split(picture: &Display, eyes: &[View]) -> Vec<Display> {
    let mut left = 0;
    let mut parts = Vec::new();
    for eye in eyes {
        let rows = picture.pixels.chunks(picture.width as usize);
        let pixels = rows.flat_map(|row| row[left..left + eye.width as usize].iter().copied()).collect();
        parts.push(Display { width: eye.width, height: picture.height, pixels });
        left += eye.width as usize;
    }
    parts
}

impl Scores {
    /// The mean of several.
    pub fn mean(scores: &[Scores]) -> Scores {
        let of =
            |value: fn(&Scores) -> f64| scores.iter().map(value).sum::<f64>() / scores.len().max(1) as f64;
        Scores {
            psnr: of(|s| s.psnr),
            psnr_display: of(|s| s.psnr_display),
            relmse: of(|s| s.relmse),
            flip: of(|s| s.flip),
            foveated_score: of(|s| s.foveated_score),
            foveated_thresholds: of(|s| s.foveated_thresholds),
            flicker: of(|s| s.flicker),
            disagreement: of(|s| s.disagreement),
        }
    }
}
