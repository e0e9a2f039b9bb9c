//! Where bytes come from: data URIs, and files of the scene's own folder and below, nothing else.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use super::Outcome;

/// Exporters differ in whether they pad.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Opens a regular file, and tells its size.
pub fn open_file(path: &Path) -> std::io::Result<(File, u64)> {
    // Before it is opened: opening a pipe would wait for its other end.
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(std::io::Error::other("it is not a regular file; give the path of a file"));
    }
    Ok((File::open(path)?, metadata.len()))
}

/// Reads at most `limit` bytes of a regular file.
pub fn read_file(path: &Path, limit: u64) -> std::io::Result<Vec<u8>> {
    let (file, size) = open_file(path)?;
    let size = size.min(limit);
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(size).unwrap_or(usize::MAX))?;
    file.take(size).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The folder whose files a scene may read.
pub struct Folder {
    /// `None`: no file may be read.
    root: Option<PathBuf>,
}

impl Folder {
    /// The folder that holds the scene's main file.
    pub fn of(file: &Path) -> std::io::Result<Folder> {
        let parent = file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok(Folder { root: Some(parent.canonicalize()?) })
    }

    /// No folder: for a scene that came from memory.
    pub fn none() -> Folder {
        Folder { root: None }
    }

    /// Reads at most `limit` bytes of what `uri` refers to; `what` names it in messages.
    pub fn read(&self, uri: &str, limit: u64, what: &str) -> Outcome<Vec<u8>> {
        match split_scheme(uri) {
            Some(("data", rest)) => decode_data_uri(rest, what),
            Some((scheme, _)) => Err(format!(
                "{what} has a URI of scheme {scheme:?}, but only files beside the scene and data URIs are read"
            )),
            None => self.read_relative(uri, limit, what),
        }
    }

    fn read_relative(&self, uri: &str, limit: u64, what: &str) -> Outcome<Vec<u8>> {
        let relative = percent_decode_str(uri)
            .decode_utf8()
            .map_err(|_| format!("{what} has a URI that is not UTF-8: {:?}", shorten(uri)))?;
        let outside = || {
            format!(
                "{what} refers to {:?}, outside the scene's folder, which is not allowed; move the file beside the scene",
                shorten(&relative)
            )
        };
        if !stays_below(Path::new(relative.as_ref())) {
            return Err(outside());
        }
        let failed = |error: std::io::Error| {
            let reason = match error.kind() {
                ErrorKind::NotFound => "there is no such file".into(),
                _ => error.to_string(),
            };
            format!("{what} cannot be read from {:?} ({reason}); put the file there", shorten(&relative))
        };
        // Resolves symbolic links, so that none leads outside.
        let Some(root) = &self.root else {
            return Err(format!(
                "{what} refers to {:?}, but a scene from memory has no folder",
                shorten(&relative)
            ));
        };
        let path = root.join(relative.as_ref()).canonicalize().map_err(failed)?;
        if !path.starts_with(root) {
            return Err(outside());
        }
        read_file(&path, limit).map_err(failed)
    }
}

/// `scheme:rest` as in RFC 3986, 3.1; `None` for relative references.
fn split_scheme(uri: &str) -> Option<(&str, &str)> {
    let (scheme, rest) = uri.split_once(':')?;
    let mut letters = scheme.chars();
    let valid = letters.next().is_some_and(|c| c.is_ascii_alphabetic())
        && letters.all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    valid.then_some((scheme, rest))
}

/// Whether a relative path never climbs above where it starts.
fn stays_below(path: &Path) -> bool {
    let mut depth = 0_i64;
    path.components().all(|component| {
        depth += match component {
            Component::Normal(_) => 1,
            Component::CurDir => 0,
            Component::ParentDir => -1,
            Component::RootDir | Component::Prefix(_) => return false,
        };
        depth >= 0
    })
}

fn decode_data_uri(rest: &str, what: &str) -> Outcome<Vec<u8>> {
    let (header, body) = rest
        .split_once(',')
        .ok_or_else(|| format!("{what} has a data URI without a comma; export it again"))?;
    if !header.ends_with(";base64") {
        return Ok(percent_decode_str(body).collect());
    }
    BASE64
        .decode(body)
        .map_err(|error| format!("{what} has a data URI that is not base64 ({error}); export it again"))
}

/// Keeps messages readable when a file holds a very long name.
fn shorten(text: &str) -> String {
    const LIMIT: usize = 120;
    if text.chars().count() <= LIMIT {
        text.into()
    } else {
        text.chars().take(LIMIT).chain(['…']).collect()
    }
}
