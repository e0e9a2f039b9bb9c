//! What speed costs in accuracy: settings are swept over poses and gazes, judged against a reference
//! that is rendered here, and reported; some of them in sequences of frames.

pub mod candidate;
mod chart;
pub mod effort;
mod judge;
pub mod merge;
mod page;
mod provenance;
mod reference;
pub mod report;
mod rivals;
pub mod sequence;
mod spread;
mod store;
pub mod sweep;

pub use effort::Effort;
pub use report::{LeftOut, Point, ReferenceError, Report};
pub use store::check_reports;
pub use sweep::{Subject, sweep};
