//! Wavefront OBJ files with their MTL materials to a [`Scene`].
//!
//! An OBJ becomes a glTF document in memory and takes glTF's way from there: what holds for that (materials
//! reduced to what matters, tangents, budgets, warnings, stand-ins) holds for it too. The file's text is
//! tidied (`text`), read by tobj, its polygons cut into triangles (`polygons`), and its materials mapped to
//! metallic-roughness (`mtl`, `statements`).
//!
//! **An OBJ is a glTF document in memory.** tobj reads its geometry; materials, pictures and nodes become the
//! same types that a glTF file's JSON does, so that what holds for glTF (materials reduced to what matters,
//! tangents, warnings, stand-ins, the budget) is not written twice.

mod mtl;
mod polygons;
mod statements;
mod text;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Mutex;

use super::gltf::json::{Accessor, Buffer, BufferView, Document, Int, Mesh, Node, Primitive, SceneRoots};
use super::source::{self, Folder};
use super::{LoadOptions, Outcome, Scene, gltf};
use crate::{Error, Result};

/// Files beyond this are no text that anybody wrote.
const MAX_FILE: u64 = 1 << 36;

/// Largest file of materials.
const MAX_MATERIALS: u64 = 1 << 26;

/// Reads an `.obj` file and the materials and images of its folder and below. Coordinates are taken for
/// metres, times [`LoadOptions::scale`]. A file of materials that is missing is told in [`Scene::warnings`].
///
/// # Errors
/// [`Error::File`] when the file itself cannot be read, [`Error::Scene`] when it is malformed or takes more
/// memory than is free.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let size = std::fs::metadata(path).map_err(|error| Error::io(path, &error))?.len();
    let refuse = |problem| Error::Scene { path: path.to_path_buf(), problem };
    options.budget.plan_bytes(size).map_err(refuse)?;
    let bytes = source::read_file(path, MAX_FILE).map_err(|error| Error::io(path, &error))?;
    let folder = Folder::of(path).map_err(|error| Error::io(path, &error))?;
    read(bytes, &folder, options).map_err(refuse)
}

/// The scene in the bytes of an OBJ file.
pub fn read(bytes: Vec<u8>, folder: &Folder, options: &LoadOptions) -> Outcome<Scene> {
    let text = text::tidy(bytes);
    if let Some(line) = text::lost_corner(&text) {
        return Err(format!(
            "line {line} cannot be read (a corner's number leads to no vertex); export the scene again"
        ));
    }
    options.budget.plan_triangles(text::triangles(&text))?;
    let mut warnings = Vec::new();
    let (models, materials) = parse(&text, folder, options, &mut warnings)?;
    drop(text);
    let mut made = Made::default();
    let given: Vec<usize> = materials.iter().map(|material| mtl::add(&mut made.document, material)).collect();
    for material in &materials {
        mtl::warn(material, &mut warnings);
    }
    for model in models {
        made.add(model.mesh, &given);
    }
    let Made { mut document, bytes, .. } = made;
    document.buffers = vec![Buffer { uri: None, byte_length: Int(bytes.len()) }];
    document.scenes = vec![SceneRoots { name: None, nodes: (0..document.nodes.len()).map(Int).collect() }];
    let whole = 0..bytes.len();
    gltf::from_document(&document, bytes.into(), Some(whole), folder, options, warnings)
}

