//! Clips: curves that play together, and which of a file's clips do.

use std::collections::HashSet;

use serde::Serialize;

use super::Curve;
use crate::scene::options::by_name;

/// What a curve moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Property {
    /// A node's translation, in its parent's units.
    Translation,
    /// A node's rotation.
    Rotation,
    /// A node's scale.
    Scale,
    /// The weights of a node's morph targets.
    Weights,
    /// Whether a node is seen, with all below it: above 0 where it is.
    Visible,
    /// How bright a light of the file is, in its unit.
    Intensity,
    /// A light's linear colour.
    Color,
    /// A material's linear base colour, with its alpha.
    BaseColor,
    /// A material's linear emitted colour.
    Emissive,
    /// What that is multiplied by.
    EmissiveStrength,
    /// Where a texture of a material lies, one of [`super::PLACED_TEXTURES`].
    UvOffset(usize),
    /// See [`Property::UvOffset`].
    UvRotation(usize),
    /// See [`Property::UvOffset`].
    UvScale(usize),
}

/// A curve, and what it moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Index of the file's node, of its light or of its material.
    pub node: usize,
    /// What of it.
    pub property: Property,
    /// How.
    pub curve: Curve,
}

impl Property {
    /// Whether it is a material's.
    pub fn is_paint(self) -> bool {
        use Property::*;
        matches!(self, BaseColor | Emissive | EmissiveStrength | UvOffset(_) | UvRotation(_) | UvScale(_))
    }

    /// Numbers of a value; none where that depends on the node.
    pub fn width(self) -> Option<usize> {
        use Property::*;
        match self {
            Translation | Scale | Color | Emissive => Some(3),
            Rotation | BaseColor => Some(4),
            Visible | Intensity | EmissiveStrength | UvRotation(_) => Some(1),
            UvOffset(_) | UvScale(_) => Some(2),
            Weights => None,
        }
    }
}

/// An animation of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// The file's name for it, or empty.
    pub name: String,
    /// Its curves; where two move the same, the later one does.
    pub channels: Vec<Channel>,
}

/// What is told of a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClipInfo {
    /// The file's name for it, or empty.
    pub name: String,
    /// Seconds from its beginning to its last key.
    pub seconds: f64,
    /// Its curves.
    pub channels: usize,
    /// Whether it is one of those that play.
    pub plays: bool,
}

/// Which clips play.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// None: all is as the file's nodes say.
    #[default]
    None,
    /// Each clip that moves nothing which an earlier one moves: of variants of a walk the first alone, of wheels
    /// with a clip each all.
    Auto,
    /// All; where two move the same, the later one does.
    All,
    /// One, by its name or its number from 0.
    One(String),
}

impl Choice {
    /// From what the operator says: "auto", "all", "none", a name or a number.
    pub fn new(text: &str) -> Self {
        match text {
            "auto" => Choice::Auto,
            "all" => Choice::All,
            "none" => Choice::None,
            one => Choice::One(one.into()),
        }
    }
}

impl Clip {
    /// Seconds from its beginning to its last key.
    pub fn seconds(&self) -> f64 {
        self.channels.iter().map(|channel| channel.curve.end()).fold(0.0, f64::max)
    }

    /// The clip's own time at a time since it began to play: it plays again from its beginning after its end,
    /// and before its beginning as if it had always played.
    pub fn looped(&self, time: f64) -> f64 {
        let seconds = self.seconds();
        if (0.0..=seconds).contains(&time) {
            return time;
        }
        // No length at all: its one pose, always.
        if seconds > 0.0 { time.rem_euclid(seconds) } else { 0.0 }
    }
}

/// The indices of the clips that play; a clause that lists what is there, where there is none of a name.
pub fn choose(clips: &[Clip], choice: &Choice) -> Result<Vec<usize>, String> {
    match choice {
        Choice::None => Ok(Vec::new()),
        Choice::All => Ok((0..clips.len()).collect()),
        Choice::One(wanted) => {
            let names: Vec<&str> = clips.iter().map(|clip| clip.name.as_str()).collect();
            by_name(&names, wanted, "animation").map(|index| vec![index])
        }
        Choice::Auto => {
            let mut moved = HashSet::new();
            let fits = |(index, clip): (usize, &Clip)| {
                let moves: HashSet<_> = clip.channels.iter().map(|c| (c.node, c.property)).collect();
                let fits = moved.is_disjoint(&moves);
                moved.extend(moves.into_iter().filter(|_| fits));
                fits.then_some(index)
            };
            Ok(clips.iter().enumerate().filter_map(fits).collect())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::animation::Interpolation;

    fn clip(name: &str, nodes: &[usize], end: f32) -> Clip {
        let curve = Curve::new(vec![0.0, end], vec![0.0; 6], 3, Interpolation::Linear).unwrap();
        let channel = |&node| Channel { node, property: Property::Translation, curve: curve.clone() };
        Clip { name: name.into(), channels: nodes.iter().map(channel).collect() }
    }

    #[test]
    fn clips_are_chosen_by_name_number_and_what_they_move() {
        let clips = [clip("walk", &[1, 2], 1.0), clip("run", &[2, 3], 1.0), clip("wheel", &[4, 3], 1.0)];
        let chosen = |text| choose(&clips, &Choice::new(text));
        assert_eq!(chosen("none"), Ok(vec![]));
        assert_eq!(chosen("all"), Ok(vec![0, 1, 2]));
        assert_eq!(chosen("run"), Ok(vec![1]));
        assert_eq!(chosen("2"), Ok(vec![2]));
        // What a clip moves that does not play is free for a later one.
        assert_eq!(chosen("auto"), Ok(vec![0, 2]));
        let refusal = chosen("jump").unwrap_err();
        assert!(refusal.contains("no animation \"jump\"") && refusal.contains("0 (\"walk\")"), "{refusal}");
        assert_eq!(choose(&[], &Choice::Auto), Ok(vec![]));
    }

    #[test]
    fn clips_loop_and_show_their_end() {
        let clip = clip("", &[0], 2.0);
        assert_eq!([0.0, 1.5, 2.0, 2.5, 4.5, -0.5].map(|t| clip.looped(t)), [0.0, 1.5, 2.0, 0.5, 0.5, 1.5]);
        let still = super::Clip { channels: Vec::new(), ..clip };
        assert_eq!([0.0, 7.0, -1.0].map(|t| still.looped(t)), [0.0; 3]);
    }
}
