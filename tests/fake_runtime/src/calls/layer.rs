//! The layers of a frame.

use openxr_sys::{self as xr, Handle};
use serde_json::{Value, json};

use super::motion::{self, Motion};
use crate::abi;
use crate::check::{check_fov, check_pose};
use crate::nested;
use crate::refusal::{Refusal, invalid, wrong};
use crate::runtime::Runtime;
use crate::vulkan::Part;

/// What a layer shows of a swapchain: a view's picture or its depths, or a board's picture.
pub(super) struct Shown {
    pub name: String,
    pub swapchain: u64,
    pub part: Part,
}

impl Runtime {
    /// Checks a projection layer and describes it for the log.
    pub(super) fn projection(
        &mut self,
        session: u64,
        layer: &xr::CompositionLayerProjection,
        parts: &mut Vec<Shown>,
    ) -> Result<Value, Refusal> {
        let space = self.space_name(layer.space)?;
        let views = nested::layer_views(layer);
        let configuration = self.running(session)?.configuration;
        let expected = configuration.map_or(Ok(0), |c| self.views(c).map(|views| views.len()))?;
        if views.len() != expected {
            return Err(invalid(format!("{} views in a layer of {expected}", views.len())));
        }
        let mut described = Vec::new();
        for (index, view) in views.iter().enumerate() {
            described.push(self.view(session, index, view, parts)?);
        }
        motion::check_all_or_none(views)?;
        Ok(json!({ "space": space, "flags": layer.layer_flags.into_raw(), "views": described }))
    }

    /// Checks a view of a projection layer, with what is chained to it, and describes it.
    fn view(
        &mut self,
        session: u64,
        index: usize,
        view: &xr::CompositionLayerProjectionView,
        parts: &mut Vec<Shown>,
    ) -> Result<Value, Refusal> {
        if view.ty != xr::CompositionLayerProjectionView::TYPE {
            return Err(invalid(format!("{:?} stands where a layer's view must", view.ty)));
        }
        let pose = check_pose(&view.pose)?;
        let fov = check_fov(&view.fov)?;
        let part = self.part(session, &view.sub_image)?;
        let swapchain = view.sub_image.swapchain.into_raw();
        let mut entry = json!({
            "pose": pose.list(), "fov": fov, "swapchain": swapchain, "rect": part.rect(), "array_index": part.layer,
        });
        parts.push(Shown { name: format!("view{index}"), swapchain, part });
        if let Some(depth) = abi::chained::<xr::CompositionLayerDepthInfoKHR>(view.next, view) {
            let (described, part) = self.depth(session, depth, part)?;
            entry["depth"] = described;
            let swapchain = depth.sub_image.swapchain.into_raw();
            parts.push(Shown { name: format!("depth{index}"), swapchain, part });
        }
        for motion in Motion::of(view) {
            let (described, shown) = self.motion(session, &motion, index)?;
            // A view may have both kinds: both are checked, the first is told.
            if entry.get("motion").is_none() {
                entry["motion"] = described;
                parts.extend(shown);
            }
        }
        Ok(entry)
    }

    /// Checks a flat picture and describes it for the log.
    pub(super) fn quad(
        &mut self,
        session: u64,
        layer: &xr::CompositionLayerQuad,
        parts: &mut Vec<Shown>,
    ) -> Result<Value, Refusal> {
        if self.session_of(layer.space.into_raw()) != Some(session) {
            return Err(wrong(xr::Result::ERROR_HANDLE_INVALID, "the space of a layer does not live"));
        }
        let space = self.space_name(layer.space)?;
        let pose = check_pose(&layer.pose)?;
        let size = [layer.size.width, layer.size.height];
        if !size.iter().all(|side| side.is_finite() && *side > 0.0) {
            return Err(invalid(format!("a flat picture of {size:?} metres")));
        }
        let eyes = layer.eye_visibility;
        let known =
            [xr::EyeVisibility::BOTH, xr::EyeVisibility::LEFT, xr::EyeVisibility::RIGHT].contains(&eyes);
        if !known {
            return Err(invalid(format!("{eyes:?} sees a flat picture")));
        }
        let flags = xr::CompositionLayerFlags::from_raw(0b111);
        if !flags.contains(layer.layer_flags) {
            return Err(invalid(format!("flags {:?} of a layer", layer.layer_flags)));
        }
        let part = self.part(session, &layer.sub_image)?;
        let swapchain = layer.sub_image.swapchain.into_raw();
        if self.holds_depths(&layer.sub_image)? {
            return Err(invalid("a flat picture of depths"));
        }
        let number = parts.iter().filter(|part| part.name.starts_with("quad")).count();
        parts.push(Shown { name: format!("quad{number}"), swapchain, part });
        Ok(json!({
            "quad": { "pose": pose.list(), "size": size, "swapchain": swapchain, "eyes": eyes.into_raw() },
            "space": space, "flags": layer.layer_flags.into_raw(),
            "rect": part.rect(),
        }))
    }

