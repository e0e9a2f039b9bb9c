//! Headsets behind an OpenXR runtime, such as SteamVR or Monado.
//!
//! [`Runtime`] is the runtime with its headset, and makes the one Vulkan device that reconstructs and
//! presents. [`Session`] follows the runtime's states, paces frames and hands out swapchain images to
//! draw into. What is lost on the way is a [`crate::headset::Fault`], which says what has to be built anew.

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
mod lifecycle;
mod runtime;
mod session;
mod setup;
mod spectator;
mod swapchain;
mod vulkan;
mod waiter;

pub use clock::FrameClock;
pub use runtime::Runtime;
pub use session::{Options, Session};
pub use swapchain::Formats;
pub use waiter::settled;
