//! The device's copy of a volume.

use bytemuck::{Pod, Zeroable};
use esvo_device::wgpu::{self, TextureUsages};
use esvo_device::{DeviceError, Gpu, Usage, uniform};

use crate::error::ShadowError;
use crate::extent::Extent;
use crate::volume::{Occupancy, Volume};

/// A volume is sent in pieces of about this many bytes, so that staging memory stays small.
const PIECE_BYTES: u64 = 64 << 20;
/// Rows of a buffer that a texture is copied to begin at multiples of so many bytes.
const PITCH: usize = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize;

/// `ShadowVolume` of kernels/trace.wgsl.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    voxels: [i32; 3],
    coarsest: u32,
}

/// What an update sent to the device.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Sent {
    /// Bytes of the volume: one for each cell of the base and the mips.
    pub bytes: u64,
    /// Writes: one for each region and level.
    pub writes: u32,
}

/// Texels of a volume's texture along each axis: half the voxels, rounded up, and then to a multiple of `2^mips`.
pub fn texture_size(voxels: [u32; 3], mips: u32) -> [u32; 3] {
    voxels.map(|n| n.div_ceil(2).next_multiple_of(1 << mips))
}

/// The layout of group 0 of kernels that follow [`TRACE_WGSL`](super::TRACE_WGSL).
///
/// # Errors
/// A lost device.
pub fn volume_layout(gpu: &Gpu) -> Result<wgpu::BindGroupLayout, DeviceError> {
    let texture = wgpu::BindGroupLayoutEntry {
        binding: 1,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D3,
            multisampled: false,
        },
        count: None,
    };
    gpu.bind_group_layout("shadow volume", &[uniform(0), texture])
}

/// The bytes of a [`Volume`] on a device.
#[derive(Debug)]
pub struct GpuVolume {
    texture: wgpu::Texture,
    group: wgpu::BindGroup,
    voxels: [u32; 3],
    mips: u32,
}

impl GpuVolume {
    /// A copy of a volume on a device.
    ///
    /// # Errors
    /// A volume that is larger than the device's textures, or than its free memory; a lost device.
    pub fn new(gpu: &Gpu, volume: &Volume) -> Result<Self, ShadowError> {
        let (voxels, mips) = (volume.voxels(), volume.mips());
        let size = texture_size(voxels, mips);
        let most = gpu.limits().max_texture_dimension_3d;
        if size.iter().any(|&n| n > most) {
            return Err(ShadowError::Device(gpu.error(format!(
                "a volume of {} x {} x {} voxels needs a texture of {} x {} x {} texels, the device allows {most} along an axis. Choose \
                 larger voxels",
                voxels[0], voxels[1], voxels[2], size[0], size[1], size[2]
            ))));
        }
        let descriptor = wgpu::TextureDescriptor {
            label: Some("shadow volume"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
            mip_level_count: mips + 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::R8Uint,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST | TextureUsages::COPY_SRC,
            view_formats: &[],
        };
        let texture = gpu.checked(|device| device.create_texture(&descriptor))?;
        let header = Header { voxels: voxels.map(|n| n as i32), coarsest: volume.coarsest() };
        let header = gpu.upload("shadow volume's size", &[header], Usage::UNIFORM)?;
        let view = gpu.checked(|_| texture.create_view(&wgpu::TextureViewDescriptor::default()))?;
        let resources = vec![header.as_entire_binding(), wgpu::BindingResource::TextureView(&view)];
        let group = gpu.bind_resources(&volume_layout(gpu)?, resources)?;
        let made = Self { texture, group, voxels, mips };
        for mip in 0..=mips {
            let size = volume.level(mip).0.map(|n| n as i32);
            let layers = (PIECE_BYTES / (size[0] as u64 * size[1] as u64).max(1)).max(1) as i32;
            for z in (0..size[2]).step_by(layers as usize) {
                let part = Extent { low: [0, 0, z], high: [size[0], size[1], z.saturating_add(layers).min(size[2])] };
                gpu.checked(|_| {
                    made.write(gpu, volume, mip, &part, &mut Vec::new());
                    gpu.queue().submit([]);
                })?;
                // So that the memory of the copy is free again.
                gpu.wait()?;
            }
        }
        Ok(made)
    }

    /// Sends regions of a volume, in base cells, and what is above them in the mips. What of a region is outside of the volume is left out. The device has them before
    /// whatever is submitted next; staging memory is held until then.
    ///
    /// # Errors
    /// A volume of another size or number of mips than the one that this is a copy of; not enough memory; a lost device.
    pub fn update(&mut self, gpu: &Gpu, volume: &Volume, regions: &[Extent]) -> Result<Sent, ShadowError> {
        if (volume.voxels(), volume.mips()) != (self.voxels, self.mips) {
            return Err(ShadowError::Device(gpu.error(format!(
                "a copy of a volume of {:?} voxels with {} mips cannot be updated from one of {:?} with {}; make a new copy",
                self.voxels,
                self.mips,
                volume.voxels(),
                volume.mips()
            ))));
        }
        let whole = volume.extent();
        Ok(gpu.checked(|_| {
            let (mut sent, mut packed) = (Sent::default(), Vec::new());
            for region in regions {
                let mut part = region.intersection(&whole);
                if part.is_empty() {
                    continue;
                }
                for mip in 0..=self.mips {
                    self.write(gpu, volume, mip, &part, &mut packed);
                    sent.bytes += part.cells();
                    sent.writes += 1;
                    part = part.parents();
                }
            }
            sent
        })?)
    }

    /// Writes a part of a level that is not empty and lies within it. `packed`: memory to use.
    fn write(&self, gpu: &Gpu, volume: &Volume, mip: u32, part: &Extent, packed: &mut Vec<u8>) {
        let (size, bytes) = volume.level(mip);
        let low = part.low.map(|c| c as usize);
        let [width, height, depth] = part.size();
        let at = |y: usize, z: usize| low[0] + size[0] * (low[1] + y + size[1] * (low[2] + z));
        // wgpu's copy has room for whole layers of the source: of a part that is low, hundreds of times its bytes. Such parts are packed first.
        let (bytes, row, rows) = if depth == 1 || height == size[1] {
            (&bytes[at(0, 0)..at(height - 1, depth - 1) + width], size[0], size[1])
        } else {
            packed.clear();
            for (y, z) in (0..depth).flat_map(|z| (0..height).map(move |y| (y, z))) {
                packed.extend_from_slice(&bytes[at(y, z)..at(y, z) + width]);
            }
            (packed.as_slice(), width, height)
        };
        let to = wgpu::TexelCopyTextureInfo {
            texture: &self.texture,
            mip_level: mip,
            origin: wgpu::Origin3d { x: low[0] as u32, y: low[1] as u32, z: low[2] as u32 },
            aspect: wgpu::TextureAspect::All,
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row as u32),
            rows_per_image: Some(rows as u32),
        };
        gpu.queue().write_texture(to, bytes, layout, extent([width, height, depth]));
    }

