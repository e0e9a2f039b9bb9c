//! What a session is made with: sizes and images of its views, and a clock to compare the runtime's times with.

use std::time::Instant;

use openxr as xr;

use super::fault::{Fault, Notes, Outcome};
use super::foveated;
use super::runtime::Runtime;
use super::swapchain::{Formats, ViewImages};
use crate::gpu::vulkan::Context;

/// Pixels across and down of views for which the runtime recommends none.
const USUAL_SIZE: u32 = 1024;

/// Pixels of each view: what is wanted, else what is recommended, as far as runtime and device can.
pub fn sizes(
    views: &[xr::ViewConfigurationView],
    wanted: [Option<u32>; 2],
    limit: u32,
    notes: &mut Notes,
) -> Vec<(u32, u32)> {
    let mut fit = |wanted: Option<u32>, recommended: u32, most: u32| {
        let most = if most == 0 { limit } else { most.min(limit) };
        if wanted.is_none() && recommended == 0 {
            notes.note(format!("the runtime recommends no size for its views: they get {USUAL_SIZE} pixels"));
        }
        let usual = if recommended == 0 { USUAL_SIZE } else { recommended };
        wanted.unwrap_or(usual).clamp(1, most.max(1))
    };
    let size = |view: &xr::ViewConfigurationView| {
        let width = fit(wanted[0], view.recommended_image_rect_width, view.max_image_rect_width);
        (width, fit(wanted[1], view.recommended_image_rect_height, view.max_image_rect_height))
    };
    views.iter().map(size).collect()
}

/// Images for all views in the first formats that the runtime does not refuse.
pub fn images(
    session: &xr::Session<xr::Vulkan>,
    context: &Context,
    candidates: &[Formats],
    sizes: &[(u32, u32)],
    notes: &mut Notes,
) -> Outcome<(Formats, Vec<ViewImages>)> {
    for &formats in candidates {
        let made: Outcome<Vec<_>> =
            sizes.iter().map(|&size| ViewImages::new(session, context, formats, size)).collect();
        let Formats { color, depth, copied } = formats;
        let further = if copied { ", to be copied for spectators," } else { "" };
        let instead = format!("no images of {color:?} with depths of {depth:?}{further} are used");
        if let Some(images) = notes.or_without(made, &instead)? {
            return Ok((formats, images));
        }
    }
    Err(Fault::Session("xrCreateSwapchain refuses every format that it offers; restart the runtime".into()))
}

/// Frames after which the runtime is asked again which sizes it recommends: no event tells of others.
const AGAIN: u32 = 45;

/// Follows the sizes that a runtime recommends.
pub struct Sizes {
    system: xr::SystemId,
    views: xr::ViewConfigurationType,
    follows: bool,
    wanted: [Option<u32>; 2],
    context: Context,
    frames: u32,
}

impl Sizes {
    /// Of a runtime's views, whose insets follow the eyes or not; those of `wanted` stay.
    pub fn new(runtime: &Runtime, follows: bool, wanted: [Option<u32>; 2], context: &Context) -> Self {
        let (system, views) = (runtime.system, runtime.views);
        Sizes { system, views, follows, wanted, context: context.clone(), frames: 0 }
    }

    /// The views with the sizes that are recommended now.
    pub fn views(&self, instance: &xr::Instance) -> xr::Result<Vec<xr::ViewConfigurationView>> {
        if self.follows {
            return foveated::views(instance, self.system, self.views);
        }
        instance.enumerate_view_configuration_views(self.system, self.views)
    }

    /// New images in place of old ones where other sizes are recommended by now; looks now and then.
    pub fn renewed(
        &mut self,
        session: &xr::Session<xr::Vulkan>,
        formats: Formats,
        old: &[ViewImages],
        notes: &mut Notes,
    ) -> Outcome<Option<Vec<ViewImages>>> {
        self.frames = (self.frames + 1) % AGAIN;
        if self.frames != 0 || self.wanted.iter().all(Option::is_some) {
            return Ok(None);
        }
        // What is refused is asked for again.
        let Ok(views) = self.views(session.instance()) else { return Ok(None) };
        let sizes = sizes(&views, self.wanted, self.context.image_size_limit(), notes);
        if sizes.len() != old.len() || sizes.iter().zip(old).all(|(size, old)| *size == old.size()) {
            return Ok(None);
        }
        images(session, &self.context, &[formats], &sizes, notes).map(|(_, images)| Some(images))
    }
}

/// A steady clock that reads as the runtime's own where that is lent.
#[derive(Clone, Copy)]
pub struct Steady {
    /// Whether it does.
    pub lent: bool,
    start: Instant,
    /// Nanoseconds of the runtime's clock at the start.
    at_start: i64,
}

impl Steady {
    /// Reads the runtime's clock once.
    pub fn new(instance: &xr::Instance) -> Self {
        let start = Instant::now();
        #[cfg(not(windows))]
        let lends = instance.exts().khr_convert_timespec_time.is_some();
        #[cfg(windows)]
        let lends = instance.exts().khr_win32_convert_performance_counter_time.is_some();
        let at_start = if lends { instance.now().ok() } else { None };
        Steady { lent: at_start.is_some(), start, at_start: at_start.map_or(0, xr::Time::as_nanos) }
    }

    /// Nanoseconds.
    pub fn read(&self) -> i64 {
        self.at_start.saturating_add(self.start.elapsed().as_nanos() as i64)
    }
}
