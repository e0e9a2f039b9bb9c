//! Where poses come from and where pictures go: one module per kind of headset.

pub mod rift_dk1;
