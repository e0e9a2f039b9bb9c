//! The application's motion vectors, told right save for the one mistake that it is asked for.
//!
//! The mistake's first word says how they are told: `synthesis`, `space_warp` or `both`; without one of them
//! there are none.
#![allow(unsafe_code)]

use std::ptr;

use ash::vk::{self, Handle as _};
use openxr::{self as hl, sys};

use crate::application::swapchain;
use crate::vulkan::Vulkan;

/// Red to alpha of both eyes' motion vectors.
pub const VECTORS: [[f32; 4]; 2] = [[0.25, -0.5, 2.0, 1.0], [1.0, -2.0, 0.0, 0.5]];
/// The depth beside them.
pub const DEPTHS: [f32; 2] = [0.75, 0.5];

/// The images of both eyes.
pub struct Motion {
    mistake: String,
    synthesis: bool,
    space_warp: bool,
    size: [u32; 2],
    vectors: Vec<hl::Swapchain<hl::Vulkan>>,
    depths: Vec<hl::Swapchain<hl::Vulkan>>,
}

/// What hangs on a view.
pub struct Chain {
    depth: sys::CompositionLayerDepthInfoKHR,
    synthesis: Option<sys::FrameSynthesisInfoEXT>,
    space_warp: Option<sys::CompositionLayerSpaceWarpInfoFB>,
}

/// Whether motion vectors are told by frame synthesis and by space warp, and the mistake with them.
fn told(mistake: &str) -> Option<(bool, bool, &str)> {
    let (kind, rest) = mistake.split_once(' ').unwrap_or((mistake, ""));
    let told = (["synthesis", "both"].contains(&kind), ["space_warp", "both"].contains(&kind), rest);
    (told.0 || told.1).then_some(told)
}

/// Enables what the motion vectors need.
pub fn enable(extensions: &mut hl::ExtensionSet, mistake: &str) {
    let Some((synthesis, space_warp, mistake)) = told(mistake) else { return };
    extensions.khr_composition_layer_depth = true;
    extensions.ext_frame_synthesis = synthesis && mistake != "not enabled";
    extensions.fb_space_warp = space_warp && mistake != "not enabled";
}

/// Brings the chains to a layer's views, in another order for each; that of the second may be left out.
pub fn hang(chains: &mut [Chain], views: &mut [sys::CompositionLayerProjectionView]) {
    for (eye, (chain, view)) in chains.iter_mut().zip(views).enumerate() {
        let mut next = ptr::null();
        if eye == 1 {
            next = ptr::from_ref(&chain.depth).cast();
        }
        if let Some(synthesis) = &mut chain.synthesis {
            synthesis.next = next;
            next = ptr::from_ref(synthesis).cast();
        }
        if let Some(space_warp) = &mut chain.space_warp {
            space_warp.next = next;
            next = ptr::from_ref(space_warp).cast();
        }
        if eye == 0 {
            chain.depth.next = next;
            next = ptr::from_ref(&chain.depth).cast();
        }
        view.next = next;
    }
}

impl Motion {
    /// Images of the size that the runtime recommends, if motion vectors are wanted.
    pub fn new(
        instance: &hl::Instance,
        system: hl::SystemId,
        session: &hl::Session<hl::Vulkan>,
        mistake: &str,
    ) -> Option<Self> {
        let (synthesis, space_warp, mistake) = told(mistake)?;
        let by_system = if space_warp { size_by_system(instance, system) } else { None };
        let by_view = if synthesis { size_by_view(instance, system) } else { None };
        let size = by_view.or(by_system).unwrap_or([8, 8]);
        let colour = match mistake {
            "vectors not attached" => hl::SwapchainUsageFlags::SAMPLED,
            _ => hl::SwapchainUsageFlags::COLOR_ATTACHMENT,
        };
        let both = |usage, format: vk::Format| {
            (0..2).map(|_| swapchain(session, usage, format.as_raw() as u32, size)).collect()
        };
        Some(Motion {
            mistake: mistake.to_string(),
            synthesis,
            space_warp,
            size,
            vectors: both(colour, vk::Format::R16G16B16A16_SFLOAT),
            depths: both(hl::SwapchainUsageFlags::DEPTH_STENCIL_ATTACHMENT, vk::Format::D32_SFLOAT),
        })
    }

