//! What a document's lists will take in memory, found without making any: a list may have an element for every
//! three bytes of text, and an element takes hundreds.

use std::fmt;

use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::json;

/// Bytes that lists inside of an element take for each byte of text, at most (`[0,0,` as numbers of 8 bytes
/// in a list with as much room again).
const NESTED: u64 = 8;

/// Bytes that placing a node takes: its transform, its order, its parent, and a placement.
const PLACED: usize = 384;

/// Bytes for each list of the document's root that has a type here.
const ELEMENTS: [(&str, usize); 11] = [
    ("accessors", size_of::<json::Accessor>()),
    ("animations", size_of::<json::Animation>()),
    ("bufferViews", size_of::<json::BufferView>()),
    ("buffers", size_of::<json::Buffer>()),
    ("images", size_of::<json::Image>()),
    ("materials", size_of::<json::Material>()),
    ("meshes", size_of::<json::Mesh>()),
    ("nodes", size_of::<json::Node>() + PLACED),
    ("samplers", size_of::<json::Sampler>()),
    ("skins", size_of::<json::Skin>()),
    ("textures", size_of::<json::Texture>()),
];

/// Bytes that parsing `text` will take, about; too few for text that is no document, which takes none.
pub fn bytes(text: &[u8]) -> u64 {
    let lists = serde_json::from_slice::<Weight>(text).map_or(0, |weight| weight.0);
    (text.len() as u64).saturating_mul(NESTED).saturating_add(lists)
}

struct Weight(u64);

impl<'de> Deserialize<'de> for Weight {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Root;
        impl<'de> Visitor<'de> for Root {
            type Value = Weight;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a document")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Weight, A::Error> {
                let mut sum = 0_u64;
                while let Some(key) = map.next_key::<std::borrow::Cow<'de, str>>()? {
                    match ELEMENTS.iter().find(|(name, _)| *name == key) {
                        // A list that grows has up to twice the room that it needs.
                        Some((_, size)) => {
                            sum = sum.saturating_add(map.next_value::<Count>()?.0 * *size as u64 * 2);
                        }
                        None => drop(map.next_value::<IgnoredAny>()?),
                    }
                }
                Ok(Weight(sum))
            }
        }
        deserializer.deserialize_map(Root)
    }
}

/// The number of a list's elements.
struct Count(u64);

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Count;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Count, A::Error> {
                let mut count = 0;
                while list.next_element::<IgnoredAny>()?.is_some() {
                    count += 1;
                }
                Ok(Count(count))
            }
        }
        deserializer.deserialize_seq(List)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_of_a_list_weighs() {
        let text = |count: usize| {
            format!("{{\"extras\": [1, 2], \"materials\": [{}]}}", vec!["{}"; count].join(","))
        };
        let difference = bytes(text(1001).as_bytes()) - bytes(text(1).as_bytes());
        assert_eq!(difference, 1000 * (2 * size_of::<json::Material>() as u64 + 3 * NESTED));
        assert_eq!(bytes(b"nothing"), 7 * NESTED);
    }
}
