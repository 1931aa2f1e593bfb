//! Slots in a texture that a kernel reads by texel.

use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;
use esvo_core::CastError;

use crate::buffers::{Buffer, ON_DEVICE, allocate};
use crate::gpu::Gpu;

/// Format of a texel: a slot of 8 bytes. Every device has that for 16 bytes.
pub(crate) const FORMAT: vk::Format = vk::Format::R32G32_UINT;
/// Format of a texel: a slot of 16 bytes.
const QUAD_FORMAT: vk::Format = vk::Format::R32G32B32A32_UINT;

/// Tests read the texels back.
const USAGE: vk::ImageUsageFlags = vk::ImageUsageFlags::from_raw(
    vk::ImageUsageFlags::STORAGE.as_raw()
        | vk::ImageUsageFlags::TRANSFER_DST.as_raw()
        | if cfg!(test) { vk::ImageUsageFlags::TRANSFER_SRC.as_raw() } else { 0 },
);

/// The whole of an image with one level and one layer.
const WHOLE: vk::ImageSubresourceRange = vk::ImageSubresourceRange {
    aspect_mask: vk::ImageAspectFlags::COLOR,
    base_mip_level: 0,
    level_count: 1,
    base_array_layer: 0,
    layer_count: 1,
};

/// A texture and its memory, in the layout `GENERAL`.
pub(crate) struct Texture {
    pub(crate) view: vk::ImageView,
    image: vk::Image,
    memory: vk::DeviceMemory,
    gpu: Arc<Gpu>,
}

impl Texture {
    /// Copies `slots`, of 8 or 16 bytes each, to a new texture with rows of `2^row_shift` texels, through `staging`, a buffer on the host
    /// that holds a row.
    pub(crate) fn upload<T: Pod>(
        gpu: &Arc<Gpu>,
        slots: &[T],
        row_shift: u32,
        staging: &mut Buffer,
    ) -> Result<Self, CastError> {
        let columns = 1usize << row_shift;
        let rows = slots.len().div_ceil(columns).max(1);
        let format = match size_of::<T>() {
            8 => FORMAT,
            16 => QUAD_FORMAT,
            bytes => return Err(gpu.error(&format!("there are no texels for slots of {bytes} bytes"))),
        };
        let texture = Self::new(gpu, format, columns as u32, rows as u32)?;
        let piece_rows = (staging.bytes as usize / size_of::<T>()) >> row_shift;
        if piece_rows == 0 {
            return Err(gpu.error(&"the buffer for copying is smaller than a row of the texture"));
        }
        for (piece, row) in slots.chunks(piece_rows * columns).zip((0i32..).step_by(piece_rows)) {
            let bytes: &[u8] = bytemuck::cast_slice(piece);
            staging.contents()[..bytes.len()].copy_from_slice(bytes);
            // The texels after the last slot get whatever the buffer holds; no slot leads there.
            let region = [rows_of(columns as u32, row, piece.len().div_ceil(columns) as u32)];
            gpu.run(|device, commands| {
                // SAFETY: the rows lie within the image and, as `piece_rows` of them fit it, within the buffer; both outlive
                // the submission; the image is in this layout.
                unsafe {
                    let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
                    device.cmd_copy_buffer_to_image(commands, staging.handle, texture.image, layout, &region);
                }
            })?;
        }
        texture.turn(vk::ImageLayout::TRANSFER_DST_OPTIMAL, vk::ImageLayout::GENERAL)?;
        Ok(texture)
    }

    /// A texture in the layout `TRANSFER_DST_OPTIMAL`.
    fn new(gpu: &Arc<Gpu>, format: vk::Format, width: u32, height: u32) -> Result<Self, CastError> {
        let failed =
            |error: vk::Result| gpu.error(&format!("cannot make a texture of {width} x {height} texels ({error})"));
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(format)
            .extent(vk::Extent3D { width, height, depth: 1 })
            .mip_levels(1)
            .array_layers(1)
            .samples(vk::SampleCountFlags::TYPE_1)
            .tiling(vk::ImageTiling::OPTIMAL)
            .usage(USAGE)
            .initial_layout(vk::ImageLayout::UNDEFINED);
        // SAFETY: the device is alive, and has the format for storage images: see `Adapter::texture_edge`.
        let image = unsafe { gpu.device.create_image(&info, None) }.map_err(failed)?;
        let mut texture =
            Self { view: vk::ImageView::null(), image, memory: vk::DeviceMemory::null(), gpu: gpu.clone() };
        // SAFETY: the image was just made.
        let needs = unsafe { gpu.device.get_image_memory_requirements(image) };
        texture.memory = allocate(gpu, &needs, &ON_DEVICE).map_err(|error| gpu.error(&error))?;
        let view = vk::ImageViewCreateInfo::default()
            .image(image)
            .view_type(vk::ImageViewType::TYPE_2D)
            .format(format)
            .subresource_range(WHOLE);
        // SAFETY: the memory suits the image and is bound once; the view is of the image. `drop` destroys what was made, also
        // if a later step fails.
        unsafe {
            gpu.device.bind_image_memory(image, texture.memory, 0).map_err(failed)?;
            texture.view = gpu.device.create_image_view(&view, None).map_err(failed)?;
        }
        texture.turn(vk::ImageLayout::UNDEFINED, vk::ImageLayout::TRANSFER_DST_OPTIMAL)?;
        Ok(texture)
    }

