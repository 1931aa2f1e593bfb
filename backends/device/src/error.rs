//! What can go wrong with a device.

use esvo_core::CastError;

/// Why a device could not be opened or did not do what it was asked for.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DeviceError {
    /// The computer has no device, or none of the wanted name. The text says what to install, or which there are.
    #[error("{0}")]
    NotFound(String),
    /// The driver refuses to open the device.
    #[error("{device}: the driver does not open the device: {message}")]
    NotOpened {
        /// Name of the device.
        device: String,
        /// What the driver reports.
        message: String,
    },
    /// A buffer over the limit of the device. Nothing was made or copied.
    #[error("{device}: the buffer \"{buffer}\" needs {bytes} bytes, the device allows {limit}")]
    TooLarge {
        /// Name of the device.
        device: String,
        /// Label of the buffer.
        buffer: String,
        /// Size of the buffer.
        bytes: u64,
        /// Largest size that the device allows for its usage.
        limit: u64,
    },
    /// The device has not enough free memory.
    #[error("{device}: not enough memory on the device")]
    OutOfMemory {
        /// Name of the device.
        device: String,
    },
    /// A shader, object or command that breaks a rule of WebGPU, or that the driver refuses.
    #[error("{device}: {message}")]
    Invalid {
        /// Name of the device.
        device: String,
        /// What wgpu or the driver reports; of a shader, with the line.
        message: String,
    },
    /// The device stopped working: it was destroyed, its driver failed or was reset.
    #[error("{device}: the device is lost ({message}); open it again")]
    Lost {
        /// Name of the device.
        device: String,
        /// What the driver reports.
        message: String,
    },
}

impl DeviceError {
    /// An error that wgpu reports.
    pub(crate) fn reported(device: &str, error: &wgpu::Error) -> Self {
        let device = device.to_owned();
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::OutOfMemory { device },
            wgpu::Error::Validation { .. } | wgpu::Error::Internal { .. } => {
                Self::Invalid { device, message: error.to_string() }
            }
        }
    }
}

/// For casters: the same text.
impl From<DeviceError> for CastError {
    fn from(error: DeviceError) -> Self {
        Self::Device(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reports_are_told_apart() {
        let source = || Box::new(std::fmt::Error);
        let memory = DeviceError::reported("Example GPU", &wgpu::Error::OutOfMemory { source: source() });
        assert_eq!(memory, DeviceError::OutOfMemory { device: "Example GPU".into() });
        let description = "no such entry".to_owned();
        let invalid = wgpu::Error::Validation { source: source(), description };
        let invalid = DeviceError::reported("Example GPU", &invalid);
        assert_eq!(invalid.to_string(), "Example GPU: no such entry");
        assert!(matches!(invalid.into(), CastError::Device(text) if text == "Example GPU: no such entry"));
    }
}
