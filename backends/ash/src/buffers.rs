//! Buffers. Each has its own memory allocation.

use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;
use esvo_core::CastError;

use crate::gpu::Gpu;

/// Kinds of memory for the device, the one that it reads fastest first.
pub(crate) const ON_DEVICE: [vk::MemoryPropertyFlags; 2] =
    [vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::empty()];
/// Kinds of memory that the processor reads and writes, the best first: cached, since the processor reads results from it.
const ON_HOST: [vk::MemoryPropertyFlags; 2] = [
    vk::MemoryPropertyFlags::from_raw(
        vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
            | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw()
            | vk::MemoryPropertyFlags::HOST_CACHED.as_raw(),
    ),
    vk::MemoryPropertyFlags::from_raw(
        vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw() | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw(),
    ),
];

/// A buffer and its memory.
pub(crate) struct Buffer {
    pub(crate) handle: vk::Buffer,
    pub(crate) bytes: u64,
    memory: vk::DeviceMemory,
    /// Address at which the processor sees the memory; null for a buffer on the device.
    address: *mut u8,
    gpu: Arc<Gpu>,
}

// SAFETY: the address points to memory that this value owns and that is reached only through references to this value.
unsafe impl Send for Buffer {}

impl Buffer {
    /// Makes a buffer in the memory of the device.
    pub(crate) fn on_device(gpu: &Arc<Gpu>, bytes: u64, usage: vk::BufferUsageFlags) -> Result<Self, CastError> {
        Self::new(gpu, bytes, usage, &ON_DEVICE)
    }

    /// Makes a buffer that the processor reads and writes too.
    pub(crate) fn on_host(gpu: &Arc<Gpu>, bytes: u64, usage: vk::BufferUsageFlags) -> Result<Self, CastError> {
        let mut buffer = Self::new(gpu, bytes, usage, &ON_HOST)?;
        // SAFETY: the memory is visible to the host and not mapped yet.
        let address = unsafe { gpu.device.map_memory(buffer.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()) };
        buffer.address = address.map_err(|error| gpu.error(&error))?.cast();
        Ok(buffer)
    }

    fn new(
        gpu: &Arc<Gpu>,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        kinds: &[vk::MemoryPropertyFlags],
    ) -> Result<Self, CastError> {
        let bytes = bytes.max(4);
        let failed = |error: vk::Result| gpu.error(&format!("cannot make a buffer of {bytes} bytes ({error})"));
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        // SAFETY: the device is alive.
        let handle = unsafe { gpu.device.create_buffer(&info, None) }.map_err(failed)?;
        let mut buffer =
            Self { handle, bytes, memory: vk::DeviceMemory::null(), address: std::ptr::null_mut(), gpu: gpu.clone() };
        // SAFETY: the buffer was just made.
        let needs = unsafe { gpu.device.get_buffer_memory_requirements(handle) };
        buffer.memory = allocate(gpu, &needs, kinds).map_err(failed)?;
        // SAFETY: the memory suits the buffer and is bound once, to a buffer that has none.
        unsafe { gpu.device.bind_buffer_memory(handle, buffer.memory, 0) }.map_err(failed)?;
        Ok(buffer)
    }

    /// The bytes of a buffer on the host; empty for a buffer on the device.
    pub(crate) fn contents(&mut self) -> &mut [u8] {
        if self.address.is_null() {
            return &mut [];
        }
        // SAFETY: the mapping covers the buffer and lasts as long as the buffer; the memory is coherent; the device is
        // idle whenever a caster can reach its buffers, since every submission is waited for.
        unsafe { std::slice::from_raw_parts_mut(self.address, self.bytes as usize) }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: every submission is waited for, so the device no longer uses the buffer. Freeing unmaps.
        unsafe {
            self.gpu.device.destroy_buffer(self.handle, None);
            self.gpu.device.free_memory(self.memory, None);
        }
    }
}

