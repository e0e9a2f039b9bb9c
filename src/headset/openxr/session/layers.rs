//! What frames end with: the views' pictures, the board with a message, or nothing.

use std::time::Duration;

use openxr as xr;

use super::super::fault::{Called, Outcome};
use super::{Session, ViewImages};
use crate::gpu::vulkan::Target;
use crate::headset::EyeView;

/// How long the last picture may stay before the wearer is told why.
const QUIET: Duration = Duration::from_secs(1);

/// How xrEndFrame refuses a layer that it could do without.
const REFUSALS: [xr::sys::Result; 6] = [
    xr::sys::Result::ERROR_LAYER_INVALID,
    xr::sys::Result::ERROR_LAYER_LIMIT_EXCEEDED,
    xr::sys::Result::ERROR_VALIDATION_FAILURE,
    xr::sys::Result::ERROR_SWAPCHAIN_RECT_INVALID,
    xr::sys::Result::ERROR_POSE_INVALID,
    xr::sys::Result::ERROR_FEATURE_UNSUPPORTED,
];

impl Session {
    /// Has the next picture of the first view kept for spectators.
    pub fn show_spectators(&mut self) {
        if let Some(spectator) = &mut self.spectator {
            spectator.wanted = true;
        }
    }

    /// The newest picture that was kept for spectators, once each: of format R8G8B8A8, encoded as sRGB.
    pub fn spectated(&mut self) -> Option<&Target> {
        self.spectator.as_mut()?.take()
    }

    /// Keeps what was drawn for the first view, before it is handed over, where spectators wait for it.
    pub(super) fn spectate(&mut self) -> Outcome<()> {
        let Some(spectator) = self.spectator.as_mut().filter(|spectator| spectator.wanted) else {
            return Ok(());
        };
        let picture = self.images.first().and_then(ViewImages::target);
        Ok(picture.map_or(Ok(()), |picture| spectator.keep(picture))?)
    }

    /// Ends the frame with the last picture, if there is one, and tells the wearer why there is no new one: at once
    /// where there is none at all, else after a while.
    pub(super) fn submit_last(&mut self, why: Option<&str>) -> Outcome<()> {
        let shown = (!self.shown.is_empty()).then(|| self.shown.clone());
        let old = self.newest.is_none_or(|newest| newest.elapsed() > QUIET);
        let tells = (shown.is_none() || old) && {
            let why = why.unwrap_or_else(|| self.why_dark());
            self.notices.write(&self.session, self.formats.color, why, &self.located, &mut self.notes)?
        };
        self.submit(shown.as_deref(), tells)
    }

    /// Ends the frame with the images that were released last, as views saw them, and with the board.
    pub(super) fn submit(&mut self, shown: Option<&[EyeView]>, board: bool) -> Outcome<()> {
        let depths: Vec<_> = self.images.iter().map(ViewImages::depth_info).collect();
        let images = self.images.iter().zip(&depths);
        let views: Vec<_> = shown
            .unwrap_or_default()
            .iter()
            .zip(images)
            .map(|(eye, (images, depth))| images.layer_view(eye, depth.as_ref()))
            .collect();
        let layer = xr::CompositionLayerProjection::new().space(&self.space).views(&views);
        let quad = if board { self.notices.layer(&self.space) } else { None };
        let mut layers: Vec<&xr::CompositionLayerBase<xr::Vulkan>> = Vec::new();
        layers.extend(shown.map(|_| &*layer));
        layers.extend(quad.iter().map(|quad| &**quad));
        let ended = self.stream.end(self.display_time, self.blend, &layers);
        let Err(code) = ended else { return Ok(()) };
        if quad.is_none() || !REFUSALS.contains(&code) {
            return ended.called("xrEndFrame");
        }
        layers.pop();
        let again = self.stream.end(self.display_time, self.blend, &layers);
        self.notices.refuse();
        self.notes.note(format!("xrEndFrame refuses the board with messages ({code:?}): there is none"));
        // Runtimes may take the frame for ended all the same.
        match again {
            Err(xr::sys::Result::ERROR_CALL_ORDER_INVALID) => Ok(()),
            again => again.called("xrEndFrame"),
        }
    }
}
