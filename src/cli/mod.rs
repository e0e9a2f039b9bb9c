//! The program's commands: arguments, and what they do.

pub mod tracker;
