//! Settings that come with the program, by name.

use super::{Config, Layers, OperatingPoint};
use crate::error::{Error, Result};

/// Names with their files' text, fastest first.
const PRESETS: [(&str, &str); 3] = [
    ("fast", include_str!("../../configs/quality/fast.toml")),
    ("balanced", include_str!("../../configs/quality/balanced.toml")),
    ("accurate", include_str!("../../configs/quality/accurate.toml")),
];

/// The names, fastest first.
pub fn names() -> [&'static str; 3] {
    PRESETS.map(|(name, _)| name)
}

/// The text of a preset's file.
///
/// # Errors
/// [`Error::Setting`] where there is none of that name.
pub fn text(name: &str) -> Result<&'static str> {
    let found = PRESETS.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| *text).ok_or_else(|| {
        let names = names().join(", ");
        Error::setting("--preset", format!("there is no preset {name:?}; choose one of {names}"))
    })
}

/// A preset over the defaults.
///
/// # Errors
/// [`Error::Setting`] where there is none of that name.
pub fn config(name: &str) -> Result<Config> {
    let mut layers = Layers::default();
    layers.preset(name)?;
    layers.finish()
}

/// The front that came with a preset.
///
/// # Errors
/// [`Error::Setting`] where there is none of that name.
pub fn front(name: &str) -> Result<Vec<OperatingPoint>> {
    Ok(config(name)?.budget.front)
}
