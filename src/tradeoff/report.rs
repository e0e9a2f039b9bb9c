//! What a measurement found: `report.json`, `points.csv`, `sequences.csv`, `front.toml` and `comparison.md`.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::provenance::Provenance;
pub use super::reference::ReferenceError;
use super::rivals::AT_EQUAL_COST;
use super::sequence::{self, Sequence};
use super::store::write_bytes;
use super::{candidate, page, spread};
use crate::config::OperatingPoint;
use crate::error::{Error, Result};
use crate::frame::front::{on_front, with_ladder};
use crate::metrics::stats::{mean, median, percentile};

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
    /// What a frame of the given settings took just before and after, in milliseconds: how fast the machine
    /// was. [`Report::steady`] takes that out of the times.
    pub pulse_ms: f64,
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
    /// Its frame time over that of the given settings.
    #[serde(default)]
    pub cost: f64,
    /// For what was made to cost as much as the given settings: whether it does, within 5 %.
    #[serde(default)]
    pub at_equal_cost: Option<bool>,
    /// What the budget controller takes of it; none for what others do.
    pub operating: Option<OperatingPoint>,
}

/// How far a reference with few bounces of light is from one with more.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its bounces.
    pub bounces: u32,
    /// Those of the other.
    pub of: u32,
    /// PSNR in linear light up to white, decibels.
    pub psnr: f64,
    /// Relative squared error in linear light.
    pub relmse: f64,
    /// Mean FLIP.
    pub flip: f64,
    /// Score of the foveated difference.
    pub foveated_score: f64,
}

/// A whole measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The scene's name.
    pub scene: String,
    /// Its triangles.
    pub triangles: usize,
    /// Program, time and machine.
    #[serde(default)]
    pub provenance: Provenance,
    /// What traces, what reconstructs, and how samples get from one to the other.
    pub device: String,
    /// Pixels across and down, both eyes together.
    pub size: [u32; 2],
    /// Pixels per degree on the axis.
    pub pixels_per_degree: f64,
    /// Poses, gazes for each, and frames that follow each other.
    pub places: [usize; 3],
    /// Frames that those which are judged may know of; rivals know of none.
    #[serde(default)]
    pub history: usize,
    /// Effort.
    pub effort: super::Effort,
    /// How far the reference may be off: the worst of its pictures.
    pub reference_error: ReferenceError,
    /// What pictures without noise lack that have fewer bounces of light; empty where only one number of
    /// bounces was measured.
    pub light_left_out: Vec<LeftOut>,
    /// Frames that follow each other, the given settings' first in each motion.
    #[serde(default)]
    pub sequences: Vec<Sequence>,
    /// Everything that was measured; the given settings first.
    pub points: Vec<Point>,
}

impl Point {
    /// Its name; where it was to cost as much as the given settings and does not, that is said.
    pub fn title(&self) -> String {
        match self.at_equal_cost {
            Some(false) => format!("{} (missed: {:.2} times the cost)", self.name, self.cost),
            _ => self.name.clone(),
        }
    }
}

impl Report {
    /// Takes the machine's ups and downs out of all times: they become what they would have been had frames
    /// of the given settings always taken their median. [`Report::drift`] tells how much that is.
    pub fn steady(&mut self) {
        let pulses: Vec<f64> = self.points.iter().map(|p| p.pulse_ms).collect();
        let Some(usual) = median(&pulses) else { return };
        for point in &mut self.points {
            let factor = usual / point.pulse_ms;
            for ms in
                [&mut point.frame_ms, &mut point.frame_ms_p10, &mut point.frame_ms_p90, &mut point.pattern_ms]
            {
                *ms *= factor;
            }
            if let Some(operating) = &mut point.operating {
                operating.frame_ms *= factor;
            }
        }
    }

    /// Frame times of the given settings between points, over their median: 10th and 90th percentile.
    pub fn drift(&self) -> [f64; 2] {
        let pulses: Vec<f64> = self.points.iter().map(|p| p.pulse_ms).collect();
        let at = |p| percentile(&pulses, p).unwrap_or(1.0) / median(&pulses).unwrap_or(1.0);
        [at(10.0), at(90.0)]
    }

    /// Marks the points on the front: among those that aim at the picture of the given settings, with as
    /// many bounces of light, and differ from them by more than the spread of what was measured.
    pub fn mark_front(&mut self) {
        let races: Vec<bool> =
            self.points.iter().map(|p| p.operating.is_some() && self.same_aim(p)).collect();
        let given = self.points[0].clone();
        let value = |(point, races): (&Point, &bool)| {
            let standing = races.then(|| spread::standing(&given, point)).flatten();
            standing.unwrap_or((f64::NAN, f64::NAN))
        };
        let values: Vec<(f64, f64)> = self.points.iter().zip(&races).map(value).collect();
        for (point, on_front) in self.points.iter_mut().zip(on_front(&values)) {
            point.on_front = on_front;
        }
    }

