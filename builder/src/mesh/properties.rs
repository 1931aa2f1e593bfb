//! What a material does with light besides its colour, and which material it is: what components of voxels are made from.

use std::sync::Arc;

use super::maps::{LinearTexture, UvTransform};
use super::texture::Texture;

/// Emission, roughness and metalness, opacity, and number of a material.
#[derive(Clone, Debug)]
pub struct Properties {
    /// Emitted light, linear RGB, 0 or more. Multiplies the texture.
    pub emission: [f32; 3],
    /// Colours of the emitted light, if they vary.
    pub emission_map: Option<PropertyMap<Texture>>,
    /// Whether the colour of the material is that of its emission, as it scatters no light: for octrees without emission.
    pub colored_by_emission: bool,
    /// Roughness, 0..=1. Multiplies green of the texture.
    pub roughness: f32,
    /// Metalness, 0..=1. Multiplies blue of the texture.
    pub metalness: f32,
    /// Roughness in green and metalness in blue, if they vary.
    pub surface_map: Option<PropertyMap<LinearTexture<3>>>,
    /// Whether alpha of the colour is opacity. Otherwise the material is opaque but for its holes.
    pub blends: bool,
    /// Number of the material, 1 for the first of the file; 0 for none.
    pub number: u32,
}

/// A texture of a property.
#[derive(Clone, Debug)]
pub struct PropertyMap<T> {
    /// The texels.
    pub texture: Arc<T>,
    /// From the texture coordinates of the mesh to those of the texture.
    pub uv_transform: UvTransform,
}

impl Default for Properties {
    fn default() -> Self {
        Self {
            emission: [0.0; 3],
            emission_map: None,
            colored_by_emission: false,
            roughness: 1.0,
            metalness: 0.0,
            surface_map: None,
            blends: false,
            number: 0,
        }
    }
}

impl Properties {
    /// The name of a number that is infinite or NaN.
    pub(super) fn non_finite(&self) -> Option<&'static str> {
        let finite = |transform: Option<&UvTransform>| {
            transform.is_none_or(|transform| transform.rows.as_flattened().iter().all(|x| x.is_finite()))
        };
        [
            ("emission", self.emission.iter().all(|x| x.is_finite())),
            ("roughness", self.roughness.is_finite()),
            ("metalness", self.metalness.is_finite()),
            ("texture transform of the emission", finite(self.emission_map.as_ref().map(|m| &m.uv_transform))),
            ("texture transform of the roughness", finite(self.surface_map.as_ref().map(|m| &m.uv_transform))),
        ]
        .into_iter()
        .find_map(|(what, finite)| (!finite).then_some(what))
    }

    /// The numbers, and the texels of the textures, as bytes: for a hash.
    pub(crate) fn visit_bytes(&self, mut part: impl FnMut(&[u8])) {
        let Self { emission, roughness, metalness, blends, number, colored_by_emission, emission_map, surface_map } =
            self;
        part(format!("{:?}", (emission, roughness, metalness, blends, number, colored_by_emission)).as_bytes());
        if let Some(map) = emission_map {
            part(format!("emission {:?} {:?}", map.uv_transform.rows, map.texture.wrap).as_bytes());
            part(bytemuck::cast_slice(&map.texture.mips[0].texels));
        }
        if let Some(map) = surface_map {
            part(format!("surface {:?} {:?}", map.uv_transform.rows, map.texture.wrap).as_bytes());
            part(bytemuck::cast_slice(&map.texture.mips[0].texels));
        }
    }
}
