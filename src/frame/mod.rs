//! One frame after the other.

pub mod log;
