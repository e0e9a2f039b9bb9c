//! What each frame did, as lines of JSON, and a summary of them.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// One frame. Times in milliseconds unless named otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Its number, from 0.
    pub frame: u64,
    /// When it is shown, in seconds of the presenter's clock.
    pub display_time_s: f64,
    /// Shaded samples.
    pub samples: u64,
    /// Pixels of the pictures made, of both eyes together.
    pub pixels: u64,
    /// Rays cast, of all kinds.
    pub rays: u64,
    /// Samples that were planned and not traced, to hold the frame time.
    pub dropped_samples: u64,
    /// Finding what pixels and samples see.
    pub trace_ms: f64,
    /// Shading the samples.
    pub shade_ms: f64,
    /// Bringing the results to the presenting device.
    pub share_ms: f64,
    /// From samples to pixels.
    pub reconstruct_ms: f64,
    /// The whole frame, from the pose to the picture.
    pub frame_ms: f64,
    /// Where the eyes looked, in 0..1 of the image from the upper left corner.
    pub gaze: DVec2,
    /// The head in the world, in metres.
    pub head_position: DVec3,
    /// The head's orientation in the world, as x, y, z, w.
    pub head_orientation: DQuat,
}

/// A file with one frame a line.
#[derive(Debug)]
pub struct FrameLog {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines.
    length: u64,
}

impl FrameLog {
    /// Makes the file, or empties the one that is there.
    ///
    /// # Errors
    /// Where it cannot be made.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        let file = File::create(&path).map_err(|e| Error::writing(&path, &e))?;
        Ok(FrameLog { path, file, length: 0 })
    }

    /// Adds a line and hands it to the system at once, so that a run that is interrupted keeps its frames.
    /// A number that is not finite is written as `null`.
    ///
    /// # Errors
    /// Where it cannot be written; the lines before stay whole.
    pub fn push(&mut self, record: &FrameRecord) -> Result<()> {
        let mut line = serde_json::to_vec(record).map_err(|e| Error::writing(&self.path, &e.into()))?;
        line.push(b'\n');
        self.file.write_all(&line).map_err(|error| {
            // Cuts off half a line; where that fails too, the first error is the one to tell.
            let _ = self.file.set_len(self.length);
            Error::writing(&self.path, &error)
        })?;
        self.length += line.len() as u64;
        Ok(())
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Frames in short. Numbers of samples, pixels and rays are means per frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// How many there were.
    pub frames: usize,
    /// Frames a second at the median frame time; 0 without frames.
    pub fps: f64,
    /// Frame times in milliseconds.
    pub frame_ms: Percentiles,
    /// Mean times of the stages in milliseconds.
    pub stage_ms: StageTimes,
    /// Shaded samples.
    pub samples: f64,
    /// Pixels.
    pub pixels: f64,
    /// Rays.
    pub rays: f64,
    /// Samples planned and not traced, of all frames together.
    pub dropped_samples: u64,
    /// Millions of rays a second of the stages that cast them, tracing and shading; 0 when these took no
    /// time.
    pub mrays_per_s: f64,
}

/// Percentiles by nearest rank: each is a value that was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// The median.
    pub p50: f64,
    /// What 99 of 100 do not exceed.
    pub p99: f64,
}

/// Times of a frame's stages in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StageTimes {
    /// Finding what pixels and samples see.
    pub trace: f64,
    /// Shading the samples.
    pub shade: f64,
    /// Bringing the results to the presenting device.
    pub share: f64,
    /// From samples to pixels.
    pub reconstruct: f64,
}

impl Summary {
    /// Sums up frames. Times that are not finite are left out; without frames all is 0.
    pub fn of(records: &[FrameRecord]) -> Self {
        let mean = |value: fn(&FrameRecord) -> f64| {
            let values: Vec<f64> = records.iter().map(value).filter(|v| v.is_finite()).collect();
            if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / values.len() as f64 }
        };
        let frame_ms = Percentiles::of(records.iter().map(|record| record.frame_ms).collect());
        let stage_ms = StageTimes {
            trace: mean(|r| r.trace_ms),
            shade: mean(|r| r.shade_ms),
            share: mean(|r| r.share_ms),
            reconstruct: mean(|r| r.reconstruct_ms),
        };
        let rays = mean(|r| r.rays as f64);
        Summary {
            frames: records.len(),
            fps: quotient(1000.0, frame_ms.p50),
            frame_ms,
            stage_ms,
            samples: mean(|r| r.samples as f64),
            pixels: mean(|r| r.pixels as f64),
            rays,
            dropped_samples: records.iter().map(|r| r.dropped_samples).fold(0, u64::saturating_add),
            mrays_per_s: quotient(rays, (stage_ms.trace + stage_ms.shade) * 1000.0),
        }
    }
}

