//! The grid of bits of one tile on the device, and the list of voxels that it becomes.

use std::time::Duration;

use esvo_device::wgpu::{self, Buffer};
use esvo_device::{Gpu, Usage};

use crate::RasterError;
use crate::passes::{Compact, Params};

/// Words of the grid that a workgroup of `kernels/compact.wgsl` takes.
const BLOCK_WORDS: u32 = 4096;

/// A grid of `edge`^3 bits.
pub(crate) struct Grid {
    pub(crate) bits: Buffer,
    pub(crate) words: u32,
    edge: u32,
    blocks: Buffer,
    block_count: u32,
    /// For each word, the number of voxels before it; one word unless attributes are wanted.
    pub(crate) ranks: Buffer,
    has_ranks: bool,
}

impl Grid {
    pub(crate) fn new(gpu: &Gpu, edge: u32, has_ranks: bool) -> Result<Self, RasterError> {
        let words = (edge.pow(3) / 32).max(1);
        let block_count = words.div_ceil(BLOCK_WORDS);
        let usage = Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC;
        let bytes = |words: u32| u64::from(words) * 4;
        Ok(Self {
            bits: gpu.buffer("grid", bytes(words), usage)?,
            words,
            edge,
            blocks: gpu.buffer("blocks", bytes(block_count + 1), usage)?,
            block_count,
            ranks: gpu.buffer("ranks", bytes(if has_ranks { words } else { 1 }), usage)?,
            has_ranks,
        })
    }

    /// Bytes on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.bits.size() + self.blocks.size() + self.ranks.size()
    }

    /// Sets all bits to zero.
    pub(crate) fn clear(&self, gpu: &Gpu) -> Result<(), RasterError> {
        Ok(gpu.run(|commands| commands.clear_buffer(&self.bits, 0, None))?)
    }

    /// The codes of the voxels whose bits are set, ascending, and how long the device took. At most `most` are listed at once.
    pub(crate) fn list(&self, gpu: &Gpu, compact: &Compact, most: u32) -> Result<(Vec<u32>, Duration), RasterError> {
        let params = Params { tile: self.edge, count: self.block_count, words: self.words, ..Params::default() };
        // The kernels that do not write the list have to bind one.
        let empty = gpu.buffer("no list", 4, Usage::STORAGE | Usage::COPY_SRC)?;
        let first = [(&compact.sum_blocks, self.block_count), (&compact.scan_blocks, 1)];
        let mut time = self.run(gpu, compact, params, &empty, &first)?;
        let voxels = self.total(gpu)?;
        let mut codes = Vec::with_capacity(voxels as usize);
        let capacity = most.min(voxels.max(1));
        let list = gpu.buffer("voxels", u64::from(capacity) * 4, Usage::STORAGE | Usage::COPY_SRC)?;
        let mut start = 0;
        while start < voxels {
            let params = Params { first: start, capacity, wanted: u32::from(self.has_ranks), ..params };
            time += self.run(gpu, compact, params, &list, &[(&compact.list_voxels, self.block_count)])?;
            let here = capacity.min(voxels - start);
            codes.extend(gpu.read::<u32>(&list, here as usize)?);
            start += here;
        }
        Ok((codes, time))
    }

    /// The number of voxels, after `scan_blocks`.
    fn total(&self, gpu: &Gpu) -> Result<u32, RasterError> {
        let at = u64::from(self.block_count) * 4;
        let one = gpu.buffer("number of voxels", 4, Usage::COPY_DST | Usage::COPY_SRC)?;
        gpu.submit(|commands| commands.copy_buffer_to_buffer(&self.blocks, at, &one, 0, 4))?;
        Ok(gpu.read::<u32>(&one, 1)?[0])
    }

    fn run(
        &self,
        gpu: &Gpu,
        compact: &Compact,
        params: Params,
        list: &Buffer,
        kernels: &[(&wgpu::ComputePipeline, u32)],
    ) -> Result<Duration, RasterError> {
        let params = gpu.upload("compact", &[params], Usage::UNIFORM)?;
        let group = gpu.bind_group(&compact.layout, &[&params, &self.bits, &self.blocks, list, &self.ranks])?;
        let time = gpu.timed(|commands, timestamps| {
            let timestamp_writes = timestamps.map(|timestamps| timestamps.compute_pass(0));
            let descriptor = wgpu::ComputePassDescriptor { label: Some("compact"), timestamp_writes };
            let mut pass = commands.begin_compute_pass(&descriptor);
            pass.set_bind_group(0, &group, &[]);
            for (pipeline, groups) in kernels {
                pass.set_pipeline(pipeline);
                pass.dispatch_workgroups(*groups, 1, 1);
            }
        })?;
        Ok(time)
    }
}
