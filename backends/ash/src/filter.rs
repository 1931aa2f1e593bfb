//! The post-process filter.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use ash::vk::{BufferUsageFlags as Usage, DescriptorType};
use esvo_core::filter::kernel::{Band, ENTRY_FILTER, FILTER_WGSL, Params, unpack};
use esvo_core::filter::{Frame, Radius};
use esvo_core::{CastError, Filtered, Picture};

use crate::buffers::Buffer;
use crate::gpu::{Gpu, TIMESTAMPS};
use crate::pipeline::{BufferSet, Pipeline};
use crate::rays::{HOST, SHADER, TRANSFER, wait};

/// The kernel and buffers for a band.
pub(crate) struct Filter {
    pipeline: Pipeline,
    set: BufferSet,
    params: Buffer,
    /// On the host, and on the device.
    input: [Buffer; 2],
    /// On the device, and on the host.
    output: [Buffer; 2],
}

impl Filter {
    /// For bands of at most this many bytes.
    pub(crate) fn new(gpu: &Arc<Gpu>, input_bytes: u64, output_bytes: u64) -> Result<Self, CastError> {
        let params = Buffer::on_host(gpu, size_of::<Params>() as u64, Usage::UNIFORM_BUFFER)?;
        let input = [
            Buffer::on_host(gpu, input_bytes, Usage::TRANSFER_SRC)?,
            Buffer::on_device(gpu, input_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_DST)?,
        ];
        let output = [
            Buffer::on_device(gpu, output_bytes, Usage::STORAGE_BUFFER | Usage::TRANSFER_SRC)?,
            Buffer::on_host(gpu, output_bytes, Usage::TRANSFER_DST)?,
        ];
        let bindings = [
            (DescriptorType::UNIFORM_BUFFER, &params),
            (DescriptorType::STORAGE_BUFFER, &input[1]),
            (DescriptorType::STORAGE_BUFFER, &output[0]),
        ];
        let set = BufferSet::new(gpu, &bindings)?;
        let pipeline = Pipeline::new(gpu, FILTER_WGSL, ENTRY_FILTER, &[set.layout])?;
        Ok(Self { pipeline, set, params, input, output })
    }

    /// Whether a band of this many bytes fits.
    pub(crate) fn fits(&self, input_bytes: u64, output_bytes: u64) -> bool {
        self.input[0].bytes >= input_bytes && self.output[0].bytes >= output_bytes
    }

    /// Filters a frame, band by band. The bands fit.
    pub(crate) fn run(
        &mut self,
        gpu: &Gpu,
        bands: &[Band],
        frame: &Frame,
        radius: Radius,
    ) -> Result<Filtered, CastError> {
        let mut rgb8 = Vec::with_capacity(3 * frame.pixels().len());
        let mut time = Duration::ZERO;
        for band in bands {
            let from: &[u8] = bytemuck::cast_slice(band.input(frame));
            let to = 4 * band.rows as usize * frame.width() as usize;
            let params = band.params(frame, radius);
            self.params.contents()[..size_of::<Params>()].copy_from_slice(bytemuck::bytes_of(&params));
            self.input[0].contents()[..from.len()].copy_from_slice(from);
            let copy_in = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: from.len() as u64 }];
            let copy_out = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: to as u64 }];
            let this = &*self;
            let start = Instant::now();
            gpu.run(|device, commands| {
                let stamp = |query, stage| {
                    if let Some(queries) = gpu.queries {
                        // SAFETY: the pool has the query, which was reset in the same submission and is written once.
                        unsafe { device.cmd_write_timestamp(commands, stage, queries, query) };
                    }
                };
                if let Some(queries) = gpu.queries {
                    // SAFETY: the queries are of this pool; nothing else uses them.
                    unsafe { device.cmd_reset_query_pool(commands, queries, 0, TIMESTAMPS) };
                }
                // SAFETY: the pixels fit both buffers, which outlive the submission.
                unsafe { device.cmd_copy_buffer(commands, this.input[0].handle, this.input[1].handle, &copy_in) };
                wait(device, commands, TRANSFER, SHADER);
                stamp(0, vk::PipelineStageFlags::TOP_OF_PIPE);
                this.pipeline.dispatch(commands, &[&this.set], band.workgroups(frame));
                stamp(1, vk::PipelineStageFlags::BOTTOM_OF_PIPE);
                wait(device, commands, SHADER, TRANSFER);
                // SAFETY: the filtered pixels fit both buffers, which outlive the submission.
                unsafe { device.cmd_copy_buffer(commands, this.output[0].handle, this.output[1].handle, &copy_out) };
                wait(device, commands, TRANSFER, HOST);
            })?;
            time += match gpu.queries {
                Some(queries) => gpu.between(queries, 0, 1)?,
                None => start.elapsed(),
            };
            unpack(bytemuck::cast_slice(&self.output[1].contents()[..to]), &mut rgb8);
        }
        Ok(Filtered { picture: Picture { width: frame.width(), height: frame.height(), rgb8 }, time })
    }
}
