//! The Vulkan library, an instance of it, and the devices of the computer.

use std::ffi::{CStr, c_void};
use std::ops::RangeInclusive;
use std::sync::{Mutex, PoisonError};

use ash::{ext, vk};
use esvo_core::gpu::choice::{INSTALL_DRIVER, choose};
use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::{CastError, Device, DeviceKind};

use crate::subgroup;
use crate::texture::FORMAT;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of the validation layer.
type Messages = Mutex<Vec<String>>;

/// An instance; with the validation layer if `ESVO_VALIDATION=1` is set and the layer is installed.
pub(crate) struct Instance {
    pub(crate) handle: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Boxed, since the messenger holds the address.
    messages: Box<Messages>,
    /// The library. It stays loaded as long as the instance, whose functions are pointers into it.
    _entry: ash::Entry,
}

/// A device, and the properties that casting depends on.
pub(crate) struct Adapter {
    pub(crate) handle: vk::PhysicalDevice,
    pub(crate) about: Device,
    pub(crate) limits: vk::PhysicalDeviceLimits,
    /// Largest allocation in bytes.
    pub(crate) max_allocation: u64,
    /// Most rows and columns of a texture of [`FORMAT`] that the kernel reads; 0 if there cannot be one.
    pub(crate) texture_edge: u32,
    /// Sizes of subgroups that pipelines can be asked for.
    pub(crate) subgroup_sizes: Option<RangeInclusive<u32>>,
    /// First queue family with compute support.
    pub(crate) queue_family: u32,
    /// Significant bits of its timestamps; 0 if it has none.
    pub(crate) timestamp_bits: u32,
    /// Order of preference, 0 is best.
    rank: u32,
}

/// The devices of the computer, best first: discrete GPUs, others, software drivers.
///
/// # Errors
/// [`CastError::Device`]: the Vulkan library is missing or does not start. An empty list is not an error.
pub fn adapters() -> Result<Vec<Device>, CastError> {
    Ok(Instance::new()?.adapters()?.into_iter().map(|adapter| adapter.about).collect())
}

fn failed(what: &str, error: &dyn std::fmt::Display) -> CastError {
    CastError::Device(format!("{what}: {error}"))
}

impl Instance {
    pub(crate) fn new() -> Result<Self, CastError> {
        // SAFETY: the library is the system's Vulkan loader, whose initialisers may run at any time.
        let entry = unsafe { ash::Entry::load() }.map_err(|error| {
            CastError::Device(format!("the Vulkan library cannot be loaded ({error}): {INSTALL_DRIVER}"))
        })?;
        let validation = validation_is_wanted() && has_validation_layer(&entry);
        let layers = if validation { vec![VALIDATION_LAYER.as_ptr()] } else { Vec::new() };
        let extensions = if validation { vec![ext::debug_utils::NAME.as_ptr()] } else { Vec::new() };
        let application = vk::ApplicationInfo::default().application_name(c"esvo").api_version(vk::API_VERSION_1_1);
        let info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        // SAFETY: everything that `info` points to lives until the call returns.
        let handle = unsafe { entry.create_instance(&info, None) }
            .map_err(|error| failed(&format!("Vulkan does not start; {INSTALL_DRIVER}"), &error))?;
        let mut instance = Self { handle, messenger: None, messages: Box::new(Mutex::new(Vec::new())), _entry: entry };
        if validation {
            instance.listen()?;
        }
        Ok(instance)
    }

