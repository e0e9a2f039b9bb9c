//! A window for both eyes' pictures, side by side: a headset's panel, or a desktop's window.

#[cfg(feature = "window")]
mod keys;
mod lens_warp;
#[cfg(feature = "window")]
mod mirror;
mod monitor;
mod pass;
#[cfg(feature = "window")]
mod window;

#[cfg(feature = "window")]
pub use keys::Keys;
pub use lens_warp::LensWarp;
#[cfg(feature = "window")]
pub use mirror::Mirror;
pub use monitor::{CONNECTORS, Monitor, panel_among, rift_connectors};
pub use pass::PanelPass;
#[cfg(feature = "window")]
pub use window::{HELP, Look, Moment, Panel, PanelFrame, PanelWindow, Wanted};
