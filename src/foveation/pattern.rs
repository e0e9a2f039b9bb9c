//! Where the samples are.
