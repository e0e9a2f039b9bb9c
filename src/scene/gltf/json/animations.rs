//! Animations as the file says them. What is malformed becomes `None`: a scene can be shown without it.

use serde::Deserialize as Derive;
use serde::de::{DeserializeOwned, Deserializer};
use serde_json::Value;

use super::Int;

#[derive(Derive, Default)]
#[serde(default)]
pub struct Animation {
    pub name: Option<String>,
    #[serde(deserialize_with = "each")]
    pub channels: Vec<Option<Channel>>,
    #[serde(deserialize_with = "each")]
    pub samplers: Vec<Option<Keys>>,
}

#[derive(Derive)]
pub struct Channel {
    pub sampler: Int,
    pub target: Target,
}

#[derive(Derive)]
pub struct Target {
    pub node: Option<Int>,
    pub path: String,
    #[serde(default)]
    pub extensions: TargetExtensions,
}

#[derive(Derive, Default)]
pub struct TargetExtensions {
    #[serde(rename = "KHR_animation_pointer")]
    pub pointer: Option<Pointer>,
}

/// A JSON pointer (RFC 6901) into the document.
#[derive(Derive)]
pub struct Pointer {
    pub pointer: String,
}

/// `animation.sampler`.
#[derive(Derive)]
pub struct Keys {
    pub input: Int,
    pub output: Int,
    pub interpolation: Option<String>,
}

/// A list whose elements are read one by one. Those that cannot be are `None`, and so is what stands in place of a
/// list, as its only element.
pub(super) fn each<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
) -> Result<Vec<Option<T>>, D::Error> {
    Ok(match Value::deserialize(deserializer)? {
        Value::Array(list) => list.into_iter().map(|element| serde_json::from_value(element).ok()).collect(),
        _ => vec![None],
    })
}
