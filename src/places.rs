//! The user's folders, by each system's ways.
//!
//! Caches go to `XDG_RUNTIME_DIR`, or to a private folder for temporary files, where the usual place cannot
//! be written: drivers need one. `foveate tracker` keeps what it learns in the user's state folder, which
//! `XDG_STATE_HOME` names, and trees and measurements of kernels are kept in the user's cache, which
//! `XDG_CACHE_HOME` names.

use std::path::PathBuf;

/// Where programs keep what can be made again: `XDG_CACHE_HOME`, or `.cache` in the home; on Windows `LOCALAPPDATA`.
/// `None` without a home. It need not be there yet.
pub fn cache() -> Option<PathBuf> {
    folder("XDG_CACHE_HOME", ".cache")
}

/// Where programs keep what they have learned: `XDG_STATE_HOME`, or `.local/state` in the home; on Windows
/// `LOCALAPPDATA`. `None` without a home. It need not be there yet.
pub fn state() -> Option<PathBuf> {
    folder("XDG_STATE_HOME", ".local/state")
}

fn folder(variable: &str, in_home: &str) -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let system = if cfg!(windows) { named("LOCALAPPDATA") } else { None };
    named(variable).or(system).or_else(|| named("HOME").map(|home| home.join(in_home)))
}
