//! The documents say what is: the files, names, commands, flags and settings in them exist, and rooms
//! use each other, tests apart, only as docs/architecture.md says, without circles.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use foveate::config::Layers;

/// Where files that documents name may be, besides the root.
const FOLDERS: [&str; 12] = [
    "src",
    "build",
    "kernels",
    "tests",
    "examples",
    "docs",
    "benches",
    "configs",
    "scripts",
    "fuzz",
    "packaging",
    ".ci",
];
/// Names that end like this are files.
const ENDINGS: [&str; 8] = [".rs", ".md", ".toml", ".sh", ".cl", ".h", ".wgsl", ".rules"];
/// Lines of a file of src at most.
const MOST_LINES: usize = 450;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The files below a folder, or the file itself.
fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_path_buf()];
    }
    let mut found: Vec<PathBuf> =
        std::fs::read_dir(path).unwrap().flat_map(|entry| files(&entry.unwrap().path())).collect();
    found.sort();
    found
}

/// Every document with its text.
fn documents() -> Vec<(PathBuf, String)> {
    let mut paths: Vec<PathBuf> =
        ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].iter().map(|name| root().join(name)).collect();
    paths
        .extend(files(&root().join("docs")).into_iter().filter(|p| p.extension().is_some_and(|e| e == "md")));
    assert!(paths.len() >= 6, "{paths:?}");
    paths.into_iter().map(|path| (path.clone(), read(&path))).collect()
}

/// What stands between backticks, outside indented blocks.
fn spans(text: &str) -> Vec<&str> {
    let lines = text.lines().filter(|line| !line.starts_with("    "));
    lines.flat_map(|line| line.split('`').skip(1).step_by(2)).collect()
}

/// The commands of indented blocks, without what follows `#`.
fn blocks(text: &str) -> Vec<&str> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("    "));
    lines.map(|line| line.split(" #").next().unwrap().trim()).collect()
}

fn is_path(span: &str) -> bool {
    let plain = span.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c));
    let (first, rest) = span.split_once('/').unwrap_or((span, ""));
    let in_folder =
        !rest.is_empty() && FOLDERS.contains(&first) || FOLDERS.contains(&span.trim_end_matches('/'));
    plain && (in_folder || !span.contains('/') && ENDINGS.iter().any(|e| span.ends_with(e) && span != *e))
}

fn missing_paths(text: &str) -> Vec<&str> {
    spans(text).into_iter().filter(|span| is_path(span) && !root().join(span).exists()).collect()
}

/// Targets of Markdown links to files, relative to `folder`, that do not exist.
fn dead_links<'a>(folder: &Path, text: &'a str) -> Vec<&'a str> {
    let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let files = targets.filter(|target| !target.contains("://") && !target.starts_with('#'));
    files.filter(|target| !folder.join(target.split('#').next().unwrap()).exists()).collect()
}

/// Names such as `Renderer::frame` or `trace_pixels` that occur nowhere in `source`.
fn missing_names<'a>(text: &'a str, source: &BTreeSet<&str>) -> Vec<&'a str> {
    let is_word = |word: &str| {
        word.starts_with(|c: char| c.is_ascii_alphabetic())
            && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let is_name = |span: &str| {
        let told = span.contains("::") || span.contains('_') && !span.contains('/');
        told && span.split("::").all(is_word)
    };
    let unknown = |span: &&str| !span.split("::").all(|word| source.contains(word));
    spans(text).into_iter().filter(|span| is_name(span)).filter(unknown).collect()
}

#[test]
fn files_and_links_lead_somewhere() {
    for (path, text) in documents() {
        assert_eq!(missing_paths(&text), Vec::<&str>::new(), "{}", path.display());
        assert_eq!(dead_links(path.parent().unwrap(), &text), Vec::<&str>::new(), "{}", path.display());
    }
}

#[test]
fn names_are_in_the_source() {
    let folders = ["src", "kernels", "tests", "benches", "configs", "Cargo.toml", "build.rs"];
    let texts: Vec<String> = folders
        .iter()
        .flat_map(|folder| files(&root().join(folder)))
        .filter(|file| !file.ends_with("tests/docs.rs") && file.extension().is_none_or(|e| e != "glb"))
        .map(|file| read(&file))
        .collect();
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let words: BTreeSet<&str> = texts.iter().flat_map(|text| text.split(|c| !is_part(c))).collect();
    for (path, text) in documents() {
        assert_eq!(missing_names(&text, &words), Vec::<&str>::new(), "{}", path.display());
    }
    let known = BTreeSet::from(["Renderer"]);
    assert_eq!(missing_names("`Renderer::gone` and `no_kernel`", &known), ["Renderer::gone", "no_kernel"]);
}

#[test]
fn wrong_files_and_links_are_noticed() {
    let text = "`src/nowhere.rs`, `src/lib.rs`, `gone.toml`, `scene.glb`, `kernels/*.wgsl`, `src/`";
    assert_eq!(missing_paths(text), ["src/nowhere.rs", "gone.toml"]);
    assert_eq!(
        dead_links(&root(), "[a](docs/gone.md) [b](README.md) [c](https://example.org)"),
        ["docs/gone.md"]
    );
}

