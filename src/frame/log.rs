//! What each frame did, as lines of JSON.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::budget::QualityState;
use super::pipeline::FrameReport;
use super::scheduler::DeviceShare;
use crate::error::{Error, Result};
use crate::whole_file;

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
    /// Samples whose estimate was not finite, and which were left out.
    pub dropped_samples: u64,
    /// Making a new sample pattern, where gaze or view had changed.
    pub pattern_ms: f64,
    /// Bringing what moves to its instant.
    #[serde(default)]
    pub motion_ms: f64,
    /// Finding what pixels and samples see.
    pub trace_ms: f64,
    /// Shading the samples.
    pub shade_ms: f64,
    /// Keeping the cache of light.
    pub light_ms: f64,
    /// Bringing the results to the presenting device.
    pub share_ms: f64,
    /// From samples to pixels.
    pub reconstruct_ms: f64,
    /// The whole frame, from the pose to the picture.
    pub frame_ms: f64,
    /// What each OpenCL device did, in the order of the run's own list of them.
    pub devices: Vec<DeviceShare>,
    /// Where the eyes looked, in 0..1 of the image from the upper left corner.
    pub gaze: DVec2,
    /// The head in the world, in metres.
    pub head_position: DVec3,
    /// The head's orientation in the world, as x, y, z, w.
    pub head_orientation: DQuat,
    /// What the frame was made with where its time is held; `null` where settings stay as they are.
    pub budget: Option<QualityState>,
    /// How old its poses were; `null` where poses are those of a script.
    #[serde(default)]
    pub pose_age_ms: Option<Ages>,
}

/// How far the times that a frame's poses were asked for lie behind (negative) or ahead of the time at which
/// its picture was seen, in milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ages {
    /// Of the poses that move the wearer.
    pub begin: Option<f64>,
    /// Of those that were traced.
    pub trace: Option<f64>,
    /// Of those that corrected what was traced: the farthest of all views.
    pub late: Option<f64>,
}

impl FrameRecord {
    /// What a renderer tells of a frame; the rest is for who has it made.
    pub fn of(report: &FrameReport) -> FrameRecord {
        FrameRecord {
            samples: report.samples as u64,
            rays: report.rays,
            dropped_samples: report.dropped.into(),
            pattern_ms: report.pattern_ms,
            motion_ms: report.stages.motion,
            trace_ms: report.stages.trace,
            shade_ms: report.stages.shade,
            light_ms: report.stages.light,
            share_ms: report.stages.share,
            reconstruct_ms: report.stages.reconstruct,
            frame_ms: report.frame_ms,
            devices: report.devices.clone(),
            ..FrameRecord::default()
        }
    }
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
    /// Tells whether [`FrameLog::create`] would replace what is no log.
    ///
    /// # Errors
    /// [`Error::File`] where a regular file of another kind has the name.
    pub fn check(path: &Path) -> Result<()> {
        /// Every record's first key.
        const BEGINNING: &[u8] = b"{\"frame\":";
        if path.is_file() { whole_file::check_kind(path, BEGINNING, "log of frames") } else { Ok(()) }
    }

    /// Makes the file, or empties the one that is there, if it is a log too.
    ///
    /// # Errors
    /// Where it cannot be made, and as [`FrameLog::check`].
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let path = path.into();
        FrameLog::check(&path)?;
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
            pattern_ms: 2.0,
            motion_ms: 0.3,
            trace_ms: 4.0,
            shade_ms: 6.0,
            light_ms: 1.5,
            share_ms: 0.5,
            reconstruct_ms: 1.0,
            frame_ms,
            devices: vec![DeviceShare {
                samples: 55_000,
                trace_ms: 4.0,
                shade_ms: 6.0,
                light_ms: 1.5,
                copy_ms: 0.5,
            }],
            gaze: DVec2::new(0.25, 0.75),
            head_position: DVec3::new(1.0, 2.0, 3.0),
            head_orientation: DQuat::from_rotation_y(0.3),
            budget: None,
            pose_age_ms: Some(Ages { begin: Some(-3.0), trace: Some(0.5), late: None }),
        }
    }

    #[test]
    fn every_line_is_there_before_the_log_is_closed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames.jsonl");
        std::fs::write(&path, "{\"frame\":0, of an earlier, longer run\n".repeat(500)).unwrap();
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

    #[test]
    fn what_is_no_log_is_not_emptied() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("diary");
        std::fs::write(&path, "dear").unwrap();
        let message = FrameLog::create(&path).unwrap_err().to_string();
        assert!(message.contains("is no log of frames"), "{message}");
        assert_eq!(std::fs::read(&path).unwrap(), b"dear");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told() {
        let mut log = FrameLog::create("/dev/full").unwrap();
        let message = log.push(&record(0, 20.0)).unwrap_err().to_string();
        assert!(message.contains("the disk is full"), "{message}");
    }
}
