//! OpenXR's pointers as values that are checked before they are read or written.
//!
//! [`In`], [`Out`] and [`Text`] are made only from arguments of a call (`table.rs`). What OpenXR asks of an
//! application, that each pointer is null or leads to what the signature says and stays so until the call
//! returns, is what the blocks below rely on.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};
use std::marker::PhantomData;

use openxr_sys as xr;

use crate::clock::Reading;
use crate::refusal::{Refusal, wrong};

/// An argument of a call, as the safe code sees it.
pub(crate) trait Argument<Raw> {
    /// # Safety
    /// The raw value came from the application in a call that has not returned.
    unsafe fn from_raw(raw: Raw) -> Self;
}

impl<T: Copy> Argument<T> for T {
    unsafe fn from_raw(raw: T) -> Self {
        raw
    }
}

impl<T> Argument<*const T> for In<'_, T> {
    unsafe fn from_raw(raw: *const T) -> Self {
        In(raw, PhantomData)
    }
}

impl<T> Argument<*mut T> for Out<T> {
    unsafe fn from_raw(raw: *mut T) -> Self {
        Out(raw)
    }
}

/// Structures that tell their type.
pub(crate) trait Typed {
    const TYPE: xr::StructureType;
}

macro_rules! typed {
    ($($name:ident)*) => { $(impl Typed for xr::$name { const TYPE: xr::StructureType = xr::$name::TYPE; })* };
}

typed! {
    ActionCreateInfo ActionSetCreateInfo ActionSpaceCreateInfo ActionStateBoolean ActionStateFloat
    ActionStateGetInfo ActionStatePose ActionStateVector2f ActionsSyncInfo BoundSourcesForActionEnumerateInfo
    CompositionLayerDepthInfoKHR CompositionLayerProjection CompositionLayerProjectionView CompositionLayerQuad
    CompositionLayerSpaceWarpInfoFB EventDataBuffer
    ExtensionProperties EyeGazeSampleTimeEXT FoveatedViewConfigurationViewVARJO FrameBeginInfo FrameEndInfo FrameState FrameSynthesisConfigViewEXT
    FrameSynthesisInfoEXT FrameWaitInfo GraphicsBindingVulkanKHR
    HandJointLocationsEXT HandJointsLocateInfoEXT HandTrackerCreateInfoEXT
    GraphicsRequirementsVulkanKHR HapticActionInfo InputSourceLocalizedNameGetInfo InstanceCreateInfo
    InstanceProperties InteractionProfileState InteractionProfileSuggestedBinding ReferenceSpaceCreateInfo
    SessionActionSetsAttachInfo SessionBeginInfo SessionCreateInfo SpaceLocation SpaceVelocity
    SwapchainCreateInfo SwapchainImageAcquireInfo SwapchainImageReleaseInfo SwapchainImageVulkanKHR SwapchainImageWaitInfo SystemEyeGazeInteractionPropertiesEXT
    SystemFoveatedRenderingPropertiesVARJO SystemHandTrackingPropertiesEXT SystemGetInfo SystemProperties
    SystemSpaceWarpPropertiesFB View ViewConfigurationProperties ViewConfigurationView ViewLocateFoveatedRenderingVARJO ViewLocateInfo
    ViewState VisibilityMaskKHR VulkanDeviceCreateInfoKHR VulkanGraphicsDeviceGetInfoKHR
    VulkanInstanceCreateInfoKHR
}

/// What every structure starts with.
#[derive(Clone, Copy)]
#[repr(C)]
struct Header {
    ty: xr::StructureType,
    next: *mut Header,
}

/// A structure or a text that the application passes in.
pub(crate) struct In<'a, T>(*const T, PhantomData<&'a T>);

impl<'a, T: Typed> In<'a, T> {
    /// The structure; refused where it is missing or of another type.
    pub fn get(&self) -> Result<&'a T, Refusal> {
        if self.0.is_null() {
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, format!("{:?} is missing", T::TYPE)));
        }
        // SAFETY: not null, so it leads to a structure with a header, by OpenXR's contract.
        let ty = unsafe { self.0.cast::<Header>().read() }.ty;
        if ty != T::TYPE {
            return Err(mistyped::<T>(ty));
        }
        // SAFETY: as above, and of the type that it says.
        Ok(unsafe { &*self.0 })
    }

    /// The structure if there is one, where the call may do without.
    pub fn optional(&self) -> Result<Option<&'a T>, Refusal> {
        if self.0.is_null() { Ok(None) } else { self.get().map(Some) }
    }
}

