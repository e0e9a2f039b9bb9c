//! What hands and eyes do.

use openxr as xr;

use super::super::actions::Actions;
use super::super::fault::{Called, Outcome};
use super::super::gaze::EyeTracker;
use super::Session;
use crate::headset::Gaze;
use crate::headset::locomotion::Hands;

/// Frames after which an eye tracker that was refused is asked again.
const BLIND: u32 = 90;

impl Session {
    /// What the eye tracker sees. One that is refused is not asked for a while.
    fn look(&mut self, time: xr::Time) -> Outcome<Option<Gaze>> {
        self.blind = self.blind.saturating_sub(1);
        let Some(eyes) = self.eyes.as_ref().filter(|_| self.blind == 0) else { return Ok(None) };
        let seen = eyes.look(&self.session, &self.space, time);
        let seen = self.notes.or_without(seen, "the gaze is not followed until it works again")?;
        if seen.is_none() {
            self.blind = BLIND;
        }
        Ok(seen)
    }

    /// Adds hands that are seen. Trackers that are refused are not asked again in this session.
    fn see(&mut self, time: xr::Time, hands: &mut Hands) -> Outcome<()> {
        let Some(trackers) = &mut self.hands else { return Ok(()) };
        let seen = trackers.see(&self.session, &self.space, time, hands);
        if self.notes.or_without(seen, "only controllers are seen, no hands")?.is_none() {
            self.hands = None;
        }
        Ok(())
    }

    /// What hands and eyes do at a time.
    pub(super) fn actions(&mut self, time: xr::Time) -> Outcome<(Hands, Option<Gaze>)> {
        let sets: Vec<xr::ActiveActionSet> = (self.actions.iter().map(Actions::set))
            .chain(self.eyes.as_ref().map(EyeTracker::set))
            .map(xr::ActiveActionSet::new)
            .collect();
        let unseen = self.eyes.as_ref().map(|_| Gaze::unseen(time.as_nanos()));
        if sets.is_empty() {
            return Ok((Hands::default(), unseen));
        }
        let synced = self.session.sync_actions(&sets).called("xrSyncActions");
        if self.notes.or_without(synced, "hands and eyes are not followed")?.is_none() {
            return Ok((Hands::default(), unseen));
        }
        let hands = self.actions.as_ref().map(|actions| actions.hands(&self.session, &self.space, time));
        let mut hands = hands.unwrap_or_default();
        self.see(time, &mut hands)?;
        if self.actions.as_ref().is_some_and(|actions| actions.menu(&self.session)) {
            self.menu.press();
        }
        Ok((hands, self.look(time)?.or(unseen)))
    }
}
