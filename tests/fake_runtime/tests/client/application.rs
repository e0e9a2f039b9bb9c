//! A small OpenXR application that does everything right, save the one mistake that it is asked for.
#![allow(unsafe_code)]

use std::ptr;

use ash::vk::{self, Handle as _};
use openxr::{self as hl, sys};

use crate::motion::{self, Motion};
use crate::vulkan::Vulkan;

/// Frames that it submits before it asks for the end.
const FRAMES: u64 = 6;
/// The frame in which mistakes are made.
const MISTAKE_AT: u64 = 3;
/// What the left and right eye are shown.
const COLOURS: [[f32; 4]; 2] = [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]];

pub struct Application {
    mistake: String,
    instance: hl::Instance,
    session: hl::Session<hl::Vulkan>,
    swapchains: Vec<hl::Swapchain<hl::Vulkan>>,
    motion: Option<Motion>,
    space: hl::Space,
    vulkan: Vulkan,
}

/// Runs it; `mistake` is empty for none.
pub fn run(mistake: &str) {
    // SAFETY: the library is the OpenXR loader.
    let entry = unsafe { hl::Entry::load(&()) }.unwrap();
    let mut extensions = hl::ExtensionSet::default();
    extensions.khr_vulkan_enable2 = true;
    extensions.khr_composition_layer_depth = mistake.starts_with("depth") && mistake != "depth not enabled";
    motion::enable(&mut extensions, mistake);
    let about = hl::ApplicationInfo { application_name: "client", ..Default::default() };
    let instance = entry.create_instance(&about, &extensions, &[], &()).unwrap();
    let system = instance.system(hl::FormFactor::HEAD_MOUNTED_DISPLAY).unwrap();
    if mistake != "no requirements" {
        instance.graphics_requirements::<hl::Vulkan>(system).unwrap();
    }
    let vulkan = Vulkan::new(&instance, system, mistake == "own device");
    // SAFETY: the handles belong together and outlive the session.
    let session = unsafe { instance.create_session::<hl::Vulkan>(system, &vulkan.binding()) };
    // The other two hold the session, which must go before the device.
    let Ok(session) = session.map(|(session, ..)| session) else {
        vulkan.destroy();
        return;
    };
    let views = instance
        .enumerate_view_configuration_views(system, hl::ViewConfigurationType::PRIMARY_STEREO)
        .unwrap();
    let format = vk::Format::R8G8B8A8_SRGB.as_raw() as u32;
    assert!(session.enumerate_swapchain_formats().unwrap().contains(&format));
    let one = |view: &hl::ViewConfigurationView| {
        let size = [view.recommended_image_rect_width, view.recommended_image_rect_height];
        swapchain(&session, hl::SwapchainUsageFlags::COLOR_ATTACHMENT, format, size)
    };
    let swapchains = views.iter().map(one).collect();
    let motion = Motion::new(&instance, system, &session, mistake);
    let space = session.create_reference_space(hl::ReferenceSpaceType::LOCAL, hl::Posef::IDENTITY).unwrap();
    let mistake = mistake.to_string();
    Application { mistake, instance, session, swapchains, motion, space, vulkan }.live();
}

/// A swapchain whose images can be cleared.
pub fn swapchain(
    session: &hl::Session<hl::Vulkan>,
    usage: hl::SwapchainUsageFlags,
    format: u32,
    [width, height]: [u32; 2],
) -> hl::Swapchain<hl::Vulkan> {
    let info = hl::SwapchainCreateInfo {
        create_flags: hl::SwapchainCreateFlags::EMPTY,
        usage_flags: usage | hl::SwapchainUsageFlags::TRANSFER_DST,
        format,
        sample_count: 1,
        width,
        height,
        face_count: 1,
        array_size: 1,
        mip_count: 1,
    };
    session.create_swapchain(&info).unwrap()
}

impl Application {
    fn makes(&self, mistake: &str) -> bool {
        self.mistake == mistake
    }

    fn raw(&self) -> sys::Session {
        self.session.as_raw()
    }

    fn live(mut self) {
        if self.makes("begin early") {
            let _ = self.session.begin(hl::ViewConfigurationType::PRIMARY_STEREO);
        }
        self.attach();
        let mut running = false;
        let mut frame = 0;
        loop {
            let mut storage = hl::EventDataBuffer::new();
            while let Some(event) = self.instance.poll_event(&mut storage).unwrap() {
                let hl::Event::SessionStateChanged(change) = event else { continue };
                match change.state() {
                    hl::SessionState::READY => {
                        self.session.begin(hl::ViewConfigurationType::PRIMARY_STEREO).unwrap();
                        running = true;
                    }
                    hl::SessionState::STOPPING => {
                        self.session.end().unwrap();
                        running = false;
                    }
                    hl::SessionState::EXITING => return self.leave(),
                    _ => {}
                }
            }
            if running {
                frame += 1;
                self.frame(frame);
                if frame == FRAMES {
                    self.session.request_exit().unwrap();
                }
            }
        }
    }

