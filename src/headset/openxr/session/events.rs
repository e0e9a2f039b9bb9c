//! What the runtime tells of itself, and the states that a session goes through.

use std::time::Duration;

use openxr as xr;

use super::super::extras;
use super::super::fault::{Called, Fault, Outcome};
use super::super::lifecycle::Duty;
use super::{EXIT_PATIENCE, Session};
use crate::headset::Headset;

impl Session {
    /// Handles what the runtime tells.
    pub(super) fn poll(&mut self) -> Outcome<()> {
        let instance = self.instance.clone();
        let mut buffer = xr::EventDataBuffer::new();
        while let Some(event) = instance.poll_event(&mut buffer).called("xrPollEvent")? {
            match event {
                xr::Event::SessionStateChanged(change) => self.enter(change.state())?,
                xr::Event::InstanceLossPending(_) => {
                    return Err(Fault::Instance("the OpenXR runtime is about to end".into()));
                }
                xr::Event::ReferenceSpaceChangePending(_) => self.floor.forget(),
                xr::Event::VisibilityMaskChangedKHR(_) => {
                    self.hidden = extras::hidden(&self.session, self.views, self.images.len());
                    self.masks += 1;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn enter(&mut self, state: xr::SessionState) -> Outcome<()> {
        self.state = state;
        match self.life.enter(state) {
            Duty::None => {}
            Duty::Begin => {
                self.clock.pause();
                self.session.begin(self.views).called("xrBeginSession")?;
            }
            Duty::End => {
                self.finish_frames()?;
                self.session.end().called("xrEndSession")?;
            }
            Duty::Exit => self.ended = true,
            Duty::Rebuild => return Err(Fault::Session("the OpenXR session is about to be lost".into())),
        }
        Ok(())
    }

    /// Takes the frame that is still waited for, so that every wait has its begin and end.
    fn finish_frames(&mut self) -> Outcome<()> {
        if self.waiter.asked() {
            self.waiter.ask(Duration::ZERO);
        }
        if self.waiter.asked()
            && let Some(state) = self.waiter.take(EXIT_PATIENCE)?
        {
            let frame = self.begin(state)?;
            self.end(&frame, None)?;
        }
        Ok(())
    }
}