/// Runs tobj over the text; progress is told by the bytes that it has read.
fn parse(
    text: &str,
    folder: &Folder,
    options: &LoadOptions,
    warnings: &mut Vec<String>,
) -> Outcome<(Vec<tobj::Model>, Vec<mtl::Source>)> {
    let mut reader = text::Lines::new(text, &options.progress);
    let how = tobj::LoadOptions { single_index: true, ..Default::default() };
    let libraries = Mutex::new((Vec::new(), Vec::new()));
    let parsed = tobj::load_obj_buf(&mut reader, &how, |name| {
        let name = name.to_string_lossy();
        let mut libraries = libraries.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        match mtl::read(&name, folder, MAX_MATERIALS) {
            Ok(sources) => {
                let names: HashMap<String, usize> =
                    sources.iter().enumerate().map(|(i, source)| (source.name.clone(), i)).collect();
                let blank = |s: &mtl::Source| tobj::Material { name: s.name.clone(), ..Default::default() };
                let materials = sources.iter().map(blank).collect();
                libraries.0.extend(sources);
                Ok((materials, names))
            }
            Err(problem) => {
                libraries.1.push(format!("{problem}; what has no material is grey"));
                Err(tobj::LoadError::OpenFileFailed)
            }
        }
    });
    let (materials, problems) = libraries.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    warnings.extend(problems);
    let (models, _) = parsed.map_err(|error| {
        format!("line {} cannot be read ({error}); export the scene again", reader.line())
    })?;
    Ok((models, materials))
}

/// A document on its way, and the bytes of its one buffer.
#[derive(Default)]
struct Made {
    document: Document,
    bytes: Vec<u8>,
    /// The material of what has none.
    grey: Option<usize>,
}

impl Made {
    /// Adds a mesh and a node that shows it.
    fn add(&mut self, mesh: tobj::Mesh, materials: &[usize]) {
        let indices = polygons::triangles(&mesh);
        if indices.is_empty() {
            return;
        }
        let vertices = mesh.positions.len() / 3;
        let mut attributes = BTreeMap::new();
        let mut attribute = |made: &mut Made, name: &str, values: &[f32], kind: &str, width: usize| {
            if values.len() == vertices * width {
                let accessor = made.floats(values, kind, vertices);
                attributes.insert(name.to_string(), accessor);
            }
        };
        attribute(self, "POSITION", &mesh.positions, "VEC3", 3);
        attribute(self, "NORMAL", &mesh.normals, "VEC3", 3);
        attribute(self, "COLOR_0", &mesh.vertex_color, "VEC3", 3);
        // An OBJ's v runs up the picture, glTF's down.
        let flipped: Vec<f32> = mesh.texcoords.chunks_exact(2).flat_map(|uv| [uv[0], 1.0 - uv[1]]).collect();
        attribute(self, "TEXCOORD_0", &flipped, "VEC2", 2);

        let bytes: &[u8] = bytemuck::cast_slice(&indices);
        let indices = self.accessor(bytes, 5125, "SCALAR", indices.len());
        let material =
            mesh.material_id.and_then(|id| materials.get(id).copied()).unwrap_or_else(|| self.grey());
        let document = &mut self.document;
        let primitive = Primitive {
            attributes,
            indices: Some(indices),
            material: Some(Int(material)),
            ..Default::default()
        };
        document.meshes.push(Mesh { primitives: vec![primitive], weights: Vec::new() });
        document.nodes.push(Node { mesh: Some(Int(document.meshes.len() - 1)), ..Default::default() });
    }

    fn grey(&mut self) -> usize {
        *self.grey.get_or_insert_with(|| mtl::add(&mut self.document, &mtl::Source::default()))
    }

    fn floats(&mut self, values: &[f32], kind: &str, count: usize) -> Int {
        self.accessor(bytemuck::cast_slice(values), 5126, kind, count)
    }

    fn accessor(&mut self, bytes: &[u8], component: usize, kind: &str, count: usize) -> Int {
        let view = BufferView {
            buffer: Int(0),
            byte_offset: Int(self.bytes.len()),
            byte_length: Int(bytes.len()),
            byte_stride: None,
            extensions: Default::default(),
        };
        self.bytes.extend_from_slice(bytes);
        self.document.buffer_views.push(view);
        self.document.accessors.push(Accessor {
            buffer_view: Some(Int(self.document.buffer_views.len() - 1)),
            byte_offset: Int(0),
            component_type: Int(component),
            normalized: false,
            count: Int(count),
            kind: kind.into(),
            sparse: None,
        });
        Int(self.document.accessors.len() - 1)
    }
}
