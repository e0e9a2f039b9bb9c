//! What frames end with: the views' pictures, the board with a message, or nothing.

use std::time::Duration;

use openxr as xr;

use super::super::fault::{Called, Outcome};
use super::super::motion::MotionInfo;
use super::super::swapchain::DepthInfo;
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
        self.submit(shown.as_deref(), tells, false)?;
        self.motion.iter_mut().for_each(|motion| motion.shown(false));
        Ok(())
    }

    /// Ends the frame with the images that were released last, as views saw them, with their motion vectors, and with the
    /// board. Runtimes that refuse one of the latter two get none from then on.
    pub(super) fn submit(
        &mut self,
        shown: Option<&[EyeView]>,
        mut board: bool,
        mut moves: bool,
    ) -> Outcome<()> {
        board &= self.notices.layer(&self.space).is_some();
        let mut ended = self.end_frame(shown, board, moves);
        while let Err(code) = ended
            && REFUSALS.contains(&code)
            && (board || moves)
        {
            if moves {
                (moves, self.motion) = (false, None);
                self.notes.note(format!("xrEndFrame refuses motion vectors ({code:?}): it gets none"));
            } else {
                board = false;
                self.notices.refuse();
                let refused = format!("xrEndFrame refuses the board with messages ({code:?}): there is none");
                self.notes.note(refused);
            }
            ended = match self.end_frame(shown, board, moves) {
                // Runtimes may take the frame for ended all the same.
                Err(xr::sys::Result::ERROR_CALL_ORDER_INVALID) => Ok(()),
                again => again,
            };
        }
        ended.called("xrEndFrame")
    }

    fn end_frame(&mut self, shown: Option<&[EyeView]>, board: bool, moves: bool) -> xr::Result<()> {
        let depths: Vec<_> = self.images.iter().map(ViewImages::depth_info).collect();
        let beside: Vec<_> = depths.iter().map(|depth| depth.as_ref().map(DepthInfo::chained)).collect();
        let motion = self.motion.as_ref().filter(|_| moves);
        let info = |(view, beside): (usize, &Option<_>)| motion?.info(view, *beside);
        let motions: Vec<_> = beside.iter().enumerate().map(info).collect();
        let beside = motions
            .iter()
            .zip(beside)
            .map(|(moves, depth)| moves.as_ref().map(MotionInfo::chained).or(depth));
        let images = self.images.iter().zip(beside);
        let views: Vec<_> = shown
            .unwrap_or_default()
            .iter()
            .zip(images)
            .map(|(eye, (images, beside))| images.layer_view(eye, beside))
            .collect();
        let layer = xr::CompositionLayerProjection::new().space(&self.space).views(&views);
        let quad = if board { self.notices.layer(&self.space) } else { None };
        let mut layers: Vec<&xr::CompositionLayerBase<xr::Vulkan>> = Vec::new();
        layers.extend(shown.map(|_| &*layer));
        layers.extend(quad.iter().map(|quad| &**quad));
        let _queue = self.context.queue();
        self.stream.end(self.display_time, self.blend, &layers)
    }
}
