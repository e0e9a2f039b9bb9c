//! From bytes to a document: `.gltf`, `.glb`, the version and the extensions.

use std::ops::Range;

use super::json::Document;
use super::{Outcome, weigh};
use crate::scene::budget::Budget;

/// Extensions that this loader implements.
const SUPPORTED: [&str; 22] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

const MAGIC: &[u8] = b"glTF";
const CHUNK_JSON: u32 = u32::from_le_bytes(*b"JSON");
const CHUNK_BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// A document and where in the file's bytes its binary chunk lies.
pub struct Container {
    /// The parsed JSON.
    pub document: Document,
    /// The binary chunk of a `.glb`.
    pub bin: Option<Range<usize>>,
}

/// Reads a `.gltf` or `.glb` file's bytes; `binary` says that the file's name promises a `.glb`.
pub fn parse(bytes: &[u8], binary: bool, budget: &Budget, warnings: &mut Vec<String>) -> Outcome<Container> {
    if !binary && !bytes.starts_with(MAGIC) {
        return Ok(Container { document: parse_json(bytes, budget, warnings)?, bin: None });
    }
    let (json, bin) = split_glb(bytes)?;
    Ok(Container { document: parse_json(&bytes[json], budget, warnings)?, bin })
}

fn parse_json(bytes: &[u8], budget: &Budget, warnings: &mut Vec<String>) -> Outcome<Document> {
    // glTF forbids a byte order mark, but some editors write one.
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    // Serde would take an array for an object.
    if bytes.trim_ascii_start().first() == Some(&b'[') {
        return Err("the JSON is an array, not a glTF 2.0 document; export it again".into());
    }
    budget.plan_document(weigh::bytes(bytes))?;
    let document: Document = serde_json::from_slice(bytes)
        .map_err(|error| format!("the JSON is not a glTF 2.0 document ({error}); export it again"))?;
    check_version(&document)?;
    check_extensions(&document, warnings)?;
    Ok(document)
}

fn check_version(document: &Document) -> Outcome<()> {
    let asset = &document.asset;
    let needed = asset.min_version.as_ref().unwrap_or(&asset.version);
    let too_new = asset.min_version.as_ref().is_some_and(|version| version != "2.0");
    if !asset.version.starts_with("2.") || too_new {
        return Err(format!(
            "it needs glTF version {needed:?}, but only 2.0 is supported; export it as glTF 2.0"
        ));
    }
    Ok(())
}

fn check_extensions(document: &Document, warnings: &mut Vec<String>) -> Outcome<()> {
    let unsupported = |name: &&String| !SUPPORTED.contains(&name.as_str());
    let required: Vec<&str> =
        document.extensions_required.iter().filter(unsupported).map(String::as_str).collect();
    if !required.is_empty() {
        return Err(format!(
            "it requires {}, which is not supported; export it without {}",
            required.join(", "),
            if required.len() == 1 { "this extension" } else { "these extensions" }
        ));
    }
    let mut optional: Vec<&String> = document.extensions_used.iter().filter(unsupported).collect();
    optional.sort();
    optional.dedup();
    warnings
        .extend(optional.iter().map(|name| format!("the extension {name} is not supported and was ignored")));
    Ok(())
}

/// The ranges of the JSON and the binary chunk (glTF 2.0, 4.4 "Binary glTF layout").
fn split_glb(bytes: &[u8]) -> Outcome<(Range<usize>, Option<Range<usize>>)> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if !bytes.starts_with(MAGIC) {
        return Err("it does not start with \"glTF\", so it is no .glb file; export it again".into());
    }
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err("it ends inside the .glb header; copy or export it again".into());
    };
    if version != 2 {
        return Err(format!(
            "it is a .glb of version {version}, but only 2 is supported; export it as glTF 2.0"
        ));
    }
    let end = length as usize;
    if end > bytes.len() {
        return Err(format!(
            "its header promises {end} bytes but it has {}; copy or export it again",
            bytes.len()
        ));
    }
    let (mut json, mut bin) = (None, None);
    let mut at = 12;
    while at < end {
        let header = (at + 8 <= end).then(|| word(at).zip(word(at + 4))).flatten();
        let Some((size, kind)) = header else {
            return Err(format!("it ends inside the chunk header at byte {at}; copy or export it again"));
        };
        let start = at + 8;
        let stop = start + size as usize;
        if size % 4 != 0 {
            return Err(format!(
                "its chunk at byte {at} has {size} bytes, not a multiple of 4; export it again"
            ));
        }
        if stop > end {
            return Err(format!(
                "its chunk at byte {at} claims {size} bytes, of which {} are there; copy or export it again",
                end - start
            ));
        }
        match kind {
            CHUNK_JSON if json.is_none() && at == 12 => json = Some(start..stop),
            CHUNK_BIN if bin.is_none() && json.is_some() => bin = Some(start..stop),
            CHUNK_JSON | CHUNK_BIN => {
                return Err(format!("its chunk at byte {at} is repeated or out of order; export it again"));
            }
            // Chunks of other kinds belong to extensions; but the first one is the JSON.
            _ if json.is_some() => {}
            _ => return Err("its first chunk is not JSON; export it again".into()),
        }
        at = stop;
    }
    let json = json.ok_or("it has no JSON chunk; export it again")?;
    Ok((json, bin))
}