    pub fn draw(&mut self, vulkan: &Vulkan) {
        let undrawn = self.mistake == "never drawn";
        for eye in 0..2 {
            draw(&mut self.depths[eye], |image| vulkan.clear_depth(image, DEPTHS[eye]));
            if !undrawn {
                let rest = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
                draw(&mut self.vectors[eye], |image| vulkan.clear(image, rest, VECTORS[eye]));
            }
        }
    }

    fn part(&self, swapchain: &hl::Swapchain<hl::Vulkan>) -> sys::SwapchainSubImage {
        let extent = sys::Extent2Di { width: self.size[0] as i32, height: self.size[1] as i32 };
        sys::SwapchainSubImage {
            swapchain: swapchain.as_raw(),
            image_rect: sys::Rect2Di { offset: sys::Offset2Di { x: 0, y: 0 }, extent },
            image_array_index: 0,
        }
    }

    /// What hangs on both views: in the left one's the mistake is made, if this frame is the one for it. Of two
    /// structures only space warp's has it.
    pub fn chains(&self, mistaken: bool) -> Vec<Chain> {
        let right = |eye| Chain {
            depth: self.depth(eye),
            synthesis: self.synthesis.then(|| self.synthesis(eye, "")),
            space_warp: self.space_warp.then(|| self.space_warp(eye, "")),
        };
        let mut chains = vec![right(0), right(1)];
        if mistaken {
            let first = if self.space_warp { "" } else { &self.mistake };
            chains[0].synthesis = self.synthesis.then(|| self.synthesis(0, first));
            chains[0].space_warp = self.space_warp.then(|| self.space_warp(0, &self.mistake));
            if self.mistake == "one view" {
                (chains[1].synthesis, chains[1].space_warp) = (None, None);
            }
        }
        chains
    }

    /// The depths of the motion vectors, told as those of the view too.
    fn depth(&self, eye: usize) -> sys::CompositionLayerDepthInfoKHR {
        sys::CompositionLayerDepthInfoKHR {
            ty: sys::CompositionLayerDepthInfoKHR::TYPE,
            next: ptr::null(),
            sub_image: self.part(&self.depths[eye]),
            min_depth: 0.0,
            max_depth: 1.0,
            near_z: 0.1,
            far_z: 100.0,
        }
    }

    fn synthesis(&self, eye: usize, mistake: &str) -> sys::FrameSynthesisInfoEXT {
        let list = |[x, y, z, w]: [f32; 4]| sys::Vector4f { x, y, z, w };
        let scale = if mistake == "endless scale" { f32::INFINITY } else { 0.5 };
        let offset = if mistake == "offset of no number" { f32::NAN } else { 0.25 };
        // What both structures tell is told once.
        let told = self.space_warp(eye, mistake);
        let flags = if mistake == "unknown flags" { 0b100 } else { 0b11 };
        sys::FrameSynthesisInfoEXT {
            ty: sys::FrameSynthesisInfoEXT::TYPE,
            next: ptr::null(),
            layer_flags: sys::FrameSynthesisInfoFlagsEXT::from_raw(flags),
            motion_vector_sub_image: told.motion_vector_sub_image,
            motion_vector_scale: list([1.0, -1.0, scale, 1.0]),
            motion_vector_offset: list([offset, 0.0, 0.0, 0.0]),
            app_space_delta_pose: told.app_space_delta_pose,
            depth_sub_image: told.depth_sub_image,
            min_depth: told.min_depth,
            max_depth: told.max_depth,
            near_z: told.near_z,
            far_z: told.far_z,
        }
    }

