//! Builds small glTF files for tests.

use std::path::{Path, PathBuf};

use base64::Engine;
use foveate::scene::Scene;
use serde_json::{Value, json};

pub const FLOAT: u32 = 5126;
pub const U8: u32 = 5121;
pub const U16: u32 = 5123;
pub const I8: u32 = 5120;
pub const I16: u32 = 5122;

/// A document and the bytes of its one buffer.
pub struct Builder {
    pub json: Value,
    bytes: Vec<u8>,
}

impl Builder {
    pub fn new() -> Self {
        Builder { json: json!({ "asset": { "version": "2.0" }, "scene": 0 }), bytes: Vec::new() }
    }

    /// Appends to one of the document's arrays and returns the index.
    pub fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json.get(list).is_none() {
            self.json[list] = json!([]);
        }
        let array = self.json[list].as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    /// An accessor over little-endian bytes; `kind` is `VEC3` and the like.
    pub fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }),
        )
    }

    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let bytes: Vec<u8> = values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let kind = [("SCALAR", 1), ("VEC2", 2), ("VEC3", 3), ("VEC4", 4), ("MAT4", 16)];
        let kind = kind.iter().find(|kind| kind.1 == N).unwrap().0;
        self.accessor(&bytes, FLOAT, kind, values.len())
    }

    pub fn shorts(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.accessor(&bytes, U16, "SCALAR", values.len())
    }

    /// A mesh of one primitive, placed by a node of its own with these further properties.
    pub fn place(&mut self, primitive: Value, node: Value) {
        let mesh = self.push("meshes", json!({ "primitives": [primitive] }));
        let mut node = node;
        node["mesh"] = json!(mesh);
        let node = self.push("nodes", node);
        self.show(node);
    }

    /// Adds a node to the scene.
    pub fn show(&mut self, node: usize) {
        if self.json.get("scenes").is_none() {
            self.json["scenes"] = json!([{ "nodes": [] }]);
        }
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(node));
    }

    /// A texture with an image of its own: `texels` in a row, as PNG.
    pub fn texture(&mut self, texels: &[[u8; 4]]) -> usize {
        let picture =
            image::RgbaImage::from_fn(texels.len() as u32, 1, |x, _| image::Rgba(texels[x as usize]));
        let mut png = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
        let view = self.view(png.get_ref());
        let image = self.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        self.push("textures", json!({ "source": image }))
    }

    /// The document with its buffer as a data URI.
    pub fn document(&self) -> Value {
        let mut json = self.json.clone();
        if !self.bytes.is_empty() {
            let data = base64::engine::general_purpose::STANDARD.encode(&self.bytes);
            let uri = format!("data:application/octet-stream;base64,{data}");
            json["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": uri }]);
        }
        json
    }

    /// Loads it as a `.gltf` file.
    pub fn load(&self) -> foveate::Result<Scene> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.gltf");
        std::fs::write(&path, self.document().to_string()).unwrap();
        Scene::load(&path)
    }

    /// Writes it as a `.glb` file.
    pub fn write_glb(&self, folder: &Path) -> PathBuf {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        let path = folder.join("scene.glb");
        std::fs::write(&path, glb(&json, &self.bytes)).unwrap();
        path
    }
}

/// The bytes of a `.glb` file.
pub fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let length = 12 + 8 + text.len() + 8 + bin.len();
    let mut file = b"glTF".to_vec();
    for word in [2, length as u32, text.len() as u32] {
        file.extend(word.to_le_bytes());
    }
    file.extend(b"JSON");
    file.extend(text);
    file.extend((bin.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(bin);
    file
}

/// The JSON and the binary chunk of a `.glb` file that is known to be whole.
pub fn split_glb(bytes: &[u8]) -> (Value, Vec<u8>) {
    let size = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json = serde_json::from_slice(&bytes[20..20 + size]).unwrap();
    (json, bytes[20 + size + 8..].to_vec())
}
