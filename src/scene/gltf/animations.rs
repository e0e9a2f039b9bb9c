//! A file's animations as clips: what cannot be played is left out with a sentence.

use super::accessor::{Accessor, Component};
use super::buffers::Buffers;
use super::json::{Animation, Document, Keys};
use super::{Outcome, json};
use crate::scene::animation::{Channel, Clip, Curve, Interpolation, PLACED_TEXTURES, Property};
use crate::scene::budget::Budget;
use crate::scene::source::shorten;

/// Every animation of the file, also those without anything to play.
pub fn clips(
    document: &Document,
    buffers: &Buffers<'_>,
    budget: &Budget,
    warnings: &mut Vec<String>,
) -> Outcome<Vec<Clip>> {
    let mut clips = Vec::with_capacity(document.animations.len());
    for (index, animation) in document.animations.iter().enumerate() {
        let Some(animation) = animation else {
            warnings.push(format!("animation {index} is malformed and does nothing; export the scene again"));
            clips.push(Clip::default());
            continue;
        };
        let name = animation.name.clone().unwrap_or_default();
        budget.plan_bytes(bytes(document, animation))?;
        let reader = Reader { document, buffers, animation };
        let (mut channels, mut faults) = (Vec::new(), Vec::new());
        for (number, channel) in animation.channels.iter().enumerate() {
            match reader.channel(channel.as_ref()) {
                Ok(channel) => channels.extend(channel),
                Err(problem) => faults.push(format!("channel {number} {problem}")),
            }
        }
        if let Some(first) = faults.first() {
            let more =
                if faults.len() > 1 { format!(", and {} more", faults.len() - 1) } else { String::new() };
            warnings.push(format!(
                "animation {index} {name:?} plays without what is wrong with it: {first}{more}; export the scene again"
            ));
        }
        clips.push(Clip { name, channels });
    }
    Ok(clips)
}

/// Bytes of all keys.
fn bytes(document: &Document, animation: &Animation) -> u64 {
    let size = |accessor: json::Int| {
        let accessor = document.accessors.get(accessor.0)?;
        Some((accessor.count.0 as u64).saturating_mul(4 * super::accessor::width(&accessor.kind)? as u64))
    };
    let keys = |channel: &json::Channel| {
        let keys = animation.samplers.get(channel.sampler.0)?.as_ref()?;
        Some(size(keys.input)?.saturating_add(size(keys.output)?))
    };
    animation.channels.iter().flatten().filter_map(keys).fold(0, u64::saturating_add)
}

/// What of which node or light a pointer names (KHR_animation_pointer); a clause where that is not played.
fn pointed(pointer: &str) -> Outcome<(&str, Option<usize>)> {
    let refuse = || format!("moves {:?}, which is not played", shorten(pointer));
    let parts: Vec<&str> = pointer.split('/').collect();
    let number = |text: &str| text.parse::<usize>().ok();
    match parts[..] {
        ["", "nodes", node, path @ ("translation" | "rotation" | "scale" | "weights")] => {
            Ok((path, Some(number(node).ok_or_else(refuse)?)))
        }
        ["", "nodes", node, "extensions", "KHR_node_visibility", path @ "visible"] => {
            Ok((path, Some(number(node).ok_or_else(refuse)?)))
        }
        ["", "extensions", "KHR_lights_punctual", "lights", light, path @ ("intensity" | "color")] => {
            Ok((path, Some(number(light).ok_or_else(refuse)?)))
        }
        _ => Err(refuse()),
    }
}

/// What of which material a pointer names, and the material's texture that it is about; none where it is about something
/// else.
fn painted(pointer: &str) -> Option<(usize, Property)> {
    let rest = pointer.strip_prefix("/materials/")?;
    let (number, path) = rest.split_once('/')?;
    let of_texture = |(texture, name): (usize, &str)| {
        let part = path.strip_prefix(name)?.strip_prefix("/extensions/KHR_texture_transform/")?;
        match part {
            "offset" => Some(Property::UvOffset(texture)),
            "rotation" => Some(Property::UvRotation(texture)),
            "scale" => Some(Property::UvScale(texture)),
            _ => None,
        }
    };
    let property = match path {
        "pbrMetallicRoughness/baseColorFactor" => Property::BaseColor,
        "emissiveFactor" => Property::Emissive,
        "extensions/KHR_materials_emissive_strength/emissiveStrength" => Property::EmissiveStrength,
        _ => TEXTURES.into_iter().enumerate().find_map(of_texture)?,
    };
    Some((number.parse().ok()?, property))
}

/// Textures whose places change.
const TEXTURES: [&str; PLACED_TEXTURES] = [
    "pbrMetallicRoughness/baseColorTexture",
    "pbrMetallicRoughness/metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
    "emissiveTexture",
];

struct Reader<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    animation: &'a Animation,
}

