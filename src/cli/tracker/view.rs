//! The tracker for a person to read: live, and as a replay's summary.

use super::line::Line;
use crate::headset::rift_dk1::device::{Snapshot, Status};
use crate::headset::rift_dk1::fusion::{Fusion, YawSource};
use glam::{DQuat, DVec3, EulerRot};
use std::io::Write;
use std::time::{Duration, Instant};

/// Lines of the live picture.
const HEIGHT: usize = 9;
/// Time between two lines where the output is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(1);

/// Draws the live view: in place on a terminal, a line a second elsewhere.
pub struct View {
    terminal: bool,
    drawn: bool,
    reports: u64,
    at: Instant,
    rate: f64,
}

impl View {
    /// A view that has drawn nothing yet.
    pub fn new(terminal: bool) -> Self {
        View { terminal, drawn: false, reports: 0, at: Instant::now(), rate: 0.0 }
    }

    /// Shows the state.
    pub fn show(&mut self, snapshot: &Snapshot, out: &mut dyn Write) -> std::io::Result<()> {
        let due = self.at.elapsed() >= LINE_EVERY;
        if due {
            self.rate = (snapshot.reports - self.reports.min(snapshot.reports)) as f64
                / self.at.elapsed().as_secs_f64();
            (self.reports, self.at) = (snapshot.reports, Instant::now());
        }
        if !self.terminal {
            let line = [status(&snapshot.status), orientation(snapshot.orientation), losses(snapshot)];
            return if due { writeln!(out, "{}", line.join("; ")) } else { Ok(()) };
        }
        if self.drawn {
            write!(out, "\x1b[{HEIGHT}A")?;
        }
        self.drawn = true;
        for line in self.lines(snapshot) {
            writeln!(out, "\x1b[2K{line}")?;
        }
        Ok(())
    }

    fn lines(&self, s: &Snapshot) -> [String; HEIGHT] {
        let (tilt, yaw) = s.doubt;
        [
            format!("Oculus Rift DK1    {}", status(&s.status)),
            format!("orientation        {}", orientation(s.orientation)),
            format!("turning            {} deg/s", degrees(s.angular_velocity)),
            format!("doubt              tilt {:.2}, yaw {:.2} deg", tilt.to_degrees(), yaw.to_degrees()),
            format!(
                "gyroscope zero     {} deg/s{}",
                degrees(s.gyro_bias),
                if s.still { ", lying still" } else { "" }
            ),
            format!("yaw                {}", yaw_source(s.yaw_source)),
            format!("reports            {:.0}/s, {}", self.rate, losses(s)),
            format!("temperature        {:.1} degrees Celsius", s.celsius),
            format!("clock              {:+.0} ppm against this machine's", s.drift * 1e6),
        ]
    }
}

fn status(status: &Status) -> String {
    match status {
        Status::Absent => "not plugged in; waiting".to_string(),
        Status::Denied(path) => format!("may not be opened: {path}"),
        Status::Failed(why) | Status::Unlisted(why) => why.clone(),
        Status::Connected => "connected".to_string(),
        Status::Silent => "silent".to_string(),
    }
}

fn orientation(q: DQuat) -> String {
    let (yaw, pitch, roll) = q.to_euler(EulerRot::YXZ);
    let [yaw, pitch, roll] = [yaw, pitch, roll].map(f64::to_degrees);
    format!("yaw {yaw:7.2}, pitch {pitch:6.2}, roll {roll:7.2} deg")
}

fn degrees(rate: DVec3) -> String {
    let [x, y, z] = rate.to_array().map(f64::to_degrees);
    format!("{x:8.3} {y:8.3} {z:8.3}")
}

fn yaw_source(source: YawSource) -> String {
    match source {
        YawSource::Calibrating(share) => {
            format!("by gyroscope; magnetometer {:.0} % calibrated, look around", share * 100.0)
        }
        YawSource::Magnetometer => "by magnetometer".to_string(),
        YawSource::Gyroscope => "by gyroscope; the magnetic field is disturbed".to_string(),
    }
}

fn losses(s: &Snapshot) -> String {
    format!("{} in all, {} ms lost, {} malformed", s.reports, s.lost_ms, s.malformed)
}

/// What a replay held.
#[derive(Debug, Default)]
pub struct Summary {
    /// Reports that were taken up.
    pub reports: u64,
    /// Records that are no reports.
    pub malformed: u64,
    /// Device time of the newest sample in seconds.
    pub device_time: f64,
    first: Option<f64>,
    averaged: u64,
    clipped: u64,
    celsius: f64,
}

impl Summary {
    /// Takes up a line, and the report's temperature.
    pub fn add(&mut self, line: &Line, celsius: Option<f64>) {
        let Ok(update) = line.update else {
            self.malformed += 1;
            return;
        };
        self.reports += 1;
        self.device_time = update.placement.seconds();
        self.first.get_or_insert(self.device_time);
        self.averaged += u64::from(update.averaged);
        self.clipped += u64::from(update.clipped);
        self.celsius = celsius.unwrap_or(self.celsius);
    }

    /// Writes the summary.
    pub fn write(&self, fusion: &Fusion, out: &mut dyn Write) -> std::io::Result<()> {
        let seconds = self.device_time - self.first.unwrap_or(self.device_time);
        let (tilt, yaw) = fusion.doubt();
        writeln!(out, "reports            {}, {} malformed", self.reports, self.malformed)?;
        writeln!(out, "device time        {seconds:.3} s, {} ms lost", fusion.lost_milliseconds())?;
        writeln!(out, "averaged, clipped  {}, {}", self.averaged, self.clipped)?;
        writeln!(out, "orientation        {}", orientation(fusion.orientation()))?;
        writeln!(out, "doubt              tilt {:.2}, yaw {:.2} deg", tilt.to_degrees(), yaw.to_degrees())?;
        writeln!(out, "gyroscope zero     {} deg/s", degrees(fusion.gyro_bias()))?;
        writeln!(out, "yaw                {}", yaw_source(fusion.yaw_source()))?;
        writeln!(out, "temperature        {:.1} degrees Celsius", self.celsius)
    }
}
