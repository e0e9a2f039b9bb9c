//! Where a scene's bytes come from: data URIs, and files of the scene's own folder and below, nothing else.

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

    /// Whether a URI holds its bytes itself.
    pub fn is_embedded(uri: &str) -> bool {
        split_scheme(uri).is_some_and(|(scheme, _)| scheme.eq_ignore_ascii_case("data"))
    }

    /// Reads at most `limit` bytes of what `uri` refers to.
    pub fn read(&self, uri: &str, limit: u64) -> Outcome<Vec<u8>> {
        if Self::is_embedded(uri) {
            return decode_data_uri(uri);
        }
        let path = self.find(uri)?;
        read_file(&path, limit).map_err(|error| unreadable(uri, &error))
    }

    /// The file that a relative URI names.
    pub fn find(&self, uri: &str) -> Outcome<PathBuf> {
        if let Some((scheme, _)) = split_scheme(uri) {
            return Err(format!(
                "its URI has the scheme {scheme:?}, but only files beside the scene and data URIs are read"
            ));
        }
        let relative = percent_decode_str(uri)
            .decode_utf8()
            .map_err(|_| format!("its URI is not UTF-8: {:?}", shorten(uri)))?;
        self.find_path(&relative)
    }

    /// The file at a relative path, below the folder and with symbolic links resolved.
    ///
    /// Scenes that were made where letter case does not matter are read all the same: where no file has
    /// exactly that name, backslashes separate folders, and case is ignored if only one name fits.
    pub fn find_path(&self, relative: &str) -> Outcome<PathBuf> {
        let slashed = relative.replace('\\', "/");
        let outside = || {
            format!(
                "it refers to {:?}, outside the scene's folder, which is not allowed; move the file beside the scene",
                shorten(relative)
            )
        };
        if !stays_below(Path::new(relative)) || !stays_below(Path::new(&slashed)) {
            return Err(outside());
        }
        let Some(root) = &self.root else {
            return Err(format!(
                "it refers to {:?}, but a scene from memory has no folder",
                shorten(relative)
            ));
        };
        // Resolves symbolic links, so that none leads outside.
        let found = root.join(relative).canonicalize().or_else(|error| {
            let alike = alike(root, Path::new(&slashed)).filter(|_| error.kind() == ErrorKind::NotFound);
            alike.map_or(Err(error), |path| path.canonicalize())
        });
        let path = found.map_err(|error| unreadable(relative, &error))?;
        if !path.starts_with(root) {
            return Err(outside());
        }
        Ok(path)
    }
}

fn unreadable(name: &str, error: &std::io::Error) -> String {
    let reason = match error.kind() {
        ErrorKind::NotFound => "there is no such file".into(),
        _ => error.to_string(),
    };
    format!("it cannot be read from {:?} ({reason}); put the file there", shorten(name))
}

/// The path below `root` that differs from `relative` in letter case alone, if there is exactly one.
fn alike(root: &Path, relative: &Path) -> Option<PathBuf> {
    let mut path = root.to_path_buf();
    for component in relative.components() {
        let exact = path.join(component);
        if exact.exists() {
            path = exact;
            continue;
        }
        let wanted = component.as_os_str().to_str()?.to_lowercase();
        let names = std::fs::read_dir(&path).ok()?.flatten().map(|entry| entry.file_name());
        let mut fitting = names.filter(|name| name.to_str().is_some_and(|n| n.to_lowercase() == wanted));
        path.push(fitting.next()?);
        if fitting.next().is_some() {
            return None;
        }
    }
    Some(path)
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

fn decode_data_uri(uri: &str) -> Outcome<Vec<u8>> {
    let (header, body) = uri.split_once(',').ok_or("its data URI has no comma; export it again")?;
    if !header.ends_with(";base64") {
        return Ok(percent_decode_str(body).collect());
    }
    BASE64.decode(body).map_err(|error| format!("its data URI is not base64 ({error}); export it again"))
}

/// Keeps messages readable when a file holds a very long name.
pub fn shorten(text: &str) -> String {
    const LIMIT: usize = 120;
    if text.chars().count() <= LIMIT {
        text.into()
    } else {
        text.chars().take(LIMIT).chain(['…']).collect()
    }
}
