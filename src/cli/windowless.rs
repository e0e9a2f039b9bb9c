//! `foveate demo --window` and `--headset dk1` where the program was built without windows.

use std::path::Path;

use super::demo::Headset;
use crate::config::Config;
use crate::error::{Error, Result};

/// What would be shown, as in builds with windows.
#[allow(dead_code)]
pub struct Show<'a> {
    /// Settings.
    pub config: &'a Config,
    /// What is to be said about them.
    pub notes: Vec<String>,
    /// A scene's file; the demo scene otherwise.
    pub scene: Option<&'a Path>,
    /// The headset whose lenses it is rendered for.
    pub headset: Option<Headset>,
    /// Frames after which it ends.
    pub frames: Option<u64>,
}

impl Show<'_> {
    /// Says that there are no windows.
    ///
    /// # Errors
    /// Always.
    pub fn run(&self, _: bool) -> Result<()> {
        let flag = if self.headset.is_some() { "--headset" } else { "--window" };
        Err(Error::setting(flag, "this program was built without windows; build it with the feature window"))
    }
}
