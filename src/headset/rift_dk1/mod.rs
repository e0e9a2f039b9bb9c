//! The Oculus Rift DK1's tracker: its bytes, its clock, the orientation, and the device itself.
//!
//! Body frame: X right, Y up, Z back, fixed to the headset. World frame: the same when the wearer
//! looks ahead, Y against gravity. Orientations take the body frame to the world frame.

pub mod clock;
pub mod device;
pub mod fusion;
pub mod optics;
pub mod recording;
pub mod report;
pub mod simulate;
pub mod takeover;
