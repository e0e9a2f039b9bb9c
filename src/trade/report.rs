//! What a measurement found: `report.json`, `points.csv`, `front.toml` and `comparison.md`.

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use super::reference::ReferenceError;
use super::rivals::AT_EQUAL_COST;
use super::store::write_bytes;
use super::{candidate, page};
use crate::config::OperatingPoint;
use crate::error::{Error, Result};
use crate::frame::front::on_front;
use crate::measure::stats::mean;

/// One way to make frames, with what it costs and reaches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Its name.
    pub name: String,
    /// The slider by which it differs from the given settings.
    pub axis: String,
    /// The effective configuration; for what others do, what describes it.
    pub config: serde_json::Value,
    /// Median milliseconds of a frame whose gaze rests.
    pub frame_ms: f64,
    /// 10th and 90th percentile of the same.
    pub frame_ms_p10: f64,
    /// See `frame_ms_p10`.
    pub frame_ms_p90: f64,
    /// Frames that were timed.
    pub frames: usize,
    /// Median milliseconds that a new gaze costs besides.
    pub pattern_ms: f64,
    /// Shaded samples of a frame.
    pub samples: usize,
    /// Rays of a frame.
    pub rays: u64,
    /// PSNR in linear light, decibels, peak 1: cut off at display white.
    pub psnr: f64,
    /// PSNR of what a screen shows.
    pub psnr_display: f64,
    /// Relative squared error in linear light.
    pub relmse: f64,
    /// Mean FLIP.
    pub flip: f64,
    /// Score of the foveated difference, 0 to 10.
    pub foveated_score: f64,
    /// The foveated difference in thresholds.
    pub foveated_thresholds: f64,
    /// The same at each pose and gaze.
    pub foveated_scores: Vec<f64>,
    /// Standard error, over poses and gazes, of how far the score is from that of the given settings; 0
    /// where there is only one.
    pub foveated_score_error: f64,
    /// Change of the error between frames, in codes of 0..1.
    pub flicker: f64,
    /// Difference of both eyes' errors, in codes of 0..1; none for one eye.
    pub disagreement: Option<f64>,
    /// Nothing else that was measured is at least as fast and as good.
    pub on_front: bool,
    /// What the budget controller takes of it; none for what others do.
    pub operating: Option<OperatingPoint>,
}

/// A whole measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The scene's name.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// What traces, what reconstructs, and how samples get from one to the other.
    pub device: String,
    /// Pixels across and down, both eyes together.
    pub size: [u32; 2],
    /// Pixels per degree on the axis.
    pub pixels_per_degree: f64,
    /// Poses, gazes for each, and frames that follow each other.
    pub places: [usize; 3],
    /// Effort.
    pub effort: super::Effort,
    /// How far the reference may be off: the worst of its pictures.
    pub reference_error: ReferenceError,
    /// Everything that was measured; the given settings first.
    pub points: Vec<Point>,
}

impl Report {
    /// Marks the points on the front: among those that aim at the picture of the given settings, with as
    /// many bounces of light.
    pub fn mark_front(&mut self) {
        let races: Vec<bool> =
            self.points.iter().map(|p| p.operating.is_some() && self.same_aim(p)).collect();
        let value = |(point, races): (&Point, &bool)| match races {
            true => (point.frame_ms, point.foveated_score),
            false => (f64::NAN, f64::NAN),
        };
        let values: Vec<(f64, f64)> = self.points.iter().zip(&races).map(value).collect();
        for (point, on_front) in self.points.iter_mut().zip(on_front(&values)) {
            point.on_front = on_front;
        }
    }

    /// Finds how sure the differences between points and the given settings are. Poses differ more than
    /// points do, so differences are taken at each before they are averaged.
    pub fn find_errors(&mut self) {
        let given = self.points.first().map_or(Vec::new(), |p| p.foveated_scores.clone());
        for point in &mut self.points {
            let apart: Vec<f64> = point.foveated_scores.iter().zip(&given).map(|(a, b)| a - b).collect();
            let error = mean(&apart).map_or(0.0, |m| m.standard_error);
            point.foveated_score_error = if error.is_finite() { error } else { 0.0 };
        }
    }

    /// Whether a point's picture is meant to be that of the given settings.
    fn same_aim(&self, point: &Point) -> bool {
        let bounces = |p: &Point| p.operating.map(|o| o.bounces);
        bounces(point) == bounces(&self.points[0])
    }

