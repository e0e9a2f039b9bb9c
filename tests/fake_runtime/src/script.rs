//! What the runtime does, as a test writes it down. Everything has a default: an empty script is a plain
//! headset that is put on, used, and taken off when the application asks for it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::order::State;

/// The whole script.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Script {
    /// Where the log goes; a line of JSON for each call is appended. Relative to the script's folder.
    pub log: PathBuf,
    /// Which of the known extensions are not listed.
    pub without: Vec<String>,
    /// The highest OpenXR version, 1.`minor`.
    pub minor_version: u16,
    /// Whether the system says that it has an eye tracker.
    pub eye_tracker: bool,
    /// The views of the stereo configuration.
    pub views: Vec<View>,
    /// The four views of the configuration with foveated insets; not offered if empty.
    pub inset_views: Vec<View>,
    /// The size that is recommended for the insets where they follow the eyes; they cannot without.
    pub following_insets: Option<[u32; 2]>,
    /// The width and height that are recommended for images of motion vectors and their depths, pixels, where
    /// the runtime takes them: XR_EXT_frame_synthesis and XR_FB_space_warp are listed only then.
    pub motion_vectors: Option<[u32; 2]>,
    /// Swapchain formats (VkFormat) in the order of preference.
    pub formats: Vec<i64>,
    /// Time between two frames, milliseconds.
    pub period_ms: f64,
    /// How high the LOCAL space is above the floor, metres.
    pub eye_height: f32,
    /// How the head moves.
    pub head: Head,
    /// Where the eyes look from a frame on; before the first, and without any, they are not tracked.
    pub gaze: Vec<Gaze>,
    /// The controllers' interaction profile, where there are any.
    pub profile: Option<String>,
    /// Ends of paths that the runtime does not know though their profiles have them, such as `thumbstick/click`.
    pub without_paths: Vec<String>,
    /// What is pressed and pushed on them.
    pub inputs: Vec<Input>,
    /// Where hands are elsewhere than held out before the head.
    pub hands: Vec<HandMove>,
    /// Hands whose joints are seen, at the same places; the headset sees none without any.
    pub seen_hands: Vec<SeenHand>,
    /// Results that calls give instead of doing their work, counted over the whole run.
    pub faults: Vec<Fault>,
    /// Calls that take their time.
    pub hangs: Vec<Hang>,
    /// What happens in the first session, the second, and so on; then the default.
    pub sessions: Vec<Session>,
}

impl Default for Script {
    fn default() -> Self {
        Script {
            log: "openxr.jsonl".into(),
            without: Vec::new(),
            minor_version: 1,
            eye_tracker: false,
            views: vec![View::eye(-0.0315), View::eye(0.0315)],
            inset_views: Vec::new(),
            following_insets: None,
            motion_vectors: None,
            // RGBA16 UNORM and SFLOAT, RGBA8 and BGRA8 SRGB, the same UNORM, depth; Monado's order.
            formats: vec![91, 97, 43, 50, 37, 44, 126, 124],
            period_ms: 10.0,
            eye_height: 1.6,
            head: Head::default(),
            gaze: Vec::new(),
            profile: None,
            without_paths: Vec::new(),
            inputs: Vec::new(),
            hands: Vec::new(),
            seen_hands: Vec::new(),
            faults: Vec::new(),
            hangs: Vec::new(),
            sessions: Vec::new(),
        }
    }
}

/// One view of the headset.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct View {
    /// Recommended width and height, pixels.
    pub size: [u32; 2],
    /// Angles left, right, up, down in degrees, as XrFovf signs them.
    pub fov: [f32; 4],
    /// Position in the head's space, metres.
    pub position: [f32; 3],
    /// Turn of a canted view in the head's space: yaw, pitch and roll, degrees, in this order.
    pub turn: [f32; 3],
    /// Share of the width and height that the triangle hidden in each corner takes; 0 for no mask.
    pub hidden_corner: f32,
}

