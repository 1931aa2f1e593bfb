//! How long one pass takes on the device.

use std::time::{Duration, Instant};

use esvo_core::DeviceKind;
use esvo_device::wgpu::CommandEncoder;
use esvo_device::{DeviceError, Gpu, Timestamps};

/// Runs what `record` records, with one pass that writes timestamps, and waits. The time is that of the device's clock; without one, and on drivers
/// that run on the processor, whose timestamps of a pass lie next to each other, that of the submission.
pub(crate) fn timed(
    gpu: &Gpu,
    record: impl FnOnce(&mut CommandEncoder, Option<&Timestamps>),
) -> Result<Duration, DeviceError> {
    let software = gpu.about().kind == DeviceKind::SoftwareGpu;
    let timestamps = if software { None } else { gpu.timestamps(1)? };
    let start = Instant::now();
    gpu.submit(|commands| {
        record(commands, timestamps.as_ref());
        if let Some(timestamps) = &timestamps {
            timestamps.resolve(commands);
        }
    })?;
    match &timestamps {
        Some(timestamps) => Ok(timestamps.read(gpu)?.span(0..=0)),
        None => {
            gpu.wait()?;
            Ok(start.elapsed())
        }
    }
}
