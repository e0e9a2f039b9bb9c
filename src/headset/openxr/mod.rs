//! Headsets behind an OpenXR runtime, such as SteamVR or Monado.
//!
//! [`Runtime`] is the runtime with its headset, and makes the one Vulkan device that reconstructs and
//! presents. [`Session`] follows the runtime's states, paces frames and hands out swapchain images to draw
//! into.
//!
//! For `foveate run` (`src/cli/run/present.rs`) the images are the runtime's own, for colours and, where it
//! takes them, for depths (`src/headset/openxr/swapchain.rs`), and the Vulkan device is the one that the
//! runtime wants. xrWaitFrame waits in a thread of its own (`src/headset/openxr/waiter.rs`) for the next
//! frame while this one is traced. What is lost comes back as a [`crate::headset::Fault`], which says whether
//! session or runtime are to be built anew. Frames without a new picture go to `Headset::hold` with the
//! reason, which a board shows (`src/headset/openxr/board.rs`). `Mirror` (`src/headset/panel/mirror.rs`) is
//! looked after between frames and never waits. `Terminal` (`src/cli/run/terminal.rs`) tells which keys were
//! pressed.

mod absent;
mod actions;
mod bindings;
mod board;
mod clock;
mod convert;
mod extras;
mod fault;
mod floor;
mod foveated;
mod gaze;
mod hand_tracking;
mod lifecycle;
mod motion;
mod runtime;
mod session;
mod setup;
mod spectator;
mod swapchain;
mod vulkan;
mod waiter;

pub use clock::FrameClock;
pub use runtime::Runtime;
pub use session::{Controls, Options, Session};
pub use swapchain::Formats;
pub use waiter::settled;
