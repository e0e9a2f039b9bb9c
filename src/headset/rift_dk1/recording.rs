//! Recordings of raw reports.
//!
//! Two forms are read, told apart by their first bytes: bare reports of 62 bytes one after another
//! (`.dk1raw`), and this program's own form, which adds host times:
//!
//! | bytes | content |
//! | --- | --- |
//! | 16 | `foveate dk1 1.0` and a line feed |
//! | 8, then 62, for each report | host time in ns (u64, little-endian; any origin), the report |

use super::report::{IN_REPORT_BYTES, SensorReport};
use crate::error::{Error, Result};
use crate::whole_file::{self, Growing};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 16] = b"foveate dk1 1.0\n";
const TIME_BYTES: usize = 8;

/// A report of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Its arrival in seconds, if the recording has host times.
    pub host: Option<f64>,
    /// The report, not yet decoded.
    pub bytes: [u8; IN_REPORT_BYTES],
}

/// Reads a recording report by report, in constant memory.
pub struct Reader {
    path: PathBuf,
    file: BufReader<File>,
    timed: bool,
    /// Bytes of the beginning that were read to tell the form.
    first: Vec<u8>,
    cut_off: usize,
}

impl Reader {
    /// Opens a recording.
    ///
    /// # Errors
    /// When the file cannot be read, holds not even one report, or begins with what is none: where it has no
    /// host times, at least half of its first records have to be reports of a DK1.
    pub fn open(path: &Path) -> Result<Self> {
        let refused = |problem: &str| {
            let problem = format!("{problem}; record one with `foveate tracker --record FILE`");
            Err(Error::File { path: path.to_path_buf(), problem })
        };
        let mut file = BufReader::new(File::open(path).map_err(|error| Error::io(path, &error))?);
        let mut first = Vec::with_capacity(MAGIC.len());
        let beginning = file.by_ref().take(MAGIC.len() as u64);
        { beginning }.read_to_end(&mut first).map_err(|error| Error::io(path, &error))?;
        let timed = first == MAGIC;
        if !timed && first.len() < MAGIC.len() {
            return refused("it holds no report");
        }
        if !timed {
            let beginning = [&first, file.fill_buf().map_err(|error| Error::io(path, &error))?].concat();
            let records = beginning.chunks_exact(IN_REPORT_BYTES);
            let (count, good) = (records.len(), records.filter(|r| SensorReport::decode(r).is_ok()).count());
            if 2 * good < count {
                return refused("it is no recording of a tracker");
            }
        }
        if timed {
            first.clear();
        }
        Ok(Reader { path: path.to_path_buf(), file, timed, first, cut_off: 0 })
    }

    /// Bytes at the end that make no whole report, known when all are read.
    pub fn cut_off(&self) -> usize {
        self.cut_off
    }

    /// Fills as much of `buffer` as there is.
    fn fill(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let ready = self.first.len().min(buffer.len());
        buffer[..ready].copy_from_slice(&self.first[..ready]);
        self.first.drain(..ready);
        let mut filled = ready;
        while filled < buffer.len() {
            match self.file.read(&mut buffer[filled..]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(filled)
    }
}

impl Iterator for Reader {
    type Item = Result<Entry>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut buffer = [0; TIME_BYTES + IN_REPORT_BYTES];
        let skipped = if self.timed { 0 } else { TIME_BYTES };
        match self.fill(&mut buffer[skipped..]) {
            Err(error) => Some(Err(Error::io(&self.path, &error))),
            Ok(filled) if skipped + filled == buffer.len() => {
                let (time, report) = buffer.split_first_chunk::<TIME_BYTES>()?;
                let host = self.timed.then(|| u64::from_le_bytes(*time) as f64 * 1e-9);
                Some(Ok(Entry { host, bytes: *report.first_chunk()? }))
            }
            Ok(filled) => {
                self.cut_off = filled;
                None
            }
        }
    }
}

/// Writes a recording with host times. It gets its name when it is [finished](Writer::finish) and holds a report;
/// what has the name before stays until then.
pub struct Writer {
    path: PathBuf,
    file: Option<Growing>,
}

impl Writer {
    /// Tells whether a recording can be written there. Nothing is made before the first report.
    ///
    /// # Errors
    /// When it cannot be written, or another kind of file has the name.
    pub fn create(path: &Path) -> Result<Self> {
        whole_file::check_kind(path, MAGIC, "recording of a tracker")?;
        Ok(Writer { path: path.to_path_buf(), file: None })
    }

