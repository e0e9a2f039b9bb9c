//! Frames without a device: the last picture is held until one comes back.

use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::waiting;

/// How long a picture is held.
const LONGEST: Duration = Duration::from_secs(60);

/// What is told then.
pub const TOLD: &str = "no device is left to trace with; the last picture is held until one comes back";

/// Since when no device has traced.
#[derive(Debug, Default)]
pub struct Absence(Option<Instant>);

impl Absence {
    /// How long a frame waits for a device itself, where pictures are held: a window has keys that want to be heard.
    pub const COMEBACK: Duration = Duration::from_millis(100);

    /// Takes a frame's failure where it may pass: what to tell, the first time.
    ///
    /// # Errors
    /// That failure, where it is another one or lasts.
    pub fn bear(&mut self, error: Error, now: Instant) -> Result<Option<&'static str>> {
        if !matches!(error, Error::NoDevice { .. }) {
            return Err(error);
        }
        let new = self.0.is_none();
        if now - *self.0.get_or_insert(now) > LONGEST {
            waiting::give_up();
            return Err(error);
        }
        Ok(new.then_some(TOLD))
    }

    /// A frame was made: what to tell, if there was none before.
    pub fn end(&mut self) -> Option<&'static str> {
        self.0.take().map(|_| "a device traces again")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_held_for_a_minute_and_only_without_devices() {
        let gone = || Error::NoDevice { kind: "OpenCL", problem: "none is left".into() };
        let mut absence = Absence::default();
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        assert!(absence.bear(gone(), at(0)).unwrap().is_some());
        assert_eq!(absence.bear(gone(), at(59)).unwrap(), None);
        assert!(absence.end().is_some() && absence.end().is_none());
        assert!(absence.bear(gone(), at(70)).unwrap().is_some());
        assert!(absence.bear(gone(), at(131)).is_err());
        let other = Error::Device { device: "it".into(), problem: "is out of paper".into() };
        assert!(Absence::default().bear(other, start).is_err());
    }
}
