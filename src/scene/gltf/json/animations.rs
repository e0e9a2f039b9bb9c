//! Animations as the file says them. What is malformed becomes `None`: a scene can be shown without it.

use serde::Deserialize as Derive;
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};

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

/// A list whose elements are read one by one; those that cannot be are `None`, and what is no list is empty.
pub(super) fn each<'de, D: Deserializer<'de>, T: de::DeserializeOwned>(
    deserializer: D,
) -> Result<Vec<Option<T>>, D::Error> {
    struct Each<T>(std::marker::PhantomData<T>);
    impl<'de, T: de::DeserializeOwned> Visitor<'de> for Each<T> {
        type Value = Vec<Option<T>>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("a list")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self::Value, A::Error> {
            let mut read = Vec::new();
            while let Some(Lenient(element)) = list.next_element()? {
                read.push(element);
            }
            Ok(read)
        }
    }
    deserializer.deserialize_seq(Each(std::marker::PhantomData))
}

struct Lenient<T>(Option<T>);

impl<'de, T: de::DeserializeOwned> Deserialize<'de> for Lenient<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        super::extensions::lenient(deserializer).map(Lenient)
    }
}
