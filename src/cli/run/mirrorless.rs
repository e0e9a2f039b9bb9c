//! `foveate run --mirror` where the program was built without windows.

use crate::error::{Error, Result};
use crate::gpu::vulkan::{Context, ContextOptions, Target};

/// There is none.
pub enum Mirror {}

impl Mirror {
    /// Says that there are no windows.
    ///
    /// # Errors
    /// Always.
    pub fn connect() -> Result<Self> {
        let problem = "this program was built without windows; build it with the feature window";
        Err(Error::setting("--mirror", problem))
    }

    /// Never asked.
    pub fn vulkan_options(&self) -> &ContextOptions {
        match *self {}
    }

    /// Never asked.
    pub fn is_closed(&self) -> bool {
        match *self {}
    }

    /// Never asked.
    pub fn wants(&self) -> bool {
        match *self {}
    }

    /// Never asked.
    pub fn release(&mut self) {
        match *self {}
    }

    /// Never asked.
    ///
    /// # Errors
    /// Never.
    pub fn look(&mut self, _: &Context, _: Option<&Target>) -> Result<()> {
        match *self {}
    }
}
