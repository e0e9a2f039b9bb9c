//! The smaller extensions: visibility mask, refresh rate, performance, the clock.

use openxr_sys::{self as xr, Handle};

use crate::abi::{In, Out};
use crate::clock;
use crate::refusal::{Outcome, invalid};
use crate::runtime::{On, enter};
use crate::world;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn visibility_mask(
    session: xr::Session,
    configuration: xr::ViewConfigurationType,
    index: u32,
    kind: xr::VisibilityMaskTypeKHR,
    mask: Out<xr::VisibilityMaskKHR>,
) -> xr::Result {
    enter("xrGetVisibilityMaskKHR", On::Session(session), |runtime, note| {
        runtime.needs("XR_KHR_visibility_mask")?;
        note.set("view", index);
        note.set("kind", format!("{kind:?}"));
        let views = runtime.views(configuration)?;
        let view = views.get(index as usize).ok_or_else(|| invalid(format!("there is no view {index}")))?;
        let changed = runtime.session(session.into_raw())?.hidden_corners.get(&index).copied();
        // Only the hidden part is there; a runtime may leave the others empty.
        let (vertices, indices) = if kind == xr::VisibilityMaskTypeKHR::HIDDEN_TRIANGLE_MESH {
            world::hidden(view, changed.unwrap_or(view.hidden_corner))
        } else {
            Default::default()
        };
        note.set("triangles", indices.len() / 3);
        mask.mask(vertices, indices)?;
        DONE
    })
}

pub(crate) fn enumerate_rates(
    session: xr::Session,
    capacity: u32,
    count: Out<u32>,
    rates: Out<f32>,
) -> xr::Result {
    enter("xrEnumerateDisplayRefreshRatesFB", On::Session(session), |runtime, _| {
        runtime.needs("XR_FB_display_refresh_rate")?;
        let usual = (1000.0 / runtime.script.period_ms) as f32;
        rates.fill(capacity, count, vec![usual / 2.0, usual])?;
        DONE
    })
}

pub(crate) fn get_rate(session: xr::Session, rate: Out<f32>) -> xr::Result {
    enter("xrGetDisplayRefreshRateFB", On::Session(session), |runtime, _| {
        runtime.needs("XR_FB_display_refresh_rate")?;
        rate.set(runtime.session(session.into_raw())?.refresh_rate)?;
        DONE
    })
}

pub(crate) fn request_rate(session: xr::Session, rate: f32) -> xr::Result {
    enter("xrRequestDisplayRefreshRateFB", On::Session(session), |runtime, note| {
        runtime.needs("XR_FB_display_refresh_rate")?;
        note.set("rate", rate);
        let usual = (1000.0 / runtime.script.period_ms) as f32;
        if rate != 0.0 && rate != usual && rate != usual / 2.0 {
            return Err(xr::Result::ERROR_DISPLAY_REFRESH_RATE_UNSUPPORTED_FB.into());
        }
        runtime.session(session.into_raw())?.refresh_rate = if rate == 0.0 { usual } else { rate };
        DONE
    })
}

pub(crate) fn performance(
    session: xr::Session,
    domain: xr::PerfSettingsDomainEXT,
    level: xr::PerfSettingsLevelEXT,
) -> xr::Result {
    enter("xrPerfSettingsSetPerformanceLevelEXT", On::Session(session), |runtime, note| {
        runtime.needs("XR_EXT_performance_settings")?;
        note.set("domain", format!("{domain:?}"));
        note.set("level", format!("{level:?}"));
        DONE
    })
}

/// xrConvertTimespecTimeToTimeKHR, on Windows xrConvertWin32PerformanceCounterToTimeKHR.
pub(crate) fn reading_to_time(
    instance: xr::Instance,
    reading: In<clock::Reading>,
    time: Out<xr::Time>,
) -> xr::Result {
    let call = if cfg!(windows) {
        "xrConvertWin32PerformanceCounterToTimeKHR"
    } else {
        "xrConvertTimespecTimeToTimeKHR"
    };
    enter(call, On::Instance(instance), |runtime, _| {
        runtime.needs(clock::EXTENSION)?;
        let told = reading.value().ok_or_else(|| invalid("the time is missing"))?;
        time.set(xr::Time::from_nanos(clock::to_nanos(told)))?;
        DONE
    })
}

/// xrConvertTimeToTimespecTimeKHR, on Windows xrConvertTimeToWin32PerformanceCounterKHR.
pub(crate) fn time_to_reading(
    instance: xr::Instance,
    time: xr::Time,
    reading: Out<clock::Reading>,
) -> xr::Result {
    let call = if cfg!(windows) {
        "xrConvertTimeToWin32PerformanceCounterKHR"
    } else {
        "xrConvertTimeToTimespecTimeKHR"
    };
    enter(call, On::Instance(instance), |runtime, _| {
        runtime.needs(clock::EXTENSION)?;
        let nanos = crate::check::check_time(time)?;
        reading.set(clock::from_nanos(nanos))?;
        DONE
    })
}