impl Default for View {
    fn default() -> Self {
        View {
            size: [96, 80],
            fov: [-45.0, 45.0, 40.0, -40.0],
            position: [0.0; 3],
            turn: [0.0; 3],
            hidden_corner: 0.0,
        }
    }
}

impl View {
    /// An eye that stands aside of the nose by some metres.
    pub fn eye(x: f32) -> Self {
        View { position: [x, 0.0, 0.0], ..View::default() }
    }
}

/// A head that moves evenly.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Head {
    /// Where it is in the LOCAL space when the session is created, metres.
    pub position: [f32; 3],
    /// Metres per second.
    pub velocity: [f32; 3],
    /// Degrees per second, to the left.
    pub yaw_rate: f32,
    /// How much farther the head turns out to be each time that a frame's views are asked for once more:
    /// degrees to the left, since predictions get better.
    pub learned_yaw: f32,
    /// The same in metres.
    pub learned_shift: [f32; 3],
}

/// Where both eyes look, from a frame on.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gaze {
    /// The frame, counted by xrWaitFrame in the session from 1.
    pub frame: u64,
    /// Degrees to the left.
    pub yaw: f32,
    /// Degrees up.
    pub pitch: f32,
    /// The eyes are lost: closed, or not seen by the tracker.
    pub lost: bool,
}

/// A component of a controller that is used for some frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Input {
    /// Such as `/user/hand/left/input/thumbstick`, or `/user/hand/left/input/x/click`.
    pub path: String,
    /// The first frame.
    pub from: u64,
    /// The last frame.
    pub to: u64,
    /// X and Y; a trigger or a button is X alone.
    pub value: [f32; 2],
}

/// Where a hand is from a frame on.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HandMove {
    /// The frame, counted by xrWaitFrame in the session from 1.
    pub frame: u64,
    /// It is the left one.
    pub left: bool,
    /// From where it is held out, in the head's space, metres.
    pub shift: [f32; 3],
    /// It is not seen.
    pub lost: bool,
}

/// A hand whose joints are seen from a frame on.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SeenHand {
    /// The frame, counted by xrWaitFrame in the session from 1.
    pub frame: u64,
    /// It is the left one.
    pub left: bool,
    /// Its fingers are closed.
    pub closed: bool,
    /// It is no longer seen.
    pub lost: bool,
}

/// A result that a call gives instead of doing its work.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fault {
    /// Such as `xrAcquireSwapchainImage`.
    pub call: String,
    /// The first of these calls that fails, counted from 1.
    pub from: u64,
    /// The last that fails; 0 for only the first.
    pub to: u64,
    /// Such as `ERROR_SESSION_LOST`, after which the session is lost for all calls (and so with
    /// `ERROR_INSTANCE_LOST`). With `FRAME_DISCARDED`, `SESSION_LOSS_PENDING` and `SESSION_NOT_FOCUSED` the call
    /// does its work all the same.
    pub result: String,
}

/// A call that takes its time before it does its work.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Hang {
    /// Such as `xrLocateViews`.
    pub call: String,
    /// The first of these calls that hangs, counted from 1 over the whole run.
    pub from: u64,
    /// The last; 0 for only the first.
    pub to: u64,
    /// For so long, milliseconds.
    pub ms: u64,
}

/// What happens in one session.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Session {
    /// When the session's state changes. A request to exit goes the shortest way and needs no step.
    pub steps: Vec<Step>,
    /// Frames that are not as usual.
    pub frames: Vec<FrameRule>,
    /// Results that calls give, counted since the session was created.
    pub faults: Vec<Fault>,
    /// Events besides changes of state.
    pub events: Vec<Event>,
    /// Frames (counted by xrEndFrame from 1) whose pictures are written out.
    pub dumps: Vec<Dump>,
}