    /// Checks a depth sub-image and describes it.
    fn depth(
        &mut self,
        session: u64,
        depth: &xr::CompositionLayerDepthInfoKHR,
        colour: Part,
    ) -> Result<(Value, Part), Refusal> {
        self.needs("XR_KHR_composition_layer_depth")?;
        let part = self.part(session, &depth.sub_image)?;
        let range = depth.min_depth..=depth.max_depth;
        let within = |depth: &f32| (0.0..=1.0).contains(depth);
        if !within(range.start()) || !within(range.end()) || range.start() >= range.end() {
            return Err(invalid(format!("depths from {:?} are not between 0 and 1", range)));
        }
        if depth.near_z == depth.far_z || !(depth.near_z >= 0.0 && depth.far_z >= 0.0) {
            return Err(invalid(format!("depth between {} and {} metres", depth.near_z, depth.far_z)));
        }
        if !self.holds_depths(&depth.sub_image)? {
            return Err(invalid("depth in a swapchain of colours"));
        }
        let described = json!({
            "swapchain": depth.sub_image.swapchain.into_raw(),
            "rect": part.rect(),
            "same_size": (part.width, part.height) == (colour.width, colour.height),
            // JSON knows no infinity.
            "near_z": depth.near_z.min(f32::MAX), "far_z": depth.far_z.min(f32::MAX),
            "min_depth": depth.min_depth, "max_depth": depth.max_depth,
        });
        Ok((described, part))
    }

    /// Whether the images of a sub-image's swapchain hold depths.
    pub(super) fn holds_depths(&mut self, sub: &xr::SwapchainSubImage) -> Result<bool, Refusal> {
        let usage = self.swapchain(sub.swapchain.into_raw())?.shape.usage;
        Ok(usage.contains(ash::vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT))
    }

    /// Checks a sub-image.
    pub(super) fn part(&mut self, session: u64, sub: &xr::SwapchainSubImage) -> Result<Part, Refusal> {
        let handle = sub.swapchain.into_raw();
        if self.session_of(handle) != Some(session) {
            return Err(wrong(
                xr::Result::ERROR_HANDLE_INVALID,
                format!("Swapchain {handle} of a layer does not live"),
            ));
        }
        let swapchain = self.swapchain(handle)?;
        let (rect, shape) = (sub.image_rect, swapchain.shape);
        if swapchain.order.released().is_none() {
            return Err(wrong(
                xr::Result::ERROR_LAYER_INVALID,
                "a layer shows a swapchain of which no image was released",
            ));
        }
        let fits = |from: i32, size: i32, all: u32| from >= 0 && size > 0 && from + size <= all as i32;
        if !fits(rect.offset.x, rect.extent.width, shape.width)
            || !fits(rect.offset.y, rect.extent.height, shape.height)
        {
            return Err(wrong(
                xr::Result::ERROR_SWAPCHAIN_RECT_INVALID,
                format!("{rect:?} is not inside {} by {}", shape.width, shape.height),
            ));
        }
        if sub.image_array_index >= shape.layers {
            return Err(invalid(format!("array layer {} of {}", sub.image_array_index, shape.layers)));
        }
        Ok(Part {
            x: rect.offset.x,
            y: rect.offset.y,
            width: rect.extent.width as u32,
            height: rect.extent.height as u32,
            layer: sub.image_array_index,
        })
    }
}
