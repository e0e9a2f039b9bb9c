//! Files that appear under their name only when they are whole: written under another name in the same
//! folder, then renamed. What was there before stays until then, whatever goes wrong.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::error::{Error, Result};
use crate::system;

/// Tells whether [`write()`] can succeed, so that nobody waits for a picture that has no place to go.
/// Changes nothing.
///
/// # Errors
/// [`Error::File`] where the folder is missing or not writable, or what has the name now is not a file
/// that may be written, or is none of the kind that its name tells: it may be dear to somebody.
pub fn check(path: &Path) -> Result<()> {
    match kind_of_name(path) {
        Some((beginning, kind)) => check_kind(path, beginning, kind),
        None => check_place(path),
    }
}

/// The same for a file of a kind that its name need not tell: what is there now may be replaced if it is empty
/// or begins in the same way. `kind` is what to call such a file, as in "no PNG picture".
///
/// # Errors
/// As [`check`].
pub fn check_kind(path: &Path, beginning: &[u8], kind: &str) -> Result<()> {
    check_place(path)?;
    let Ok(there) = File::open(path) else { return Ok(()) };
    let mut first = Vec::new();
    there.take(beginning.len() as u64).read_to_end(&mut first).map_err(|e| Error::io(path, &e))?;
    if first.is_empty() || first == beginning {
        return Ok(());
    }
    let problem = format!("it is there already and is no {kind}; give another name, or remove it");
    Err(Error::File { path: path.to_path_buf(), problem })
}

/// How a file of this name begins, and what it is called.
fn kind_of_name(path: &Path) -> Option<(&'static [u8], &'static str)> {
    let ending = path.extension()?.to_str()?.to_lowercase();
    let kinds: [(&str, &[u8], &str); 6] = [
        ("png", b"\x89PNG", "PNG picture"),
        ("exr", b"\x76\x2f\x31\x01", "OpenEXR picture"),
        ("gif", b"GIF8", "GIF animation"),
        ("glb", b"glTF", "binary glTF scene"),
        // As this program writes them: nothing else tells such a file from others.
        ("obj", b"mtllib ", "generated OBJ scene"),
        ("mtl", b"newmtl ", "generated OBJ materials"),
    ];
    kinds.into_iter().find(|kind| kind.0 == ending).map(|(_, beginning, kind)| (beginning, kind))
}

fn check_place(path: &Path) -> Result<()> {
    let path = &resolved(path);
    match fs::metadata(path) {
        Ok(there) if there.is_dir() => return Err(Error::writing(path, &ErrorKind::IsADirectory.into())),
        Ok(there) if !there.is_file() => {
            let problem = "it is a device or a pipe, not a file; choose another name".to_string();
            return Err(Error::File { path: path.clone(), problem });
        }
        Ok(_) => drop(OpenOptions::new().write(true).open(path).map_err(|e| Error::writing(path, &e))?),
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => return Err(Error::writing(path, &error)),
    }
    Draft::create(path).map(drop)
}

/// Tells whether files can be written to a folder, or the folder itself can be made where it is not there
/// yet. Changes nothing.
///
/// # Errors
/// [`Error::File`] that names `folder`.
pub fn check_folder(folder: &Path) -> Result<()> {
    let fail = |error: &io::Error| Error::writing(folder, error);
    let nearest = folder
        .ancestors()
        .map(|ancestor| if ancestor.as_os_str().is_empty() { Path::new(".") } else { ancestor })
        .find(|ancestor| fs::symlink_metadata(ancestor).is_ok())
        .ok_or_else(|| fail(&ErrorKind::NotFound.into()))?;
    if !fs::metadata(nearest).map_err(|e| fail(&e))?.is_dir() {
        return Err(fail(&ErrorKind::NotADirectory.into()));
    }
    Draft::within(nearest).map(drop).map_err(|e| fail(&e))
}

/// Writes a file with `fill`. A file of that name is replaced when all is written, and left alone where
/// that fails; what a link points at is replaced, not the link.
///
/// # Errors
/// What `fill` says, or [`Error::File`] where the file cannot be made.
pub fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    check_place(path)?;
    replace(&resolved(path), fill)
}

