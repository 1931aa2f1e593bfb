//! An open device: queue, command buffer, timestamps.

use std::time::Duration;

use ash::{ext, vk};
use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::{CastError, Device};

use crate::instance::{Adapter, Instance};
use crate::subgroup;

/// Timestamps: start and end of the coarse pass, start and end of the main pass.
pub(crate) const TIMESTAMPS: u32 = 4;

/// A device with one queue, one command buffer and one fence. It runs one submission at a time and waits for it.
///
/// Every object made from the device holds an `Arc` of it, so that the device is destroyed last.
pub(crate) struct Gpu {
    pub(crate) device: ash::Device,
    pub(crate) adapter: Adapter,
    pub(crate) memory: vk::PhysicalDeviceMemoryProperties,
    /// Of all pipelines, if a size was demanded.
    pub(crate) subgroup_size: Option<u32>,
    queue: vk::Queue,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    /// `None` if the queue has no timestamps.
    pub(crate) queries: Option<vk::QueryPool>,
    /// The last field: it is dropped after `drop` has destroyed the device.
    instance: Instance,
}

impl Gpu {
    pub(crate) fn open(options: &GpuOptions) -> Result<Self, CastError> {
        let instance = Instance::new()?;
        let adapter = instance.choose(options)?;
        let failed = |error: vk::Result| CastError::Device(format!("{}: {error}", adapter.about.name));
        let queues =
            [vk::DeviceQueueCreateInfo::default().queue_family_index(adapter.queue_family).queue_priorities(&[1.0])];
        let features =
            vk::PhysicalDeviceFeatures::default().shader_storage_image_extended_formats(adapter.texture_edge > 0);
        let mut subgroups = vk::PhysicalDeviceSubgroupSizeControlFeatures::default().subgroup_size_control(true);
        let extensions = [ext::subgroup_size_control::NAME.as_ptr()];
        let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&features);
        if let Some(size) = options.subgroup_size {
            subgroup::check(size, adapter.subgroup_sizes.as_ref())
                .map_err(|what| CastError::Device(format!("{}: {what}", adapter.about.name)))?;
            info = info.enabled_extension_names(&extensions).push_next(&mut subgroups);
        }
        // SAFETY: the adapter is of this instance and has the queue family; `info` lives until the call returns.
        let device = unsafe { instance.handle.create_device(adapter.handle, &info, None) }.map_err(failed)?;
        // SAFETY: as above.
        let memory = unsafe { instance.handle.get_physical_device_memory_properties(adapter.handle) };
        // SAFETY: the device was created with one queue of this family.
        let queue = unsafe { device.get_device_queue(adapter.queue_family, 0) };
        let mut gpu = Self {
            device,
            adapter,
            memory,
            subgroup_size: options.subgroup_size,
            queue,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            queries: None,
            instance,
        };
        gpu.prepare().map_err(|error| gpu.error(&error))?;
        gpu.instance.check()?;
        Ok(gpu)
    }

    fn prepare(&mut self) -> Result<(), vk::Result> {
        let pool = vk::CommandPoolCreateInfo::default()
            .queue_family_index(self.adapter.queue_family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device is alive. `drop` destroys every object, also if a later step fails.
        unsafe {
            self.pool = self.device.create_command_pool(&pool, None)?;
            let buffers = vk::CommandBufferAllocateInfo::default().command_pool(self.pool).command_buffer_count(1);
            self.commands = self.device.allocate_command_buffers(&buffers)?.first().copied().unwrap_or_default();
            self.fence = self.device.create_fence(&vk::FenceCreateInfo::default(), None)?;
            if self.adapter.timestamp_bits > 0 {
                let info =
                    vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(TIMESTAMPS);
                self.queries = Some(self.device.create_query_pool(&info, None)?);
            }
        }
        Ok(())
    }

    pub(crate) fn about(&self) -> &Device {
        &self.adapter.about
    }

    /// Bytes of the largest heap of memory of its own; `None` without one.
    pub(crate) fn memory_bytes(&self) -> Option<u64> {
        let heaps = &self.memory.memory_heaps[..self.memory.memory_heap_count as usize];
        let own = heaps.iter().filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        own.map(|heap| heap.size).max()
    }

    /// An error of this device.
    pub(crate) fn error(&self, what: &dyn std::fmt::Display) -> CastError {
        CastError::Device(format!("{}: {what}", self.adapter.about.name))
    }

    /// Records commands, submits them, and waits until they are done.
    ///
    /// `record` gets the command buffer in the recording state and must only use objects of this device that live until
    /// this call returns.
    pub(crate) fn run(&self, record: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<(), CastError> {
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let commands = [self.commands];
        let submits = [vk::SubmitInfo::default().command_buffers(&commands)];
        // SAFETY: the command buffer is not in use, since every submission is waited for below; after a failed wait the
        // device is lost and every call fails. A `Gpu` is reached only through the `&mut` of its caster, so no other
        // thread uses queue, pool or fence.
        let result = unsafe {
            (|| {
                self.device.begin_command_buffer(self.commands, &begin)?;
                record(&self.device, self.commands);
                self.device.end_command_buffer(self.commands)?;
                self.device.reset_fences(&[self.fence])?;
                self.device.queue_submit(self.queue, &submits, self.fence)?;
                self.device.wait_for_fences(&[self.fence], true, u64::MAX)
            })()
        };
        result.map_err(|error: vk::Result| self.error(&error))?;
        self.check()
    }

    /// Returns the messages of the validation layer as an error.
    pub(crate) fn check(&self) -> Result<(), CastError> {
        self.instance.check()
    }

    /// Time between two timestamps, `first` and `last`, of the last submission.
    pub(crate) fn between(&self, queries: vk::QueryPool, first: u32, last: u32) -> Result<Duration, CastError> {
        let read = |query| {
            let mut ticks = [0u64];
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            // SAFETY: the pool has the query, and the submission that wrote it is done.
            unsafe { self.device.get_query_pool_results(queries, query, &mut ticks, flags) }
                .map_err(|error| self.error(&error))?;
            Ok::<u64, CastError>(ticks[0])
        };
        let mask = u64::MAX >> (64 - self.adapter.timestamp_bits.min(64));
        // The counter may have wrapped around between the two.
        let ticks = read(last)?.wrapping_sub(read(first)?) & mask;
        Ok(Duration::from_nanos((ticks as f64 * f64::from(self.adapter.limits.timestamp_period)) as u64))
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // SAFETY: every object made from the device held an `Arc` of it, so all are gone; nothing runs once the device is
        // idle.
        unsafe {
            // If waiting fails, the device is lost, and a lost device may be destroyed.
            let _ = self.device.device_wait_idle();
            if let Some(queries) = self.queries {
                self.device.destroy_query_pool(queries, None);
            }
            self.device.destroy_fence(self.fence, None);
            self.device.destroy_command_pool(self.pool, None);
            self.device.destroy_device(None);
        }
    }
}