impl In<'_, c_char> {
    /// The text; refused where it is missing.
    pub fn text(&self) -> Result<String, Refusal> {
        if self.0.is_null() {
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, "a text is missing"));
        }
        // SAFETY: not null, so it ends with a zero, by OpenXR's contract.
        Ok(unsafe { CStr::from_ptr(self.0) }.to_string_lossy().into_owned())
    }
}

impl In<'_, Reading> {
    /// What a clock read, if it is told.
    pub fn value(&self) -> Option<Reading> {
        // SAFETY: not null, so it leads to a time, by OpenXR's contract.
        (!self.0.is_null()).then(|| unsafe { *self.0 })
    }
}

fn mistyped<T: Typed>(ty: xr::StructureType) -> Refusal {
    wrong(xr::Result::ERROR_VALIDATION_FAILURE, format!("{ty:?} stands where {:?} must", T::TYPE))
}

/// The first structure of a type in a chain of an answer that is being written.
pub(crate) fn chained_out<T: Typed + Copy>(next: *mut std::ffi::c_void) -> Option<T> {
    // SAFETY: `next` is the chain of a structure that the application passed in, as `fill_typed` hands it on.
    unsafe { find(next.cast(), T::TYPE).map(|found| found.cast::<T>().read()) }
}

/// The first structure of a type in a chain.
pub(crate) fn chained<T: Typed>(next: *const std::ffi::c_void, _owner: &impl Typed) -> Option<&T> {
    // SAFETY: `next` is the chain of a structure that the application passed in.
    unsafe { find(next.cast_mut().cast(), T::TYPE).map(|found| &*found.cast::<T>()) }
}

/// # Safety
/// `next` is a chain of structures.
unsafe fn find(mut next: *mut Header, ty: xr::StructureType) -> Option<*mut Header> {
    while !next.is_null() {
        // SAFETY: by the caller's contract.
        let header = unsafe { next.read() };
        if header.ty == ty {
            return Some(next);
        }
        next = header.next;
    }
    None
}

/// Where the application wants an answer.
pub(crate) struct Out<T>(*mut T);

impl<T> Clone for Out<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Out<T> {}

impl<T> Out<T> {
    /// Writes a value that has no type of its own.
    pub fn set(self, value: T) -> Result<(), Refusal> {
        if self.0.is_null() {
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, "there is no place for the answer"));
        }
        // SAFETY: not null, so it may be written, by OpenXR's contract.
        unsafe { self.0.write(value) };
        Ok(())
    }

    /// The two-call idiom: the count where nothing is asked for, otherwise all values.
    pub fn fill(self, capacity: u32, count: Out<u32>, values: Vec<T>) -> Result<(), Refusal> {
        count.set(values.len() as u32)?;
        if capacity == 0 {
            return Ok(());
        }
        if (capacity as usize) < values.len() {
            return Err(Refusal::Answer(xr::Result::ERROR_SIZE_INSUFFICIENT));
        }
        for (index, value) in values.into_iter().enumerate() {
            self.at(index).set(value)?;
        }
        Ok(())
    }

    fn at(self, index: usize) -> Self {
        if self.0.is_null() {
            return self;
        }
        // SAFETY: `fill`, `fill_typed` and `chained_each` stay below the capacity that the application told.
        Out(unsafe { self.0.add(index) })
    }
}

