//! Colours and normals of voxels: what shaders read for them, and what their sums say.

use bytemuck::{Pod, Zeroable};
use esvo_device::{Gpu, Usage};
use esvo_format::srgb;
use glam::{DVec3, Vec3};

use crate::RasterError;
use crate::surface::{Looks, TriangleLook, Wrap};

/// Words of a voxel's sums; see `kernels/emit_sum.wgsl`.
pub(crate) const SUM_WORDS: usize = 10;
/// What 1 is in sums.
const STEPS: f32 = 16383.0;
/// Most triangles in a voxel: sums of normals have a sign.
const MOST: u32 = i32::MAX as u32 / STEPS as u32;
/// Normals whose sum is shorter than this share of their number cancel out: they are those of both sides of a sheet.
const CANCELLED: f32 = 0.1;

/// Which attributes are wanted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Wanted {
    /// Colours.
    pub colors: bool,
    /// Normals.
    pub normals: bool,
}

impl Wanted {
    pub(crate) fn any(self) -> bool {
        self.colors || self.normals
    }

    pub(crate) fn bits(self) -> u32 {
        u32::from(self.colors) | u32::from(self.normals) << 1
    }
}

/// A [`TriangleLook`] as shaders read it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct LookRecord {
    normals: [[f32; 3]; 3],
    uvs: [[f32; 2]; 3],
    colors: [[f32; 3]; 3],
    material: u32,
    texels: f32,
}

impl LookRecord {
    pub(crate) fn new(looks: &Looks, triangle: usize, corners: &[DVec3; 3], voxel: f64) -> Self {
        let look = &looks.triangles[triangle];
        let &TriangleLook { normals, uvs, colors, material } = look;
        Self { normals, uvs, colors, material, texels: looks.texels_per_voxel(look, corners, voxel) }
    }
}

const _: () = assert!(size_of::<LookRecord>() == 104 && size_of::<MaterialRecord>() == 32);

/// A material as shaders read it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct MaterialRecord {
    color: [f32; 3],
    start: u32,
    size: [u32; 2],
    levels: u32,
    wrap: u32,
}

/// Materials and texels on the device.
pub(crate) struct Palette {
    pub(crate) materials: esvo_device::wgpu::Buffer,
    pub(crate) texels: esvo_device::wgpu::Buffer,
}

impl Palette {
    /// Uploads materials and textures. Levels of textures that are too fine for the device's memory are left out, the finest first, of
    /// all textures alike.
    pub(crate) fn new(gpu: &Gpu, looks: &Looks) -> Result<Self, RasterError> {
        let room = gpu.max_storage_bytes() / 4;
        let texels_from = |skipped: usize| -> u64 {
            let of = |texture: &crate::surface::Texture| {
                let first = skipped.min(texture.mips.len() - 1);
                texture.mips[first..].iter().map(|level| level.len() as u64).sum::<u64>()
            };
            looks.textures.iter().map(of).sum()
        };
        let skipped = (0..16).find(|&skipped| texels_from(skipped) <= room).unwrap_or(16);
        let (mut texels, mut starts): (Vec<[u8; 4]>, Vec<(u32, usize)>) = (Vec::new(), Vec::new());
        for texture in &looks.textures {
            let first = skipped.min(texture.mips.len() - 1);
            starts.push((texels.len() as u32, first));
            texels.extend(texture.mips[first..].iter().flatten());
        }
        let wrap = |wrap: Wrap| match wrap {
            Wrap::Repeat => 0,
            Wrap::Mirror => 1,
            Wrap::Clamp => 2,
        };
        let record = |material: &crate::surface::Material| {
            let plain = MaterialRecord { color: material.color, start: 0, size: [1; 2], levels: 0, wrap: 0 };
            material.texture.map_or(plain, |index| {
                let texture = &looks.textures[index as usize];
                let (start, first) = starts[index as usize];
                MaterialRecord {
                    start,
                    size: texture.size(first),
                    levels: (texture.mips.len() - first) as u32,
                    wrap: wrap(texture.wrap[0]) | wrap(texture.wrap[1]) << 2,
                    ..plain
                }
            })
        };
        let materials: Vec<MaterialRecord> = looks.materials.iter().map(record).collect();
        Ok(Self {
            materials: gpu.upload("materials", &materials, Usage::STORAGE)?,
            texels: gpu.upload("texels", &texels, Usage::STORAGE)?,
        })
    }
}

/// Colour and normal of a voxel.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Attributes {
    /// sRGB-encoded colour; black if it was not wanted.
    pub color: [u8; 3],
    /// Unit normal; zero if it was not wanted.
    pub normal: [f32; 3],
}

impl Attributes {
    /// The mean that sums stand for.
    pub(crate) fn of_sums(sums: &[u32], wanted: Wanted) -> Result<Self, RasterError> {
        let triangles = sums[0];
        if triangles > MOST {
            return Err(RasterError::TooManyInVoxel { triangles, most: MOST });
        }
        let mean = |at: usize| sums[at] as i32 as f32 / (STEPS * triangles.max(1) as f32);
        let vector = |at: usize| Vec3::new(mean(at), mean(at + 1), mean(at + 2));
        let color = if wanted.colors { vector(1).to_array().map(encoded) } else { [0; 3] };
        let mut normal = Vec3::ZERO;
        if wanted.normals {
            normal = vector(4);
            if normal.length() < CANCELLED {
                normal = vector(7);
            }
            normal = normal.normalize_or(Vec3::Z);
        }
        Ok(Self { color, normal: normal.to_array() })
    }
}

/// The sRGB byte of a linear value.
fn encoded(linear: f32) -> u8 {
    (srgb::encode(linear) * 255.0).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_become_means() {
        let wanted = Wanted { colors: true, normals: true };
        let s = STEPS as i32;
        // Two triangles that face each other, one white and one black.
        let sums = [2, s, s, s, 0, 0, 0, 0, 2 * s, 0].map(|x| x as u32);
        let found = Attributes::of_sums(&sums, wanted).unwrap();
        assert_eq!(found, Attributes { color: [188; 3], normal: [0.0, 1.0, 0.0] });
        let sums = [1, 0, 0, s, 0, 0, -s, 0, 0, s].map(|x| x as u32);
        let found = Attributes::of_sums(&sums, wanted).unwrap();
        assert_eq!(found, Attributes { color: [0, 0, 255], normal: [0.0, 0.0, -1.0] });
        let many = [MOST + 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        assert!(Attributes::of_sums(&many, wanted).unwrap_err().to_string().contains("triangles meet one voxel"));
    }
}
