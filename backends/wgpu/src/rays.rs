//! Lists of rays: their buffers, and a way to cast them that does not wait.

use std::collections::VecDeque;
use std::sync::Arc;

use esvo_core::gpu::kernel::{self, Pass, WORKGROUP};
use esvo_core::gpu::resident::SlotMap;
use esvo_core::{CastError, Hit, Ray, View};
use esvo_device::{DeviceError, Gpu, Reading, Usage, storage, uniform};

/// Buffers for the rays of one dispatch.
pub(crate) struct RayBuffers {
    /// Most rays.
    capacity: usize,
    view: wgpu::Buffer,
    rays: wgpu::Buffer,
    out: wgpu::Buffer,
    staging: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// Fewest rays that buffers are made for.
const SMALLEST: usize = 1 << 10;
/// Most sets of buffers that wait for more rays.
const MOST_SPARE: usize = 2;

/// Layout of group 0.
pub(crate) fn layout(gpu: &Gpu) -> Result<wgpu::BindGroupLayout, CastError> {
    let entries =
        [uniform(kernel::BINDING_VIEW), storage(kernel::BINDING_RAYS, true), storage(kernel::BINDING_OUT, false)];
    Ok(gpu.bind_group_layout("rays", &entries)?)
}

impl RayBuffers {
    /// Buffers for `count` rays at least, at most `most`: from `spare`, else new ones.
    pub(crate) fn take(gpu: &Gpu, spare: &mut Vec<Self>, count: usize, most: usize) -> Result<Self, CastError> {
        // Those that are too small are in the way of larger ones.
        spare.retain(|buffers| buffers.capacity >= count);
        if let Some(buffers) = spare.pop() {
            return Ok(buffers);
        }
        let capacity = count.next_power_of_two().max(SMALLEST).min(most);
        let bytes = |size: usize| (capacity * size) as u64;
        let view = gpu.buffer("view of rays", size_of::<View>() as u64, Usage::UNIFORM | Usage::COPY_DST)?;
        let rays = gpu.buffer("rays", bytes(size_of::<Ray>()), Usage::STORAGE | Usage::COPY_DST)?;
        let out = gpu.buffer("hits of rays", bytes(size_of::<Hit>()), Usage::STORAGE | Usage::COPY_SRC)?;
        let staging = gpu.buffer("hits to read", bytes(size_of::<Hit>()), Usage::MAP_READ | Usage::COPY_DST)?;
        let group = gpu.bind_group(&layout(gpu)?, &[&view, &rays, &out])?;
        Ok(Self { capacity, view, rays, out, staging, group })
    }

    /// Submits rays that fit the buffers, and asks for the hits.
    pub(crate) fn submit(
        self,
        gpu: &Gpu,
        pipeline: &wgpu::ComputePipeline,
        octree: &wgpu::BindGroup,
        root: u32,
        rays: &[Ray],
    ) -> Result<Batch, CastError> {
        let count = rays.len() as u32;
        let bytes = size_of_val(rays) as u64 / size_of::<Ray>() as u64 * size_of::<Hit>() as u64;
        gpu.write(&self.view, 0, bytemuck::bytes_of(&kernel::rays_view(root, count)))?;
        gpu.write(&self.rays, 0, bytemuck::cast_slice(rays))?;
        gpu.submit(|commands| {
            let descriptor = wgpu::ComputePassDescriptor { label: Some(Pass::Rays.entry()), timestamp_writes: None };
            let mut compute = commands.begin_compute_pass(&descriptor);
            compute.set_pipeline(pipeline);
            compute.set_bind_group(0, &self.group, &[]);
            compute.set_bind_group(1, octree, &[]);
            compute.dispatch_workgroups(kernel::ray_workgroups(count, WORKGROUP), 1, 1);
            drop(compute);
            commands.copy_buffer_to_buffer(&self.out, 0, &self.staging, 0, bytes);
        })?;
        let reading = gpu.begin_reading(&self.staging, bytes)?;
        Ok(Batch { buffers: self, reading, count: rays.len() })
    }
}

/// Rays on their way.
pub(crate) struct Batch {
    buffers: RayBuffers,
    reading: Reading,
    /// Number of rays.
    count: usize,
}

impl Batch {
    /// Copies the hits to `to`, as many as there are rays, if they have arrived, and gives the buffers to `spare`; otherwise
    /// returns itself.
    pub(crate) fn finish(
        self,
        gpu: &Gpu,
        to: &mut [Hit],
        spare: &mut Vec<RayBuffers>,
    ) -> Result<Option<Self>, DeviceError> {
        let copy = |from: &[u8]| bytemuck::cast_slice_mut(to).copy_from_slice(from);
        if gpu.finish_reading(&self.buffers.staging, &self.reading, copy)?.is_none() {
            return Ok(Some(self));
        }
        if spare.len() < MOST_SPARE {
            spare.push(self.buffers);
        }
        Ok(None)
    }
}

/// Hits that the device has not delivered yet: see [`WgpuCaster::submit_rays`](crate::WgpuCaster::submit_rays).
pub struct PendingHits {
    batches: VecDeque<Batch>,
    /// Those of the batches that have arrived, then those that have not.
    hits: Vec<Hit>,
    arrived: usize,
    /// Why a batch was not read. Its hits are missing, so the list is never complete.
    failed: Option<DeviceError>,
    map: Arc<SlotMap>,
}

impl PendingHits {
    pub(crate) fn new(batches: VecDeque<Batch>, map: Arc<SlotMap>) -> Self {
        let rays = batches.iter().map(|batch| batch.count).sum();
        Self { batches, hits: vec![Hit::miss(0); rays], arrived: 0, failed: None, map }
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.hits.len()
    }

