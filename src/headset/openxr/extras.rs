//! What some runtimes offer beside pictures and poses: used when listed, absent without a fuss.
#![allow(unsafe_code)]

use openxr as xr;
use xr::sys;

use crate::headset::HiddenMesh;

/// Asks for the refresh rate nearest to `wanted` hertz, and for steady clocks of processor and GPU.
/// Whatever the runtime makes of it is not this program's to judge.
pub fn request(session: &xr::Session<xr::Vulkan>, wanted: f64) {
    let extensions = session.instance().exts();
    if wanted > 0.0 && extensions.fb_display_refresh_rate.is_some() {
        let rates = session.enumerate_display_refresh_rates().unwrap_or_default();
        let off = |rate: &f32| (f64::from(*rate) - wanted).abs();
        if let Some(rate) = rates.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))) {
            let _ = session.request_display_refresh_rate(rate);
        }
    }
    if let Some(performance) = &extensions.ext_performance_settings {
        for domain in [sys::PerfSettingsDomainEXT::CPU, sys::PerfSettingsDomainEXT::GPU] {
            let level = sys::PerfSettingsLevelEXT::SUSTAINED_HIGH;
            // SAFETY: the session is alive, and the extension that the function belongs to is enabled.
            let _ =
                unsafe { (performance.perf_settings_set_performance_level)(session.as_raw(), domain, level) };
        }
    }
}

/// What the lenses hide of each view; empty where the runtime does not tell.
pub fn hidden(
    session: &xr::Session<xr::Vulkan>,
    configuration: xr::ViewConfigurationType,
    views: usize,
) -> Vec<HiddenMesh> {
    let mesh = |view: usize| {
        session.instance().exts().khr_visibility_mask.as_ref()?;
        let kind = xr::VisibilityMaskTypeKHR::HIDDEN_TRIANGLE_MESH;
        let mask = session.get_visibility_mask_khr(configuration, view as u32, kind).ok()?;
        let vertices: Vec<_> = mask.vertices.iter().map(|vertex| [vertex.x, vertex.y]).collect();
        Some(HiddenMesh::new(&vertices, &mask.indices))
    };
    (0..views).map(|view| mesh(view).unwrap_or_default()).collect()
}
