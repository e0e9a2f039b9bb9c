//! What is asked of a tracker as a HID device, and of where such devices are plugged in.

use crate::headset::rift_dk1::report::IN_REPORT_BYTES;
use std::ffi::CString;
use std::time::Duration;

/// USB vendor and product.
pub const IDS: (u16, u16) = (0x2833, 0x0001);
/// Bytes of a read: Windows adds two.
pub const READ_BYTES: usize = IN_REPORT_BYTES + 2;

/// Why the device did not do what it was asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The user may not open it.
    #[cfg_attr(not(feature = "dk1"), allow(dead_code))]
    Denied,
    /// Anything else, most often that it was unplugged.
    Other(String),
}

/// An open tracker.
pub trait Port: Send {
    /// Waits for a report; 0 bytes when none came.
    fn read(&mut self, buffer: &mut [u8; READ_BYTES], wait: Duration) -> Result<usize, Failure>;
    /// Asks for a feature report, whose id is the buffer's first byte; the bytes that came.
    fn feature(&mut self, buffer: &mut [u8]) -> Result<usize, Failure>;
    /// Sets a feature report.
    fn set_feature(&mut self, bytes: &[u8]) -> Result<(), Failure>;
}

/// Where trackers are plugged in.
pub trait Bus: Send {
    /// Looks for a tracker; the path to open it by.
    fn find(&mut self) -> Result<Option<CString>, Failure>;
    /// Opens a tracker. It can be opened more than once.
    fn open(&mut self, path: &CString) -> Result<Box<dyn Port>, Failure>;
}

/// The machine's HID devices.
#[cfg(feature = "dk1")]
pub fn system_bus() -> Box<dyn Bus> {
    Box::new(super::system::SystemBus::default())
}

/// Without the feature "dk1" there are none.
#[cfg(not(feature = "dk1"))]
pub fn system_bus() -> Box<dyn Bus> {
    struct NoBus;
    const WHY: &str = "this program was built without the tracker's driver; build it with the feature dk1";
    impl Bus for NoBus {
        fn find(&mut self) -> Result<Option<CString>, Failure> {
            Err(Failure::Other(WHY.to_string()))
        }

        fn open(&mut self, _: &CString) -> Result<Box<dyn Port>, Failure> {
            Err(Failure::Other(WHY.to_string()))
        }
    }
    Box::new(NoBus)
}
