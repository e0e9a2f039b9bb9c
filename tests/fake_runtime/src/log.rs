//! The log: one line of JSON for each call, written by the runtime and read by tests.

use std::collections::HashMap;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use openxr_sys as xr;
use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::clock;

/// What is to be told about a call besides its name and result.
#[derive(Debug, Default)]
pub(crate) struct Note(Map<String, Value>);

impl Note {
    pub fn set(&mut self, key: &str, value: impl Serialize) {
        self.0.insert(key.into(), json!(value));
    }

    /// A text that was set.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key)?.as_str()
    }
}

/// Where calls are written down.
#[derive(Debug)]
pub(crate) struct Writer {
    path: PathBuf,
    counts: HashMap<String, u64>,
}

impl Writer {
    /// Opens a log to append to it. What it already holds counts: the loader may unload the runtime between
    /// two instances.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        let mut counts = HashMap::new();
        if path.exists() {
            for record in Log::read(path).0 {
                *counts.entry(record.call().to_string()).or_default() += 1;
            }
        }
        OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Writer { path: path.to_path_buf(), counts })
    }

    /// How often a call was made in the whole run.
    pub fn count(&self, call: &str) -> u64 {
        self.counts.get(call).copied().unwrap_or(0)
    }

    pub fn write(&mut self, call: &str, result: xr::Result, note: Note) {
        *self.counts.entry(call.into()).or_default() += 1;
        let mut record = Map::new();
        record.insert("ns".into(), clock::now().into());
        record.insert("call".into(), call.into());
        record.insert("result".into(), format!("{result:?}").into());
        record.extend(note.0);
        // One write for a line, so that a process that dies leaves whole lines behind.
        let line = format!("{}\n", Value::Object(record));
        // Nothing closes a file when the loader unloads the library, so it is not kept open.
        let file = OpenOptions::new().append(true).open(&self.path);
        file.and_then(|mut file| file.write_all(line.as_bytes())).expect("the log can be written");
    }
}

/// One call.
#[derive(Clone, Debug)]
pub struct Record(pub Value);

impl Record {
    /// Such as `xrEndFrame`.
    pub fn call(&self) -> &str {
        self.0["call"].as_str().unwrap_or_default()
    }

    /// Such as `SUCCESS` or `ERROR_SESSION_LOST`.
    pub fn result(&self) -> &str {
        self.0["result"].as_str().unwrap_or_default()
    }

    /// The rule that the application broke, if it broke one.
    pub fn violation(&self) -> Option<&str> {
        self.0["violation"].as_str()
    }
}

/// All calls of a run, in order.
#[derive(Clone, Debug)]
pub struct Log(pub Vec<Record>);

impl Log {
    /// Reads a log.
    ///
    /// # Panics
    /// Where there is none, or a line is not JSON.
    pub fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let record =
            |line: &str| Record(serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}")));
        // The last line may still be being written: a reader can see a part of it.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        Log(whole.lines().map(record).collect())
    }

    /// All calls of one name.
    pub fn calls(&self, name: &str) -> Vec<&Record> {
        self.0.iter().filter(|record| record.call() == name).collect()
    }

    /// All rules that the application broke, each with the call.
    pub fn violations(&self) -> Vec<String> {
        let told = |record: &Record| record.violation().map(|what| format!("{}: {what}", record.call()));
        self.0.iter().filter_map(told).collect()
    }

    /// Whether the application ended as it should: every instance and session that was created is destroyed,
    /// and nothing was left alive in them. Says what is wrong otherwise.
    pub fn leftovers(&self) -> Vec<String> {
        let good = |name: &str| self.calls(name).iter().filter(|r| r.result() == "SUCCESS").count();
        let mut faults = Vec::new();
        for kind in ["Instance", "Session", "Swapchain", "Space", "ActionSet", "Action"] {
            let made: usize = self.0.iter().filter(|r| r.0["made"] == kind).count();
            let gone = good(&format!("xrDestroy{kind}"));
            if made != gone {
                faults.push(format!("{made} of kind {kind} were created, {gone} destroyed"));
            }
        }
        faults
    }
}
