//! USB over IP, as the kernel's virtual host controller speaks it: one device at the other end of a socket.
//! The layout is that of the kernel's Documentation/usb/usbip_protocol.rst; all numbers are big-endian.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::dk1::Dk1;

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
const HEADER: usize = 48;
/// What a device answers that refuses a request, and what an unlinked request ends with.
const EPIPE: i32 = -32;
const ECONNRESET: i32 = -104;
/// Full speed, in the kernel's numbers.
const FULL_SPEED: u32 = 2;
const PORT: u32 = 0;

/// What the host asks of endpoint 0.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    pub kind: u8,
    pub request: u8,
    pub value: u16,
    pub length: u16,
}

/// A device that is plugged in; dropping it unplugs it.
pub struct Plugged {
    socket: UnixStream,
    pub device: Arc<Mutex<Dk1>>,
}

struct Link {
    socket: UnixStream,
    /// Requests for a report that wait for one.
    waiting: VecDeque<u32>,
}

impl Plugged {
    /// Plugs a device into the first port of the virtual controller.
    pub fn plug(device: Dk1) -> Self {
        let (kernels, socket) = UnixStream::pair().unwrap();
        let line = format!("{PORT} {} {} {FULL_SPEED}", kernels.as_raw_fd(), 0x10002);
        std::fs::write("/sys/devices/platform/vhci_hcd.0/attach", line).unwrap();
        let device = Arc::new(Mutex::new(device));
        let link = Link { socket: socket.try_clone().unwrap(), waiting: VecDeque::new() };
        let link = Arc::new(Mutex::new(link));
        let (from, shared, answers) = (socket.try_clone().unwrap(), device.clone(), link.clone());
        std::thread::spawn(move || answer(from, &shared, &answers));
        let shared = device.clone();
        std::thread::spawn(move || {
            while send_due(&shared, &link).is_some() {
                std::thread::sleep(Duration::from_micros(500));
            }
        });
        Plugged { socket, device }
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        std::fs::write("/sys/devices/platform/vhci_hcd.0/detach", format!("{PORT}")).unwrap();
        // The kernel may have closed it already.
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
        self.device.lock().unwrap().unplugged = true;
    }
}

/// Answers the kernel until the socket is closed.
fn answer(mut from: UnixStream, device: &Mutex<Dk1>, link: &Mutex<Link>) {
    let mut header = [0; HEADER];
    while from.read_exact(&mut header).is_ok() {
        let word = |at: usize| u32::from_be_bytes(header[at..at + 4].try_into().unwrap());
        let (command, number, inwards, endpoint) = (word(0), word(4), word(12) == 1, word(16));
        if command == UNLINK {
            let unlinked = word(20);
            let mut link = link.lock().unwrap();
            let before = link.waiting.len();
            link.waiting.retain(|&waiting| waiting != unlinked);
            let status = if link.waiting.len() < before { ECONNRESET } else { 0 };
            link.write(UNLINKED, number, status, 0, &[]);
            continue;
        }
        assert_eq!(command, SUBMIT);
        let mut data = vec![0; if inwards { 0 } else { word(24) as usize }];
        if from.read_exact(&mut data).is_err() {
            return;
        }
        if endpoint == 1 {
            link.lock().unwrap().waiting.push_back(number);
            continue;
        }
        let pair = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
        let setup = Setup { kind: header[40], request: header[41], value: pair(42), length: pair(46) };
        let answer = device.lock().unwrap().control(setup, &data);
        let mut link = link.lock().unwrap();
        match answer {
            Some(bytes) if inwards => {
                let bytes = &bytes[..bytes.len().min(setup.length.into())];
                link.write(SUBMITTED, number, 0, bytes.len(), bytes);
            }
            Some(_) => link.write(SUBMITTED, number, 0, data.len(), &[]),
            None => link.write(SUBMITTED, number, EPIPE, 0, &[]),
        }
    }
}

/// Sends a report if one is due and wanted; `None` once the device is unplugged.
fn send_due(device: &Mutex<Dk1>, link: &Mutex<Link>) -> Option<()> {
    let mut device = device.lock().unwrap();
    if device.unplugged {
        return None;
    }
    let mut link = link.lock().unwrap();
    if let Some(&number) = link.waiting.front()
        && let Some(report) = device.due()
    {
        link.waiting.pop_front();
        link.write(SUBMITTED, number, 0, report.len(), &report);
    }
    Some(())
}

impl Link {
    fn write(&mut self, command: u32, number: u32, status: i32, length: usize, data: &[u8]) {
        let mut bytes = vec![0; HEADER];
        bytes[0..4].copy_from_slice(&command.to_be_bytes());
        bytes[4..8].copy_from_slice(&number.to_be_bytes());
        bytes[20..24].copy_from_slice(&status.to_be_bytes());
        bytes[24..28].copy_from_slice(&(length as u32).to_be_bytes());
        bytes.extend(data);
        // The kernel may have hung up; the thread that reads finds out.
        let _ = self.socket.write_all(&bytes);
    }
}
