//! Triangle meshes as the builder takes them: indexed triangles, one material each, attributes per vertex.

use std::sync::Arc;

/// An indexed triangle mesh in its own units.
///
/// Vertex attributes other than the position are optional: each array is either empty or as long as `positions`.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions in mesh units. Every component must be finite.
    pub positions: Vec<[f64; 3]>,
    /// Unit shading normals per vertex, or empty (the geometric normal is used then).
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates per vertex, or empty. `v` grows downwards from the first row of the image; coordinates wrap.
    pub uvs: Vec<[f32; 2]>,
    /// Vertex colours in linear RGB, 0..=1, or empty. They multiply the material's colour.
    pub colors: Vec<[f32; 3]>,
    /// Vertex indices of each triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `materials` for each triangle; as long as `triangles`.
    pub triangle_materials: Vec<u32>,
    /// At least one material if there is a triangle.
    pub materials: Vec<Material>,
    /// What the loader had to say: missing textures, skipped primitives. One line each.
    pub warnings: Vec<String>,
}

/// Surface colour of a set of triangles.
#[derive(Clone, Debug)]
pub struct Material {
    /// The name in the source file, or a made-up one.
    pub name: String,
    /// Linear RGB and alpha, 0..=1. Multiplies the texture.
    pub base_color: [f32; 4],
    /// Colour texture, if any.
    pub texture: Option<Arc<Texture>>,
    /// Texels (or plain colours) whose alpha is below this are holes; `None`: opaque.
    pub alpha_cutoff: Option<f32>,
}

impl Default for Material {
    fn default() -> Self {
        Self { name: "default".into(), base_color: [0.8, 0.8, 0.8, 1.0], texture: None, alpha_cutoff: None }
    }
}

/// An image with all its mip levels, 8 bits per channel: RGB encoded as sRGB, alpha linear.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Mip levels, the full image first, each half the size of the one before (rounded down, at least 1).
    pub mips: Vec<MipLevel>,
}

/// One mip level: row-major RGBA, first row on top.
#[derive(Clone, Debug)]
pub struct MipLevel {
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Vec<[u8; 4]>,
}
