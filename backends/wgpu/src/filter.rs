//! The post-process filter.

use std::time::{Duration, Instant};

use esvo_core::filter::kernel::{Band, ENTRY_FILTER, FILTER_WGSL, unpack};
use esvo_core::filter::{Frame, Radius};
use esvo_core::{CastError, Filtered, Picture};
use esvo_device::{Gpu, Timestamps, Usage, storage, uniform};

/// The kernel, compiled.
pub(crate) struct Filter {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    /// `None` if the device has no clock.
    timing: Option<Timestamps>,
}

impl Filter {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, CastError> {
        let layout = gpu.bind_group_layout("filter", &[uniform(0), storage(1, true), storage(2, false)])?;
        let module = gpu.shader("filter.wgsl", FILTER_WGSL)?;
        let pipeline = gpu.compute_pipeline(&module, ENTRY_FILTER, &[&layout])?;
        Ok(Self { layout, pipeline, timing: gpu.timestamps(1)? })
    }

    /// Filters a frame, band by band.
    ///
    /// Buffers have at most `max_bytes`.
    pub(crate) fn run(&self, gpu: &Gpu, max_bytes: u64, frame: &Frame, radius: Radius) -> Result<Filtered, CastError> {
        let max_groups = gpu.limits().max_compute_workgroups_per_dimension;
        let mut rgb8 = Vec::with_capacity(3 * frame.pixels().len());
        let mut time = Duration::ZERO;
        for band in Band::all(frame, max_bytes, max_groups)? {
            let count = band.rows as usize * frame.width() as usize;
            let params = gpu.upload("filter", &[band.params(frame, radius)], Usage::UNIFORM)?;
            let input = gpu.upload("pixels", band.input(frame), Usage::STORAGE)?;
            let output = gpu.buffer("filtered", 4 * count as u64, Usage::STORAGE | Usage::COPY_SRC)?;
            let group = gpu.bind_group(&self.layout, &[&params, &input, &output])?;
            let start = Instant::now();
            gpu.submit(|commands| {
                let timestamp_writes = self.timing.as_ref().map(|timing| timing.compute_pass(0));
                let descriptor = wgpu::ComputePassDescriptor { label: Some(ENTRY_FILTER), timestamp_writes };
                let mut compute = commands.begin_compute_pass(&descriptor);
                compute.set_pipeline(&self.pipeline);
                compute.set_bind_group(0, &group, &[]);
                let (x, y) = band.workgroups(frame);
                compute.dispatch_workgroups(x, y, 1);
                drop(compute);
                if let Some(timing) = &self.timing {
                    timing.resolve(commands);
                }
            })?;
            time += match &self.timing {
                Some(timing) => timing.read(gpu)?.span(0..=0),
                None => {
                    gpu.wait()?;
                    start.elapsed()
                }
            };
            unpack(&gpu.read(&output, count)?, &mut rgb8);
        }
        Ok(Filtered { picture: Picture { width: frame.width(), height: frame.height(), rgb8 }, time })
    }
}
