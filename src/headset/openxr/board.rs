//! A board with a message, as a layer of its own: what the wearer sees while there are no new pictures.
//!
//! It hangs ahead of where the head was as the message came, upright, and stays there while the head turns; it
//! follows a head that has turned away. Where nothing is known of the head, it moves with it.

use glam::{DQuat, DVec3};
use openxr as xr;

use super::fault::{Called, Notes, Outcome};
use super::swapchain::{Formats, ViewImages};
use crate::gpu::vulkan::{Commands, Context, Encoding, Format};
use crate::headset::EyeView;
use crate::headset::message::{Message, MessagePass, SIZE};
use crate::math::pose::Pose;

/// How far away the board is, and how wide, in metres.
const DISTANCE: f64 = 1.75;
const WIDTH: f32 = 1.28;
/// Cosine of the angle by which a head may turn away from the board before it follows: 40 degrees.
const ASIDE: f64 = 0.766;

/// The board, once there was something to be told.
pub struct Notices {
    board: Option<Board>,
    /// The runtime has refused it.
    refused: bool,
    context: Context,
}

struct Board {
    // In the order in which they end: commands let go of the images' targets first.
    commands: Commands,
    pass: MessagePass,
    images: ViewImages,
    /// What stands on it.
    says: String,
    /// Where it hangs in the tracked space.
    place: Option<Pose>,
    /// The head's own space, for a board that moves with it.
    head: xr::Space,
}

impl Notices {
    /// Nothing yet.
    pub fn new(context: &Context) -> Self {
        Notices { board: None, refused: false, context: context.clone() }
    }

    /// Has a text stand on the board, which is made for the first one; `eyes` are where they were last, if that is
    /// known. False where there is no board, or nothing on it yet.
    ///
    /// # Errors
    /// Where something is lost that has to be built anew.
    pub fn write(
        &mut self,
        session: &xr::Session<xr::Vulkan>,
        format: Format,
        text: &str,
        eyes: &[EyeView],
        notes: &mut Notes,
    ) -> Outcome<bool> {
        if self.board.is_none() && !self.refused {
            let made = Board::new(session, &self.context, format);
            self.board = notes.or_without(made, "the wearer sees no messages")?;
            self.refused = self.board.is_none();
        }
        self.board.as_mut().map_or(Ok(false), |board| board.write(text, eyes))
    }

    /// The board, where something stands on it.
    pub fn layer<'a>(&'a self, space: &'a xr::Space) -> Option<xr::CompositionLayerQuad<'a, xr::Vulkan>> {
        let board = self.board.as_ref()?;
        let ahead = Pose { position: DVec3::NEG_Z * DISTANCE, ..Pose::IDENTITY };
        Some(match board.place {
            Some(place) => board.images.layer_quad(space, place, WIDTH),
            None => board.images.layer_quad(&board.head, ahead, WIDTH),
        })
    }

    /// There is no board from now on.
    pub fn refuse(&mut self) {
        (self.board, self.refused) = (None, true);
    }
}

impl Board {
    fn new(session: &xr::Session<xr::Vulkan>, context: &Context, color: Format) -> Outcome<Board> {
        let images = ViewImages::new(session, context, Formats { color, depth: None, copied: false }, SIZE)?;
        let head = session.create_reference_space(xr::ReferenceSpaceType::VIEW, xr::Posef::IDENTITY);
        Ok(Board {
            commands: Commands::new(context)?,
            pass: MessagePass::new(context, color)?,
            images,
            says: String::new(),
            place: None,
            head: head.called("xrCreateReferenceSpace")?,
        })
    }

    fn write(&mut self, text: &str, eyes: &[EyeView]) -> Outcome<bool> {
        self.place = head(eyes).map(|head| placed(self.place, &head));
        if self.says == text {
            return Ok(true);
        }
        // What the compositor keeps is not waited for: then the last message stays.
        let Some(target) = self.images.acquire_within(std::time::Duration::ZERO)? else {
            return Ok(!self.says.is_empty());
        };
        self.commands.begin()?;
        // Runtimes take what they are given for linear light, or decode it by themselves.
        let target = (&target, Encoding::DisplayLinear);
        self.pass.record(&mut self.commands, &Message::new(text, SIZE), target, [0, 0])?;
        self.commands.submit()?;
        self.commands.wait()?;
        self.images.release()?;
        self.says = text.to_string();
        Ok(true)
    }
}

/// The head: between the first two eyes, turned as the first.
fn head(eyes: &[EyeView]) -> Option<Pose> {
    let [left, right] = [eyes.first()?, eyes.get(1).or(eyes.first())?].map(|eye| eye.space_from_eye);
    Some(Pose { position: (left.position + right.position) * 0.5, ..left })
}

/// Where the board hangs for a head: where it did, or upright ahead of the head where that is out of sight.
fn placed(before: Option<Pose>, head: &Pose) -> Pose {
    let ahead = head.rotation * DVec3::NEG_Z;
    let sees = |place: &Pose| {
        let there = place.position - head.position;
        (there.length() - DISTANCE).abs() < DISTANCE / 2.0 && there.normalize_or_zero().dot(ahead) > ASIDE
    };
    before.filter(sees).unwrap_or_else(|| {
        // Whoever looks straight up or down faces where their brow or chin does.
        let level = DVec3::new(ahead.x, 0.0, ahead.z).try_normalize();
        let level = level.filter(|_| ahead.y.abs() < 0.99);
        let facing = level.unwrap_or_else(|| {
            let up = head.rotation * DVec3::Y * -ahead.y.signum();
            DVec3::new(up.x, 0.0, up.z).normalize_or(DVec3::NEG_Z)
        });
        let rotation = DQuat::from_rotation_y((-facing.x).atan2(-facing.z));
        Pose::new(rotation, head.position + facing * DISTANCE)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_board_hangs_upright_ahead_and_stays_until_it_is_out_of_sight() {
        let at = DVec3::new(1.0, 1.6, -2.0);
        let head =
            |yaw: f64, pitch: f64| Pose::new(DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch), at);
        for (yaw, pitch) in [(0.0, 0.0), (1.0, 0.5), (-2.5, -0.7), (0.4, 1.5), (0.4, -1.5)] {
            let place = placed(None, &head(yaw, pitch));
            let facing = DQuat::from_rotation_y(yaw) * DVec3::NEG_Z;
            assert!((place.position - at - facing * DISTANCE).length() < 1e-6, "{yaw} {pitch}: {place:?}");
            // Its front, +Z, is towards the head, and its top is up.
            assert!((place.rotation * DVec3::Z + facing).length() < 1e-6, "{yaw} {pitch}");
            assert!((place.rotation * DVec3::Y - DVec3::Y).length() < 1e-6, "{yaw} {pitch}");
        }
        let first = placed(None, &head(0.0, 0.0));
        assert_eq!(placed(Some(first), &head(0.6, 0.1)), first);
        assert_ne!(placed(Some(first), &head(0.8, 0.0)), first);
        let gone = Pose { position: at + DVec3::X * 9.0, ..head(0.0, 0.0) };
        assert_ne!(placed(Some(first), &gone), first);
    }
}
