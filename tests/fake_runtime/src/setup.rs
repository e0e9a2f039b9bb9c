//! Starting an application under the runtime.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::json;

use crate::log::Log;
use crate::runtime::SCRIPT_VARIABLE;
use crate::script::Script;

/// A folder with the runtime's manifest, its script and its log.
#[derive(Debug)]
pub struct Setup {
    folder: PathBuf,
    log: PathBuf,
}

impl Setup {
    /// Writes manifest and script.
    ///
    /// # Panics
    /// Where the folder cannot be written, or the runtime's library is not beside the test.
    pub fn new(folder: &Path, script: &Script) -> Self {
        let write = |name: &str, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        };
        let manifest = json!({
            "file_format_version": "1.0.0",
            "runtime": { "name": "Scripted test runtime", "library_path": library() },
        });
        write("runtime.json", manifest.to_string());
        write("script.json", serde_json::to_string(script).expect("a script is JSON"));
        let log = folder.join(&script.log);
        let _ = std::fs::remove_file(&log);
        Setup { folder: folder.to_path_buf(), log }
    }

    /// Lets an application use the runtime.
    pub fn apply<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        command
            .env("XR_RUNTIME_JSON", self.folder.join("runtime.json"))
            .env(SCRIPT_VARIABLE, self.folder.join("script.json"))
            .env_remove("XR_ENABLE_API_LAYERS")
    }

    /// What the application has called.
    pub fn log(&self) -> Log {
        Log::read(&self.log)
    }
}

/// The shared library, which cargo builds beside the tests that depend on this crate.
fn library() -> PathBuf {
    let test = std::env::current_exe().expect("a test knows where it is");
    let name = format!("{}fake_runtime{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    let path = test.with_file_name(name);
    assert!(path.exists(), "{} is not there", path.display());
    path
}