    /// Finds what points cost, and whether those that were to cost as much as the given settings do.
    pub fn find_costs(&mut self) {
        let given = self.points.first().map_or(0.0, |p| p.frame_ms).max(1e-9);
        for point in &mut self.points {
            point.cost = point.frame_ms / given;
            point.at_equal_cost =
                point.name.ends_with(AT_EQUAL_COST).then(|| (point.cost - 1.0).abs() <= spread::EQUAL);
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
        write_bytes(&out.join("sequences.csv"), sequence::csv(&self.sequences).as_bytes())?;
        write_bytes(&out.join("front.toml"), self.front_toml()?.as_bytes())?;
        write_bytes(&out.join("comparison.md"), self.comparison().as_bytes())?;
        let html = page::html(self, picture, reference);
        write_bytes(&out.join("report.html"), html.as_bytes())
    }

    /// One line for each point.
    fn csv(&self) -> String {
        let mut text = String::from(
            "name,axis,frame_ms,frame_ms_p10,frame_ms_p90,cost,pattern_ms,samples,rays,psnr,psnr_display,relmse,\
             flip,foveated_score,foveated_score_error,flicker,disagreement,on_front\n",
        );
        for p in &self.points {
            text += &format!(
                "\"{}\",{},{:.3},{:.3},{:.3},{:.3},{:.3},{},{},{:.3},{:.3},{:.6},{:.5},{:.4},{:.4},{:.6},{},{}\n",
                p.name.replace('"', "\"\""),
                p.axis,
                p.frame_ms,
                p.frame_ms_p10,
                p.frame_ms_p90,
                p.cost,
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
        let given = &self.points[0];
        let told = self.points.iter().filter(|p| spread::standing(given, p).is_some());
        let points: Vec<OperatingPoint> = told.filter_map(|p| p.operating).collect();
        let front: Vec<OperatingPoint> = self.front().iter().filter_map(|p| p.operating).collect();
        let front = points.first().map_or(Vec::new(), |given| with_ladder(&points, &front, given));
        let text = toml::to_string(&File { budget: Budget { front } })
            .map_err(|e| Error::setting("front.toml", format!("the front cannot be written: {e}")))?;
        let origin: String = self
            .provenance
            .rows()
            .iter()
            .map(|(name, value)| format!("# {name}: {}\n", one_line(value)))
            .collect();
        Ok(format!(
            "# The Pareto front of {} on {}, {}x{}: milliseconds of a frame against the\n\
             # foveated score. Written by foveate measure; give it with --config, and a --target-ms where nothing\n\
             # is displayed. Points that cannot be told from the given settings are left out.\n{origin}\n{text}",
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
                if p.axis == candidate::GIVEN { "foveate".to_string() } else { p.title() },
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

#[cfg(test)]
pub mod tests {
    //! Also makes reports for other tests.

    use super::*;
    use crate::config::Config;

    /// A point with a frame time and a score; the machine was as fast as `pulse_ms` says.
    pub fn point(name: &str, axis: &str, frame_ms: f64, foveated_score: f64, pulse_ms: f64) -> Point {
        Point {
            name: name.to_string(),
            axis: axis.to_string(),
            config: serde_json::json!({ "name": name }),
            frame_ms,
            frame_ms_p10: frame_ms * 0.9,
            frame_ms_p90: frame_ms * 1.2,
            frames: 3,
            pulse_ms,
            pattern_ms: 1.0,
            samples: 10,
            rays: 20,
            psnr: 30.0,
            psnr_display: 31.0,
            relmse: 0.01,
            flip: 0.1,
            foveated_score,
            foveated_thresholds: 1.0,
            foveated_scores: vec![foveated_score; 2],
            foveated_score_error: 0.0,
            flicker: 0.01,
            disagreement: None,
            on_front: false,
            cost: 1.0,
            at_equal_cost: None,
            operating: Some(OperatingPoint::of(&Config::default(), 1000, frame_ms, foveated_score)),
        }
    }

    /// A report of these points.
    pub fn report(scene: &str, points: Vec<Point>) -> Report {
        Report {
            scene: scene.to_string(),
            triangles: 2,
            provenance: Provenance::now(vec!["a driver 1.0".to_string()], "0123".to_string()),
            device: "a device".to_string(),
            size: [4, 2],
            pixels_per_degree: 2.0,
            places: [1, 2, 2],
            history: 3,
            effort: super::super::Effort::Quick,
            reference_error: ReferenceError {
                passes: 4,
                rays_per_pixel: 8,
                psnr: 40.0,
                psnr_display: 40.0,
                relmse: 0.001,
                flip_of_halves: 0.01,
            },
            light_left_out: Vec::new(),
            sequences: Vec::new(),
            points,
        }
    }

    #[test]
    fn a_machine_that_slows_down_does_not_count() {
        let mut slow = point("slow", "rays", 30.0, 6.0, 20.0);
        slow.operating = None;
        let mut found = report(
            "scene",
            vec![
                point("given", candidate::GIVEN, 10.0, 5.0, 10.0),
                slow,
                point("same", "k", 10.5, 5.0, 10.5),
                point("fast", "rays", 8.0, 4.0, 8.0),
            ],
        );
        let drift = found.drift();
        assert!(drift[0] < 0.9 && drift[1] > 1.5, "{drift:?}");
        found.steady();
        let times: Vec<f64> = found.points.iter().map(|p| p.frame_ms).collect();
        let usual = 10.25;
        for (ms, expected) in times.iter().zip([1.0, 1.5, 1.0, 1.0]) {
            assert!((ms - expected * usual).abs() < 1e-9, "{times:?}");
        }
        assert!((found.points[3].operating.unwrap().frame_ms - usual).abs() < 1e-9);
        assert!((found.points[1].frame_ms_p90 - 1.2 * 1.5 * usual).abs() < 1e-9);
    }

    #[test]
    fn the_front_is_of_points_that_frames_can_move_to() {
        let mut apart = point("late", candidate::LATE, 1.0, 9.0, 1.0);
        apart.operating = None;
        let mut found = report(
            "scene",
            vec![
                point("given", candidate::GIVEN, 10.0, 5.0, 10.0),
                apart,
                point("worse", "rays", 12.0, 4.0, 10.0),
                point("better", "rays", 20.0, 6.0, 10.0),
            ],
        );
        found.mark_front();
        let front: Vec<&str> = found.front().iter().map(|p| p.name.as_str()).collect();
        assert_eq!(front, ["given", "better"]);
    }
}
