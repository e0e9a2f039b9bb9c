//! Motion vectors for runtimes that make pictures between those that they get: XR_EXT_frame_synthesis, else
//! XR_FB_space_warp.
//!
//! Vectors belong to the step from one picture to the next. Whatever breaks that row of pictures, a frame that shows the
//! last one again, a picture without vectors, a wearer who has been carried elsewhere or a tracked space that the runtime
//! has recentred, leaves one frame without them.
#![allow(unsafe_code)]

use std::marker::PhantomData;
use std::time::Duration;

use glam::DQuat;
use openxr::{self as xr, sys};

use super::convert;
use super::fault::{Called, Notes, Outcome};
use super::swapchain::{Chained, DEPTH_FORMATS, Formats, ViewImages};
use crate::gpu::vulkan::{Context, Format};
use crate::headset::EyeView;
use crate::math::pose::Pose;
use crate::reconstruct::{MotionImage, NEAREST_DEPTH};

/// Metres and radians that locomotion may carry the wearer from one picture to the next, and that an eye may move in the
/// tracked space; farther is a cut.
const CUT: (f64, f64) = (0.5, 0.25);

/// How long an image is waited for in one frame: a picture without vectors is better than one that comes late.
const PATIENCE: Duration = Duration::from_millis(4);

/// The extension that takes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    FrameSynthesis,
    SpaceWarp,
}

/// Where the wearer is.
#[derive(Clone, Copy, Debug)]
struct Stand {
    /// The tracked space in the scene.
    world_from_space: Pose,
    /// The first eye in that.
    space_from_eye: Pose,
}

impl Stand {
    /// Whether pictures in between could show how one came here from there.
    fn follows(&self, last: &Stand) -> bool {
        let carried = last.world_from_space.inverse().then(self.world_from_space);
        let moved = last.space_from_eye.inverse().then(self.space_from_eye);
        [carried, moved].iter().all(|step| {
            step.position.length() < CUT.0 && step.rotation.angle_between(DQuat::IDENTITY) < CUT.1
        })
    }
}

/// Of all views, their images, and how far the row of pictures has come.
pub struct MotionVectors {
    kind: Kind,
    images: Vec<ViewImages>,
    /// In this frame.
    stands: Stand,
    /// In the one whose picture, with vectors, came just before.
    stood: Option<Stand>,
    /// This frame has images, and they have been drawn into.
    drawn: bool,
}

impl MotionVectors {
    /// Images for the motion vectors of so many views, where the runtime takes them; what is refused is noted.
    ///
    /// # Errors
    /// Where session or runtime are lost.
    pub fn new(
        session: &xr::Session<xr::Vulkan>,
        system: xr::SystemId,
        (views, count): (xr::ViewConfigurationType, usize),
        context: &Context,
        notes: &mut Notes,
    ) -> Outcome<Option<MotionVectors>> {
        const WITHOUT: &str = "the runtime gets no motion vectors";
        let instance = session.instance();
        let Recommended { kind, sizes: told } = match recommended(instance, system, views) {
            Ok(Some(told)) => told,
            Ok(None) => return Ok(None),
            // A loss is told by the next call.
            Err(code) => {
                notes.note(format!("the size of motion vectors is not told ({code:?}): {WITHOUT}"));
                return Ok(None);
            }
        };
        let limit = context.image_size_limit();
        let usable =
            |&(width, height): &(u32, u32)| (1..=limit).contains(&width) && (1..=limit).contains(&height);
        if told.len() < count || !told.iter().all(usable) {
            notes.note(format!("motion vectors of {told:?} pixels are asked for: {WITHOUT}"));
            return Ok(None);
        }
        let offered = session.enumerate_swapchain_formats().called("xrEnumerateSwapchainFormats")?;
        let is_offered = |format: &Format| offered.contains(&(format.as_raw() as u32));
        let depth = DEPTH_FORMATS.into_iter().find(is_offered);
        let color = Format::R16G16B16A16_SFLOAT;
        if depth.is_none() || !is_offered(&color) {
            notes.note(format!("the runtime offers no {color:?} or no format of depths: {WITHOUT}"));
            return Ok(None);
        }
        let formats = Formats { color, depth, copied: false };
        let images = |&size| ViewImages::new(session, context, formats, size);
        let images: Outcome<Vec<_>> = told[..count].iter().map(images).collect();
        let Some(images) = notes.or_without(images, WITHOUT)? else { return Ok(None) };
        let stands = Stand { world_from_space: Pose::IDENTITY, space_from_eye: Pose::IDENTITY };
        Ok(Some(MotionVectors { kind, images, stands, stood: None, drawn: false }))
    }

