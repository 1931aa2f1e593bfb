//! Buffers: making, filling, reading.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytemuck::Pod;
use wgpu::BufferUsages as Usage;

use crate::error::DeviceError;
use crate::gpu::Gpu;

/// Data is copied in pieces of this many bytes, so that staging memory stays small.
const PIECE_BYTES: usize = 64 << 20;
/// How long another thread may take to deliver a buffer after the device is done.
const DELIVERY: Duration = Duration::from_secs(10);

impl Gpu {
    /// Makes a buffer of `size` bytes, filled with zeros.
    ///
    /// # Errors
    /// [`DeviceError::TooLarge`]: more than the device allows in a buffer or, of a storage buffer, in a binding;
    /// [`DeviceError::OutOfMemory`].
    pub fn buffer(&self, label: &str, size: u64, usage: Usage) -> Result<wgpu::Buffer, DeviceError> {
        let storage = usage.contains(Usage::STORAGE);
        let limit = if storage { self.max_storage_bytes() } else { self.limits().max_buffer_size };
        if size > limit {
            let device = self.about().name.clone();
            return Err(DeviceError::TooLarge { device, buffer: label.into(), bytes: size, limit });
        }
        let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        self.checked(|device| device.create_buffer(&descriptor))
    }

    /// Makes a buffer with this data. Its size is rounded up to a multiple of 4 bytes, and at least 4, since a binding
    /// cannot be empty; the rest is zero.
    ///
    /// # Errors
    /// As [`buffer`](Self::buffer), before anything is copied; a lost device.
    pub fn upload<T: Pod>(&self, label: &str, data: &[T], usage: Usage) -> Result<wgpu::Buffer, DeviceError> {
        let data: &[u8] = bytemuck::cast_slice(data);
        let size = (data.len() as u64).next_multiple_of(4).max(4);
        let buffer = self.buffer(label, size, usage | Usage::COPY_DST)?;
        self.fill(&buffer, data)?;
        Ok(buffer)
    }

    /// Writes this data to the start of a buffer with usage `COPY_DST`, in pieces, so that staging memory stays small. Its number
    /// of bytes is rounded up to a multiple of 4; the rest is zero.
    ///
    /// # Errors
    /// More than the buffer holds, or a buffer without that usage; a lost device.
    pub fn fill<T: Pod>(&self, buffer: &wgpu::Buffer, data: &[T]) -> Result<(), DeviceError> {
        let data: &[u8] = bytemuck::cast_slice(data);
        let (whole, rest) = data.split_at(data.len() - data.len() % 4);
        for (piece, at) in whole.chunks(PIECE_BYTES).zip((0..).step_by(PIECE_BYTES)) {
            self.write_now(buffer, at, piece)?;
        }
        if !rest.is_empty() {
            let mut word = [0; 4];
            word[..rest.len()].copy_from_slice(rest);
            self.write_now(buffer, whole.len() as u64, &word)?;
        }
        self.check()
    }

    /// Writes to a buffer with usage `COPY_DST` from byte `at` on, before the next submission. `at` and the number of bytes
    /// are multiples of 4. Does not wait.
    ///
    /// # Errors
    /// On a device of the program: bytes outside of the buffer, a buffer without that usage, not enough memory for the copy.
    /// On a device that was opened here, the next [`submit`](Self::submit) or [`check`](Self::check) returns these.
    pub fn write(&self, buffer: &wgpu::Buffer, at: u64, bytes: &[u8]) -> Result<(), DeviceError> {
        self.caught(|_| self.queue().write_buffer(buffer, at, bytes))
    }

    /// Writes and waits, so that the memory of the copy is free again.
    fn write_now(&self, buffer: &wgpu::Buffer, at: u64, bytes: &[u8]) -> Result<(), DeviceError> {
        self.caught(|_| {
            self.queue().write_buffer(buffer, at, bytes);
            self.queue().submit([]);
        })?;
        self.wait()
    }

