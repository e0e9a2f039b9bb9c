//! Descriptors by which one driver hands memory to another. Only Unix has them; elsewhere no driver lists that it
//! exports or imports any, so the stand-ins are never made.
#![allow(unsafe_code)]

#[cfg(unix)]
pub use std::os::fd::{FromRawFd, IntoRawFd, OwnedFd};

#[cfg(not(unix))]
pub use elsewhere::{FromRawFd, IntoRawFd, OwnedFd};

#[cfg(not(unix))]
mod elsewhere {
    /// Stands for a descriptor.
    #[derive(Debug)]
    pub struct OwnedFd(i32);

    /// As the trait of `std::os::fd`.
    pub trait FromRawFd {
        /// Owns a descriptor.
        ///
        /// # Safety
        /// It must be open, and nobody else's.
        unsafe fn from_raw_fd(fd: i32) -> Self;
    }

    /// As the trait of `std::os::fd`.
    pub trait IntoRawFd {
        /// Gives the descriptor up.
        fn into_raw_fd(self) -> i32;
    }

    impl FromRawFd for OwnedFd {
        unsafe fn from_raw_fd(fd: i32) -> Self {
            OwnedFd(fd)
        }
    }

    impl IntoRawFd for OwnedFd {
        fn into_raw_fd(self) -> i32 {
            self.0
        }
    }
}
