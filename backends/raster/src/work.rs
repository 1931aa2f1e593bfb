//! Running a method over one tile, whatever is done with the voxels that it finds.

use std::time::{Duration, Instant};

use esvo_device::wgpu::{self, BindGroup, Buffer};
use esvo_device::{Gpu, Usage};
use rayon::prelude::*;

use crate::attributes::LookRecord;
use crate::grid::Grid;
use crate::passes::{Emit, Params, Passes, TARGET};
use crate::records::{Item, Record};
use crate::tiles::Tile;
use crate::{Method, Pair, RasterError, Surface};

/// How much is done at once. Results do not depend on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rooms {
    /// Most triangles in one draw or dispatch.
    pub(crate) triangles: usize,
    /// Most items of work in one dispatch.
    pub(crate) items: usize,
    /// Most pairs that one dispatch may leave undecided; at least as many as an item can have, which is 16 x 16 columns of a tile.
    pub(crate) undecided: u32,
    /// Most voxels in one list, and most that have sums at once.
    pub(crate) voxels: u32,
}

impl Rooms {
    /// What fits into bindings of so many bytes.
    pub(crate) fn of(bytes: u64) -> Self {
        // A look has 104 bytes, the largest of the structs of which there is one for each triangle.
        Self { triangles: 1 << 20, items: 1 << 22, undecided: 1 << 20, voxels: (bytes / 4).min(1 << 25) as u32 }
    }
}

/// Invocations of a workgroup in `kernels/compute.wgsl`.
const GROUP: u32 = 64;

/// Takes pairs of record and code that a dispatch leaves undecided, with the index of their batch.
type TakePairs<'a> = &'a mut dyn FnMut(usize, &[[u32; 2]]);

/// Triangles of a tile on the device.
pub(crate) struct Batch {
    records: Buffer,
    count: u32,
    /// The first of them in [`Tile::triangles`].
    first: usize,
    /// Work of the compute shader.
    items: Vec<Item>,
    /// For each triangle how it looks, if that is wanted.
    looks: Option<Buffer>,
}

/// A method, the grid, a tile of it and its triangles on the device.
pub(crate) struct Work<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) passes: &'a Passes,
    pub(crate) method: Method,
    pub(crate) grid: &'a Grid,
    pub(crate) tile: &'a Tile,
    pub(crate) voxels: u32,
    pub(crate) rooms: Rooms,
    /// Bytes of buffers that were made.
    pub(crate) bytes: u64,
    /// Time to prepare triangles on the processor.
    pub(crate) preparation: Duration,
    batches: Vec<Batch>,
}

