//! What a frame is shown on, and where poses and gazes come from.

pub mod deadline;
pub mod locomotion;
pub mod mock;
pub mod mouse_look;
pub mod openxr;
pub mod panel;
pub mod rift_dk1;
