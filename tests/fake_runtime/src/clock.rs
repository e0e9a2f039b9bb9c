//! The system's monotonic clock, by the extension that OpenXR has for it: each system has its own.
#![allow(unsafe_code)]

#[cfg(unix)]
mod system {
    /// What the clock reads.
    pub type Reading = libc::timespec;

    pub const EXTENSION: &str = "XR_KHR_convert_timespec_time";

    pub fn to_nanos(reading: Reading) -> i64 {
        reading.tv_sec * 1_000_000_000 + reading.tv_nsec
    }

    pub fn from_nanos(nanos: i64) -> Reading {
        Reading { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 }
    }

    pub fn read() -> Reading {
        let mut time = from_nanos(0);
        // SAFETY: the place is valid; this clock exists everywhere.
        unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut time) };
        time
    }
}

#[cfg(windows)]
mod system {
    use std::sync::LazyLock;

    /// What the clock reads: ticks of the performance counter.
    pub type Reading = openxr_sys::platform::LARGE_INTEGER;

    pub const EXTENSION: &str = "XR_KHR_win32_convert_performance_counter_time";

    unsafe extern "system" {
        fn QueryPerformanceCounter(ticks: *mut i64) -> i32;
        fn QueryPerformanceFrequency(ticks: *mut i64) -> i32;
    }

    /// Ticks of a second, which stay the same.
    static FREQUENCY: LazyLock<i64> = LazyLock::new(|| {
        let mut ticks = 0;
        // SAFETY: the place is valid.
        unsafe { QueryPerformanceFrequency(&raw mut ticks) };
        ticks.max(1)
    });

    fn scaled(value: i64, from: i64, to: i64) -> i64 {
        (i128::from(value) * i128::from(to) / i128::from(from)) as i64
    }

    pub fn to_nanos(reading: Reading) -> i64 {
        scaled(reading, *FREQUENCY, 1_000_000_000)
    }

    pub fn from_nanos(nanos: i64) -> Reading {
        scaled(nanos, 1_000_000_000, *FREQUENCY)
    }

    pub fn read() -> Reading {
        let mut ticks = 0;
        // SAFETY: the place is valid.
        unsafe { QueryPerformanceCounter(&raw mut ticks) };
        ticks
    }
}

pub(crate) use system::{EXTENSION, Reading, from_nanos, to_nanos};

/// Nanoseconds now.
pub(crate) fn now() -> i64 {
    to_nanos(system::read())
}