impl Reader<'_> {
    /// A channel, if it moves anything; else a clause about what is wrong with it.
    fn channel(&self, channel: Option<&json::Channel>) -> Outcome<Option<Channel>> {
        let channel = channel.ok_or("is malformed")?;
        let target = &channel.target;
        let pointer = target.extensions.pointer.as_ref().filter(|_| target.path == "pointer");
        if let Some((material, property)) = pointer.and_then(|pointer| painted(&pointer.pointer)) {
            return self.paint(channel, material, property).map(Some);
        }
        let (path, node) = match &target.extensions.pointer {
            Some(pointer) if target.path == "pointer" => pointed(&pointer.pointer)?,
            _ => (target.path.as_str(), target.node.map(|node| node.0)),
        };
        if let "intensity" | "color" = path {
            return self.light(channel, path, node).map(Some);
        }
        let property = match path {
            "translation" => Property::Translation,
            "rotation" => Property::Rotation,
            "scale" => Property::Scale,
            "weights" => Property::Weights,
            "visible" => Property::Visible,
            other => return Err(format!("moves {other:?}, which is not played")),
        };
        // Without a node it is for an extension, and to be ignored (glTF 2.0, 5.6 "animation.channel.target").
        let Some(node) = node else { return Ok(None) };
        let there =
            self.document.nodes.get(node).ok_or_else(|| format!("moves node {node}, which is not there"))?;
        if there.matrix.is_some() && !matches!(property, Property::Weights | Property::Visible) {
            return Err(format!("moves node {node}, which has a matrix"));
        }
        let width = property.width().map_or_else(|| self.targets(node), Ok)?;
        let keys = self.keys(channel)?;
        if property == Property::Visible && keys.interpolation.as_deref() != Some("STEP") {
            return Err(format!("shows and hides node {node} other than by steps"));
        }
        Ok(Some(Channel { node, property, curve: self.curve(keys, width, property)? }))
    }

    fn keys(&self, channel: &json::Channel) -> Outcome<&Keys> {
        let keys = self.animation.samplers.get(channel.sampler.0).and_then(Option::as_ref);
        keys.ok_or_else(|| format!("has no sampler {}", channel.sampler.0))
    }

    /// A channel that changes a light of the file.
    fn light(&self, channel: &json::Channel, path: &str, light: Option<usize>) -> Outcome<Channel> {
        let count = self.document.extensions.lights.as_ref().map_or(0, |lights| lights.lights.len());
        let light = light.filter(|light| *light < count).ok_or("changes a light that is not there")?;
        let (property, width) = if path == "color" { (Property::Color, 3) } else { (Property::Intensity, 1) };
        Ok(Channel { node: light, property, curve: self.curve(self.keys(channel)?, width, property)? })
    }

    /// A channel that changes a material of the file.
    fn paint(&self, channel: &json::Channel, material: usize, property: Property) -> Outcome<Channel> {
        let there = self.document.materials.get(material);
        let there = there.ok_or_else(|| format!("changes material {material}, which is not there"))?;
        let pbr = &there.pbr_metallic_roughness;
        let textures = [
            &pbr.base_color_texture,
            &pbr.metallic_roughness_texture,
            &there.normal_texture,
            &there.occlusion_texture,
            &there.emissive_texture,
        ];
        if let Property::UvOffset(texture) | Property::UvRotation(texture) | Property::UvScale(texture) =
            property
            && textures[texture].is_none()
        {
            return Err(format!("moves a texture that material {material} does not have"));
        }
        let width = property.width().unwrap_or(1);
        Ok(Channel { node: material, property, curve: self.curve(self.keys(channel)?, width, property)? })
    }

    /// Morph targets of a node's mesh.
    fn targets(&self, node: usize) -> Outcome<usize> {
        let mesh = self.document.nodes[node].mesh;
        let primitives = mesh.iter().flat_map(|mesh| &self.document.meshes[mesh.0].primitives);
        let most = primitives.map(|primitive| primitive.targets.len()).max().unwrap_or(0);
        if most == 0 { Err(format!("moves the weights of node {node}, which has none")) } else { Ok(most) }
    }

    fn curve(&self, keys: &Keys, width: usize, property: Property) -> Outcome<Curve> {
        let interpolation = match keys.interpolation.as_deref() {
            None | Some("LINEAR") => Interpolation::Linear,
            Some("STEP") => Interpolation::Step,
            Some("CUBICSPLINE") => Interpolation::Cubic,
            Some(other) => return Err(format!("has the unknown interpolation {other:?}")),
        };
        let times = self.numbers(keys.input, &[1], &[Component::F32])?;
        let parts = [Component::F32, Component::I8, Component::U8, Component::I16, Component::U16];
        let widths = if property == Property::Weights { 1 } else { width };
        let values = self.numbers(keys.output, &[widths], &parts)?;
        Curve::new(times, values, width, interpolation)
    }

    /// All numbers of an accessor; integers are fractions (glTF 2.0, 3.11 "Animations").
    fn numbers(&self, accessor: json::Int, widths: &[usize], parts: &[Component]) -> Outcome<Vec<f32>> {
        if accessor.0 >= self.document.accessors.len() {
            return Err(format!("has keys in accessor {}, which is not there", accessor.0));
        }
        let read = Accessor::new(self.document, self.buffers, accessor.0)
            .and_then(|accessor| accessor.expect("keys of an animation", widths, parts));
        let read = read.map_err(|problem| {
            let cause = problem.trim_end_matches("; export the scene again").to_string();
            format!("has keys that cannot be read ({cause})")
        })?;
        let read = read.always_normalized();
        Ok((0..read.count).flat_map(|i| read.get::<4>(i).into_iter().take(read.width)).collect())
    }
}
