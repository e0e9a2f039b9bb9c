//! Where the eye looks, how sharp it sees there, and which pixels are sampled for it.

pub mod law;
pub mod pattern;