/// What is wrong with a command line that starts with `foveate`: empty when nothing is.
fn faults(line: &str) -> Vec<String> {
    let words: Vec<&str> = line.split_whitespace().skip(1).collect();
    let command = words.iter().take_while(|word| !word.starts_with('-'));
    let help = Command::new(env!("CARGO_BIN_EXE_foveate")).args(command).arg("--help").output().unwrap();
    if !help.status.success() {
        return vec![format!("{line}: there is no such command")];
    }
    let help = String::from_utf8(help.stdout).unwrap();
    let known: BTreeSet<&str> = help
        .split(|c: char| c.is_whitespace() || ",[".contains(c))
        .filter(|word| word.starts_with("--"))
        .collect();
    let mut faults = Vec::new();
    for (at, word) in words.iter().enumerate() {
        let flag = word.split('=').next().unwrap_or(word);
        if flag.starts_with("--") && !known.contains(flag) {
            faults.push(format!("{line}: there is no {word}"));
        }
        if *word == "--set"
            && let Err(error) = Layers::default().assign(words.get(at + 1).unwrap_or(&""))
        {
            faults.push(format!("{line}: {error}"));
        }
    }
    faults
}

#[test]
fn commands_flags_and_settings_exist() {
    let documents = documents();
    let commands: BTreeSet<&str> = documents
        .iter()
        .flat_map(|(_, text)| spans(text).into_iter().chain(blocks(text)))
        .filter(|span| span.starts_with("foveate "))
        .collect();
    assert!(commands.len() >= 15, "{commands:?}");
    assert_eq!(commands.iter().flat_map(|line| faults(line)).collect::<Vec<_>>(), Vec::<String>::new());
    assert_eq!(faults("foveate render a.glb --out b.png --no-such-flag").len(), 1);
    assert_eq!(faults("foveate rnder a.glb --out b.png").len(), 1);
    assert_eq!(faults("foveate demo --set trace.rais=3").len(), 1);
}

#[test]
fn make_targets_exist() {
    let makefile = read(&root().join("Makefile"));
    let documents = documents();
    let lines = documents.iter().flat_map(|(_, text)| spans(text).into_iter().chain(blocks(text)));
    let targets: BTreeSet<&str> =
        lines.filter_map(|line| line.strip_prefix("make ")?.split_whitespace().next()).collect();
    assert!(targets.len() >= 5, "{targets:?}");
    for target in targets {
        assert!(makefile.contains(&format!("\n{target}:")), "there is no make {target}");
    }
}

/// The rooms of the table in docs/architecture.md, from the bottom up.
fn rooms() -> Vec<String> {
    let text = read(&root().join("docs/architecture.md"));
    let rows = text.lines().filter_map(|line| line.strip_prefix("| `src/")?.split('`').next());
    rows.map(|room| room.trim_end_matches('/').trim_end_matches(".rs").to_string()).collect()
}

/// The rooms that a source text names, by their place in `rooms`.
fn used<'a>(text: &str, rooms: &'a [String]) -> BTreeSet<(usize, &'a str)> {
    let word =
        |rest: &str| rest.split(|c: char| !c.is_ascii_lowercase() && c != '_').next().map(str::to_string);
    let named: Vec<String> = text.split("crate::").skip(1).filter_map(word).collect();
    rooms.iter().enumerate().filter(|(_, room)| named.contains(room)).map(|(i, room)| (i, &**room)).collect()
}

#[test]
fn rooms_use_only_rooms_below_them() {
    let rooms = rooms();
    let declared = read(&root().join("src/lib.rs")).matches("pub mod ").count();
    assert_eq!(rooms.len(), declared, "docs/architecture.md lists every room once: {rooms:?}");
    let mut wrong = BTreeSet::new();
    for (place, room) in rooms.iter().enumerate() {
        let folder = root().join("src").join(room);
        let parts = [folder.with_extension("rs"), folder];
        let found: Vec<PathBuf> =
            parts.iter().filter(|part| part.exists()).flat_map(|part| files(part)).collect();
        assert!(!found.is_empty(), "src/{room} has files");
        for file in found.into_iter().filter(|file| !file.ends_with("tests.rs")) {
            let text = read(&file);
            let shipped = text.split("#[cfg(test)]").next().unwrap();
            let above = used(shipped, &rooms).into_iter().filter(|(other, _)| *other > place);
            wrong.extend(above.map(|(_, other)| (room.as_str(), other.to_string())));
        }
    }
    assert_eq!(wrong, BTreeSet::new(), "rooms that use one above them");
}

/// Files with more lines than a reader keeps in mind.
fn long_files(folder: &Path, most: usize) -> Vec<String> {
    let all = files(folder).into_iter().filter(|file| file.extension().is_some_and(|e| e == "rs"));
    let counted = all.map(|file| (read(&file).lines().count(), file));
    let long = counted.filter(|(lines, _)| *lines > most);
    long.map(|(lines, file)| format!("{}: {lines} lines", file.display())).collect()
}

#[test]
fn no_file_is_long() {
    let source = root().join("src");
    assert_eq!(long_files(&source, MOST_LINES), Vec::<String>::new(), "split these by idea");
    assert!(!long_files(&source, 300).is_empty(), "lines are counted");
}
