//! Pictures on the host, how far two of them are apart, and what a handful of numbers says.

pub mod display;
mod filter;
pub mod flip;
pub mod foveated;
pub mod metric;
pub mod pairs;
pub mod picture;
pub mod stats;
pub mod temporal;
pub mod uncovered;

pub use display::Display;
pub use metric::{Comparison, compare};
pub use picture::Picture;
