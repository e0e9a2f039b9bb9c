//! What the validation layers say.
#![allow(unsafe_code)]

use std::ffi::c_void;
use std::sync::{Arc, Mutex};

use ash::vk;

use super::{lock, no_device};
use crate::error::Result;

/// Messages kept of the validation layers; later ones are counted out by the length alone.
const MESSAGES_KEPT: usize = 1000;

pub(super) struct Messenger {
    pub functions: ash::ext::debug_utils::Instance,
    pub handle: vk::DebugUtilsMessengerEXT,
    pub messages: Arc<Mutex<Vec<String>>>,
}

impl Messenger {
    pub fn new(entry: &ash::Entry, instance: &ash::Instance) -> Result<Self> {
        let functions = ash::ext::debug_utils::Instance::new(entry, instance);
        let messages = Arc::new(Mutex::new(Vec::new()));
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(keep_message))
            .user_data(Arc::as_ptr(&messages).cast_mut().cast());
        // SAFETY: the extension is enabled; the user data lives in the messenger's own Arc, which is
        // dropped after the handle is destroyed.
        let handle = unsafe { functions.create_debug_utils_messenger(&info, None) }
            .map_err(|code| no_device(format!("the validation layer cannot be listened to ({code})")))?;
        Ok(Messenger { functions, handle, messages })
    }
}

/// Keeps a validation message.
///
/// # Safety
/// Called by the validation layer: `data` is valid, and `user` is the messages' mutex.
unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: by the function's contract; the message is a string that ends with a zero.
    let (messages, text) = unsafe {
        let text = (*data).message_as_c_str().map(|text| text.to_string_lossy().into_owned());
        (&*user.cast::<Mutex<Vec<String>>>(), text)
    };
    let mut messages = lock(messages);
    if messages.len() < MESSAGES_KEPT {
        messages.push(text.unwrap_or_default());
    }
    vk::FALSE
}
