//! A window for both eyes' pictures, side by side: a headset's panel, or a desktop's window.

mod keys;
mod monitor;
mod pass;
mod warp;
mod window;

pub use keys::Keys;
pub use monitor::{Monitor, panel_among, rift_connectors};
pub use pass::PanelPass;
pub use warp::Warp;
pub use window::{HELP, Moment, Panel, Shot, Wanted};
