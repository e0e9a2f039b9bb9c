//! The keep-alive's own thread: neither rendering nor a stalled reader can starve it.

use super::configure::keep_alive;
use super::hid::Port;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// The time between two commands; the tracker goes quiet after ten seconds.
pub const PERIOD: Duration = Duration::from_secs(3);

/// Sends the keep-alive until it is dropped, or the device is gone.
pub struct KeepAliveThread {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl KeepAliveThread {
    /// Starts the thread with a handle of its own.
    pub fn start(mut port: Box<dyn Port>, period: Duration) -> std::io::Result<Self> {
        let (stop, stopped) = channel::<()>();
        let thread = std::thread::Builder::new().name("dk1-keep-alive".to_string()).spawn(move || {
            while stopped.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                if port.set_feature(&keep_alive().encode()).is_err() {
                    return;
                }
            }
        })?;
        Ok(KeepAliveThread { stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for KeepAliveThread {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            // The thread does not panic, and there is nobody to tell.
            let _ = thread.join();
        }
    }
}