    fn space_warp(&self, eye: usize, mistake: &str) -> sys::CompositionLayerSpaceWarpInfoFB {
        let flags = if mistake == "unknown flags" { 0b10 } else { 0b1 };
        let mut told = sys::CompositionLayerSpaceWarpInfoFB {
            ty: sys::CompositionLayerSpaceWarpInfoFB::TYPE,
            next: ptr::null(),
            layer_flags: sys::CompositionLayerSpaceWarpInfoFlagsFB::from_raw(flags),
            motion_vector_sub_image: self.part(&self.vectors[eye]),
            app_space_delta_pose: sys::Posef {
                orientation: sys::Quaternionf { x: 0.0, y: 0.6, z: 0.0, w: 0.8 },
                position: sys::Vector3f { x: 0.5, y: 0.0, z: -1.0 },
            },
            depth_sub_image: self.part(&self.depths[eye]),
            min_depth: 0.0,
            max_depth: 1.0,
            // Reversed, and without end.
            near_z: f32::INFINITY,
            far_z: 0.1,
        };
        match mistake {
            "vectors of depths" => told.motion_vector_sub_image = self.part(&self.depths[eye]),
            "depths of colours" => told.depth_sub_image = self.part(&self.vectors[eye]),
            "vectors outside" => told.motion_vector_sub_image.image_rect.offset.x = 1,
            "depths outside" => told.depth_sub_image.image_rect.extent.height += 1,
            "near is far" => told.near_z = told.far_z,
            "far at the eye" => told.far_z = 0.0,
            "depth too far" => told.max_depth = 2.0,
            "depth turned round" => (told.min_depth, told.max_depth) = (1.0, 0.0),
            "delta of no length" => told.app_space_delta_pose.orientation.w = 5.0,
            "delta to nowhere" => told.app_space_delta_pose.position.y = f32::NAN,
            _ => {}
        }
        told
    }
}

/// Fills a swapchain's next image.
fn draw(swapchain: &mut hl::Swapchain<hl::Vulkan>, clear: impl FnOnce(vk::Image)) {
    let images = swapchain.enumerate_images().unwrap();
    let image = swapchain.acquire_image().unwrap();
    swapchain.wait_image(hl::Duration::INFINITE).unwrap();
    clear(vk::Image::from_raw(images[image as usize]));
    swapchain.release_image().unwrap();
}

/// The size that XR_EXT_frame_synthesis recommends, which here is one for both views.
fn size_by_view(instance: &hl::Instance, system: hl::SystemId) -> Option<[u32; 2]> {
    let config = sys::FrameSynthesisConfigViewEXT {
        ty: sys::FrameSynthesisConfigViewEXT::TYPE,
        next: ptr::null_mut(),
        recommended_motion_vector_image_rect_width: 0,
        recommended_motion_vector_image_rect_height: 0,
    };
    let mut configs = [config; 2];
    let mut views = configs.each_mut().map(|config| sys::ViewConfigurationView {
        ty: sys::ViewConfigurationView::TYPE,
        next: ptr::from_mut(config).cast(),
        recommended_image_rect_width: 0,
        max_image_rect_width: 0,
        recommended_image_rect_height: 0,
        max_image_rect_height: 0,
        recommended_swapchain_sample_count: 0,
        max_swapchain_sample_count: 0,
    });
    let (kind, mut count) = (sys::ViewConfigurationType::PRIMARY_STEREO, 0);
    let enumerate = instance.fp().enumerate_view_configuration_views;
    // SAFETY: there are as many views as the call is told, and their chains live as long.
    let result = unsafe { enumerate(instance.as_raw(), system, kind, 2, &mut count, views.as_mut_ptr()) };
    let sizes = configs.map(|config| {
        [
            config.recommended_motion_vector_image_rect_width,
            config.recommended_motion_vector_image_rect_height,
        ]
    });
    assert_eq!(sizes[0], sizes[1]);
    (result == sys::Result::SUCCESS).then_some(sizes[0])
}

/// The size that XR_FB_space_warp recommends.
fn size_by_system(instance: &hl::Instance, system: hl::SystemId) -> Option<[u32; 2]> {
    let mut motion = sys::SystemSpaceWarpPropertiesFB {
        ty: sys::SystemSpaceWarpPropertiesFB::TYPE,
        next: ptr::null_mut(),
        recommended_motion_vector_image_rect_width: 0,
        recommended_motion_vector_image_rect_height: 0,
    };
    let mut properties = sys::SystemProperties::out(ptr::from_mut(&mut motion).cast());
    let get = instance.fp().get_system_properties;
    // SAFETY: the structures are what the call asks for.
    let result = unsafe { get(instance.as_raw(), system, properties.as_mut_ptr()) };
    let size = [
        motion.recommended_motion_vector_image_rect_width,
        motion.recommended_motion_vector_image_rect_height,
    ];
    (result == sys::Result::SUCCESS).then_some(size)
}
