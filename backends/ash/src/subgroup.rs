//! Subgroups of a demanded size.

use std::ops::RangeInclusive;

use ash::{ext, vk};

/// Most invocations of the workgroups that this crate dispatches.
const MOST_INVOCATIONS: u32 = 256;

/// The sizes of subgroups that compute pipelines of a device can be asked for; `None` if it cannot be asked for any.
pub(crate) fn sizes(instance: &ash::Instance, device: vk::PhysicalDevice) -> Option<RangeInclusive<u32>> {
    // SAFETY: the device is of this instance.
    let extensions = unsafe { instance.enumerate_device_extension_properties(device) }.unwrap_or_default();
    let is_there = |extension: &vk::ExtensionProperties| {
        extension.extension_name_as_c_str() == Ok(ext::subgroup_size_control::NAME)
    };
    if !extensions.iter().any(is_there) {
        return None;
    }
    let mut feature = vk::PhysicalDeviceSubgroupSizeControlFeatures::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut feature);
    let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut sizes);
    // SAFETY: the caller's devices have Vulkan 1.1, which has the calls, and this one the extension with the structures.
    unsafe {
        instance.get_physical_device_features2(device, &mut features);
        instance.get_physical_device_properties2(device, &mut properties);
    }
    let can = feature.subgroup_size_control == vk::TRUE
        && sizes.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE);
    let least = sizes.min_subgroup_size.max(MOST_INVOCATIONS.div_ceil(sizes.max_compute_workgroup_subgroups.max(1)));
    (can && least <= sizes.max_subgroup_size).then_some(least..=sizes.max_subgroup_size)
}

/// Whether pipelines can be asked for subgroups of this size.
///
/// # Errors
/// They cannot; which sizes there are.
pub(crate) fn check(size: u32, sizes: Option<&RangeInclusive<u32>>) -> Result<(), String> {
    match sizes {
        Some(sizes) if sizes.contains(&size) && size.is_power_of_two() => Ok(()),
        Some(sizes) => Err(format!(
            "subgroups of {size}: expected a power of two from {} to {}, as the driver has them",
            sizes.start(),
            sizes.end()
        )),
        None => Err(format!("subgroups of {size}: the driver cannot be asked for a size")),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn sizes_that_the_driver_does_not_have_are_refused() {
        assert_eq!(check(16, Some(&(8..=32))), Ok(()));
        for size in [0, 4, 12, 64] {
            assert!(check(size, Some(&(8..=32))).expect_err("refused").contains("from 8 to 32"));
        }
        assert!(check(32, None).expect_err("refused").contains("cannot be asked"));
    }
}
