//! Textures that compute shaders read by texel.

use bytemuck::Pod;

use crate::error::DeviceError;
use crate::gpu::Gpu;

/// Data is copied in pieces of about this many bytes, so that staging memory stays small.
const PIECE_BYTES: usize = 64 << 20;

/// Entry of a bind group layout: a storage texture that compute shaders read.
pub fn read_texture(binding: u32, format: wgpu::TextureFormat) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::StorageTexture {
            access: wgpu::StorageTextureAccess::ReadOnly,
            format,
            view_dimension: wgpu::TextureViewDimension::D2,
        },
        count: None,
    }
}

impl Gpu {
    /// Makes a texture of one texel for each element of `data`, in rows of `columns`, to be read by compute shaders. The rest of
    /// the last row is zero.
    ///
    /// # Errors
    /// More rows or columns than the device allows; a format whose texels have another size than `T`;
    /// [`DeviceError::OutOfMemory`]; a lost device.
    pub fn upload_texture<T: Pod>(
        &self,
        label: &str,
        format: wgpu::TextureFormat,
        columns: u32,
        data: &[T],
    ) -> Result<wgpu::TextureView, DeviceError> {
        let row_bytes = columns as usize * size_of::<T>();
        if row_bytes == 0 || format.block_copy_size(None).map(|bytes| bytes as usize) != Some(size_of::<T>()) {
            return Err(self.error(format!("{label}: texels of {} bytes are not those of {format:?}", size_of::<T>())));
        }
        let data: &[u8] = bytemuck::cast_slice(data);
        let size = |rows: usize| wgpu::Extent3d {
            width: columns,
            height: u32::try_from(rows).unwrap_or(u32::MAX),
            depth_or_array_layers: 1,
        };
        let texture = self.checked(|device| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: size(data.len().div_ceil(row_bytes).max(1)),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        })?;
        let piece_rows = (PIECE_BYTES / row_bytes).max(1);
        for (piece, row) in data.chunks(piece_rows * row_bytes).zip((0u32..).step_by(piece_rows)) {
            let whole = piece.len() - piece.len() % row_bytes;
            self.write_rows(&texture, row, &piece[..whole], row_bytes, &size(whole / row_bytes))?;
            if whole < piece.len() {
                let mut last = piece[whole..].to_vec();
                last.resize(row_bytes, 0);
                self.write_rows(&texture, row + (whole / row_bytes) as u32, &last, row_bytes, &size(1))?;
            }
            // So that the memory of the copy is free again.
            self.caught(|_| self.queue().submit([]))?;
            self.wait()?;
        }
        self.checked(|_| texture.create_view(&wgpu::TextureViewDescriptor::default()))
    }

    fn write_rows(
        &self,
        texture: &wgpu::Texture,
        row: u32,
        bytes: &[u8],
        row_bytes: usize,
        size: &wgpu::Extent3d,
    ) -> Result<(), DeviceError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let to = wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x: 0, y: row, z: 0 },
            aspect: wgpu::TextureAspect::All,
        };
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes as u32), rows_per_image: None };
        self.caught(|_| self.queue().write_texture(to, bytes, layout, *size))
    }
}