    /// The bytes of the base level (0) or a mip as the device has them, with the texels that the texture has beyond them, x fastest, and how many there are along
    /// each axis. For tests: it waits for all that was submitted.
    ///
    /// # Errors
    /// No such mip; not enough memory; a lost device.
    pub fn read_level(&self, gpu: &Gpu, mip: u32) -> Result<([usize; 3], Vec<u8>), ShadowError> {
        if mip > self.mips {
            return Err(ShadowError::Device(
                gpu.error(format!("the volume has {} mips, mip {mip} was asked for", self.mips)),
            ));
        }
        let size = texture_size(self.voxels, self.mips).map(|n| (n >> mip) as usize);
        let pitch = size[0].next_multiple_of(PITCH);
        let layers = (PIECE_BYTES as usize / (pitch * size[1])).clamp(1, size[2]);
        let room = (pitch * size[1] * layers) as u64;
        let staging = gpu.buffer("shadow volume to read", room, Usage::MAP_READ | Usage::COPY_DST)?;
        let mut bytes = Vec::with_capacity(size.iter().product());
        for z in (0..size[2]).step_by(layers) {
            let depth = layers.min(size[2] - z);
            let from = wgpu::TexelCopyTextureInfo {
                texture: &self.texture,
                mip_level: mip,
                origin: wgpu::Origin3d { x: 0, y: 0, z: z as u32 },
                aspect: wgpu::TextureAspect::All,
            };
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(pitch as u32),
                rows_per_image: Some(size[1] as u32),
            };
            let to = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
            gpu.submit(|commands| commands.copy_texture_to_buffer(from, to, extent([size[0], size[1], depth])))?;
            gpu.read_staging(&staging, (pitch * size[1] * depth) as u64, |rows| {
                rows.chunks_exact(pitch).for_each(|row| bytes.extend_from_slice(&row[..size[0]]));
            })?;
        }
        Ok((size, bytes))
    }

    /// Group 0 of kernels that follow [`TRACE_WGSL`](super::TRACE_WGSL).
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.group
    }

    /// The texture; the module's page says how bytes lie in it.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// Voxels along each axis.
    pub fn voxels(&self) -> [u32; 3] {
        self.voxels
    }

    /// Number of mips.
    pub fn mips(&self) -> u32 {
        self.mips
    }

    /// Texels of all levels: bytes on the device, if it adds none.
    pub fn bytes(&self) -> u64 {
        let size = texture_size(self.voxels, self.mips).map(u64::from);
        (0..=self.mips).map(|mip| size.map(|n| n >> mip).iter().product::<u64>()).sum()
    }
}

fn extent([width, height, depth]: [usize; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: depth as u32 }
}