/// Writes a file with `fill` in the place of whatever has its name, be it a link, which is not followed.
///
/// # Errors
/// As [`write()`].
pub fn replace(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    let mut growing = Growing { path: path.to_path_buf(), draft: Draft::create(path)? };
    fill(&mut growing.draft.file)?;
    growing.finish()
}

/// A file that is filled bit by bit, and appears under its name when it is [finished](Growing::finish).
pub struct Growing {
    path: PathBuf,
    draft: Draft,
}

impl Growing {
    /// Begins it. What has the name now stays until it is finished.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be made.
    pub fn create(path: &Path) -> Result<Growing> {
        let path = resolved(path);
        let draft = Draft::create(&path)?;
        Ok(Growing { path, draft })
    }

    /// Adds bytes.
    ///
    /// # Errors
    /// [`Error::File`] where they cannot be written.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.draft.file.write_all(bytes).map_err(|error| Error::writing(&self.path, &error))
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::File`] where that fails.
    pub fn finish(self) -> Result<()> {
        let Growing { path, mut draft } = self;
        let named = draft.file.flush().and_then(|()| fs::rename(&draft.temporary, &path));
        named.map_err(|error| Error::writing(&path, &error))
    }
}

/// Removes what processes have left in a folder that were killed while they wrote. Each holds a lock on what it
/// writes; one that has just begun may not have it yet.
pub fn sweep(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let number = name.strip_prefix(".foveate-").and_then(|rest| rest.strip_suffix(".part"));
        let Some(process) = number.and_then(|rest| rest.split_once('-')).map(|(process, _)| process) else {
            continue;
        };
        if is_abandoned(&path, process) {
            let _ = fs::remove_file(&path);
        }
    }
}

fn is_abandoned(path: &Path, process: &str) -> bool {
    /// A process is given so long from making a file to locking it.
    const JUST_BEGUN: Duration = Duration::from_secs(10);
    let about = fs::symlink_metadata(path);
    let Some(about) = about.ok().filter(fs::Metadata::is_file) else { return false };
    let age = about.modified().ok().and_then(|at| at.elapsed().ok()).unwrap_or_default();
    if process.parse() == Ok(std::process::id()) || age < JUST_BEGUN && system::runs(process) {
        return false;
    }
    !system::is_written(path)
}

/// The file that a link points at, and any other path as it is.
fn resolved(path: &Path) -> PathBuf {
    fs::canonicalize(path).ok().filter(|_| path.is_symlink()).unwrap_or_else(|| path.to_path_buf())
}

/// A file under a name that nothing else uses, removed where it was not renamed.
struct Draft {
    temporary: PathBuf,
    file: BufWriter<File>,
    /// Tells others that it is being written; some file systems have no locks.
    _lock: Option<system::Lock>,
}

impl Draft {
    /// Makes one beside `path`.
    fn create(path: &Path) -> Result<Draft> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        Draft::within(folder.unwrap_or(Path::new("."))).map_err(|e| Error::writing(path, &e))
    }

    fn within(folder: &Path) -> io::Result<Draft> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
        if SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_path_buf()) {
            sweep(folder);
        }
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let temporary = folder.join(format!(".foveate-{}-{number}.part", std::process::id()));
            match OpenOptions::new().write(true).create_new(true).open(&temporary) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
                Ok(file) => {
                    let lock = file.try_clone().ok().and_then(system::lock);
                    return Ok(Draft { temporary, file: BufWriter::new(file), _lock: lock });
                }
            }
        }
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        // After a rename there is nothing to remove; where it fails, the error that led here is told.
        let _ = fs::remove_file(&self.temporary);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn put(path: &Path, text: &str) -> Result<()> {
        write(path, |file| file.write_all(text.as_bytes()).map_err(|e| Error::writing(path, &e)))
    }

    #[test]
    fn a_failed_write_leaves_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        put(&path, "first").unwrap();
        let fail = |file: &mut BufWriter<File>| {
            file.write_all(b"half").unwrap();
            assert_eq!(names(folder.path()).len(), 2, "the half is under another name");
            Err(Error::setting("test", "stops here"))
        };
        assert!(write(&path, fail).is_err());
        assert_eq!(
            (fs::read(&path).unwrap(), names(folder.path())),
            (b"first".to_vec(), vec!["picture".into()])
        );
        put(&path, "second").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names(folder.path()).len()), (b"second".to_vec(), 1));
    }

    #[test]
    fn wrong_places_are_told_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "kept").unwrap();
        for (path, part) in [
            (folder.path().join("none/picture.png"), "its folder does not exist"),
            (folder.path().to_path_buf(), "a folder is in its place"),
            (file.join("picture.png"), "is a file, not a folder"),
        ] {
            let message = check(&path).unwrap_err().to_string();
            assert!(message.contains(part) && message.starts_with(path.to_str().unwrap()), "{message}");
            assert_eq!(message, put(&path, "x").unwrap_err().to_string());
        }
        assert_eq!(names(folder.path()), ["file"]);
        check(&file).unwrap();
        check(&folder.path().join("new")).unwrap();
        assert_eq!((fs::read(&file).unwrap(), names(folder.path()).len()), (b"kept".to_vec(), 1));
    }

    /// What a killed process leaves is gone when the next one writes there; what one writes now stays.
    #[test]
    fn what_killed_processes_leave_is_swept() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // No process has this number: the kernel's limit is 2^22.
        fs::write(at(".foveate-99999999-3.part"), "half").unwrap();
        fs::write(at(".foveate-99999999-x.png"), "kept").unwrap();
        fs::write(at("other.part"), "kept").unwrap();
        let written = at(".foveate-99999998-1.part");
        fs::write(&written, "under way").unwrap();
        let lock = system::lock(File::open(&written).unwrap()).unwrap();
        std::os::unix::fs::symlink(at("other.part"), at(".foveate-99999999-4.part")).unwrap();
        put(&at("a"), "new").unwrap();
        let left = names(folder.path());
        assert_eq!(
            left,
            [
                ".foveate-99999998-1.part",
                ".foveate-99999999-4.part",
                ".foveate-99999999-x.png",
                "a",
                "other.part"
            ]
        );
        drop(lock);
        sweep(folder.path());
        assert!(!written.exists());
    }

    #[test]
    fn files_of_another_kind_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        for (name, kind) in [("a.png", "PNG"), ("a.EXR", "OpenEXR"), ("a.gif", "GIF"), ("a.glb", "glTF")] {
            let path = folder.path().join(name);
            fs::write(&path, "a diary").unwrap();
            let message = check(&path).unwrap_err().to_string();
            assert!(message.contains("is there already") && message.contains(kind), "{message}");
            assert_eq!(fs::read(&path).unwrap(), b"a diary");
            fs::write(&path, "").unwrap();
            check(&path).unwrap();
        }
        let (path, of_ours) = (folder.path().join("a.png"), b"\x89PNG of before");
        fs::write(&path, of_ours).unwrap();
        check(&path).unwrap();
        check_kind(&folder.path().join("none"), b"FVRAYS01", "rays").unwrap();
        fs::write(&path, "FVRAYS0").unwrap();
        assert!(check_kind(&path, b"FVRAYS01", "file of rays").is_err());
    }

    #[test]
    fn folders_that_can_be_made_are_not_made_yet() {
        let folder = tempfile::tempdir().unwrap();
        check_folder(&folder.path().join("a/b/c")).unwrap();
        check_folder(folder.path()).unwrap();
        assert!(names(folder.path()).is_empty());
        let file = folder.path().join("file");
        fs::write(&file, "kept").unwrap();
        for path in [file.clone(), file.join("a/b")] {
            let message = check_folder(&path).unwrap_err().to_string();
            assert!(message.contains("is a file, not a folder"), "{message}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        put(&link, "new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&target).unwrap(), b"new");
        let device = folder.path().join("device.png");
        std::os::unix::fs::symlink("/dev/null", &device).unwrap();
        assert!(check(&device).unwrap_err().to_string().contains("not a file"));
    }
}