impl<'a> Work<'a> {
    /// Prepares and uploads the triangles of a tile.
    pub(crate) fn new(
        gpu: &'a Gpu,
        passes: &'a Passes,
        method: Method,
        grid: &'a Grid,
        (tile, voxels, rooms): (&'a Tile, u32, Rooms),
        surface: &Surface<'_>,
        with_looks: bool,
    ) -> Result<Self, RasterError> {
        let mut work = Self {
            gpu,
            passes,
            method,
            grid,
            tile,
            voxels,
            rooms,
            bytes: 0,
            preparation: Duration::ZERO,
            batches: Vec::new(),
        };
        for (index, triangles) in tile.triangles.chunks(rooms.triangles).enumerate() {
            let start = Instant::now();
            let scale = f64::from(voxels);
            let records: Vec<Record> = (triangles.par_iter())
                .map(|&t| Record::new(&surface.corners[t as usize].map(|corner| corner * scale), (tile, scale), method))
                .collect();
            let mut items = Vec::new();
            if method == Method::Compute {
                let parts: Vec<Vec<Item>> = (records.par_chunks(4096).enumerate())
                    .map(|(chunk, records)| {
                        let mut items = Vec::new();
                        for (i, record) in records.iter().enumerate() {
                            record.items((chunk * 4096 + i) as u32, tile, &mut items);
                        }
                        items
                    })
                    .collect();
                items = parts.concat();
            }
            work.preparation += start.elapsed();
            let looks = surface.looks.filter(|_| with_looks).map(|looks| {
                let record = |&t: &u32| LookRecord::new(looks, t as usize, &surface.corners[t as usize], 1.0 / scale);
                gpu.upload("looks", &triangles.par_iter().map(record).collect::<Vec<_>>(), Usage::STORAGE)
            });
            let looks = looks.transpose()?;
            let uploaded = gpu.upload("triangles", &records, Usage::STORAGE)?;
            work.bytes += uploaded.size() + looks.as_ref().map_or(0, Buffer::size) + (items.len() * 12) as u64;
            let (count, first) = (records.len() as u32, index * rooms.triangles);
            work.batches.push(Batch { records: uploaded, count, first, items, looks });
        }
        Ok(work)
    }

    fn params(&self) -> Params {
        let end = std::array::from_fn(|k| self.voxels as i32 - self.tile.corner[k] as i32);
        Params { tile: self.tile.edge, end, ..Params::default() }
    }

    /// Group 0 of a batch.
    fn group(&self, batch: &Batch, params: Params) -> Result<BindGroup, RasterError> {
        let params = self.gpu.upload("parameters", &[params], Usage::UNIFORM)?;
        Ok(self.gpu.bind_group(&self.passes.layout, &[&params, &batch.records, &self.grid.bits])?)
    }

    /// Draws all triangles; group 1 has `buffers`, or for sums `buffers` around the looks of the batch: see [`with_looks`].
    pub(crate) fn draw(
        &self,
        emit: Emit,
        change: impl Fn(&mut Params),
        buffers: &[&Buffer],
    ) -> Result<Duration, RasterError> {
        let raster = self.passes.raster(self.gpu, self.method, emit)?;
        let target = self.gpu.checked(|device| {
            let size = wgpu::Extent3d { width: self.tile.edge, height: self.tile.edge, depth_or_array_layers: 1 };
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("pixels"),
                size,
                mip_level_count: 1,
                sample_count: self.method.samples(),
                dimension: wgpu::TextureDimension::D2,
                format: TARGET,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        })?;
        let mut time = Duration::ZERO;
        for batch in &self.batches {
            let mut params = self.params();
            change(&mut params);
            let group = self.group(batch, params)?;
            let found = self.gpu.bind_group(&raster.emit_layout, &with_looks(batch, buffers))?;
            time += self.gpu.timed(|commands, timestamps| {
                let attachment = wgpu::RenderPassColorAttachment {
                    view: &target,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Discard,
                    },
                };
                let mut pass = commands.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some(self.method.name()),
                    color_attachments: &[Some(attachment)],
                    timestamp_writes: timestamps.map(|timestamps| timestamps.render_pass(0)),
                    ..Default::default()
                });
                pass.set_pipeline(&raster.pipeline);
                pass.set_bind_group(0, &group, &[]);
                pass.set_bind_group(1, &found, &[]);
                pass.draw(0..3 * batch.count, 0..1);
            })?;
        }
        Ok(time)
    }

    /// Runs the compute shader over all triangles; groups as for [`draw`](Self::draw). Passes what stays undecided to `undecided`, with the
    /// index of the batch, unless it is `None`.
    pub(crate) fn compute(
        &self,
        emit: Emit,
        change: impl Fn(&mut Params),
        buffers: &[&Buffer],
        mut undecided: Option<TakePairs<'_>>,
    ) -> Result<Duration, RasterError> {
        let compute = self.passes.compute(self.gpu, emit)?;
        let capacity = if undecided.is_some() { self.rooms.undecided } else { 0 };
        let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
        let left = self.gpu.buffer("undecided", u64::from(capacity) * 8 + 8, usage)?;
        let mut time = Duration::ZERO;
        for (index, batch) in self.batches.iter().enumerate() {
            let found = self.gpu.bind_group(&compute.emit_layout, &with_looks(batch, buffers))?;
            for items in batch.items.chunks(self.rooms.items) {
                let list = self.gpu.upload("work", items, Usage::STORAGE)?;
                let work = self.gpu.bind_group(&compute.work_layout, &[&list, &left])?;
                // Ranges of items; a range that leaves too much undecided is done again in halves.
                let mut ranges = vec![(0, items.len() as u32)];
                while let Some((first, count)) = ranges.pop() {
                    let mut params = Params { first, count, capacity, ..self.params() };
                    change(&mut params);
                    time += self.dispatch(&compute.voxelize, batch, params, [&found, &work], Some(&left))?;
                    let Some(take) = undecided.as_mut() else { continue };
                    let total = self.gpu.read::<u32>(&left, 1)?[0];
                    if total > capacity && count > 1 {
                        ranges.extend([(first + count / 2, count - count / 2), (first, count / 2)]);
                        continue;
                    }
                    // An item has 256 columns of at most 1024 voxels: fewer than the capacity.
                    let pairs: Vec<[u32; 2]> = self.gpu.read(&left, 1 + total.min(capacity) as usize)?;
                    take(index, &pairs[1..]);
                }
            }
        }
        Ok(time)
    }

    /// Emits pairs of a record of batch `index` and a voxel's code.
    pub(crate) fn apply(
        &self,
        emit: Emit,
        change: impl Fn(&mut Params),
        buffers: &[&Buffer],
        (index, pairs): (usize, &[[u32; 2]]),
    ) -> Result<Duration, RasterError> {
        if pairs.is_empty() {
            return Ok(Duration::ZERO);
        }
        let compute = self.passes.compute(self.gpu, emit)?;
        let batch = &self.batches[index];
        let none = self.gpu.buffer("undecided", 8, Usage::STORAGE | Usage::COPY_DST)?;
        let list = self.gpu.upload("pairs", pairs, Usage::STORAGE)?;
        let found = self.gpu.bind_group(&compute.emit_layout, &with_looks(batch, buffers))?;
        let work = self.gpu.bind_group(&compute.work_layout, &[&list, &none])?;
        let mut params = self.params();
        change(&mut params);
        params.count = pairs.len() as u32;
        self.dispatch(&compute.apply, batch, params, [&found, &work], None)
    }

    fn dispatch(
        &self,
        pipeline: &wgpu::ComputePipeline,
        batch: &Batch,
        mut params: Params,
        groups: [&BindGroup; 2],
        to_clear: Option<&Buffer>,
    ) -> Result<Duration, RasterError> {
        let all = params.count.div_ceil(GROUP);
        params.groups_x = all.min(self.gpu.limits().max_compute_workgroups_per_dimension);
        let group = self.group(batch, params)?;
        let time = self.gpu.timed(|commands, timestamps| {
            if let Some(buffer) = to_clear {
                commands.clear_buffer(buffer, 0, Some(8));
            }
            let timestamp_writes = timestamps.map(|timestamps| timestamps.compute_pass(0));
            let descriptor = wgpu::ComputePassDescriptor { label: Some("voxelize"), timestamp_writes };
            let mut pass = commands.begin_compute_pass(&descriptor);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(1, groups[0], &[]);
            pass.set_bind_group(2, groups[1], &[]);
            pass.dispatch_workgroups(params.groups_x, all.div_ceil(params.groups_x), 1);
        })?;
        Ok(time)
    }

    /// The triangle and the voxel that a pair stands for.
    pub(crate) fn pair(&self, index: usize, [record, code]: [u32; 2]) -> Pair {
        let at = esvo_format::morton_place(u64::from(code));
        let cell = std::array::from_fn(|k| self.tile.corner[k] + at[k]);
        Pair { triangle: self.tile.triangles[self.batches[index].first + record as usize], cell }
    }
}

/// The buffers of group 1. If a batch has looks, they come second.
fn with_looks<'a>(batch: &'a Batch, buffers: &[&'a Buffer]) -> Vec<&'a Buffer> {
    let mut all = buffers.to_vec();
    if let Some(looks) = &batch.looks
        && !all.is_empty()
    {
        all.insert(1, looks);
    }
    all
}