/// Memory of the first of these kinds that suits `needs`. The error is `ERROR_FEATURE_NOT_PRESENT` if the device has none.
pub(crate) fn allocate(
    gpu: &Gpu,
    needs: &vk::MemoryRequirements,
    kinds: &[vk::MemoryPropertyFlags],
) -> Result<vk::DeviceMemory, vk::Result> {
    let types = &gpu.memory.memory_types[..gpu.memory.memory_type_count as usize];
    let find = |kind: vk::MemoryPropertyFlags| {
        (0u32..)
            .zip(types)
            .find(|(index, memory)| needs.memory_type_bits >> index & 1 != 0 && memory.property_flags.contains(kind))
    };
    let (index, _) = kinds.iter().find_map(|&kind| find(kind)).ok_or(vk::Result::ERROR_FEATURE_NOT_PRESENT)?;
    let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index);
    // SAFETY: the device is alive and has the memory type.
    unsafe { gpu.device.allocate_memory(&info, None) }
}

/// Copies `data` to the start of a buffer with usage `TRANSFER_DST`, in pieces as large as `staging`, a buffer on the host.
pub(crate) fn fill<T: Pod>(gpu: &Gpu, buffer: &Buffer, data: &[T], staging: &mut Buffer) -> Result<(), CastError> {
    let data: &[u8] = bytemuck::cast_slice(data);
    // Copies start at multiples of four bytes.
    let piece_bytes = (staging.bytes as usize / 4 * 4).max(4);
    for (piece, offset) in data.chunks(piece_bytes).zip((0u64..).step_by(piece_bytes)) {
        staging.contents()[..piece.len()].copy_from_slice(piece);
        let copy = [vk::BufferCopy { src_offset: 0, dst_offset: offset, size: piece.len() as u64 }];
        gpu.run(|device, commands| {
            // SAFETY: the piece lies within both buffers, which outlive the submission.
            unsafe { device.cmd_copy_buffer(commands, staging.handle, buffer.handle, &copy) };
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use esvo_core::gpu::kernel::GpuOptions;

    use super::*;

    /// The device; `None` without one, unless the environment variable `ESVO_REQUIRE_GPU` demands one.
    fn gpu() -> Option<Arc<Gpu>> {
        match Gpu::open(&GpuOptions::default()) {
            Ok(gpu) => Some(Arc::new(gpu)),
            Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => {
                eprintln!("skipped: {error}");
                None
            }
        }
    }

    #[test]
    fn uploads_arrive_piece_by_piece() {
        let Some(gpu) = gpu() else { return };
        let slots: Vec<u64> = (0..1000).map(|i| i * 0x1_0000_0001).collect();
        let mut staging = Buffer::on_host(&gpu, 24, vk::BufferUsageFlags::TRANSFER_SRC).expect("is made");
        let usage = vk::BufferUsageFlags::TRANSFER_DST | vk::BufferUsageFlags::TRANSFER_SRC;
        let copy = |from: &Buffer, to: &Buffer| {
            let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: 8000 }];
            // SAFETY: both buffers have 8000 bytes and outlive the submission.
            gpu.run(|device, commands| unsafe { device.cmd_copy_buffer(commands, from.handle, to.handle, &region) })
        };
        let there = Buffer::on_device(&gpu, 8000, usage).expect("is made");
        fill(&gpu, &there, &slots, &mut staging).expect("uploads");
        let mut back = Buffer::on_host(&gpu, 8000, vk::BufferUsageFlags::TRANSFER_DST).expect("is made");
        copy(&there, &back).expect("copies");
        assert_eq!(back.contents(), bytemuck::cast_slice::<u64, u8>(&slots));
    }

    #[test]
    fn impossible_sizes_are_errors() {
        let Some(gpu) = gpu() else { return };
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        if !gpu.about().detail.contains("validated") {
            assert!(Buffer::on_device(&gpu, 1 << 62, usage).is_err());
            Buffer::on_device(&gpu, 64, usage).expect("the device still works");
        }
    }

    #[test]
    fn what_the_validation_layer_says_is_an_error() {
        let Some(gpu) = gpu() else { return };
        if !gpu.about().detail.contains("validated") {
            eprintln!("skipped: the validation layer is missing, or not wanted");
            return;
        }
        let _ = Buffer::on_device(&gpu, 64, vk::BufferUsageFlags::empty());
        assert!(gpu.check().is_err(), "a buffer without any usage");
        assert!(gpu.check().is_ok(), "each message is returned once");
    }
}