    /// Adds a report that arrived at `host` seconds.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, host: f64, report: &[u8; IN_REPORT_BYTES]) -> Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => {
                let mut file = Growing::create(&self.path)?;
                file.put(MAGIC)?;
                none.insert(file)
            }
        };
        file.put(&((host * 1e9) as u64).to_le_bytes())?;
        file.put(report)
    }

    /// Gives the file its name, if there was a report.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn finish(self) -> Result<()> {
        self.file.map_or(Ok(()), Growing::finish)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::headset::rift_dk1::report::SensorReport;

    fn report(timestamp: u16) -> [u8; IN_REPORT_BYTES] {
        SensorReport { sample_count: 2, timestamp, ..SensorReport::default() }.encode()
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dk1rec");
        let mut writer = Writer::create(&path).unwrap();
        writer.add(1.5, &report(7)).unwrap();
        writer.add(1.502, &report(9)).unwrap();
        assert!(!path.exists());
        writer.finish().unwrap();
        let entries: Vec<_> = Reader::open(&path).unwrap().map(Result::unwrap).collect();
        assert_eq!(entries.len(), 2);
        assert_eq!((entries[0].bytes, entries[0].host), (report(7), Some(1.5)));
        assert!((entries[1].host.unwrap() - 1.502).abs() < 1e-9);
    }

    #[test]
    fn bare_reports_are_read_and_a_cut_end_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.dk1raw");
        let mut bytes = [report(1), report(3)].concat();
        bytes.extend([1; 5]);
        std::fs::write(&path, &bytes).unwrap();
        let mut reader = Reader::open(&path).unwrap();
        let entries: Vec<_> = reader.by_ref().map(Result::unwrap).collect();
        assert_eq!(entries, [1, 3].map(|time| Entry { host: None, bytes: report(time) }));
        assert_eq!(reader.cut_off(), 5);
    }

    #[test]
    fn what_is_no_recording_is_refused_and_never_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.glb");
        // Some records of it look like reports.
        let bytes = [vec![7; 62 * 9], report(1).to_vec(), b"glTF".repeat(5000)].concat();
        std::fs::write(&path, &bytes).unwrap();
        let problem = Reader::open(&path).err().unwrap().to_string();
        assert!(problem.contains("no recording of a tracker"), "{problem}");
        assert!(Writer::create(&path).is_err());
        assert!(std::fs::read(&path).unwrap() == bytes);
    }

    #[test]
    fn a_recording_without_reports_leaves_the_earlier_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.rec");
        let record = |times: &[u16]| {
            let mut writer = Writer::create(&path).unwrap();
            times.iter().for_each(|&time| writer.add(1.0, &report(time)).unwrap());
            writer.finish().unwrap();
            std::fs::read(&path).map_or(0, |bytes| bytes.len())
        };
        assert_eq!(record(&[]), 0);
        assert_eq!(record(&[1, 2]), 16 + 2 * 70);
        assert_eq!(record(&[]), 16 + 2 * 70);
        assert_eq!(record(&[1]), 16 + 70);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_empty_or_missing_file_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty");
        std::fs::write(&path, b"").unwrap();
        let problem = Reader::open(&path).err().unwrap().to_string();
        assert!(problem.contains("holds no report"), "{problem}");
        assert!(Reader::open(&folder.path().join("none")).is_err());
    }
}
