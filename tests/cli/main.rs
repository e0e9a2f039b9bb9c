//! The program as it is run: every command, its flags, and what it says where it cannot do what is asked.

#[path = "../common/mod.rs"]
mod common;

mod bench;
mod measure;
mod mock;
mod motion;
mod refusals;
mod render;
mod scene;
mod system;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::builder::Builder;
use image::RgbImage;
use serde_json::{Value, json};

/// What a run of the program left behind.
#[derive(Debug)]
struct Run {
    code: Option<i32>,
    out: String,
    err: String,
}

/// The program with arguments in one string, split at spaces, in a folder.
fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    command.current_dir(folder).args(arguments.split_whitespace());
    command
}

fn run(mut command: Command) -> Run {
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let run = Run { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) };
    assert!(!run.err.contains("panicked"), "{command:?}: {run:?}");
    run
}

fn foveate(folder: &Path, arguments: &str) -> Run {
    run(command(folder, arguments))
}

impl Run {
    /// It did what was asked, without a word of complaint; the demo tells why it shows no headset.
    fn succeeds(self) -> Self {
        assert_eq!((self.code, self.complaints().as_str()), (Some(0), ""), "{self:?}");
        self
    }

    /// What it said beside that note.
    fn complaints(&self) -> String {
        const STANDS_IN: &str = "foveate: note: a mock headset stands in for a real one: ";
        self.err.split_inclusive('\n').filter(|line| !line.starts_with(STANDS_IN)).collect()
    }

    /// Its one JSON object.
    fn json(&self) -> Value {
        let value: Value = serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {self:?}"));
        assert!(value.is_object() && self.out.trim_end().lines().count() == 1, "{self:?}");
        value
    }

    /// It failed as a program reads it: one JSON object on standard error. Returns its code and its message.
    fn refusal(&self) -> (String, String) {
        assert_eq!((self.code, self.out.as_str(), self.err.lines().count()), (Some(1), "", 1), "{self:?}");
        let told: Value = serde_json::from_str(&self.err).unwrap_or_else(|e| panic!("{e}: {self:?}"));
        let text = |key: &str| told["error"][key].as_str().unwrap().to_string();
        (text("code"), text("message"))
    }

    /// It said one sentence, did nothing else, and exited with 1. Returns the sentence, as it is told without --json.
    fn sentence(&self) -> String {
        if self.err.starts_with('{') {
            return format!("foveate: {}", self.refusal().1);
        }
        assert_eq!((self.code, self.out.as_str()), (Some(1), ""), "{self:?}");
        let complaints = self.complaints();
        let (first, rest) = complaints.split_once('\n').expect("a line");
        assert!(first.starts_with("foveate: ") && first.len() > 20 && rest.is_empty(), "{self:?}");
        assert!(!first.contains("os error"), "says what the system says, not what to do: {first}");
        first.to_string()
    }
}

/// A folder with `scene.glb`: three walls in different colours and finishes on a floor, one with a lamp.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut builder = Builder::new();
    let corners = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [-1.0, 2.0, 0.0f32]];
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&[0, 1, 2, 0, 2, 3]));
    let finishes = [
        json!({ "baseColorFactor": [0.6, 0.6, 0.6, 1.0], "metallicFactor": 0.0 }),
        json!({ "baseColorFactor": [0.9, 0.1, 0.1, 1.0], "metallicFactor": 0.0 }),
        json!({ "baseColorFactor": [0.1, 0.9, 0.2, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.2 }),
        json!({ "baseColorFactor": [0.2, 0.2, 0.9, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.5 }),
    ];
    let places = [
        json!({ "scale": [8, 8, 1], "rotation": [-0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()], "translation": [0, 0, 8] }),
        json!({ "translation": [-1.5, 0.0, 0.0] }),
        json!({ "translation": [1.0, 0.0, -2.0], "rotation": [0.0, -0.2, 0.0, 0.98] }),
        json!({ "translation": [0.3, 0.0, 1.5], "scale": [0.3, 0.3, 0.3] }),
    ];
    for (index, (finish, place)) in finishes.into_iter().zip(places).enumerate() {
        let lamp = if index == 3 { 2.0 } else { 0.0 };
        let material = json!({ "pbrMetallicRoughness": finish, "doubleSided": true, "emissiveFactor": [lamp / 2.0, 0.0, 0.0] });
        let material = builder.push("materials", material);
        let primitive =
            json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": material });
        builder.place(primitive, place);
    }
    builder.write_glb(folder.path());
    folder
}

/// The small picture of that scene which most tests make; `--out` and more flags follow.
const SMALL: &str = "render scene.glb --json --width 48 --height 32 --samples 300 --rays 4 \
                     --position 0.2,1.5,5 --look-at 0,0.9,0 --fov-y 50 --reconstruct k-nn";

fn png(path: PathBuf) -> RgbImage {
    image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).into_rgb8()
}

/// How many pixels of two pictures of one size differ.
fn differing(a: &RgbImage, b: &RgbImage) -> usize {
    assert_eq!(a.dimensions(), b.dimensions());
    a.pixels().zip(b.pixels()).filter(|(a, b)| a != b).count()
}

/// The names of a folder's files, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_comparer_rejects_one_wrong_pixel() {
    let right = RgbImage::from_fn(48, 32, |x, y| image::Rgb([x as u8, y as u8, 7]));
    let mut wrong = right.clone();
    assert_eq!(differing(&right, &wrong), 0);
    wrong.get_pixel_mut(47, 31).0[2] += 1;
    assert_eq!(differing(&right, &wrong), 1);
}