impl<T: Typed> Out<T> {
    fn header(self) -> Result<Header, Refusal> {
        if self.0.is_null() {
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, format!("{:?} is missing", T::TYPE)));
        }
        // SAFETY: not null, so it starts with a header that the application has filled in.
        let header = unsafe { self.0.cast::<Header>().read() };
        if header.ty == T::TYPE { Ok(header) } else { Err(mistyped::<T>(header.ty)) }
    }

    /// Writes a structure that keeps its chain.
    pub fn write(self, make: impl FnOnce(*mut std::ffi::c_void) -> T) -> Result<(), Refusal> {
        let header = self.header()?;
        self.set(make(header.next.cast()))
    }

    /// The first structure of a type in this one's chain.
    pub fn chained<U: Typed>(self) -> Result<Option<Out<U>>, Refusal> {
        let next = self.header()?.next;
        // SAFETY: the chain of a structure that the application passed in.
        Ok(unsafe { find(next, U::TYPE) }.map(|found| Out(found.cast())))
    }

    /// The structures of a type in the chains of the first `count` elements of an array, at most as many as the
    /// application has told that there are.
    pub fn chained_each<U: Typed>(self, count: u32) -> Result<Vec<Out<U>>, Refusal> {
        let found = (0..count as usize).filter_map(|index| self.at(index).chained().transpose());
        found.collect()
    }

    /// The two-call idiom for structures that keep their chains.
    pub fn fill_typed<V>(
        self,
        capacity: u32,
        count: Out<u32>,
        values: Vec<V>,
        make: impl Fn(*mut std::ffi::c_void, V) -> T,
    ) -> Result<(), Refusal> {
        count.set(values.len() as u32)?;
        if capacity == 0 {
            return Ok(());
        }
        if (capacity as usize) < values.len() {
            return Err(Refusal::Answer(xr::Result::ERROR_SIZE_INSUFFICIENT));
        }
        values.into_iter().enumerate().try_for_each(|(index, value)| self.at(index).write(|n| make(n, value)))
    }
}

impl Out<xr::EventDataBuffer> {
    /// Writes an event, which is smaller than the buffer.
    pub fn event<T: Copy>(self, event: T) -> Result<(), Refusal> {
        self.header()?;
        assert!(size_of::<T>() <= size_of::<xr::EventDataBuffer>());
        // SAFETY: the buffer is there (its header was read) and holds any event, as asserted.
        unsafe { self.0.cast::<T>().write(event) };
        Ok(())
    }
}

impl Out<xr::VisibilityMaskKHR> {
    /// Writes a mask by the two-call idiom, which here is inside the structure.
    pub fn mask(self, vertices: Vec<xr::Vector2f>, indices: Vec<u32>) -> Result<(), Refusal> {
        self.header()?;
        // SAFETY: there, of this type, and filled in by the application.
        let mask = unsafe { &mut *self.0 };
        let (points, corners) = (Out(mask.vertices), Out(mask.indices));
        points.fill(mask.vertex_capacity_input, Out(&mut mask.vertex_count_output), vertices)?;
        corners.fill(mask.index_capacity_input, Out(&mut mask.index_count_output), indices)
    }
}

impl Out<xr::HandJointLocationsEXT> {
    /// Writes where a hand's joints are into the places that the structure leads to, or that it is not seen.
    pub fn joints(
        self,
        joints: Option<[xr::HandJointLocationEXT; xr::HAND_JOINT_COUNT_EXT]>,
    ) -> Result<(), Refusal> {
        self.header()?;
        // SAFETY: there, of this type, and filled in by the application.
        let locations = unsafe { &mut *self.0 };
        if locations.joint_count as usize != xr::HAND_JOINT_COUNT_EXT {
            let told = format!("{} joints are asked for", locations.joint_count);
            return Err(wrong(xr::Result::ERROR_VALIDATION_FAILURE, told));
        }
        locations.is_active = joints.is_some().into();
        let nowhere = xr::HandJointLocationEXT {
            location_flags: xr::SpaceLocationFlags::EMPTY,
            pose: xr::Posef { orientation: xr::Quaternionf::default(), position: xr::Vector3f::default() },
            radius: f32::NAN,
        };
        let joints = joints.unwrap_or([nowhere; xr::HAND_JOINT_COUNT_EXT]);
        Out(locations.joint_locations).fill(locations.joint_count, Out(&mut 0), joints.to_vec())
    }
}

impl Out<c_char> {
    /// The same place, as an array of a length that the call promises.
    pub fn array<const N: usize>(self) -> Out<[c_char; N]> {
        Out(self.0.cast())
    }
}

impl Out<xr::SwapchainImageBaseHeader> {
    /// The same place, as Vulkan's images.
    pub fn vulkan(self) -> Out<xr::SwapchainImageVulkanKHR> {
        Out(self.0.cast())
    }
}

/// A text in an array that ends with a zero, cut where it does not fit.
pub(crate) fn characters<const N: usize>(text: &str) -> [c_char; N] {
    let mut characters = [0; N];
    for (to, from) in characters.iter_mut().zip(text.bytes().take(N - 1)) {
        *to = from as c_char;
    }
    characters
}

/// The text of such an array.
pub(crate) fn text(characters: &[c_char]) -> String {
    let bytes: Vec<u8> = characters.iter().take_while(|&&c| c != 0).map(|&c| c as u8).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}
