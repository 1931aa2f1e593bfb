//! How long passes take, by the device's own clock.

use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

use esvo_core::DeviceKind;
use wgpu::BufferUsages as Usage;

use crate::error::DeviceError;
use crate::gpu::Gpu;

/// Two timestamps for each pass of a submission: its start and its end.
pub struct Timestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
    passes: u32,
}

/// The timestamps of a submission that is done.
#[derive(Clone, Debug)]
pub struct PassTimes {
    /// Start and end of each pass.
    ticks: Vec<[u64; 2]>,
    /// Nanoseconds.
    period: f64,
}

impl Gpu {
    /// Timestamps for this many passes, at least 1; `None` if the device has no clock.
    ///
    /// # Errors
    /// More passes than the device allows; not enough memory.
    pub fn timestamps(&self, passes: u32) -> Result<Option<Timestamps>, DeviceError> {
        if !self.has_clock() {
            return Ok(None);
        }
        let queries = self.checked(|device| {
            device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: passes.saturating_mul(2),
            })
        })?;
        let bytes = u64::from(passes) * 16;
        let resolved = self.buffer("timestamps", bytes, Usage::QUERY_RESOLVE | Usage::COPY_SRC)?;
        let staging = self.buffer("timestamps to read", bytes, Usage::MAP_READ | Usage::COPY_DST)?;
        Ok(Some(Timestamps { queries, resolved, staging, passes }))
    }

    /// Runs what `record` records, with one pass that writes the timestamps of pass 0 if it is given any, and waits. The time is that of the device's
    /// clock; without one, and on drivers that run on the processor, that from submission to the end: llvmpipe's two timestamps of a compute pass are next to
    /// each other, however long it takes.
    ///
    /// # Errors
    /// As [`submit`](Self::submit) and [`wait`](Self::wait).
    pub fn timed(
        &self,
        record: impl FnOnce(&mut wgpu::CommandEncoder, Option<&Timestamps>),
    ) -> Result<Duration, DeviceError> {
        let software = self.about().kind == DeviceKind::SoftwareGpu;
        let timestamps = if software { None } else { self.timestamps(1)? };
        let start = Instant::now();
        self.submit(|commands| {
            record(commands, timestamps.as_ref());
            if let Some(timestamps) = &timestamps {
                timestamps.resolve(commands);
            }
        })?;
        match &timestamps {
            Some(timestamps) => Ok(timestamps.read(self)?.span(0..=0)),
            None => {
                self.wait()?;
                Ok(start.elapsed())
            }
        }
    }
}

impl Timestamps {
    /// For the descriptor of compute pass number `pass`, from 0.
    pub fn compute_pass(&self, pass: u32) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        }
    }

    /// For the descriptor of render pass number `pass`, from 0.
    pub fn render_pass(&self, pass: u32) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * pass),
            end_of_pass_write_index: Some(2 * pass + 1),
        }
    }

    /// Makes the timestamps readable. Comes after the passes, in the same submission.
    pub fn resolve(&self, commands: &mut wgpu::CommandEncoder) {
        commands.resolve_query_set(&self.queries, 0..2 * self.passes, &self.resolved, 0);
        commands.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, 0, u64::from(self.passes) * 16);
    }

    /// Waits for the submission and reads its timestamps. Those of passes that were not part of it are not defined.
    ///
    /// # Errors
    /// A lost device.
    pub fn read(&self, gpu: &Gpu) -> Result<PassTimes, DeviceError> {
        let mut ticks = vec![[0; 2]; self.passes as usize];
        gpu.read_staging(&self.staging, u64::from(self.passes) * 16, |bytes| {
            bytemuck::cast_slice_mut(&mut ticks).copy_from_slice(bytes);
        })?;
        Ok(PassTimes { ticks, period: gpu.queue().get_timestamp_period().into() })
    }
}

impl PassTimes {
    /// From the start of the first of these passes to the end of the last. Zero where the clock ran backwards.
    ///
    /// # Panics
    /// A pass beyond those that there are timestamps for.
    pub fn span(&self, passes: RangeInclusive<u32>) -> Duration {
        let [start, _] = self.ticks[*passes.start() as usize];
        let [_, end] = self.ticks[*passes.end() as usize];
        Duration::from_nanos((end.saturating_sub(start) as f64 * self.period) as u64)
    }
}