    /// The front, fastest first.
    pub fn front(&self) -> Vec<&Point> {
        let mut front: Vec<&Point> = self.points.iter().filter(|p| p.on_front).collect();
        front.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
        front
    }

    /// Writes all files; `picture` gives a point's pictures as JPEG (what it shows, its error map).
    ///
    /// # Errors
    /// [`Error::File`] where one cannot be written.
    pub fn write(
        &self,
        out: &Path,
        picture: &dyn Fn(&str) -> Option<[Vec<u8>; 2]>,
        reference: Option<Vec<u8>>,
    ) -> Result<()> {
        let json = serde_json::to_vec_pretty(self).map_err(|e| Error::writing(out, &e.into()))?;
        write_bytes(&out.join("report.json"), &json)?;
        write_bytes(&out.join("points.csv"), self.csv().as_bytes())?;
        write_bytes(&out.join("front.toml"), self.front_toml()?.as_bytes())?;
        write_bytes(&out.join("comparison.md"), self.comparison().as_bytes())?;
        let html = page::html(self, picture, reference);
        write_bytes(&out.join("report.html"), html.as_bytes())
    }

    /// One line for each point.
    fn csv(&self) -> String {
        let mut text = String::from(
            "name,axis,frame_ms,frame_ms_p10,frame_ms_p90,pattern_ms,samples,rays,psnr,psnr_display,relmse,\
             flip,foveated_score,foveated_score_error,flicker,disagreement,on_front\n",
        );
        for p in &self.points {
            text += &format!(
                "\"{}\",{},{:.3},{:.3},{:.3},{:.3},{},{},{:.3},{:.3},{:.6},{:.5},{:.4},{:.4},{:.6},{},{}\n",
                p.name.replace('"', "\"\""),
                p.axis,
                p.frame_ms,
                p.frame_ms_p10,
                p.frame_ms_p90,
                p.pattern_ms,
                p.samples,
                p.rays,
                p.psnr,
                p.psnr_display,
                p.relmse,
                p.flip,
                p.foveated_score,
                p.foveated_score_error,
                p.flicker,
                p.disagreement.map_or(String::new(), |d| format!("{d:.6}")),
                p.on_front
            );
        }
        text
    }

    /// The front as settings: `--config front.toml` has frames move along it.
    fn front_toml(&self) -> Result<String> {
        #[derive(Serialize)]
        struct Budget {
            front: Vec<OperatingPoint>,
        }
        #[derive(Serialize)]
        struct File {
            budget: Budget,
        }
        let front = self.front().iter().filter_map(|p| p.operating).collect();
        let text = toml::to_string(&File { budget: Budget { front } })
            .map_err(|e| Error::setting("front.toml", format!("the front cannot be written: {e}")))?;
        Ok(format!(
            "# The Pareto front of {} on {}, {}x{}: milliseconds of a frame against the\n\
             # foveated score. Written by foveate measure; give it with --config, and a --target-ms.\n\n{text}",
            one_line(&self.scene),
            one_line(&self.device),
            self.size[0],
            self.size[1],
        ))
    }

    /// A table in Markdown: the given settings, the front, and what others do.
    pub fn comparison(&self) -> String {
        let mut text = String::from(
            "| scene | method | frame ms (p10 to p90) | PSNR dB | relMSE | FLIP | foveated score | flicker | eyes |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
        );
        let given = self.points.iter().filter(|p| p.axis == candidate::GIVEN);
        let rivals = self.points.iter().filter(|p| p.axis == candidate::RIVAL);
        for p in given.chain(rivals) {
            text += &format!(
                "| {} | {} | {:.0} ({:.0} to {:.0}) | {:.2} | {:.4} | {:.4} | {:.2} | {:.4} | {} |\n",
                one_line(&self.scene),
                if p.axis == candidate::GIVEN { "foveate" } else { &p.name },
                p.frame_ms,
                p.frame_ms_p10,
                p.frame_ms_p90,
                p.psnr,
                p.relmse,
                p.flip,
                p.foveated_score,
                p.flicker,
                p.disagreement.map_or("".to_string(), |d| format!("{d:.4}")),
            );
        }
        text
    }

    /// Rivals that were made to cost what the given settings do.
    pub fn at_equal_cost(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(|p| p.name.ends_with(AT_EQUAL_COST))
    }
}

fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
