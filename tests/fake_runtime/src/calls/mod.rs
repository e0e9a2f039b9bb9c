//! What each call does.

pub(crate) mod action;
pub(crate) mod action_state;
pub(crate) mod configuration;
pub(crate) mod event;
pub(crate) mod extension;
pub(crate) mod frame;
pub(crate) mod graphics;
pub(crate) mod hand_tracking;
pub(crate) mod instance;
pub(crate) mod layer;
pub(crate) mod motion;
pub(crate) mod session;
pub(crate) mod space;
pub(crate) mod swapchain;
