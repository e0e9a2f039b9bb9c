//! What is drawn over pictures for those who want to see how they are made.

use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// What is shown; nothing by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overlay {
    /// A ring around the point at which the picture is sharp.
    pub gaze: bool,
    /// A point in each pixel that has a sample.
    pub samples: bool,
    /// Lines between every eight columns and rows of camera rays.
    pub rays: bool,
}

impl Overlay {
    /// All of it.
    pub const ALL: Overlay = Overlay { gaze: true, samples: true, rays: true };

    /// As kernels/shared/overlay.wgsl has it.
    pub(super) fn bits(self) -> u8 {
        u8::from(self.gaze) | u8::from(self.samples) << 1 | u8::from(self.rays) << 2
    }

    fn parts(self) -> impl Iterator<Item = &'static str> {
        let all = [(self.gaze, "gaze"), (self.samples, "samples"), (self.rays, "rays")];
        all.into_iter().filter_map(|(shown, name)| shown.then_some(name))
    }
}

impl FromStr for Overlay {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut overlay = Overlay::default();
        for name in text.split(',').map(str::trim).filter(|name| !name.is_empty()) {
            match name {
                "gaze" => overlay.gaze = true,
                "samples" => overlay.samples = true,
                "rays" => overlay.rays = true,
                _ => {
                    return Err(format!(
                        "{name:?} is none of gaze, samples and rays, with commas between them"
                    ));
                }
            }
        }
        Ok(overlay)
    }
}

impl Serialize for Overlay {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.parts().collect::<Vec<_>>().join(","))
    }
}

impl<'de> Deserialize<'de> for Overlay {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_named() {
        assert_eq!("".parse(), Ok(Overlay::default()));
        assert_eq!("rays, gaze".parse(), Ok(Overlay { samples: false, ..Overlay::ALL }));
        assert!("gaze,levels".parse::<Overlay>().unwrap_err().contains("\"levels\" is none of gaze"));
        for overlay in [Overlay::default(), Overlay::ALL, Overlay { rays: false, ..Overlay::ALL }] {
            let text = serde_json::to_string(&overlay).unwrap();
            assert_eq!(serde_json::from_str::<Overlay>(&text).unwrap(), overlay, "{text}");
        }
    }
}