    /// Whether there are no rays.
    pub fn is_empty(&self) -> bool {
        self.hits.is_empty()
    }

    /// Takes what has arrived. Returns the hits once all have. After an error, returns the same error at every call.
    pub(crate) fn advance(&mut self, gpu: &Gpu, spare: &mut Vec<RayBuffers>) -> Result<Option<Vec<Hit>>, CastError> {
        if let Some(error) = &self.failed {
            return Err(error.clone().into());
        }
        while let Some(batch) = self.batches.pop_front() {
            let next = self.arrived + batch.count;
            match batch.finish(gpu, &mut self.hits[self.arrived..next], spare) {
                Ok(None) => self.arrived = next,
                Ok(Some(later)) => {
                    self.batches.push_front(later);
                    return Ok(None);
                }
                Err(error) => {
                    self.batches.clear();
                    return Err(self.failed.insert(error).clone().into());
                }
            }
        }
        let mut hits = std::mem::take(&mut self.hits);
        self.arrived = 0;
        self.map.restore(&mut hits);
        Ok(Some(hits))
    }
}

#[cfg(test)]
mod tests {
    use esvo_core::gpu::kernel::GpuOptions;
    use esvo_core::testing::{rays::incoherent, sample::Sample};
    use esvo_core::{Caster, Rays};

    use crate::WgpuCaster;

    #[test]
    fn a_list_that_lost_a_batch_never_returns_hits() {
        let options = GpuOptions { max_rays: Some(100), ..GpuOptions::default() };
        let mut caster = match WgpuCaster::new(&options) {
            Ok(caster) => caster,
            Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => {
                eprintln!("skipped: {error}");
                return;
            }
        };
        let octree = Sample::plain(4, false).octree().unwrap();
        caster.load(&octree).unwrap();
        let rays = incoherent(300, 1);
        for lost in 0..3 {
            let mut pending = caster.submit_rays(&Rays::new(&octree, 0, &rays)).unwrap();
            // The buffer is not mapped any more when the hits are read.
            pending.batches[lost].buffers.staging.unmap();
            let mut poll = || {
                for _ in 0..60_000 {
                    match caster.poll(&mut pending) {
                        Ok(None) => std::thread::sleep(std::time::Duration::from_millis(1)),
                        other => return other.map(Option::unwrap_or_default),
                    }
                }
                panic!("no hits after a minute");
            };
            let first = poll().unwrap_err().to_string();
            for _ in 0..3 {
                assert_eq!(poll().unwrap_err().to_string(), first, "batch {lost}");
            }
        }
        let mut hits = Vec::new();
        caster.cast_rays(&Rays::new(&octree, 0, &rays), &mut hits).unwrap();
        assert_eq!(hits.len(), rays.len());
    }
}