    /// The first `count` values of a buffer with usage `COPY_SRC`, through a staging buffer made for this call.
    ///
    /// # Errors
    /// More than the buffer holds, or a buffer without that usage; a lost device.
    pub fn read<T: Pod>(&self, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, DeviceError> {
        let mut values = vec![T::zeroed(); count];
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut values);
        if bytes.is_empty() {
            return Ok(values);
        }
        let size = (bytes.len() as u64).next_multiple_of(4);
        if size > buffer.size() {
            let (wanted, there) = (bytes.len(), buffer.size());
            return Err(self.error(format!("{wanted} bytes were asked for of a buffer of {there} bytes")));
        }
        let staging = self.buffer("to read", size, Usage::MAP_READ | Usage::COPY_DST)?;
        self.submit(|commands| commands.copy_buffer_to_buffer(buffer, 0, &staging, 0, size))?;
        self.read_staging(&staging, size, |from| bytes.copy_from_slice(&from[..bytes.len()]))?;
        Ok(values)
    }

    /// Waits for what was submitted and gives the first `bytes` bytes of a buffer with usage `MAP_READ`, a multiple of 4,
    /// to `take`. For programs that read often and keep the staging buffer.
    ///
    /// # Errors
    /// A buffer that cannot be mapped; a lost device.
    pub fn read_staging(
        &self,
        staging: &wgpu::Buffer,
        bytes: u64,
        take: impl FnOnce(&[u8]),
    ) -> Result<(), DeviceError> {
        let reading = self.begin_reading(staging, bytes)?;
        self.wait()?;
        // A thread that waits for the device takes what is ready for all of them, and may still be about to deliver it.
        let deadline = Instant::now() + DELIVERY;
        while !reading.has_arrived() && Instant::now() < deadline {
            std::thread::yield_now();
        }
        self.finish_reading(staging, &reading, take)?.ok_or_else(|| self.error("the device did not deliver the buffer"))
    }

    /// Asks for the first `bytes` bytes of a buffer with usage `MAP_READ`, a multiple of 4, and does not wait. For
    /// [`finish_reading`](Self::finish_reading).
    ///
    /// # Errors
    /// On a device of the program: a buffer that cannot be mapped; a lost device. On a device that was opened here, `wait` and
    /// `finish_reading` return these.
    pub fn begin_reading(&self, staging: &wgpu::Buffer, bytes: u64) -> Result<Reading, DeviceError> {
        let reading = Reading { bytes, result: Arc::new(Mutex::new(None)) };
        let store = reading.result.clone();
        self.caught(|_| {
            staging.map_async(wgpu::MapMode::Read, ..bytes, move |mapped| {
                *store.lock().unwrap_or_else(PoisonError::into_inner) = Some(mapped);
            });
        })?;
        Ok(reading)
    }

    /// Gives the bytes of a buffer to `take` if they have arrived, and returns what it returns; `None` if they have not. The
    /// device delivers them while it is [polled](Self::poll) or waited for.
    ///
    /// # Errors
    /// A buffer that cannot be mapped; a lost device.
    pub fn finish_reading<T>(
        &self,
        staging: &wgpu::Buffer,
        reading: &Reading,
        take: impl FnOnce(&[u8]) -> T,
    ) -> Result<Option<T>, DeviceError> {
        match reading.result.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(Ok(())) => {}
            Some(Err(error)) => return Err(self.error(error)),
            None => return Ok(None),
        }
        let view = staging.get_mapped_range(..reading.bytes).map_err(|error| self.error(error))?;
        let taken = take(&view);
        drop(view);
        staging.unmap();
        Ok(Some(taken))
    }
}

/// Bytes that were asked for by [`Gpu::begin_reading`].
pub struct Reading {
    bytes: u64,
    result: Arc<Mutex<Option<Result<(), wgpu::BufferAsyncError>>>>,
}

impl Reading {
    fn has_arrived(&self) -> bool {
        self.result.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }
}