    /// The name of the extension.
    pub fn extension(&self) -> &'static str {
        match self.kind {
            Kind::FrameSynthesis => "XR_EXT_frame_synthesis",
            Kind::SpaceWarp => "XR_FB_space_warp",
        }
    }

    /// The next images, one for each view; none where the compositor still reads one of them.
    ///
    /// # Errors
    /// As [`ViewImages::acquire`].
    pub fn acquire(&mut self) -> Outcome<Vec<Option<MotionImage>>> {
        let y_up = self.kind == Kind::SpaceWarp;
        let acquire = |images: &mut ViewImages| images.acquire_within(PATIENCE);
        let images: Outcome<Option<Vec<_>>> = self.images.iter_mut().map(acquire).collect();
        let images = images?;
        self.drawn = images.is_some();
        let image = |target| Some(MotionImage { target, y_up });
        Ok(images.map_or_else(|| vec![None; self.images.len()], |all| all.into_iter().map(image).collect()))
    }

    /// Tells where the tracked space lies in the scene in the picture that is about to be handed over.
    pub fn stand(&mut self, world_from_space: Pose) {
        self.stands.world_from_space = world_from_space;
    }

    /// Hands the images of a picture over, as its views saw it; whether they are to be told.
    ///
    /// # Errors
    /// As [`ViewImages::release`].
    pub fn release(&mut self, shown: &[EyeView]) -> Outcome<bool> {
        if let Some(eye) = shown.first() {
            self.stands.space_from_eye = eye.space_from_eye;
        }
        if !self.drawn {
            return Ok(false);
        }
        self.images.iter_mut().try_for_each(ViewImages::release)?;
        Ok(self.stood.is_some_and(|stood| self.stands.follows(&stood)))
    }

    /// A picture was handed over, or none was. One whose vectors were not drawn is not what the next one's lead from.
    pub fn shown(&mut self, picture: bool) {
        let drawn = std::mem::replace(&mut self.drawn, false);
        self.stood = (picture && drawn).then_some(self.stands);
    }

    /// What a layer tells of a view's motion vectors, and after it what it tells beside them.
    pub fn info<'a>(&'a self, view: usize, beside: Option<Chained<'a>>) -> Option<MotionInfo<'a>> {
        let (vectors, depth) = self.images.get(view)?.sub_images();
        let delta = self.stood?.world_from_space.inverse().then(self.stands.world_from_space);
        let (next, delta, depth) = (Chained::next(beside), convert::posef(delta), depth?);
        // As `ViewImages::depth_info` has it.
        let (min_depth, max_depth, near_z, far_z) = (0.0, 1.0, f32::MAX, NEAREST_DEPTH);
        Some(match self.kind {
            Kind::FrameSynthesis => {
                let all = |v| sys::Vector4f { x: v, y: v, z: v, w: v };
                MotionInfo::FrameSynthesis(
                    sys::FrameSynthesisInfoEXT {
                        ty: sys::FrameSynthesisInfoEXT::TYPE,
                        next,
                        layer_flags: sys::FrameSynthesisInfoFlagsEXT::EMPTY,
                        motion_vector_sub_image: vectors,
                        motion_vector_scale: all(1.0),
                        motion_vector_offset: all(0.0),
                        app_space_delta_pose: delta,
                        depth_sub_image: depth,
                        min_depth,
                        max_depth,
                        near_z,
                        far_z,
                    },
                    PhantomData,
                )
            }
            Kind::SpaceWarp => MotionInfo::SpaceWarp(
                sys::CompositionLayerSpaceWarpInfoFB {
                    ty: sys::CompositionLayerSpaceWarpInfoFB::TYPE,
                    next,
                    layer_flags: sys::CompositionLayerSpaceWarpInfoFlagsFB::EMPTY,
                    motion_vector_sub_image: vectors,
                    app_space_delta_pose: delta,
                    depth_sub_image: depth,
                    min_depth,
                    max_depth,
                    near_z,
                    far_z,
                },
                PhantomData,
            ),
        })
    }
}