    /// Collects the messages of the validation layer.
    fn listen(&mut self) -> Result<(), CastError> {
        let functions = ext::debug_utils::Instance::new(&self._entry, &self.handle);
        let messages: *const Messages = &*self.messages;
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(collect))
            .user_data(messages.cast_mut().cast());
        // SAFETY: `user_data` points into a box that outlives the messenger: `drop` destroys the messenger first.
        let messenger = unsafe { functions.create_debug_utils_messenger(&info, None) }
            .map_err(|error| failed("the validation layer does not report", &error))?;
        self.messenger = Some((functions, messenger));
        Ok(())
    }

    /// Returns the messages of the validation layer since the last call as an error.
    pub(crate) fn check(&self) -> Result<(), CastError> {
        let said = std::mem::take(&mut *self.messages.lock().unwrap_or_else(PoisonError::into_inner));
        if said.is_empty() { Ok(()) } else { Err(CastError::Device(format!("validation: {}", said.join("\n")))) }
    }

    /// The devices with Vulkan 1.1 or later and a compute queue, best first.
    pub(crate) fn adapters(&self) -> Result<Vec<Adapter>, CastError> {
        // SAFETY: the instance is alive.
        let handles = unsafe { self.handle.enumerate_physical_devices() }
            .map_err(|error| failed(&format!("no Vulkan device; {INSTALL_DRIVER}"), &error))?;
        let mut adapters: Vec<Adapter> = handles.into_iter().filter_map(|handle| self.adapter(handle)).collect();
        adapters.sort_by_key(|adapter| adapter.rank);
        Ok(adapters)
    }

    /// The best device that the options allow.
    pub(crate) fn choose(&self, options: &GpuOptions) -> Result<Adapter, CastError> {
        let mut adapters = self.adapters()?;
        let devices: Vec<Device> = adapters.iter().map(|adapter| adapter.about.clone()).collect();
        Ok(adapters.swap_remove(choose(&devices, options.adapter.as_deref())?))
    }

    fn texture_edge(&self, handle: vk::PhysicalDevice, limits: &vk::PhysicalDeviceLimits) -> u32 {
        // SAFETY: `handle` comes from this instance.
        let (features, format) = unsafe {
            (
                self.handle.get_physical_device_features(handle),
                self.handle.get_physical_device_format_properties(handle, FORMAT),
            )
        };
        let is_there = features.shader_storage_image_extended_formats == vk::TRUE
            && format.optimal_tiling_features.contains(vk::FormatFeatureFlags::STORAGE_IMAGE);
        if is_there { limits.max_image_dimension2_d } else { 0 }
    }

    fn adapter(&self, handle: vk::PhysicalDevice) -> Option<Adapter> {
        // SAFETY: `handle` comes from this instance.
        let version = unsafe { self.handle.get_physical_device_properties(handle) }.api_version;
        if version < vk::API_VERSION_1_1 {
            return None;
        }
        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut maintenance).push_next(&mut subgroup);
        if version >= vk::API_VERSION_1_2 {
            all = all.push_next(&mut driver);
        }
        // SAFETY: the device has Vulkan 1.1, which has the call and the first two structures; the third is added only with
        // Vulkan 1.2.
        unsafe { self.handle.get_physical_device_properties2(handle, &mut all) };
        let properties = all.properties;
        // SAFETY: as before.
        let families = unsafe { self.handle.get_physical_device_queue_family_properties(handle) };
        let (queue_family, family) =
            (0u32..).zip(&families).find(|(_, family)| family.queue_flags.contains(vk::QueueFlags::COMPUTE))?;
        let text = |field: Result<&CStr, _>| field.map_or(String::new(), |name: &CStr| name.to_string_lossy().into());
        let name = text(properties.device_name_as_c_str());
        let driver = format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()));
        let (rank, kind) = match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => (0, DeviceKind::Gpu),
            vk::PhysicalDeviceType::CPU => (2, DeviceKind::SoftwareGpu),
            _ => (1, DeviceKind::Gpu),
        };
        let timing = if family.timestamp_valid_bits > 0 {
            "timed by timestamp queries"
        } else {
            "timed by wall clock around submission"
        };
        let validated = if self.messenger.is_some() { ", validated" } else { "" };
        let detail = format!(
            "ash, Vulkan {}.{}, {}, subgroups of {}, {timing}{validated}",
            vk::api_version_major(version),
            vk::api_version_minor(version),
            driver.trim(),
            subgroup.subgroup_size
        );
        Some(Adapter {
            handle,
            about: Device { name, kind, detail },
            limits: properties.limits,
            texture_edge: self.texture_edge(handle, &properties.limits),
            max_allocation: maintenance.max_memory_allocation_size,
            subgroup_sizes: subgroup::sizes(&self.handle, handle),
            queue_family,
            timestamp_bits: family.timestamp_valid_bits,
            rank,
        })
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: no object of this instance is left: `Gpu` owns the instance and drops it last.
        unsafe {
            if let Some((functions, messenger)) = self.messenger.take() {
                functions.destroy_debug_utils_messenger(messenger, None);
            }
            self.handle.destroy_instance(None);
        }
    }
}

/// Whether `ESVO_VALIDATION` is 1, or is not set and the program checks its own assertions.
fn validation_is_wanted() -> bool {
    std::env::var_os("ESVO_VALIDATION").map_or(cfg!(debug_assertions), |value| value == "1")
}

fn has_validation_layer(entry: &ash::Entry) -> bool {
    // SAFETY: the library is loaded.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.unwrap_or_default();
    layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER))
}

/// The callback of the messenger: stores the message.
///
/// # Safety
/// `user` points to the [`Messages`] of a living instance.
unsafe extern "system" fn collect(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes a message that is valid during the call, or null.
    let text = unsafe { data.as_ref().and_then(|data| data.message_as_c_str()) };
    // SAFETY: the caller promises that `user` points to the messages of a living instance.
    if let (Some(text), Some(messages)) = (text, unsafe { user.cast::<Messages>().as_ref() }) {
        messages.lock().unwrap_or_else(PoisonError::into_inner).push(text.to_string_lossy().into_owned());
    }
    vk::FALSE
}