    fn attach(&self) {
        let set = self.instance.create_action_set("main", "Main", 0).unwrap();
        let action = set.create_action::<f32>("push", "Push", &[]).unwrap();
        if self.makes("sync unattached") {
            let _ = self.session.sync_actions(&[hl::ActiveActionSet::new(&set)]);
        }
        let path = |text| self.instance.string_to_path(text).unwrap();
        let input = match self.makes("no such input") {
            true => "/user/hand/left/input/thumbstick/y",
            false => "/user/hand/left/input/select/click",
        };
        let profile = path("/interaction_profiles/khr/simple_controller");
        let binding = hl::Binding::new(&action, path(input));
        let suggested = self.instance.suggest_interaction_profile_bindings(profile, &[binding]);
        assert_eq!(suggested.is_ok(), !self.makes("no such input"));
        self.session.attach_action_sets(&[&set]).unwrap();
        if self.makes("attach twice") {
            let _ = self.session.attach_action_sets(&[&set]);
        }
    }

    fn wait(&self) -> sys::FrameState {
        let mut state = sys::FrameState::out(ptr::null_mut());
        // SAFETY: the structures are what the call asks for.
        unsafe {
            let result = (self.instance.fp().wait_frame)(self.raw(), ptr::null(), state.as_mut_ptr());
            assert_eq!(result, sys::Result::SUCCESS);
            state.assume_init()
        }
    }

    fn begin(&self) -> sys::Result {
        // SAFETY: the call asks for nothing.
        unsafe { (self.instance.fp().begin_frame)(self.raw(), ptr::null()) }
    }

    fn end(&self, time: sys::Time, views: &[sys::CompositionLayerProjectionView]) -> sys::Result {
        let layer = sys::CompositionLayerProjection {
            ty: sys::CompositionLayerProjection::TYPE,
            next: ptr::null(),
            layer_flags: sys::CompositionLayerFlags::EMPTY,
            space: self.space.as_raw(),
            view_count: views.len() as u32,
            views: views.as_ptr(),
        };
        let layers = [ptr::from_ref(&layer).cast()];
        let ty = match self.makes("wrong type") {
            true => sys::FrameState::TYPE,
            false => sys::FrameEndInfo::TYPE,
        };
        let info = sys::FrameEndInfo {
            ty,
            next: ptr::null(),
            display_time: time,
            environment_blend_mode: sys::EnvironmentBlendMode::OPAQUE,
            layer_count: u32::from(!views.is_empty()),
            layers: layers.as_ptr(),
        };
        // SAFETY: the structures are what the call asks for, or wrong in a way that the runtime finds.
        unsafe { (self.instance.fp().end_frame)(self.raw(), &info) }
    }

    fn frame(&mut self, number: u64) {
        let mistaken = number == MISTAKE_AT;
        if mistaken && self.makes("begin without wait") {
            self.begin();
        }
        if mistaken && self.makes("end without begin") {
            self.end(sys::Time::from_nanos(1), &[]);
        }
        if mistaken && self.makes("end session early") {
            let _ = self.session.end();
        }
        let state = self.wait();
        self.begin();
        let time = state.predicted_display_time;
        if mistaken && self.makes("no time") {
            let _ = self.session.locate_views(
                hl::ViewConfigurationType::PRIMARY_STEREO,
                sys::Time::from_nanos(0),
                &self.space,
            );
        }
        let mut layers = Vec::new();
        if bool::from(state.should_render) {
            let (_, views) = self
                .session
                .locate_views(hl::ViewConfigurationType::PRIMARY_STEREO, time, &self.space)
                .unwrap();
            if !(self.makes("never drawn")) {
                self.draw(mistaken);
            }
            layers = self.layer_views(&views);
        }
        if let Some(view) = layers.first_mut().filter(|_| mistaken) {
            match self.mistake.as_str() {
                "rectangle outside" => view.sub_image.image_rect.offset.x = 1,
                "pose of no length" => view.pose.orientation.w = 5.0,
                "no field of view" => view.fov.angle_left = view.fov.angle_right,
                _ => {}
            }
        }
        let depth = self.depth_info();
        if let Some(view) = layers.first_mut().filter(|_| mistaken && self.mistake.starts_with("depth")) {
            view.next = ptr::from_ref(&depth).cast();
        }
        let mut chains = self.motion.as_ref().map(|motion| motion.chains(mistaken)).unwrap_or_default();
        motion::hang(&mut chains, &mut layers);
        if mistaken && self.makes("one view") {
            layers.pop();
        }
        let shift = i64::from(mistaken && self.makes("another time"));
        let result = self.end(sys::Time::from_nanos(time.as_nanos() + shift), &layers);
        // A refused frame is still there to be ended.
        if result != sys::Result::SUCCESS {
            let right = std::mem::take(&mut self.mistake);
            assert_eq!(self.end(time, &[]), sys::Result::SUCCESS);
            self.mistake = right;
        }
    }

