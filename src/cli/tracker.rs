//! `foveate tracker`: a Rift DK1's tracker, live, recorded or replayed.

mod line;
mod view;

use super::options::Overrides;
use super::stop::stop_signal;
use crate::config::{Dk1Config, Layers};
use crate::error::{Error, Result};
use crate::headset::rift_dk1::device::{RECORDED_AHEAD, Received, Status, Tracker};
use crate::headset::rift_dk1::fusion::{Fusion, Keepsake};
use crate::headset::rift_dk1::recording::{Reader, Writer};
use crate::headset::rift_dk1::report::SensorReport;
use crate::places;
use line::Line;
use std::io::{BufWriter, ErrorKind, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use view::{Summary, View};

/// Time between two pictures of the live view.
const REFRESH: Duration = Duration::from_millis(100);
/// How long a tracker may take to be found, and to send its first report.
const PATIENCE: Duration = Duration::from_secs(2);
const LONG_PATIENCE: Duration = Duration::from_secs(8);

/// Arguments of `foveate tracker`.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Args {
    /// Write every report with its host time to FILE,
    /// when the run ends; a run without reports leaves what was there
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    pub record: Option<PathBuf>,
    /// Run a recording instead of a tracker; bare 62-byte reports (.dk1raw) will do
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Print one JSON line for each report
    #[arg(long)]
    pub json: bool,
    /// Stop after this many seconds
    #[arg(long, value_name = "S", conflicts_with = "replay")]
    pub seconds: Option<f64>,
    /// Keep what is learned of each tracker in DIR
    /// [default: the setting dk1.memory; a replay keeps nothing]
    #[arg(long, value_name = "DIR")]
    pub memory: Option<PathBuf>,
    #[command(flatten)]
    overrides: Overrides,
    /// Start a replay from what is kept in FILE of the tracker
    #[arg(long, value_name = "FILE", requires = "replay")]
    pub calibration: Option<PathBuf>,
}

/// Runs the command; output goes to standard output.
///
/// # Errors
/// When a file or the tracker cannot be used. A reader that closes our output is no error.
pub fn run(args: &Args) -> Result<()> {
    if args.seconds.is_some_and(|seconds| !(seconds.is_finite() && seconds > 0.0)) {
        return Err(Error::setting(
            "--seconds",
            "it is not a positive number of seconds; give one, such as 10",
        ));
    }
    let config = args.overrides.layers(Layers::default())?.finish()?;
    let mut out = BufWriter::new(std::io::stdout().lock());
    match &args.replay {
        Some(path) => replay(args, path, &mut out),
        None => live(args, &config.dk1, &mut out),
    }
}

/// Runs a recording through the fusion.
fn replay(args: &Args, path: &Path, out: &mut dyn Write) -> Result<()> {
    check_regular(path, "a recording")?;
    let mut reader = Reader::open(path)?;
    let mut fusion = match &args.calibration {
        Some(path) => Fusion::resume(&read_keepsake(path)?),
        None => Fusion::new(),
    };
    let mut summary = Summary::default();
    for entry in reader.by_ref() {
        let entry = entry?;
        let report = SensorReport::decode(&entry.bytes);
        let update = report.map(|report| fusion.update(&report, entry.host));
        let line = Line {
            host: entry.host,
            update,
            orientation: fusion.orientation(),
            predicted: fusion.predicted(RECORDED_AHEAD),
            angular_velocity: fusion.angular_velocity(),
            yaw_source: fusion.yaw_source(),
        };
        if args.json && !written(line.write(summary.device_time, out))? {
            return Ok(());
        }
        summary.add(&line, report.ok().map(|report| report.celsius()));
    }
    if !args.json {
        written(summary.write(&fusion, out))?;
    }
    written(out.flush())?;
    if summary.reports == 0 {
        let problem =
            format!("none of its {} records is a DK1's report; is it a recording?", summary.malformed);
        return Err(Error::File { path: path.to_path_buf(), problem });
    }
    if reader.cut_off() > 0 {
        super::complain(&format!(
            "note: {}: the last {} bytes are no whole report and were left out",
            path.display(),
            reader.cut_off()
        ));
    }
    Ok(())
}

/// Pipes and devices may have no end, or none that comes.
fn check_regular(path: &Path, what: &str) -> Result<()> {
    if !std::fs::metadata(path).map_err(|e| Error::io(path, &e))?.is_file() {
        let problem = format!("it is not a regular file; give the path of {what}");
        return Err(Error::File { path: path.to_path_buf(), problem });
    }
    Ok(())
}

fn read_keepsake(path: &Path) -> Result<Keepsake> {
    /// Many times what a run keeps.
    const MOST_BYTES: u64 = 1 << 16;
    check_regular(path, "what a live run kept")?;
    let file = std::fs::File::open(path).map_err(|error| Error::io(path, &error))?;
    let mut text = String::new();
    file.take(MOST_BYTES).read_to_string(&mut text).map_err(|error| Error::io(path, &error))?;
    serde_json::from_str(&text).map_err(|error| Error::File {
        path: path.to_path_buf(),
        problem: format!("this is no calibration of a tracker: {error}; give a file that a live run kept"),
    })
}

