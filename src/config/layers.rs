//! Layers of settings before they are typed: defaults, files, presets, single keys.

use std::path::Path;

use toml::{Table, Value};

use super::{Config, TRADED, preset};
use crate::error::{Error, Result};

/// Layers of settings before they are typed: starts with defaults.
#[derive(Clone, Debug)]
pub struct Layers {
    table: Table,
    /// What was laid over the defaults.
    given: Table,
}

impl Default for Layers {
    fn default() -> Self {
        Layers::over(Config::default())
    }
}

impl Layers {
    /// Layers over other defaults than the usual ones.
    pub fn over(defaults: Config) -> Self {
        let table = Table::try_from(defaults).expect("a configuration is a table");
        Layers { table, given: Table::new() }
    }

    /// Lays a preset over what is there.
    ///
    /// # Errors
    /// Where there is none of that name.
    pub fn preset(&mut self, name: &str) -> Result<()> {
        self.text(preset::text(name)?, &Path::new("configs/quality").join(format!("{name}.toml")))
    }

    /// Lays a TOML file over what is there.
    ///
    /// # Errors
    /// Where it cannot be read, is not TOML, names a key that does not exist, or has a value that does
    /// not fit.
    pub fn file(&mut self, path: &Path) -> Result<()> {
        self.text(&read_text(path)?, path)
    }

    /// Lays a file's text over what is there.
    fn text(&mut self, text: &str, path: &Path) -> Result<()> {
        let table: Table = text.parse().map_err(|e: toml::de::Error| Error::File {
            path: path.to_path_buf(),
            problem: format!("it is not a TOML file: {}; see configs/default.toml", e.message()),
        })?;
        let laid = table.into_iter().try_for_each(|(key, value)| self.lay(key, value));
        laid.and_then(|()| self.typed()?.check_keys()).map_err(|e| match e {
            Error::Setting { key, problem } => {
                Error::File { path: path.to_path_buf(), problem: format!("{key}: {problem}") }
            }
            other => other,
        })
    }

    /// Sets every key of a section by itself, so that messages name it. A law's parameters belong together.
    fn lay(&mut self, key: String, value: Value) -> Result<()> {
        match value {
            Value::Table(section) if !section.is_empty() && !key.ends_with(".law") => {
                section.into_iter().try_for_each(|(name, value)| self.lay(format!("{key}.{name}"), value))
            }
            value => self.set(&key, value),
        }
    }

    /// Lays one `key=value` over what is there. The value is TOML; a bare word is text.
    ///
    /// # Errors
    /// Where there is no `=`, no such key, or the value does not fit.
    pub fn assign(&mut self, assignment: &str) -> Result<()> {
        let Some((key, text)) = assignment.split_once('=') else {
            return Err(Error::setting(
                "--set",
                format!("{assignment:?} is not key=value, such as trace.rays=16"),
            ));
        };
        let value = format!("v = {text}")
            .parse::<Table>()
            .ok()
            .filter(|table| table.len() == 1)
            .and_then(|mut table| table.remove("v"))
            .unwrap_or_else(|| Value::String(text.to_string()));
        self.set(key.trim(), value)
    }

