//! Materials as the recursion reads them.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::color_map::ColorMap;
use super::properties::PropertyLook;
use super::range::{AlphaMap, RangeMap};
use super::srgb::encode_srgb;
use super::texels::TexelMap;
use crate::{ComponentSettings, Material, Mesh, NormalMap, Texture, TextureTest};

/// A material.
pub(crate) struct Look {
    /// Linear RGB, which multiplies everything else.
    pub base: Vec3,
    /// `base` encoded as sRGB, if the colour depends on nothing else.
    pub plain: Option<[u8; 3]>,
    /// The colour texture.
    pub texture: Option<Arc<ColorMap>>,
    /// Bounds of the texture's colours, if the test for refinement looks at texels.
    pub color_range: Option<Arc<Ranges>>,
    /// The normal map.
    pub normal_map: Option<NormalMap>,
    /// Bounds of the normal map's channels, if the test for refinement looks at texels.
    pub normal_range: Option<Arc<Ranges>>,
    /// Which parts are holes.
    pub cutout: Cutout,
    /// What components come from.
    pub properties: PropertyLook,
}

/// Bounds of a map's texels, as a test for refinement sees them.
pub(crate) enum Ranges {
    /// Of the full image.
    Texels(TexelMap),
    /// Of the image averaged to the size of the finest voxels.
    Averages(RangeMap<3>),
}

/// Which parts of a material are holes.
pub(crate) enum Cutout {
    /// None.
    Solid,
    /// All of it.
    Gone,
    /// The parts that the texture's alpha cuts out.
    Map(Arc<AlphaMap>),
}

/// Maps that several materials can share, by the address of the texture that they were made from.
#[derive(Default)]
struct Shared {
    maps: HashMap<*const Texture, Arc<ColorMap>>,
    colors: HashMap<*const Texture, Arc<Ranges>>,
    normals: HashMap<*const crate::LinearTexture<3>, Arc<Ranges>>,
    /// By texture and by the smallest alpha that is solid.
    alphas: HashMap<(*const Texture, u32), Arc<AlphaMap>>,
}

impl Ranges {
    fn of_colors(texture: &Arc<Texture>, test: TextureTest) -> Self {
        match test {
            TextureTest::Texels => Self::Texels(TexelMap::of_colors(texture)),
            _ => Self::Averages(RangeMap::of_colors(texture)),
        }
    }

    fn of_channels(texture: &crate::LinearTexture<3>, test: TextureTest) -> Self {
        match test {
            TextureTest::Texels => Self::Texels(TexelMap::of_channels(texture)),
            _ => Self::Averages(RangeMap::of_channels(texture)),
        }
    }
}

impl Look {
    /// All materials of a mesh.
    pub(crate) fn all(mesh: &Mesh, test: TextureTest, kept: ComponentSettings) -> Arc<[Self]> {
        let mut shared = Shared::default();
        mesh.materials.iter().map(|m| Self::new(m, mesh, test, kept, &mut shared)).collect()
    }

    fn new(material: &Material, mesh: &Mesh, test: TextureTest, kept: ComponentSettings, shared: &mut Shared) -> Self {
        let [r, g, b, alpha] = material.base_color;
        // What is coloured by its emission scatters no light: with the emission stored, it is black.
        let black = kept.emission && material.properties.colored_by_emission;
        let base = if black { Vec3::ZERO } else { Vec3::new(r, g, b) };
        let texels = test != TextureTest::Centroids;
        let texture = material.texture.clone().filter(|_| !mesh.uvs.is_empty());
        let normal_map = material.normal_map.clone().filter(|_| !mesh.uvs.is_empty());
        let color_range = texture.as_ref().filter(|_| texels).map(|texture| {
            let entry = shared.colors.entry(Arc::as_ptr(texture));
            entry.or_insert_with(|| Arc::new(Ranges::of_colors(texture, test))).clone()
        });
        let normal_range = normal_map.as_ref().filter(|_| texels).map(|map| {
            let entry = shared.normals.entry(Arc::as_ptr(&map.texture));
            entry.or_insert_with(|| Arc::new(Ranges::of_channels(&map.texture, test))).clone()
        });
        let cutout = match (material.alpha_cutoff, &texture) {
            (None, _) => Cutout::Solid,
            (Some(cutoff), None) => {
                if alpha < cutoff {
                    Cutout::Gone
                } else {
                    Cutout::Solid
                }
            }
            (Some(cutoff), Some(texture)) => {
                let least = if alpha > 0.0 { cutoff / alpha } else { f32::INFINITY };
                let entry = shared.alphas.entry((Arc::as_ptr(texture), least.to_bits()));
                let map = entry.or_insert_with(|| Arc::new(AlphaMap::new(texture, least))).clone();
                if map.is_all_hole() {
                    Cutout::Gone
                } else if map.is_all_solid() {
                    Cutout::Solid
                } else {
                    Cutout::Map(map)
                }
            }
        };
        // Alpha of a texture may be needed where its colours are not.
        let needed = !black || matches!(cutout, Cutout::Map(_)) || kept.opacity && material.properties.blends;
        let (texture, color_range) = if needed { (texture, color_range) } else { (None, None) };
        let mut properties = PropertyLook::new(material, !mesh.uvs.is_empty(), kept);
        if let Some(map) = properties.emission_map.as_ref().filter(|_| texels) {
            let entry = shared.colors.entry(Arc::as_ptr(&map.texture));
            properties.emission_range =
                Some(entry.or_insert_with(|| Arc::new(Ranges::of_colors(&map.texture, test))).clone());
        }
        let texture = texture.map(|texture| {
            let entry = shared.maps.entry(Arc::as_ptr(&texture));
            entry.or_insert_with(|| Arc::new(ColorMap::new(texture))).clone()
        });
        let plain = (texture.is_none() && (mesh.colors.is_empty() || black)).then(|| encode_srgb(base));
        Self { base, plain, texture, color_range, normal_map, normal_range, cutout, properties }
    }

    /// Whether the colour, the normal or the holes can vary over a triangle even if its vertex normals do not.
    pub(crate) fn varies(&self) -> bool {
        self.plain.is_none()
            || self.normal_map.is_some()
            || matches!(self.cutout, Cutout::Map(_))
            || self.properties.varies()
    }

    /// Texels of the full colour texture across the unit of texture coordinates.
    pub(crate) fn texture_size(&self) -> Option<Vec2> {
        let mip = &self.texture.as_ref()?.texture.mips[0];
        Some(Vec2::new(mip.width as f32, mip.height as f32))
    }
}
