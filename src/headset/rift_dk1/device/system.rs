//! The machine's HID devices. The one place that knows hidapi.

use std::ffi::CString;
use std::fs::File;
use std::io::ErrorKind;
use std::time::Duration;

use hidapi::{DeviceInfo, HidApi, HidDevice, HidError};

use super::hid::{Bus, Failure, IDS, Port, READ_BYTES};

/// The machine's HID devices.
#[derive(Default)]
pub struct SystemBus {
    api: Option<HidApi>,
}

impl SystemBus {
    fn api(&mut self) -> Result<&mut HidApi, Failure> {
        let api = match self.api.take() {
            Some(api) => api,
            None => HidApi::new().map_err(unlisted)?,
        };
        Ok(self.api.insert(api))
    }
}

impl Bus for SystemBus {
    fn find(&mut self) -> Result<Option<CString>, Failure> {
        let api = self.api()?;
        api.reset_devices().and_then(|()| api.add_devices(IDS.0, IDS.1)).map_err(unlisted)?;
        let found = api.device_list().find(|info| is_tracker(info));
        Ok(found.map(|info| info.path().to_owned()))
    }

    fn open(&mut self, path: &CString) -> Result<Box<dyn Port>, Failure> {
        match self.api()?.open_path(path) {
            Ok(device) => Ok(Box::new(SystemPort(device))),
            Err(_) if is_denied(path) => Err(Failure::Denied),
            Err(error) => Err(other(error)),
        }
    }
}

/// Other makers use the same numbers, so the name counts too. A device made by uhid has no manufacturer
/// but the product's name.
fn is_tracker(info: &DeviceInfo) -> bool {
    let named = |text: Option<&str>, part: &str| text.is_some_and(|text| text.contains(part));
    let manufacturer = info.manufacturer_string().filter(|text| !text.trim().is_empty());
    match manufacturer {
        Some(_) => named(manufacturer, "Oculus"),
        None => named(info.product_string(), "Tracker DK"),
    }
}

/// hidapi's error is only a text: the system is asked for the reason.
fn is_denied(path: &CString) -> bool {
    let opened = path.to_str().map(|path| File::options().read(true).write(true).open(path));
    matches!(opened, Ok(Err(error)) if error.kind() == ErrorKind::PermissionDenied)
}

/// Nothing is known of trackers then, so that plugging one in again is no help.
fn unlisted(error: HidError) -> Failure {
    Failure::Other(format!(
        "the system does not list its HID devices ({error}); see whether other programs find any, and restart the system"
    ))
}

fn other(error: HidError) -> Failure {
    Failure::Other(error.to_string())
}

struct SystemPort(HidDevice);

impl Port for SystemPort {
    fn read(&mut self, buffer: &mut [u8; READ_BYTES], wait: Duration) -> Result<usize, Failure> {
        let wait = i32::try_from(wait.as_millis()).unwrap_or(i32::MAX);
        self.0.read_timeout(buffer, wait).map_err(other)
    }

    fn feature(&mut self, buffer: &mut [u8]) -> Result<usize, Failure> {
        let got = self.0.get_feature_report(buffer).map_err(other)?;
        Ok(got.min(buffer.len()))
    }

    fn set_feature(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.0.send_feature_report(bytes).map_err(other)
    }
}