impl Default for Session {
    fn default() -> Self {
        use State::*;
        let step = |at, go: &[State]| Step { at, go: go.to_vec() };
        Session {
            steps: vec![
                step(When::Created, &[Idle, Ready]),
                step(When::Frame(1), &[Synchronized, Visible, Focused]),
                step(When::Ended(1), &[Idle, Exiting]),
            ],
            frames: Vec::new(),
            faults: Vec::new(),
            events: Vec::new(),
            dumps: Vec::new(),
        }
    }
}

/// States that follow each other at one moment.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When.
    pub at: When,
    /// The states, in order.
    pub go: Vec<State>,
}

/// A moment in a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum When {
    /// xrCreateSession.
    Created,
    /// xrBeginSession, counted from 1.
    Begun(u64),
    /// After xrWaitFrame has decided about its frame, counted from 1.
    Frame(u64),
    /// xrEndSession, counted from 1.
    Ended(u64),
}

/// How some frames differ.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FrameRule {
    /// The first frame, counted by xrWaitFrame from 1.
    pub from: u64,
    /// The last frame; 0 for only the first.
    pub to: u64,
    /// In place of what the session's state says.
    pub should_render: Option<bool>,
    /// How much longer xrWaitFrame takes, milliseconds.
    pub wait_ms: u64,
    /// xrWaitFrame returns at once, as that of some runtimes does for frames that nobody sees.
    pub at_once: bool,
    /// Added to the predicted display time, milliseconds.
    pub offset_ms: f64,
    /// In place of the predicted display time, nanoseconds.
    pub display_time: Option<i64>,
    /// In place of the script's time between two frames, milliseconds.
    pub period_ms: Option<f64>,
    /// In place of the predicted display period, nanoseconds.
    pub display_period: Option<i64>,
    /// Where the head is is not known: positions of views are told to be invalid, and are not numbers.
    pub unplaced: bool,
    /// Nor is how it is turned: orientations have no length.
    pub unturned: bool,
}

/// An event at a frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// The frame, counted by xrWaitFrame from 1.
    pub frame: u64,
    /// What happens.
    pub event: EventKind,
}

/// What is told by an event.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The instance will be lost.
    InstanceLossPending,
    /// Another visibility mask holds for a view: its `hidden_corner` from now on.
    VisibilityMask {
        /// The view's index in the configuration that runs.
        view: u32,
        /// See [`View::hidden_corner`].
        hidden_corner: f32,
    },
    /// Another refresh rate, hertz.
    RefreshRate(f32),
    /// The wearer has the runtime make where the head is, and the way it faces, the LOCAL space's origin.
    Recentred,
    /// Another size is recommended for a view from now on, which no event tells.
    ViewSize {
        /// The view's index in the stereo configuration.
        view: usize,
        /// See [`View::size`].
        size: [u32; 2],
    },
}

/// A frame whose pictures are written out.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dump {
    /// The frame, counted by xrEndFrame from 1.
    pub frame: u64,
    /// The folder; `view0.raw` and so on hold the rows of each sub-image, in its format, and `depth0.raw` and
    /// so on those of the depths that are told beside them, `motion0.raw` and `motion_depth0.raw` and so on
    /// those of motion vectors and their depths, `quad0.raw` and so on those of flat pictures.
    pub folder: PathBuf,
}

/// Whether a number is in a range whose end may be left out.
pub(crate) fn within(number: u64, from: u64, to: u64) -> bool {
    from <= number && number <= to.max(from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_are_read_back() {
        let mut script = Script::default();
        script.sessions.push(Session::default());
        script.sessions[0].events.push(Event { frame: 3, event: EventKind::RefreshRate(72.0) });
        let text = serde_json::to_string(&script).unwrap();
        let back: Script = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
        assert!(serde_json::from_str::<Script>("{}").is_ok());
        assert!(serde_json::from_str::<Script>(r#"{ "wiews": [] }"#).is_err());
    }

    #[test]
    fn ranges_may_be_a_single_number() {
        assert!(
            within(3, 3, 0) && !within(4, 3, 0) && !within(2, 3, 0) && within(5, 3, 5) && !within(6, 3, 5)
        );
    }
}