    /// Sets one dotted key.
    ///
    /// # Errors
    /// Where there is no such key, or the value does not fit.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) -> Result<()> {
        if key.split('.').count() > MAX_DEPTH {
            // The key is not repeated: it may be as long as a command line.
            return Err(Error::setting(
                "a key",
                "no key has so many dots; configs/default.toml lists every key",
            ));
        }
        if let Some((_, now)) = RENAMED.iter().find(|(old, _)| *old == key) {
            return Err(Error::setting(key, format!("it is called {now} now")));
        }
        let nested = key
            .rsplit('.')
            .fold(value.into(), |inner, part| Value::Table(Table::from_iter([(part.to_string(), inner)])));
        let Value::Table(layer) = nested else { return Err(Error::setting(key, "there is no such key")) };
        overlay(&mut self.table, layer.clone());
        overlay(&mut self.given, layer);
        let checked: Result<Config, _> = self.table.clone().try_into();
        checked.map(drop).map_err(|e| refused(key, &e))
    }

    /// Whether a dotted key was given a value, or has its default.
    pub fn gives(&self, key: &str) -> bool {
        let mut parts = key.split('.');
        let first = parts.next().and_then(|part| self.given.get(part));
        parts.try_fold(first, |inner, part| inner.map(|v| v.get(part))).flatten().is_some()
    }

    /// Has frames keep up with a display, where nothing else was said: no time to hold, and none of the settings
    /// that would be moved for it ([`TRADED`]). Where one of those was given, they stay, and its key is answered.
    pub fn keep_up(&mut self) -> Option<&'static str> {
        if self.gives("budget.target_ms") {
            return None;
        }
        let fixed = TRADED.into_iter().find(|key| self.gives(key));
        if fixed.is_none() {
            let budget = Table::from_iter([("target_ms".to_string(), "display".into())]);
            overlay(&mut self.table, Table::from_iter([("budget".to_string(), budget.into())]));
        }
        fixed
    }

    /// Has pictures on a display exposed by what is seen, where no exposure was given.
    pub fn expose(&mut self) {
        if !self.gives("view.exposure") {
            let view = Table::from_iter([("exposure".to_string(), "auto".into())]);
            overlay(&mut self.table, Table::from_iter([("view".to_string(), view.into())]));
        }
    }

    /// The typed, validated configuration.
    ///
    /// # Errors
    /// [`Error::Setting`] about the first key that does not exist or has a value that does not fit.
    pub fn finish(&self) -> Result<Config> {
        let config = self.typed()?;
        config.check_keys()?;
        config.check_size()?;
        if self.gives("foveation.samples") {
            config.check_samples()?;
        }
        Ok(config)
    }

    /// Refuses the first key whose value is out of its range.
    ///
    /// # Errors
    /// [`Error::Setting`] that names it.
    pub fn check(&self) -> Result<()> {
        self.typed()?.check_keys()
    }

    fn typed(&self) -> Result<Config> {
        self.table.clone().try_into().map_err(|e: toml::de::Error| refused("configuration", &e))
    }
}

/// Keys of earlier versions, and what they are called now.
pub(super) const RENAMED: [(&str, &str); 1] =
    [("trace.walk", "trace.traversal, with the values \"auto\", \"packet\" and \"single-ray\"")];

/// Parts of a key at most.
const MAX_DEPTH: usize = 8;

/// Bytes of a configuration file at most.
const MAX_FILE: u64 = 1 << 20;

fn read_text(path: &Path) -> Result<String> {
    let fail = |problem: &str| Error::File { path: path.to_path_buf(), problem: problem.to_string() };
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
    if !metadata.is_file() {
        return Err(fail("it is not a regular file; give the path of a file"));
    }
    if metadata.len() > MAX_FILE {
        return Err(fail("it is larger than 1 MiB; give a file like configs/default.toml"));
    }
    std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => {
            fail("it is not text in UTF-8; give a file like configs/default.toml")
        }
        _ => Error::io(path, &e),
    })
}

/// What is wrong with a value, in words of TOML and not of Rust.
fn refused(key: &str, error: &toml::de::Error) -> Error {
    const WORDS: [(&str, &str); 18] = [
        ("invalid type: unit variant, expected string only", "expected one of its names as text"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected f32", "expected a number"),
        ("expected f64", "expected a number"),
        ("expected path string", "expected a path as text"),
        ("expected a sequence", "expected a list"),
        ("invalid type: sequence", "invalid type: a list"),
        ("invalid type: map", "invalid type: a section"),
        ("invalid type: boolean", "invalid type: the value"),
        ("expected internally tagged enum Law", "expected a law's name, or a section with it"),
        ("invalid type: floating point", "invalid type: the number"),
        ("invalid type: integer", "invalid type: the number"),
        ("invalid type: string", "invalid type: the text"),
        ("expected a boolean", "expected true or false"),
        ("expected a string", "expected text"),
        ("invalid value: integer", "invalid value:"),
    ];
    let message = error.message().trim_end().to_string();
    let what = WORDS.iter().fold(message, |what, (from, to)| what.replace(from, to));
    // Their names follow, which are Rust's.
    let what = what
        .split_once("expected struct ")
        .map_or(what.clone(), |(before, _)| format!("{before}expected a section"));
    Error::setting(key, format!("{what}; configs/default.toml lists every key"))
}

/// Lays `top` over `base`, key by key. A law given anew, by name, brings its own parameters.
fn overlay(base: &mut Table, top: Table) {
    for (key, value) in top {
        let named = |v: &Value| v.as_str().map(|name| Table::from_iter([("name".to_string(), name.into())]));
        match (base.get_mut(&key), value) {
            (Some(old), value) if key == "law" && value.is_str() => {
                *old = Value::Table(named(&value).expect("it is a string"));
            }
            (Some(old), Value::Table(new)) if key == "law" && new.contains_key("name") => {
                *old = Value::Table(new)
            }
            (Some(Value::Table(old)), Value::Table(new)) => overlay(old, new),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}
