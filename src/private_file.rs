//! Files of the user's cache: in folders of this user alone, and never through a link, a pipe or a device that
//! somebody has put in a file's place.

use std::fs::{self, File, OpenOptions};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::{places, system, whole_file};

/// The program's part of the user's cache ([`places::cache`]); `None` without a home.
pub fn user_folder() -> Option<PathBuf> {
    Some(places::cache()?.join("foveate"))
}

/// Opens a file to read it; `None` where it is not there, is no regular file of this user, or lies in a folder that
/// others may write to.
pub fn open(path: &Path) -> Option<File> {
    if !is_ours(path.parent()?) {
        return None;
    }
    let file = system::direct(OpenOptions::new().read(true)).open(path).ok()?;
    let about = file.metadata().ok()?;
    (about.is_file() && system::is_own(&about)).then_some(file)
}

/// Writes a file with `fill`, in a folder that is made where it is missing; what has its name is replaced, be it a
/// link.
///
/// # Errors
/// What `fill` says, or [`Error::File`] where the folder is another user's or cannot be written.
pub fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    system::make_private(folder).map_err(|e| Error::writing(folder, &e))?;
    if !is_ours(folder) {
        let problem = "others may write to it; make it yours alone (chmod 700)".to_string();
        return Err(Error::File { path: folder.to_path_buf(), problem });
    }
    whole_file::replace(path, fill)
}

/// Whether a folder is this user's alone, not through a link.
fn is_ours(folder: &Path) -> bool {
    fs::symlink_metadata(folder).is_ok_and(|about| about.is_dir() && system::is_private(folder, &about))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::os::unix::fs::{PermissionsExt, symlink};

    fn put(path: &Path, text: &str) -> Result<()> {
        write(path, |file| file.write_all(text.as_bytes()).map_err(|e| Error::writing(path, &e)))
    }

    fn get(path: &Path) -> Option<String> {
        let mut text = String::new();
        open(path)?.read_to_string(&mut text).ok()?;
        Some(text)
    }

    #[test]
    fn files_lie_in_folders_of_the_user_alone() {
        let base = tempfile::tempdir().unwrap();
        let path = base.path().join("foveate/trees/a.tree");
        put(&path, "kept").unwrap();
        assert_eq!(get(&path).as_deref(), Some("kept"));
        let folder = path.parent().unwrap();
        let mode = |mode: u32| fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
        let has = || fs::metadata(folder).unwrap().permissions().mode() & 0o777;
        assert_eq!(
            (has(), fs::metadata(folder.parent().unwrap()).unwrap().permissions().mode() & 0o777),
            (0o700, 0o700)
        );
        mode(0o755);
        assert_eq!((get(&path).as_deref(), has()), (Some("kept"), 0o700));
        for open_to_others in [0o775, 0o777, 0o702] {
            mode(open_to_others);
            assert_eq!(get(&path), None);
            assert!(put(&path, "new").unwrap_err().to_string().contains("others may write"));
        }
    }

    #[test]
    fn links_pipes_and_devices_are_not_followed() {
        let base = tempfile::tempdir().unwrap();
        let folder = base.path().join("cache");
        let (path, elsewhere) = (folder.join("a"), base.path().join("elsewhere"));
        put(&path, "kept").unwrap();
        fs::write(&elsewhere, "precious").unwrap();
        let replaced_by = |place: &dyn Fn()| {
            fs::remove_file(&path).unwrap();
            place();
            assert_eq!(get(&path), None);
            put(&path, "new").unwrap();
            assert_eq!(get(&path).as_deref(), Some("new"));
        };
        replaced_by(&|| symlink(&elsewhere, &path).unwrap());
        replaced_by(&|| symlink("/dev/zero", &path).unwrap());
        replaced_by(&|| {
            let made = std::process::Command::new("mkfifo").arg(&path).status().unwrap();
            assert!(made.success());
        });
        assert_eq!(fs::read_to_string(&elsewhere).unwrap(), "precious");
        // A link in the folder's place leads to a folder that may be anybody's.
        let link = base.path().join("link");
        symlink(&folder, &link).unwrap();
        assert_eq!(get(&link.join("a")), None);
        assert!(put(&link.join("a"), "new").is_err());
    }
}