impl Percentiles {
    /// Of the finite ones among these values; 0 when there are none.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        let rank = |hundredths: usize| {
            let rank = (values.len() * hundredths).div_ceil(100);
            values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Percentiles { p50: rank(50), p99: rank(99) }
    }
}

/// `a / b`, and 0 where `b` is not above 0.
fn quotient(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(frame: u64, frame_ms: f64) -> FrameRecord {
        FrameRecord {
            frame,
            display_time_s: frame as f64 / 60.0,
            samples: 55_000,
            pixels: 1_024_000,
            rays: 2_000_000 + frame,
            dropped_samples: 1,
            trace_ms: 4.0,
            shade_ms: 6.0,
            share_ms: 0.5,
            reconstruct_ms: 1.0,
            frame_ms,
            gaze: DVec2::new(0.25, 0.75),
            head_position: DVec3::new(1.0, 2.0, 3.0),
            head_orientation: DQuat::from_rotation_y(0.3),
        }
    }

    #[test]
    fn every_line_is_there_before_the_log_is_closed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames.jsonl");
        std::fs::write(&path, "an earlier, longer run\n".repeat(500)).unwrap();
        let mut log = FrameLog::create(&path).unwrap();
        for frame in 0..5 {
            log.push(&record(frame, 20.0)).unwrap();
            let text = std::fs::read_to_string(log.path()).unwrap();
            assert!(text.ends_with('\n'));
            let read: Vec<FrameRecord> =
                text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            assert_eq!(read, (0..=frame).map(|i| record(i, 20.0)).collect::<Vec<_>>());
        }
    }

    #[test]
    fn keys_are_those_that_others_build_on() {
        let line = serde_json::to_value(record(0, 20.0)).unwrap();
        assert_eq!(line["gaze"], serde_json::json!([0.25, 0.75]));
        assert_eq!(line["head_orientation"].as_array().unwrap().len(), 4);
        let summary = serde_json::to_value(Summary::of(&[record(0, 20.0)])).unwrap();
        for key in ["frames", "fps", "samples", "pixels", "rays", "dropped_samples", "mrays_per_s"] {
            assert!(summary[key].is_number(), "{key}");
        }
        assert_eq!(summary["frame_ms"], serde_json::json!({"p50": 20.0, "p99": 20.0}));
        assert_eq!(
            summary["stage_ms"],
            serde_json::json!({"trace": 4.0, "shade": 6.0, "share": 0.5, "reconstruct": 1.0})
        );
    }

    #[test]
    fn numbers_that_are_none_make_a_line_all_the_same() {
        let directory = tempfile::tempdir().unwrap();
        let mut log = FrameLog::create(directory.path().join("frames.jsonl")).unwrap();
        log.push(&record(0, f64::NAN)).unwrap();
        let line: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(log.path()).unwrap()).unwrap();
        assert!(line["frame_ms"].is_null());
    }

    #[test]
    fn wrong_places_are_told() {
        let directory = tempfile::tempdir().unwrap();
        for (path, part) in [
            (directory.path().to_path_buf(), "a folder is in its place"),
            (directory.path().join("no/frames.jsonl"), "its folder does not exist"),
        ] {
            let message = FrameLog::create(&path).unwrap_err().to_string();
            assert!(message.contains(part) && message.starts_with(path.to_str().unwrap()), "{message}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told() {
        let mut log = FrameLog::create("/dev/full").unwrap();
        let message = log.push(&record(0, 20.0)).unwrap_err().to_string();
        assert!(message.contains("the disk is full"), "{message}");
    }

    #[test]
    fn a_summary_is_of_medians_and_means() {
        let mut records: Vec<FrameRecord> = (0..100).map(|i| record(i, i as f64 + 1.0)).collect();
        let summary = Summary::of(&records);
        assert_eq!((summary.frames, summary.dropped_samples), (100, 100));
        assert_eq!(summary.frame_ms, Percentiles { p50: 50.0, p99: 99.0 });
        assert_eq!(summary.fps, 20.0);
        assert_eq!((summary.samples, summary.pixels, summary.rays), (55_000.0, 1_024_000.0, 2_000_049.5));
        assert!((summary.mrays_per_s - 200.00495).abs() < 1e-9);
        records[99].frame_ms = 1e6;
        assert_eq!(Summary::of(&records).fps, 20.0, "one late frame does not change the median");
        records[99].frame_ms = f64::NAN;
        assert_eq!(Summary::of(&records).frame_ms, Percentiles { p50: 50.0, p99: 99.0 });
    }

    #[test]
    fn no_frames_and_no_times_are_zeros() {
        assert_eq!(Summary::of(&[]), Summary::default());
        let summary = Summary::of(&[FrameRecord::default()]);
        assert_eq!((summary.frames, summary.fps, summary.mrays_per_s), (1, 0.0, 0.0));
    }
}
