//! Every reference of the document is in range, checked once, so that all others may simply index.

use super::Outcome;
use super::json::{Document, Int, Material, TextureInfo};

/// Refuses a document with an index that points nowhere, naming the index.
pub fn references(document: &Document) -> Outcome<()> {
    let d = document;
    for (i, accessor) in d.accessors.iter().enumerate() {
        let sparse = accessor.sparse.iter().flat_map(|s| [s.indices.buffer_view, s.values.buffer_view]);
        for view in accessor.buffer_view.into_iter().chain(sparse) {
            inside([view], d.buffer_views.len(), || format!("accessor {i}"), "bufferView")?;
        }
    }
    for (i, view) in d.buffer_views.iter().enumerate() {
        let compressed = view.extensions.meshopt().map(|meshopt| meshopt.buffer);
        inside(
            compressed.into_iter().chain([view.buffer]),
            d.buffers.len(),
            || format!("bufferView {i}"),
            "buffer",
        )?;
    }
    for (i, image) in d.images.iter().enumerate() {
        inside(image.buffer_view, d.buffer_views.len(), || format!("image {i}"), "bufferView")?;
    }
    for (i, texture) in d.textures.iter().enumerate() {
        let sources = texture.source.into_iter().chain(texture.other_sources());
        inside(sources, d.images.len(), || format!("texture {i}"), "image")?;
        inside(texture.sampler, d.samplers.len(), || format!("texture {i}"), "sampler")?;
    }
    for (i, material) in d.materials.iter().enumerate() {
        for info in textures_of(material) {
            inside([info.index], d.textures.len(), || format!("material {i}"), "texture")?;
        }
    }
    meshes(d)?;
    nodes(d)?;
    for (i, scene) in d.scenes.iter().enumerate() {
        inside(scene.nodes.iter().copied(), d.nodes.len(), || format!("scene {i}"), "node")?;
    }
    for (i, skin) in d.skins.iter().enumerate() {
        inside(skin.joints.iter().copied(), d.nodes.len(), || format!("skin {i}"), "node")?;
        inside(skin.inverse_bind_matrices, d.accessors.len(), || format!("skin {i}"), "accessor")?;
    }
    inside(d.scene, d.scenes.len(), || "the document".into(), "scene")
}

fn meshes(d: &Document) -> Outcome<()> {
    for (i, mesh) in d.meshes.iter().enumerate() {
        for (j, primitive) in mesh.primitives.iter().enumerate() {
            let name = || format!("primitive {j} of mesh {i}");
            let morphs = primitive.targets.iter().flat_map(|target| target.values());
            let accessors = primitive.attributes.values().chain(morphs).copied().chain(primitive.indices);
            inside(accessors, d.accessors.len(), name, "accessor")?;
            let variants = primitive.extensions.variants.iter().flat_map(|v| &v.mappings).map(|m| m.material);
            inside(variants.chain(primitive.material), d.materials.len(), name, "material")?;
            let draco = primitive.extensions.draco.as_ref().map(|draco| draco.buffer_view);
            inside(draco, d.buffer_views.len(), name, "bufferView")?;
        }
    }
    Ok(())
}

fn nodes(d: &Document) -> Outcome<()> {
    let lights = d.extensions.lights.as_ref().map_or(0, |lights| lights.lights.len());
    for (i, node) in d.nodes.iter().enumerate() {
        let name = || format!("node {i}");
        inside(node.children.iter().copied(), d.nodes.len(), name, "node")?;
        inside(node.mesh, d.meshes.len(), name, "mesh")?;
        inside(node.camera, d.cameras.len(), name, "camera")?;
        inside(node.skin, d.skins.len(), name, "skin")?;
        let instances = node.extensions.instances.iter().flat_map(|i| i.attributes.values().copied());
        inside(instances, d.accessors.len(), name, "accessor")?;
        inside(node.extensions.light.as_ref().map(|light| light.light), lights, name, "light")?;
    }
    Ok(())
}

fn textures_of(material: &Material) -> impl Iterator<Item = &TextureInfo> {
    let pbr = &material.pbr_metallic_roughness;
    [
        &pbr.base_color_texture,
        &pbr.metallic_roughness_texture,
        &material.normal_texture,
        &material.occlusion_texture,
        &material.emissive_texture,
    ]
    .into_iter()
    .flatten()
    .chain(material.extensions.layers.all_textures())
}

fn inside(
    indices: impl IntoIterator<Item = Int>,
    count: usize,
    user: impl Fn() -> String,
    kind: &str,
) -> Outcome<()> {
    match indices.into_iter().find(|index| index.0 >= count) {
        Some(Int(bad)) => {
            let there = if count == 0 { "none".into() } else { format!("only {count}") };
            Err(format!(
                "{} refers to {kind} {bad}, but the file has {there}; export the scene again",
                user()
            ))
        }
        None => Ok(()),
    }
}
