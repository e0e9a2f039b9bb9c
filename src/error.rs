//! One variant for each thing that an operator can act on.
//!
//! Every message is one sentence that names the thing, says what is wrong with it and what to do
//! next. Programmer's mistakes are asserts; expected outcomes are values; neither is found here.

use std::path::{Path, PathBuf};

/// The crate's result type.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An adverse condition that the person in front of the program can do something about.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and the next step.
        problem: String,
    },
    /// A scene was read but cannot be used.
    #[error("scene {}: {problem}", path.display())]
    Scene {
        /// The scene's main file.
        path: PathBuf,
        /// What is wrong, and the next step.
        problem: String,
    },
    /// An environment map was read but cannot be used.
    #[error("environment {}: {problem}", path.display())]
    Environment {
        /// The map's file.
        path: PathBuf,
        /// What is wrong, and the next step.
        problem: String,
    },
    /// A flag or a configuration key has a value that cannot be used.
    #[error("{key}: {problem}")]
    Setting {
        /// The flag or key, as the operator wrote it.
        key: String,
        /// What is wrong, and what is accepted.
        problem: String,
    },
    /// No device of a kind that is needed was found, or none passes its self-test.
    #[error("no usable {kind} device: {problem}")]
    NoDevice {
        /// `OpenCL`, `Vulkan`, `OpenXR` or `HID`.
        kind: &'static str,
        /// What was found instead, and the next step.
        problem: String,
    },
    /// A device refused something.
    #[error("{device}: {problem}")]
    Device {
        /// The device's name.
        device: String,
        /// What it refused, its error code, and the next step.
        problem: String,
    },
    /// A kernel did not compile on a device.
    #[error("kernel {kernel} does not build on {device}: {log}")]
    Kernel {
        /// The kernel file.
        kernel: String,
        /// The device's name.
        device: String,
        /// The compiler's first error line.
        log: String,
    },
}

impl Error {
    /// A word for programs that read errors: it stays when sentences change.
    pub fn code(&self) -> &'static str {
        match self {
            Error::File { .. } => "file",
            Error::Scene { .. } => "scene",
            Error::Environment { .. } => "environment",
            Error::Setting { .. } => "setting",
            Error::NoDevice { .. } => "no-device",
            Error::Device { .. } => "device",
            Error::Kernel { .. } => "kernel",
        }
    }

    /// A [`Error::File`] from an I/O error, with the next step where one is known.
    pub fn io(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind;
        let problem = match error.kind() {
            ErrorKind::NotFound => "there is no such file; check the path".to_string(),
            ErrorKind::PermissionDenied => "this user may not open it; check its permissions".to_string(),
            ErrorKind::IsADirectory => "it is a folder; give the path of a file".to_string(),
            ErrorKind::OutOfMemory => {
                "there is too little memory to read it; free some, or raise the limit (ulimit -v)".to_string()
            }
            _ => format!("{error}"),
        };
        Error::File { path: path.to_path_buf(), problem }
    }

    /// A [`Error::File`] from an I/O error in writing, with the next step where one is known.
    pub fn writing(path: &Path, error: &std::io::Error) -> Self {
        use std::io::ErrorKind;
        let problem = match error.kind() {
            ErrorKind::NotFound => "its folder does not exist; create it or choose another".to_string(),
            ErrorKind::PermissionDenied => "this user may not write it; choose another folder".to_string(),
            ErrorKind::ReadOnlyFilesystem => "it is on a read-only disk; choose another folder".to_string(),
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
                "the disk is full; free some space, what was written before is kept".to_string()
            }
            ErrorKind::FileTooLarge => {
                "files may not become so large here; raise the limit (ulimit -f), or choose another folder"
                    .to_string()
            }
            ErrorKind::IsADirectory => {
                "a folder is in its place; remove it or choose another folder".to_string()
            }
            ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
                "a part of this path is a file, not a folder; choose another folder".to_string()
            }
            _ => format!("it cannot be written ({error}); choose another folder"),
        };
        Error::File { path: path.to_path_buf(), problem }
    }

    /// A [`Error::Setting`].
    pub fn setting(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Error::Setting { key: key.into(), problem: problem.into() }
    }
}
