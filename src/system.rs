//! What each system does in its own way with files: whose they are, who writes them now, and what links and pipes do.
//! On Unix by owners, modes and locks; on Windows a user's folders are the user's, and a file that somebody writes can be
//! kept from everybody else.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{ErrorKind, Result};
use std::path::Path;

#[cfg(unix)]
mod ways {
    use super::*;
    use nix::fcntl::{Flock, FlockArg};
    use nix::libc::{O_NOFOLLOW, O_NONBLOCK};
    use std::fs::{DirBuilder, Permissions, set_permissions};
    use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};

    /// Nobody but the owner may do anything.
    const PRIVATE: u32 = 0o700;
    /// Group and others may write.
    const OTHERS_WRITE: u32 = 0o022;

    /// Tells others that a file is being written, for as long as it exists.
    pub type Lock = Flock<File>;

    fn user() -> u32 {
        nix::unistd::geteuid().as_raw()
    }

    pub fn direct(options: &mut OpenOptions) -> &mut OpenOptions {
        options.custom_flags(O_NOFOLLOW | O_NONBLOCK)
    }

    pub fn lock(file: File) -> Option<Lock> {
        Flock::lock(file, FlockArg::LockExclusiveNonblock).ok()
    }

    pub fn is_written(path: &Path) -> bool {
        let file = direct(OpenOptions::new().write(true)).open(path);
        !file.is_ok_and(|file| lock(file).is_some())
    }

    pub fn runs(process: &str) -> bool {
        Path::new("/proc").join(process).exists()
    }

    pub fn make_private(folder: &Path) -> Result<()> {
        DirBuilder::new().recursive(true).mode(PRIVATE).create(folder)
    }

    pub fn is_own(about: &Metadata) -> bool {
        about.uid() == user()
    }

    pub fn is_private(folder: &Path, about: &Metadata) -> bool {
        let ours = is_own(about) && about.mode() & OTHERS_WRITE == 0;
        if ours && about.mode() & 0o077 != 0 {
            let _ = set_permissions(folder, Permissions::from_mode(PRIVATE));
        }
        ours
    }

    pub fn free_bytes(folder: &Path) -> Option<u64> {
        let disk = nix::sys::statvfs::statvfs(folder).ok()?;
        Some(disk.blocks_available().saturating_mul(disk.fragment_size()))
    }
}

#[cfg(windows)]
mod ways {
    use super::*;
    use std::os::windows::fs::OpenOptionsExt;

    /// Whoever has a file open for writing is seen by that.
    pub type Lock = ();

    pub fn direct(options: &mut OpenOptions) -> &mut OpenOptions {
        /// FILE_FLAG_OPEN_REPARSE_POINT: a link itself is opened, which is no regular file.
        const THE_LINK_ITSELF: u32 = 0x0020_0000;
        options.custom_flags(THE_LINK_ITSELF)
    }

    pub fn lock(_file: File) -> Option<Lock> {
        Some(())
    }

    pub fn is_written(path: &Path) -> bool {
        // Opened for nobody else, it is opened only where nobody has it open.
        direct(OpenOptions::new().write(true).share_mode(0)).open(path).is_err()
    }

    pub fn runs(_process: &str) -> bool {
        true
    }

    pub fn make_private(folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder)
    }

    pub fn is_own(_about: &Metadata) -> bool {
        true
    }

    pub fn is_private(_folder: &Path, _about: &Metadata) -> bool {
        true
    }

    pub fn free_bytes(_folder: &Path) -> Option<u64> {
        None
    }
}

pub use ways::Lock;

/// Has a file itself be opened, not what a link in its place leads to, and without waiting for a pipe's other end.
pub fn direct(options: &mut OpenOptions) -> &mut OpenOptions {
    ways::direct(options)
}

/// Tells others that a file is being written; some file systems cannot.
pub fn lock(file: File) -> Option<Lock> {
    ways::lock(file)
}

/// Whether somebody writes a file now; so it seems where that cannot be found out.
pub fn is_written(path: &Path) -> bool {
    ways::is_written(path)
}

/// Whether a process of that number runs; so it seems where that cannot be found out.
pub fn runs(process: &str) -> bool {
    ways::runs(process)
}

/// Makes a folder for this user alone, and those above it that are missing.
///
/// # Errors
/// Where it cannot be made.
pub fn make_private(folder: &Path) -> Result<()> {
    match ways::make_private(folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

/// Whether a file is this user's.
pub fn is_own(about: &Metadata) -> bool {
    ways::is_own(about)
}

/// Whether a folder is this user's and nobody else may write to it. What others may read is made private.
pub fn is_private(folder: &Path, about: &Metadata) -> bool {
    ways::is_private(folder, about)
}

/// Bytes that this user may still write to the disk of a folder, which need not be there yet; `None` where the system
/// does not tell.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    ways::free_bytes(folder.ancestors().find(|ancestor| ancestor.exists())?)
}
