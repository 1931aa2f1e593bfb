//! What is voxelized: triangles, and how they look.

use glam::{DVec3, Vec2};

use crate::RasterError;

/// Triangles in a grid, whose edge has length 1 and whose lower corner is the origin.
///
/// Parts outside of the grid are cut off. Triangles without an area count like others: a voxel that they touch is set.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The corners of each triangle.
    pub corners: &'a [[DVec3; 3]],
    /// How the triangles look, if voxels shall have attributes.
    pub looks: Option<&'a Looks>,
}

/// Colours and normals of triangles.
#[derive(Clone, Debug, Default)]
pub struct Looks {
    /// One for each triangle.
    pub triangles: Vec<TriangleLook>,
    /// Materials that triangles refer to.
    pub materials: Vec<Material>,
    /// Textures that materials refer to.
    pub textures: Vec<Texture>,
}

/// What is different at the corners of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct TriangleLook {
    /// Normals, not zero.
    pub normals: [[f32; 3]; 3],
    /// Texture coordinates; v grows downwards.
    pub uvs: [[f32; 2]; 3],
    /// Linear RGB that multiplies the material's.
    pub colors: [[f32; 3]; 3],
    /// Index into [`Looks::materials`].
    pub material: u32,
}

/// A plain colour, or one that multiplies a texture.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    /// Linear RGB.
    pub color: [f32; 3],
    /// Index into [`Looks::textures`].
    pub texture: Option<u32>,
}

/// How a texture goes on outside of its coordinates 0 to 1.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Wrap {
    /// It repeats.
    Repeat,
    /// It repeats, every other time mirrored.
    Mirror,
    /// Its edge goes on.
    Clamp,
}

/// An image with its mip levels, each of half the size of the one before it, rounded down, at least 1.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Width of the first level.
    pub width: u32,
    /// Height of the first level.
    pub height: u32,
    /// For each level its texels, row by row: sRGB-encoded RGB; the fourth byte is not used.
    pub mips: Vec<Vec<[u8; 4]>>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
}

impl Texture {
    /// Width and height of a level.
    pub(crate) fn size(&self, level: usize) -> [u32; 2] {
        [self.width, self.height].map(|side| (side >> level).max(1))
    }
}

impl Looks {
    /// Checks everything that shaders rely on.
    pub(crate) fn check(&self, triangles: usize) -> Result<(), RasterError> {
        let wrong = |what: String| Err(RasterError::Looks(what));
        if self.triangles.len() != triangles {
            return wrong(format!("{} looks were given for {triangles} triangles", self.triangles.len()));
        }
        for (index, look) in self.triangles.iter().enumerate() {
            if look.material as usize >= self.materials.len() {
                return wrong(format!(
                    "triangle {index} refers to material {}, but there are {}",
                    look.material,
                    self.materials.len()
                ));
            }
        }
        for (index, material) in self.materials.iter().enumerate() {
            if material.texture.is_some_and(|texture| texture as usize >= self.textures.len()) {
                return wrong(format!("material {index} refers to a texture that is not there"));
            }
        }
        for (index, texture) in self.textures.iter().enumerate() {
            let fits = |(level, texels): (usize, &Vec<[u8; 4]>)| {
                let [width, height] = texture.size(level);
                u64::from(width) * u64::from(height) == texels.len() as u64
            };
            if texture.mips.is_empty() || !texture.mips.iter().enumerate().all(fits) {
                return wrong(format!("texture {index} has a level whose number of texels does not fit its size"));
            }
        }
        Ok(())
    }

    /// Texels of the finest level across the edge of a voxel, where a texel covers as much of the triangle's surface on average.
    pub(crate) fn texels_per_voxel(&self, look: &TriangleLook, corners: &[DVec3; 3], voxel: f64) -> f32 {
        let Some(texture) = self.materials[look.material as usize].texture else { return 0.0 };
        let texture = &self.textures[texture as usize];
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        let [a, b, c] = look.uvs.map(|uv| Vec2::from(uv) * size);
        let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        let texels = (f64::from((b - a).perp_dot(c - a).abs()) / area).sqrt() * voxel;
        if texels.is_finite() { texels as f32 } else { 0.0 }
    }
}
