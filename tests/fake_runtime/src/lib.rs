//! An OpenXR runtime for tests. The OpenXR loader loads it like any other; a script tells what it does, it
//! writes each call into a log, and it holds the application to OpenXR's rules of order.
//!
//! It is both a shared library, which the loader opens, and a Rust library, with which tests write the
//! script ([`script::Script`]), start the application under it ([`Setup`]) and read the log ([`log::Log`]).
//!
//! Broken rules are told in the log ([`log::Log::violations`]) and answered with the error that OpenXR has
//! for them. Images are real: they are made on the application's Vulkan device, and can be read back.

mod abi;
mod calls;
mod check;
mod clock;
pub mod log;
mod nested;
mod objects;
pub mod order;
mod profiles;
mod refusal;
mod runtime;
pub mod script;
mod setup;
mod table;
mod vulkan;
mod world;

pub use runtime::SCRIPT_VARIABLE;
pub use setup::Setup;
pub use table::xrNegotiateLoaderRuntimeInterface;