/// What a layer tells of a view's motion vectors; lives as long as the images that it names.
pub enum MotionInfo<'a> {
    /// Vulkan's coordinates, Y down.
    FrameSynthesis(sys::FrameSynthesisInfoEXT, PhantomData<&'a ViewImages>),
    /// Y up.
    SpaceWarp(sys::CompositionLayerSpaceWarpInfoFB, PhantomData<&'a ViewImages>),
}

impl MotionInfo<'_> {
    /// To be chained to a layer's view.
    pub fn chained(&self) -> Chained<'_> {
        let info = match self {
            MotionInfo::FrameSynthesis(info, _) => (&raw const *info).cast(),
            MotionInfo::SpaceWarp(info, _) => (&raw const *info).cast(),
        };
        Chained(info, PhantomData)
    }
}

/// Who takes motion vectors, and the sizes of each view's, in pixels across and down.
struct Recommended {
    kind: Kind,
    sizes: Vec<(u32, u32)>,
}

fn recommended(
    instance: &xr::Instance,
    system: xr::SystemId,
    views: xr::ViewConfigurationType,
) -> xr::Result<Option<Recommended>> {
    if instance.exts().ext_frame_synthesis.is_some() {
        let sizes = synthesis_sizes(instance, system, views)?;
        return Ok(Some(Recommended { kind: Kind::FrameSynthesis, sizes }));
    }
    if instance.exts().fb_space_warp.is_some() {
        let size = space_warp_size(instance, system)?;
        // Twice as many as the most views of a configuration.
        return Ok(Some(Recommended { kind: Kind::SpaceWarp, sizes: vec![size; 8] }));
    }
    Ok(None)
}

fn synthesis_sizes(
    instance: &xr::Instance,
    system: xr::SystemId,
    kind: xr::ViewConfigurationType,
) -> xr::Result<Vec<(u32, u32)>> {
    let count = instance.enumerate_view_configuration_views(system, kind)?.len();
    let blank = sys::FrameSynthesisConfigViewEXT {
        ty: sys::FrameSynthesisConfigViewEXT::TYPE,
        next: std::ptr::null_mut(),
        recommended_motion_vector_image_rect_width: 0,
        recommended_motion_vector_image_rect_height: 0,
    };
    let mut told = vec![blank; count];
    // SAFETY: a structure of plain numbers and a pointer.
    let blank: sys::ViewConfigurationView = unsafe { std::mem::zeroed() };
    let view = |told: &mut sys::FrameSynthesisConfigViewEXT| sys::ViewConfigurationView {
        ty: sys::ViewConfigurationView::TYPE,
        next: (&raw mut *told).cast(),
        ..blank
    };
    let mut views: Vec<_> = told.iter_mut().map(view).collect();
    let mut count = 0;
    // SAFETY: there are as many views as the capacity says, each with a structure that is chained to it; all live
    // until the call returns. The extension that those belong to is enabled.
    let code = unsafe {
        let ask = instance.fp().enumerate_view_configuration_views;
        ask(instance.as_raw(), system, kind, views.len() as u32, &mut count, views.as_mut_ptr())
    };
    let size = |told: &sys::FrameSynthesisConfigViewEXT| {
        (told.recommended_motion_vector_image_rect_width, told.recommended_motion_vector_image_rect_height)
    };
    if code == sys::Result::SUCCESS { Ok(told.iter().map(size).collect()) } else { Err(code) }
}

fn space_warp_size(instance: &xr::Instance, system: xr::SystemId) -> xr::Result<(u32, u32)> {
    let mut told = sys::SystemSpaceWarpPropertiesFB {
        ty: sys::SystemSpaceWarpPropertiesFB::TYPE,
        next: std::ptr::null_mut(),
        recommended_motion_vector_image_rect_width: 0,
        recommended_motion_vector_image_rect_height: 0,
    };
    let mut properties = sys::SystemProperties::out((&raw mut told).cast());
    // SAFETY: both structs are of the types that they say, and live until the call returns; the extension that the
    // second belongs to is enabled.
    let code =
        unsafe { (instance.fp().get_system_properties)(instance.as_raw(), system, properties.as_mut_ptr()) };
    let size =
        (told.recommended_motion_vector_image_rect_width, told.recommended_motion_vector_image_rect_height);
    if code == sys::Result::SUCCESS { Ok(size) } else { Err(code) }
}
