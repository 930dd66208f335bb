//! Collects the validation layer's messages: tests fail on any.

use parking_lot::Mutex;
use std::ffi::{CStr, c_void};

use ash::{ext::debug_utils, vk};

use crate::GpuError;
use crate::error::During as _;

/// The Khronos layer that checks every call.
pub(crate) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Collects warnings and errors for as long as it lives.
pub(crate) struct Messenger {
    loader: debug_utils::Instance,
    handle: vk::DebugUtilsMessengerEXT,
    // Boxed: the driver holds its address.
    messages: Box<Messages>,
}

type Messages = Mutex<Vec<String>>;

impl Messenger {
    /// Starts to collect. `instance` was made with the debug-utils extension.
    pub(crate) fn new(entry: &ash::Entry, instance: &ash::Instance) -> Result<Self, GpuError> {
        let messages: Box<Messages> = Box::default();
        let loader = debug_utils::Instance::new(entry, instance);
        let user_data: *const Messages = &raw const *messages;
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                    | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(collect))
            .user_data(user_data.cast_mut().cast());
        // SAFETY: the instance is alive and has the extension; the user data is a `Messages` at a stable
        // address that outlives the messenger, which `Drop` destroys first.
        let handle = unsafe { loader.create_debug_utils_messenger(&info, None) }
            .during("listening to the validation layer")?;
        Ok(Self { loader, handle, messages })
    }

    /// All messages so far.
    pub(crate) fn messages(&self) -> Vec<String> {
        self.messages.lock().clone()
    }
}

impl Drop for Messenger {
    fn drop(&mut self) {
        // SAFETY: the handle is ours and destroyed once; the instance is alive, for `Gpu` drops its messenger
        // before it.
        unsafe { self.loader.destroy_debug_utils_messenger(self.handle, None) };
    }
}

/// The callback the layer calls, on whichever thread made the offending call.
unsafe extern "system" fn collect(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes either null or a pointer that is valid for the call
    // (VUID-PFN_vkDebugUtilsMessengerCallbackEXT).
    let text = unsafe { data.as_ref() }
        // SAFETY: the message is null-terminated UTF-8 and lives through the call; `message_as_c_str` checks
        // for null.
        .and_then(|data| unsafe { data.message_as_c_str() })
        .map_or_else(|| "a message without text".to_owned(), |text| text.to_string_lossy().into_owned());
    // SAFETY: the user data is the `Messages` that `Messenger::new` registered, alive until after the
    // messenger is destroyed.
    if let Some(messages) = unsafe { user_data.cast::<Messages>().as_ref() } {
        messages.lock().push(text);
    }
    vk::FALSE // do not abort the call
}
