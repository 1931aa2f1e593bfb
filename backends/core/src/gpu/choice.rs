//! Which of a computer's GPUs an engine takes.

use crate::{CastError, Device};

/// Index of the first device whose name contains `name`, whatever its case; with `None`, of the first. `devices` are in
/// order of preference.
///
/// # Errors
/// [`CastError::Device`]: without devices, the text says what to install; without one of that name, which there are.
pub fn choose(devices: &[Device], name: Option<&str>) -> Result<usize, CastError> {
    if devices.is_empty() {
        return Err(CastError::Device(format!("no Vulkan device was found: {INSTALL_DRIVER}")));
    }
    let wanted = name.unwrap_or_default().to_lowercase();
    devices.iter().position(|device| device.name.to_lowercase().contains(&wanted)).ok_or_else(|| {
        let names: Vec<_> = devices.iter().map(|device| device.name.as_str()).collect();
        CastError::Device(format!(
            "no Vulkan device has {:?} in its name; there are: {}",
            name.unwrap_or_default(),
            names.join(", ")
        ))
    })
}

/// What to do where no device is found.
pub const INSTALL_DRIVER: &str = "install the driver of the GPU, or a driver that runs on the processor (Debian: mesa-vulkan-drivers and libvulkan1)";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceKind;

    #[test]
    fn devices_are_chosen_by_a_part_of_their_name() {
        let device = |name: &str| Device { name: name.into(), kind: DeviceKind::Gpu, detail: String::new() };
        let devices = [device("Example GPU 1"), device("Example GPU 2"), device("other")];
        let index = |name| choose(&devices, name).ok();
        assert_eq!([index(None), index(Some("gpu 2")), index(Some("OTHER"))], [Some(0), Some(1), Some(2)]);
        let error = choose(&devices, Some("GPU 3")).expect_err("no such device").to_string();
        assert_eq!(error, "no Vulkan device has \"GPU 3\" in its name; there are: Example GPU 1, Example GPU 2, other");
        assert!(choose(&[], None).expect_err("no device").to_string().contains("mesa-vulkan-drivers"));
    }
}