    /// Changes the layout, after all that was done and before all that will be done with the texture.
    fn turn(&self, from: vk::ImageLayout, to: vk::ImageLayout) -> Result<(), CastError> {
        let barrier = [vk::ImageMemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE)
            .old_layout(from)
            .new_layout(to)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(self.image)
            .subresource_range(WHOLE)];
        self.gpu.run(|device, commands| {
            let all = vk::PipelineStageFlags::ALL_COMMANDS;
            // SAFETY: the command buffer is being recorded; the image has memory and outlives the submission.
            unsafe {
                device.cmd_pipeline_barrier(commands, all, all, vk::DependencyFlags::empty(), &[], &[], &barrier);
            }
        })
    }
}

/// Rows of a texture as a region to be copied, without gaps in the buffer.
fn rows_of(columns: u32, first: i32, rows: u32) -> vk::BufferImageCopy {
    let layers = vk::ImageSubresourceLayers {
        aspect_mask: WHOLE.aspect_mask,
        mip_level: 0,
        base_array_layer: 0,
        layer_count: 1,
    };
    vk::BufferImageCopy::default()
        .image_subresource(layers)
        .image_offset(vk::Offset3D { x: 0, y: first, z: 0 })
        .image_extent(vk::Extent3D { width: columns, height: rows, depth: 1 })
}

impl Drop for Texture {
    fn drop(&mut self) {
        // SAFETY: every submission is waited for, so the device no longer uses the texture.
        unsafe {
            self.gpu.device.destroy_image_view(self.view, None);
            self.gpu.device.destroy_image(self.image, None);
            self.gpu.device.free_memory(self.memory, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use esvo_core::gpu::kernel::GpuOptions;

    use super::*;

    #[test]
    fn uploads_arrive_piece_by_piece() {
        let gpu = match Gpu::open(&GpuOptions::default()) {
            Ok(gpu) => Arc::new(gpu),
            Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
            Err(error) => return eprintln!("skipped: {error}"),
        };
        if gpu.adapter.texture_edge == 0 {
            return eprintln!("skipped: the device has no such textures");
        }
        // 32 rows of 32, the last of which is not full, in pieces of three rows.
        let slots: Vec<u64> = (0..1000).map(|i| i * 0x1_0000_0001).collect();
        let mut staging = Buffer::on_host(&gpu, 3 * 256 + 100, vk::BufferUsageFlags::TRANSFER_SRC).expect("is made");
        let texture = Texture::upload(&gpu, &slots, 5, &mut staging).expect("uploads");
        let mut back = Buffer::on_host(&gpu, 32 * 256, vk::BufferUsageFlags::TRANSFER_DST).expect("is made");
        let region = [rows_of(32, 0, 32)];
        texture.turn(vk::ImageLayout::GENERAL, vk::ImageLayout::TRANSFER_SRC_OPTIMAL).expect("turns");
        let copied = gpu.run(|device, commands| {
            let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            // SAFETY: the buffer has room for all rows; both outlive the submission.
            unsafe { device.cmd_copy_image_to_buffer(commands, texture.image, layout, back.handle, &region) };
        });
        copied.expect("copies");
        assert_eq!(back.contents()[..8000], *bytemuck::cast_slice::<u64, u8>(&slots));

        let mut small = Buffer::on_host(&gpu, 100, vk::BufferUsageFlags::TRANSFER_SRC).expect("is made");
        assert!(Texture::upload(&gpu, &slots, 5, &mut small).is_err(), "a buffer smaller than a row");
        assert!(Texture::upload(&gpu, &[0u32; 8], 5, &mut staging).is_err(), "slots of four bytes");
        assert!(Texture::upload::<u64>(&gpu, &[], 5, &mut staging).is_ok());
    }
}
