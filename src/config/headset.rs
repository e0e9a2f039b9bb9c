//! What is done in a headset, and the Rift DK1.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::scene::grab::Grab;

/// The Rift DK1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dk1Config {
    /// Pixels of the undistorted pictures for one of the panel's at the lenses' centres.
    pub resolution: f64,
    /// The folder where what is learned of each tracker is kept; empty for the user's state folder.
    pub memory: PathBuf,
}

impl Default for Dk1Config {
    fn default() -> Self {
        Dk1Config { resolution: 1.0, memory: PathBuf::new() }
    }
}

/// What is done in a headset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadsetConfig {
    /// Move pixels to where they are seen from the newest pose, by their depths, just before they are shown.
    pub late_correction: bool,
    /// How much more than is shown is traced at each side, as a share of the view's width and height, so that
    /// the late correction finds something there.
    pub margin: f64,
    /// Let the sharp region follow the eyes where a tracker tells where they look.
    pub eye_tracking: bool,
    /// Use a sharp inset for each eye where the headset has one.
    pub insets: bool,
    /// Pictures a second to ask the headset for; 0 for its own choice.
    pub refresh_hz: f64,
    /// The hand that points and turns; the other one goes.
    pub hand: Hand,
    /// How controllers move the wearer.
    pub walk: Walk,
    /// Metres per second of a smooth walk.
    pub speed: f64,
    /// How controllers turn the wearer.
    pub turn: Turn,
    /// Degrees of a snap turn, or per second of a smooth one.
    pub turn_degrees: f64,
    /// Draw hands in the scene, or the controllers that they hold, and where the pointing one points while it aims.
    pub show_hands: bool,
    /// What hands can seize in the scene.
    pub grab: Grab,
    /// Let the terminal's keys move the wearer too.
    pub keyboard: bool,
    /// Hand over pictures' depths where the runtime takes them, for its own reprojection.
    pub depth: bool,
    /// Hand over how far what pictures show has moved where the runtime takes that, for pictures of its own in between.
    pub motion_vectors: bool,
}

/// The hand that points and turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hand {
    /// As bindings usually are.
    Right,
    /// Everything is bound to the other hand.
    Left,
}

/// How controllers move the wearer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Walk {
    /// To where the hand points that does.
    Teleport,
    /// As the other hand's stick is pushed.
    Smooth,
    /// Not at all.
    Off,
}

/// How controllers turn the wearer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Turn {
    /// By a fixed angle at each push of the stick in the hand that points.
    Snap,
    /// As long as that stick is pushed.
    Smooth,
    /// Not at all.
    Off,
}

impl Default for HeadsetConfig {
    fn default() -> Self {
        HeadsetConfig {
            late_correction: true,
            margin: 0.0,
            eye_tracking: true,
            insets: true,
            refresh_hz: 0.0,
            hand: Hand::Right,
            walk: Walk::Teleport,
            speed: 2.0,
            turn: Turn::Snap,
            turn_degrees: 30.0,
            show_hands: true,
            grab: Grab::Marked,
            keyboard: true,
            depth: true,
            motion_vectors: true,
        }
    }
}
