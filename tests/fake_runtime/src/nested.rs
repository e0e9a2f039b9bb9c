//! Arrays within the structures that an application passes in.
#![allow(unsafe_code)]

use std::ffi::CStr;

use openxr_sys as xr;

use crate::abi::Typed;

/// The elements of an array within a structure that the application passed in.
fn list<T>(_owner: &impl Typed, first: *const T, count: u32) -> &[T] {
    if first.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: the owner, which is private to the accessors below, promises as many elements.
    unsafe { std::slice::from_raw_parts(first, count as usize) }
}

/// The extensions that an application asks for.
pub(crate) fn extensions(info: &xr::InstanceCreateInfo) -> Vec<String> {
    let names = list(info, info.enabled_extension_names, info.enabled_extension_count);
    // SAFETY: names end with zeros, by OpenXR's contract.
    names.iter().map(|&name| unsafe { CStr::from_ptr(name) }.to_string_lossy().into_owned()).collect()
}

/// The bindings that an application suggests.
pub(crate) fn bindings(info: &xr::InteractionProfileSuggestedBinding) -> &[xr::ActionSuggestedBinding] {
    list(info, info.suggested_bindings, info.count_suggested_bindings)
}

/// The action sets that an application attaches.
pub(crate) fn attached_sets(info: &xr::SessionActionSetsAttachInfo) -> &[xr::ActionSet] {
    list(info, info.action_sets, info.count_action_sets)
}

/// The action sets that an application synchronises.
pub(crate) fn active_sets(info: &xr::ActionsSyncInfo) -> &[xr::ActiveActionSet] {
    list(info, info.active_action_sets, info.count_active_action_sets)
}

/// A layer of a frame.
pub(crate) enum Layer<'a> {
    Projection(&'a xr::CompositionLayerProjection),
    Quad(&'a xr::CompositionLayerQuad),
    /// Of a type that is not known.
    Other(xr::StructureType),
}

/// The layers of a frame.
pub(crate) fn layers(info: &xr::FrameEndInfo) -> Vec<Layer<'_>> {
    let layers = list(info, info.layers, info.layer_count);
    let one = |&layer: &*const xr::CompositionLayerBaseHeader| {
        if layer.is_null() {
            return Layer::Other(xr::StructureType::UNKNOWN);
        }
        // SAFETY: not null, so it starts with a header, by OpenXR's contract.
        match unsafe { (*layer).ty } {
            // SAFETY: of the type that it says.
            xr::CompositionLayerProjection::TYPE => Layer::Projection(unsafe { &*layer.cast() }),
            // SAFETY: of the type that it says.
            xr::CompositionLayerQuad::TYPE => Layer::Quad(unsafe { &*layer.cast() }),
            ty => Layer::Other(ty),
        }
    };
    layers.iter().map(one).collect()
}

/// The views of a layer.
pub(crate) fn layer_views(layer: &xr::CompositionLayerProjection) -> &[xr::CompositionLayerProjectionView] {
    list(layer, layer.views, layer.view_count)
}
