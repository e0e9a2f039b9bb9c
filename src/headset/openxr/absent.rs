//! Why there is no runtime: what the loader's code means, and what is wrong with what it was pointed at.

use std::path::{Path, PathBuf};

use openxr::sys;
use serde_json::Value;

/// The variable that names the active runtime's manifest.
const VARIABLE: &str = "XR_RUNTIME_JSON";

/// Why no instance can be made, and the next step.
pub fn why(code: sys::Result) -> String {
    use sys::Result as Code;
    if let Some(problem) = std::env::var_os(VARIABLE).and_then(|path| wrong_manifest(Path::new(&path))) {
        return problem;
    }
    let (problem, next) = match code {
        Code::ERROR_RUNTIME_UNAVAILABLE if std::env::var_os(VARIABLE).is_some() => (
            "the runtime that XR_RUNTIME_JSON names does not start",
            "look at its log, or unset the variable",
        ),
        Code::ERROR_RUNTIME_UNAVAILABLE => {
            ("no runtime is active", "install SteamVR or Monado and make it the active one")
        }
        Code::ERROR_API_LAYER_NOT_PRESENT => {
            ("an API layer that is asked for is not installed", "look at XR_ENABLE_API_LAYERS")
        }
        Code::ERROR_FILE_ACCESS_ERROR | Code::ERROR_FILE_CONTENTS_INVALID => (
            "the active runtime's manifest cannot be read",
            "look at XR_RUNTIME_JSON and at openxr/1/active_runtime.json in ~/.config and /etc/xdg",
        ),
        Code::ERROR_EXTENSION_NOT_PRESENT | Code::ERROR_EXTENSION_DEPENDENCY_NOT_ENABLED => {
            ("the active runtime does not have the extensions that it lists", "update it")
        }
        Code::ERROR_API_VERSION_UNSUPPORTED => ("the active runtime is older than OpenXR 1.0", "update it"),
        Code::ERROR_LIMIT_REACHED => ("the active runtime takes no more programs", "end the other one"),
        Code::ERROR_OUT_OF_MEMORY => ("memory has run out", "end other programs"),
        _ => ("the active runtime does not answer", "start SteamVR or monado-service"),
    };
    format!("{problem} (xrCreateInstance: {code:?}); {next}")
}

/// What is wrong with a manifest and the library that it names.
fn wrong_manifest(path: &Path) -> Option<String> {
    let wrong = |problem: String| {
        Some(format!(
            "XR_RUNTIME_JSON names {}, {problem}; correct the variable, or unset it",
            path.display()
        ))
    };
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return wrong("which does not exist".into());
        }
        Err(error) => return wrong(format!("which cannot be read ({error})")),
    };
    let Ok(manifest) = serde_json::from_str::<Value>(&text) else {
        return wrong("which is no JSON".into());
    };
    let Some(library) = manifest["runtime"]["library_path"].as_str() else {
        return wrong("which names no runtime.library_path".into());
    };
    // A bare name is looked for where the system looks for libraries.
    let named = PathBuf::from(library);
    let place = path.parent().unwrap_or(Path::new("")).join(&named);
    (named.components().count() > 1 && !place.exists())
        .then(|| wrong(format!("whose library {} does not exist", place.display())))
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn manifests_that_are_wrong_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let library = file("runtime.so", "");
        for (path, part) in [
            (folder.path().join("none.json"), "does not exist"),
            (folder.path().to_path_buf(), "cannot be read"),
            (file("text.json", "runtime"), "is no JSON"),
            (file("empty.json", "{}"), "names no runtime.library_path"),
            (
                file("lost.json", r#"{ "runtime": { "library_path": "./gone.so" } }"#),
                "gone.so does not exist",
            ),
        ] {
            let problem = wrong_manifest(&path).unwrap();
            assert!(problem.contains(part) && problem.contains(path.to_str().unwrap()), "{problem}");
        }
        let good = format!(r#"{{ "runtime": {{ "library_path": "{}" }} }}"#, library.display());
        assert_eq!(wrong_manifest(&file("good.json", &good)), None);
        assert_eq!(wrong_manifest(&file("bare.json", r#"{ "runtime": { "library_path": "x.so" } }"#)), None);
    }
}
