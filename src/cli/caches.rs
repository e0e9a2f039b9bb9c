//! A place for caches where the user's folder for them cannot be written: drivers refuse to work without one.

use std::path::PathBuf;

use crate::{places, system, whole_file};

/// Drivers that cannot keep what they have built say that kernels are wrong: with less than this many bytes free, a
/// disk is full for them.
const LEAST_BYTES: u64 = 16 << 20;

/// What `XDG_CACHE_HOME` is to be for this run, and what the operator should know of it; nothing where the user's
/// folder for caches can be used, or there is no better place.
///
/// The place is this user's own for as long as the machine runs: `XDG_RUNTIME_DIR`, or a folder for temporary files
/// that nobody else may enter. PoCL, Mesa and this program keep what they have built there.
pub fn elsewhere() -> Option<(PathBuf, String)> {
    let usual = places::cache();
    let full = usual.as_deref().and_then(system::free_bytes).is_some_and(|free| free < LEAST_BYTES);
    if usual.as_deref().is_some_and(|folder| !full && whole_file::check_folder(folder).is_ok()) {
        return None;
    }
    let place = std::env::var_os("XDG_RUNTIME_DIR")
        .map(PathBuf::from)
        .filter(|folder| folder.is_absolute() && folder.is_dir() && whole_file::check_folder(folder).is_ok())
        .map(|folder| folder.join("foveate-cache"))
        .or_else(private)?;
    let told = usual.map_or("there is no folder for caches".to_string(), |usual| {
        let why = if full { ", whose disk is full" } else { "" };
        format!("caches cannot be kept in {}{why}", usual.display())
    });
    let place_shown = place.display();
    Some((
        place.clone(),
        format!(
            "{told}; they are in {place_shown} until the machine stops; name another place in XDG_CACHE_HOME"
        ),
    ))
}

/// A folder below that for temporary files, of this user and closed to others.
#[cfg(unix)]
fn private() -> Option<PathBuf> {
    use std::os::unix::fs::{DirBuilderExt, MetadataExt};
    // Whose process this is, is also who owns what it makes.
    let user = std::fs::metadata("/proc/self").ok()?.uid();
    let folder = std::env::temp_dir().join(format!("foveate-cache-{user}"));
    let _ = std::fs::DirBuilder::new().mode(0o700).create(&folder);
    let found = std::fs::symlink_metadata(&folder).ok()?;
    // Somebody else may have been faster: kernels from such a folder would be theirs.
    let ours = found.is_dir() && found.uid() == user && found.mode() & 0o077 == 0;
    (ours && whole_file::check_folder(&folder).is_ok()).then_some(folder)
}

/// Elsewhere folders for temporary files are the user's own.
#[cfg(not(unix))]
fn private() -> Option<PathBuf> {
    let folder = std::env::temp_dir().join("foveate-cache");
    whole_file::check_folder(&folder).is_ok().then_some(folder)
}
