//! A window for both eyes' pictures, side by side: a headset's panel, or a desktop's window.

mod keys;
mod lens_warp;
mod monitor;
mod pass;
mod window;

pub use keys::Keys;
pub use lens_warp::LensWarp;
pub use monitor::{Monitor, panel_among, rift_connectors};
pub use pass::PanelPass;
pub use window::{HELP, Look, Moment, Panel, PanelFrame, PanelWindow, Wanted};
