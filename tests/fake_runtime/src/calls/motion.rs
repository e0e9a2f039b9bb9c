//! Motion vectors that are told beside a layer's views, for frames that the runtime makes up:
//! XR_EXT_frame_synthesis and XR_FB_space_warp, whose rules are the same.

use ash::vk;
use openxr_sys::{self as xr, Handle};
use serde_json::{Value, json};

use super::layer::Shown;
use crate::abi;
use crate::check::check_pose;
use crate::refusal::{Refusal, invalid};
use crate::runtime::Runtime;

/// What one of the two structures says.
pub(super) struct Motion<'a> {
    kind: &'static str,
    extension: &'static str,
    flags: u64,
    known_flags: u64,
    vectors: &'a xr::SwapchainSubImage,
    depths: &'a xr::SwapchainSubImage,
    delta: &'a xr::Posef,
    /// minDepth and maxDepth.
    range: [f32; 2],
    /// nearZ and farZ, metres.
    planes: [f32; 2],
    /// motionVectorScale and motionVectorOffset, which only frame synthesis has.
    scale_and_offset: Option<[[f32; 4]; 2]>,
}

impl<'a> Motion<'a> {
    /// The structures in a view's chain, of each kind the first.
    pub fn of(view: &'a xr::CompositionLayerProjectionView) -> Vec<Self> {
        let synthesis = abi::chained::<xr::FrameSynthesisInfoEXT>(view.next, view).map(Self::synthesis);
        let warp = abi::chained::<xr::CompositionLayerSpaceWarpInfoFB>(view.next, view).map(Self::space_warp);
        synthesis.into_iter().chain(warp).collect()
    }

    fn synthesis(info: &'a xr::FrameSynthesisInfoEXT) -> Self {
        let list = |v: xr::Vector4f| [v.x, v.y, v.z, v.w];
        let known = xr::FrameSynthesisInfoFlagsEXT::USE_2D_MOTION_VECTOR
            | xr::FrameSynthesisInfoFlagsEXT::REQUEST_RELAXED_FRAME_INTERVAL;
        Motion {
            kind: "synthesis",
            extension: "XR_EXT_frame_synthesis",
            flags: info.layer_flags.into_raw(),
            known_flags: known.into_raw(),
            vectors: &info.motion_vector_sub_image,
            depths: &info.depth_sub_image,
            delta: &info.app_space_delta_pose,
            range: [info.min_depth, info.max_depth],
            planes: [info.near_z, info.far_z],
            scale_and_offset: Some([list(info.motion_vector_scale), list(info.motion_vector_offset)]),
        }
    }

    fn space_warp(info: &'a xr::CompositionLayerSpaceWarpInfoFB) -> Self {
        Motion {
            kind: "space_warp",
            extension: "XR_FB_space_warp",
            flags: info.layer_flags.into_raw(),
            known_flags: xr::CompositionLayerSpaceWarpInfoFlagsFB::FRAME_SKIP.into_raw(),
            vectors: &info.motion_vector_sub_image,
            depths: &info.depth_sub_image,
            delta: &info.app_space_delta_pose,
            range: [info.min_depth, info.max_depth],
            planes: [info.near_z, info.far_z],
            scale_and_offset: None,
        }
    }

    /// Checks what needs no swapchain.
    fn check_numbers(&self) -> Result<(), Refusal> {
        if self.flags & !self.known_flags != 0 {
            return Err(invalid(format!("flags {:#b} of motion vectors", self.flags)));
        }
        let [from, to] = self.range;
        // Unlike those of a layer's depths, both ends may be the same.
        if !self.range.iter().all(|depth| (0.0..=1.0).contains(depth)) || from > to {
            return Err(invalid(format!("motion's depths from {from} to {to} are not between 0 and 1")));
        }
        let [near, far] = self.planes;
        if near == far || !(near > 0.0 && far > 0.0) {
            return Err(invalid(format!("motion's depth between {near} and {far} metres")));
        }
        if !self.scale_and_offset.iter().flatten().flatten().all(|number| number.is_finite()) {
            return Err(invalid(format!("scale and offset {:?} of motion vectors", self.scale_and_offset)));
        }
        Ok(())
    }
}

impl Runtime {
    /// The recommended width and height of motion vectors' images; refused where the extension that tells
    /// them was not enabled.
    pub(super) fn motion_vectors(&mut self, extension: &str) -> Result<[u32; 2], Refusal> {
        self.needs(extension)?;
        self.script.motion_vectors.ok_or_else(|| xr::Result::ERROR_RUNTIME_FAILURE.into())
    }

    /// Checks the motion vectors of a view, by its index, and describes them.
    pub(super) fn motion(
        &mut self,
        session: u64,
        motion: &Motion,
        index: usize,
    ) -> Result<(Value, [Shown; 2]), Refusal> {
        self.needs(motion.extension)?;
        motion.check_numbers()?;
        let delta = check_pose(motion.delta)?;
        let vectors = self.part(session, motion.vectors)?;
        let depths = self.part(session, motion.depths)?;
        let swapchains = [motion.vectors, motion.depths].map(|sub| sub.swapchain.into_raw());
        let shape = self.swapchain(swapchains[0])?.shape;
        if !shape.usage.contains(vk::ImageUsageFlags::COLOR_ATTACHMENT) {
            return Err(invalid("motion vectors in a swapchain that is no colour attachment"));
        }
        if !self.holds_depths(motion.depths)? {
            return Err(invalid("motion's depth in a swapchain of colours"));
        }
        let mut described = json!({
            "kind": motion.kind, "flags": motion.flags, "delta": delta.list(),
            "swapchain": swapchains[0], "rect": vectors.rect(), "format": shape.format.as_raw(),
            "depth_swapchain": swapchains[1], "depth_rect": depths.rect(),
            // JSON knows no infinity.
            "near_z": motion.planes[0].min(f32::MAX), "far_z": motion.planes[1].min(f32::MAX),
            "min_depth": motion.range[0], "max_depth": motion.range[1],
        });
        if let Some([scale, offset]) = motion.scale_and_offset {
            described["scale"] = json!(scale);
            described["offset"] = json!(offset);
        }
        let shown = [("motion", swapchains[0], vectors), ("motion_depth", swapchains[1], depths)];
        let shown =
            shown.map(|(name, swapchain, part)| Shown { name: format!("{name}{index}"), swapchain, part });
        Ok((described, shown))
    }
}

/// Both extensions want motion vectors beside each view of a layer, where they are beside one.
pub(super) fn check_all_or_none(views: &[xr::CompositionLayerProjectionView]) -> Result<(), Refusal> {
    let kinds = |view| Motion::of(view).iter().map(|motion| motion.kind).collect::<Vec<_>>();
    if views.windows(2).any(|pair| kinds(&pair[0]) != kinds(&pair[1])) {
        return Err(invalid("motion vectors beside some of a layer's views, not beside all"));
    }
    Ok(())
}