/// Follows a tracker.
fn live(args: &Args, config: &Dk1Config, out: &mut dyn Write) -> Result<()> {
    let mut writer = args.record.as_deref().map(Writer::create).transpose()?;
    let stop = stop_signal(|| ())?;
    let (sender, received) = channel();
    let listener = Box::new(move |report: &Received| {
        // The other end is gone only when the command is ending.
        let _ = sender.send(*report);
    });
    let memory = args.memory.clone().or_else(|| memory(config));
    let tracker = Tracker::start(memory, Some(listener))?;
    let begun = Instant::now();
    let end = args.seconds.map(|seconds| begun + Duration::from_secs_f64(seconds.min(1e9)));
    let mut view = View::new(std::io::stdout().is_terminal());
    let mut connected = false;
    let mut device_time = 0.0;
    while end.is_none_or(|end| Instant::now() < end) && !stop.load(Ordering::Relaxed) {
        std::thread::sleep(REFRESH);
        let reports = take_up(&received, writer.as_mut())?;
        connected |= !reports.is_empty();
        if !connected {
            give_up(&tracker, begun.elapsed())?;
        }
        let going_on = if args.json {
            print_lines(&reports, &mut device_time, out)
        } else {
            view.show(&tracker.snapshot(), out)
        };
        if !written(going_on.and_then(|()| out.flush()))? {
            break;
        }
    }
    drop(tracker);
    take_up(&received, writer.as_mut())?;
    writer.map_or(Ok(()), Writer::finish)
}

/// Empties the channel, and records what was in it.
fn take_up(received: &Receiver<Received>, mut writer: Option<&mut Writer>) -> Result<Vec<Received>> {
    let reports: Vec<_> = received.try_iter().collect();
    if let Some(writer) = writer.as_mut() {
        for report in &reports {
            writer.add(report.host, &report.bytes)?;
        }
    }
    Ok(reports)
}

/// Before its first report a tracker may be missing for good.
fn give_up(tracker: &Tracker, waited: Duration) -> Result<()> {
    let patience = match tracker.snapshot().status {
        Status::Denied(_) | Status::Failed(_) | Status::Unlisted(_) => Duration::ZERO,
        Status::Absent => PATIENCE,
        Status::Silent | Status::Connected => LONG_PATIENCE,
    };
    match tracker.problem() {
        Some(problem) if waited > patience => Err(problem),
        _ => Ok(()),
    }
}

fn print_lines(reports: &[Received], device_time: &mut f64, out: &mut dyn Write) -> std::io::Result<()> {
    for report in reports {
        let line = Line {
            host: Some(report.host),
            update: report.update,
            orientation: report.orientation,
            predicted: report.predicted,
            angular_velocity: report.angular_velocity,
            yaw_source: report.yaw_source,
        };
        line.write(*device_time, out)?;
        *device_time = line.device_time().unwrap_or(*device_time);
    }
    Ok(())
}

/// False when whoever reads our output has had enough.
fn written(result: std::io::Result<()>) -> Result<bool> {
    match result {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(Error::writing(Path::new("standard output"), &error)),
    }
}

/// The folder where what is learned of trackers is kept: the setting's, or the user's folder for what
/// programs learn.
pub(super) fn memory(config: &Dk1Config) -> Option<PathBuf> {
    if !config.memory.as_os_str().is_empty() {
        return Some(config.memory.clone());
    }
    places::state().map(|state| state.join("foveate"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibration_is_a_regular_file_of_moderate_size() {
        let told = |path: &Path| read_keepsake(path).unwrap_err().to_string();
        assert!(told(Path::new("/dev/zero")).contains("not a regular file"));
        let folder = tempfile::tempdir().unwrap();
        let sparse = folder.path().join("sparse");
        std::fs::File::create(&sparse).unwrap().set_len(1 << 40).unwrap();
        assert!(told(&sparse).contains("no calibration of a tracker"));
    }
    use crate::headset::rift_dk1::report::SensorReport;

    #[test]
    fn a_file_without_reports_is_an_error_and_a_good_one_prints_a_line_each() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dk1raw");
        let args = Args { json: true, ..Args::default() };
        std::fs::write(&path, [7; 124]).unwrap();
        let problem = replay(&args, &path, &mut Vec::new()).unwrap_err().to_string();
        assert!(problem.contains("no recording of a tracker"), "{problem}");

        let good = SensorReport { sample_count: 2, timestamp: 65_535, ..SensorReport::default() }.encode();
        let next = SensorReport { sample_count: 2, timestamp: 1, ..SensorReport::default() }.encode();
        std::fs::write(&path, [good, [9; 62], next].concat()).unwrap();
        let mut out = Vec::new();
        replay(&args, &path, &mut out).unwrap();
        let lines: Vec<serde_json::Value> =
            String::from_utf8(out).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0]["device_time_s"], 65.536);
        assert_eq!(lines[1]["device_time_s"], 65.536);
        assert_eq!(lines[1]["flags"], serde_json::json!(["malformed"]));
        assert_eq!(lines[2]["device_time_s"], 65.538);
        assert_eq!(lines[2]["orientation"], serde_json::json!([1.0, 0.0, 0.0, 0.0]));
        assert_eq!(lines[2]["predicted_40ms"], serde_json::json!([1.0, 0.0, 0.0, 0.0]));
    }
}