    fn draw(&mut self, mistaken: bool) {
        if let Some(motion) = &mut self.motion {
            motion.draw(&self.vulkan);
        }
        for (eye, &colour) in COLOURS.iter().enumerate() {
            let swapchain = &mut self.swapchains[eye];
            let images = swapchain.enumerate_images().unwrap();
            let image = swapchain.acquire_image().unwrap();
            if mistaken && eye == 0 {
                match self.mistake.as_str() {
                    "release without wait" => {
                        let release = self.instance.fp().release_swapchain_image;
                        // SAFETY: the call asks for nothing; the crate's own would not make it.
                        unsafe { release(swapchain.as_raw(), ptr::null()) };
                    }
                    // Three images, and one is held: the fourth is too many.
                    "acquire too many" => {
                        for _ in 0..3 {
                            let _ = swapchain.acquire_image();
                        }
                        for _ in 0..2 {
                            swapchain.wait_image(hl::Duration::INFINITE).unwrap();
                            swapchain.release_image().unwrap();
                        }
                    }
                    _ => {}
                }
            }
            swapchain.wait_image(hl::Duration::INFINITE).unwrap();
            let rest = match self.mistake == "wrong layout" {
                true => vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
                false => vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
            };
            self.vulkan.clear(vk::Image::from_raw(images[image as usize]), rest, colour);
            self.swapchains[eye].release_image().unwrap();
        }
    }

    fn layer_views(&self, views: &[hl::View]) -> Vec<sys::CompositionLayerProjectionView> {
        let size = [96, 80];
        let one = |(view, swapchain): (&hl::View, &hl::Swapchain<hl::Vulkan>)| {
            sys::CompositionLayerProjectionView {
                ty: sys::CompositionLayerProjectionView::TYPE,
                next: ptr::null(),
                pose: view.pose,
                fov: view.fov,
                sub_image: sys::SwapchainSubImage {
                    swapchain: swapchain.as_raw(),
                    image_rect: sys::Rect2Di {
                        offset: sys::Offset2Di { x: 0, y: 0 },
                        extent: sys::Extent2Di { width: size[0], height: size[1] },
                    },
                    image_array_index: 0,
                },
            }
        };
        views.iter().zip(&self.swapchains).map(one).collect()
    }

    /// Depths that no runtime takes: they lie in the left eye's colours, and more may be wrong with them.
    fn depth_info(&self) -> sys::CompositionLayerDepthInfoKHR {
        let extent = sys::Extent2Di { width: 96, height: 80 };
        sys::CompositionLayerDepthInfoKHR {
            ty: sys::CompositionLayerDepthInfoKHR::TYPE,
            next: ptr::null(),
            sub_image: sys::SwapchainSubImage {
                swapchain: self.swapchains[0].as_raw(),
                image_rect: sys::Rect2Di { offset: sys::Offset2Di { x: 0, y: 0 }, extent },
                image_array_index: 0,
            },
            min_depth: 0.0,
            max_depth: if self.makes("depth too far") { 2.0 } else { 1.0 },
            near_z: 0.1,
            far_z: if self.makes("depth of no extent") { 0.1 } else { 100.0 },
        }
    }

    fn leave(self) {
        let Application { mistake, instance, session, mut swapchains, motion, space, vulkan } = self;
        if mistake == "stale handle" {
            let stale = swapchains.pop().unwrap().as_raw();
            let mut index = 0;
            // SAFETY: the runtime knows that this swapchain is gone, and touches nothing of it.
            unsafe { (instance.fp().acquire_swapchain_image)(stale, ptr::null(), &mut index) };
        }
        if mistake == "space left" {
            // SAFETY: the session is what is destroyed, once; what hangs on it is not touched again.
            unsafe { (instance.fp().destroy_session)(session.as_raw()) };
            std::process::exit(0);
        }
        drop((swapchains, motion, space, session));
        if mistake != "instance left" {
            drop(instance);
        } else {
            std::mem::forget(instance);
        }
        vulkan.destroy();
    }
}

/// What stands in the way of running it.
pub fn missing() -> Option<String> {
    // SAFETY: the libraries are the loaders of OpenXR and Vulkan; no device is opened.
    unsafe {
        if let Err(error) = hl::Entry::load(&()) {
            return Some(format!("no OpenXR loader ({error})"));
        }
        let devices = ash::Entry::load().map_err(|e| e.to_string()).and_then(|entry| {
            let instance = entry.create_instance(&Default::default(), None).map_err(|e| e.to_string())?;
            let devices = instance.enumerate_physical_devices().map(|list| list.len());
            instance.destroy_instance(None);
            devices.map_err(|e| e.to_string())
        });
        match devices {
            Ok(0) => Some("no Vulkan device".into()),
            Ok(_) => None,
            Err(error) => Some(format!("no Vulkan device ({error})")),
        }
    }
}

/// Whether Vulkan's validation layer is installed.
pub fn validates() -> bool {
    // SAFETY: only the names of layers are asked for.
    let layers = unsafe { ash::Entry::load().map(|entry| entry.enumerate_instance_layer_properties()) };
    layers.is_ok_and(|found| {
        let named = |layer: &vk::LayerProperties| {
            layer.layer_name_as_c_str().is_ok_and(|name| name == c"VK_LAYER_KHRONOS_validation")
        };
        found.is_ok_and(|layers| layers.iter().any(named))
    })
}
