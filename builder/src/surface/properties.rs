//! Components of voxels: emission, roughness and metalness, opacity and material of the surface in them, averaged over its area as
//! colours are. The material is that of most of the area; if several have as much, the one with the lowest number.
//!
//! Which columns a tree has is decided once for a mesh: those that the settings ask for and that some material needs.

use std::sync::Arc;

use esvo_format::file::attachment;
use esvo_format::{Column, ComponentFormat, NumberFormat};
use glam::{DVec3, Vec2, Vec3, Vec3A};

use super::Surface;
use super::attributes::at_least;
use super::look::{Look, Ranges};
use super::srgb::encode_srgb;
use super::voxel::VoxelSurface;
use crate::clip::polygon::area_and_centroid;
use crate::mesh::maps::{LinearTexture, UvTransform};
use crate::mesh::properties::PropertyMap;
use crate::{ComponentSettings, Material, Texture};

/// The properties of a material as the recursion reads them.
pub(crate) struct PropertyLook {
    pub emission: Vec3,
    pub emission_map: Option<PropertyMap<Texture>>,
    /// Bounds of the colours of the emission map, if the test for refinement looks at texels.
    pub emission_range: Option<Arc<Ranges>>,
    pub roughness: f32,
    pub metalness: f32,
    pub surface_map: Option<PropertyMap<LinearTexture<3>>>,
    /// Alpha that multiplies that of the colour texture; 1 for an opaque material.
    pub opacity: f32,
    pub blends: bool,
    pub number: u32,
}

impl PropertyLook {
    /// Those of a material that the settings keep. `textured`: whether the mesh has texture coordinates.
    pub(crate) fn new(material: &Material, textured: bool, kept: ComponentSettings) -> Self {
        let given = &material.properties;
        let mut own = Self::default();
        if kept.emission {
            own.emission = given.emission.map(|x| x.max(0.0)).into();
            own.emission_map = given.emission_map.clone().filter(|_| textured && own.emission != Vec3::ZERO);
        }
        if kept.roughness_metalness {
            (own.roughness, own.metalness) = (given.roughness, given.metalness);
            own.surface_map = given.surface_map.clone().filter(|_| textured);
        }
        if kept.opacity && given.blends {
            (own.opacity, own.blends) = (material.base_color[3], true);
        }
        if kept.material {
            own.number = given.number;
        }
        own
    }

    /// Whether emission, roughness or metalness can vary over a triangle.
    pub(crate) fn varies(&self) -> bool {
        self.emission_map.is_some() || self.surface_map.is_some()
    }
}

impl Default for PropertyLook {
    fn default() -> Self {
        Self {
            emission: Vec3::ZERO,
            emission_map: None,
            emission_range: None,
            roughness: 1.0,
            metalness: 0.0,
            surface_map: None,
            opacity: 1.0,
            blends: false,
            number: 0,
        }
    }
}

/// The columns of a tree of surface with these materials.
pub(crate) fn columns(looks: &[Look]) -> Vec<Column> {
    let any = |has: fn(&PropertyLook) -> bool| looks.iter().any(|look| has(&look.properties));
    let most = looks.iter().map(|look| look.properties.number).max().unwrap_or(0);
    let material = if most > u32::from(u16::MAX) {
        ComponentFormat { number: NumberFormat::U32, ..ComponentFormat::MATERIAL }
    } else {
        ComponentFormat::MATERIAL
    };
    let has_surface = |p: &PropertyLook| (p.roughness, p.metalness) != (1.0, 0.0) || p.surface_map.is_some();
    [
        (any(|p| p.emission != Vec3::ZERO), attachment::EMISSION, ComponentFormat::EMISSION),
        (any(has_surface), attachment::ROUGHNESS_METALNESS, ComponentFormat::ROUGHNESS_METALNESS),
        (any(|p| p.blends), attachment::OPACITY, ComponentFormat::OPACITY),
        (most > 0, attachment::MATERIAL, material),
    ]
    .into_iter()
    .filter(|(there, ..)| *there)
    .map(|(_, kind, format)| Column::new(kind, format))
    .collect()
}

/// Properties of some surface, as sums weighted by area. Only filled in if the tree has columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Extra {
    emission: [f32; 3],
    roughness: f32,
    metalness: f32,
    opacity: f32,
    number: u32,
}

impl Extra {
    /// The same properties on all of a surface of this weight.
    pub(crate) fn of(self, weight: f32) -> Self {
        Self {
            emission: self.emission.map(|x| x * weight),
            roughness: self.roughness * weight,
            metalness: self.metalness * weight,
            opacity: self.opacity * weight,
            number: self.number,
        }
    }

    /// Sums of parts, each with its weight.
    pub(crate) fn of_parts(parts: impl Iterator<Item = (f32, Self)> + Clone) -> Self {
        let mut sum = Self::default();
        for (_, part) in parts.clone() {
            sum.emission = std::array::from_fn(|k| sum.emission[k] + part.emission[k]);
            sum.roughness += part.roughness;
            sum.metalness += part.metalness;
            sum.opacity += part.opacity;
        }
        Self { number: most(parts.map(|(weight, part)| (part.number, weight))), ..sum }
    }

    /// The words of a column for surface of this weight.
    pub(crate) fn encode(&self, weight: f32, column: &Column) -> [u32; 4] {
        let mean = |x: f32| f64::from(x) / f64::from(weight);
        let numbers = match column.kind {
            attachment::EMISSION => self.emission.map(mean),
            attachment::ROUGHNESS_METALNESS => [mean(self.roughness), mean(self.metalness), 0.0],
            attachment::OPACITY => [mean(self.opacity), 0.0, 0.0],
            _ => [f64::from(self.number), 0.0, 0.0],
        };
        column.format.encode(&numbers)
    }
}

/// The number with the greatest sum of weights; the lowest of several.
fn most(mut numbers: impl Iterator<Item = (u32, f32)> + Clone) -> u32 {
    let Some((first, _)) = numbers.clone().next() else { return 0 };
    if numbers.clone().all(|(number, _)| number == first) {
        return first;
    }
    let mut sums: Vec<(u32, f32)> = Vec::new();
    for (number, weight) in &mut numbers {
        match sums.binary_search_by_key(&number, |sum| sum.0) {
            Ok(at) => sums[at].1 += weight,
            Err(at) => sums.insert(at, (number, weight)),
        }
    }
    let mut best = sums[0];
    for sum in sums {
        if sum.1 > best.1 {
            best = sum;
        }
    }
    best.0
}

/// Properties of the surface in a voxel.
pub(crate) fn extra(voxel: &VoxelSurface) -> Extra {
    let surface = voxel.surface;
    let samples: Vec<(f32, Extra)> = (voxel.pieces.iter())
        .map(|piece| {
            let vertices = voxel.arena.vertices(piece, &surface.corners);
            let normal = surface.normals[piece.triangle as usize].into();
            let (area, centroid) = area_and_centroid(vertices, normal);
            let weight = at_least(area, voxel.size);
            (weight, surface.properties_at(piece.triangle, centroid, voxel.size).of(weight))
        })
        .collect();
    Extra::of_parts(samples.iter().copied())
}

impl Surface<'_> {
    /// The properties of a triangle at point `p` of it, filtered to the size of a voxel.
    pub(crate) fn properties_at(&self, triangle: u32, p: DVec3, voxel_size: f64) -> Extra {
        let look = self.look(triangle);
        let own = &look.properties;
        let mut found = Extra {
            emission: own.emission.into(),
            roughness: own.roughness,
            metalness: own.metalness,
            opacity: own.opacity,
            number: own.number,
        };
        let alpha = look.texture.as_ref().filter(|_| own.blends);
        if !own.varies() && alpha.is_none() {
            return found;
        }
        let Some(uv) = self.uv_at(triangle, p) else { return found };
        let footprint = |size: (u32, u32), transform: &UvTransform| {
            voxel_size as f32 * self.map_density(triangle, Vec2::new(size.0 as f32, size.1 as f32), transform)
        };
        if let Some(map) = &own.emission_map {
            let mip = &map.texture.mips[0];
            let footprint = footprint((mip.width, mip.height), &map.uv_transform);
            let [r, g, b, _] = map.texture.sample(map.uv_transform.apply(uv.into()), footprint);
            found.emission = (own.emission * Vec3::new(r, g, b)).into();
        }
        if let Some(map) = &own.surface_map {
            let mip = &map.texture.mips[0];
            let footprint = footprint((mip.width, mip.height), &map.uv_transform);
            let [_, green, blue] = map.texture.sample(map.uv_transform.apply(uv.into()), footprint);
            (found.roughness, found.metalness) = (own.roughness * green, own.metalness * blue);
        }
        if let Some(map) = alpha {
            let mip = &map.texture.mips[0];
            let footprint = footprint((mip.width, mip.height), &UvTransform::IDENTITY);
            found.opacity = own.opacity * map.texture.sample(uv.into(), footprint)[3];
        }
        found
    }

    /// Whether one emission is within the bound of colours everywhere on some surface in a voxel: as of colours, sRGB-encoded, what is
    /// brighter than white being white.
    pub(crate) fn emission_fits<'a>(
        &self,
        pieces: impl Iterator<Item = (u32, &'a [DVec3])>,
        voxel_size: f64,
        color_error: f32,
    ) -> bool {
        let (mut low, mut high) = ([u8::MAX; 3], [0u8; 3]);
        for (triangle, vertices) in pieces {
            let [lo, hi] = self.emission_range(triangle, vertices, voxel_size);
            low = std::array::from_fn(|k| low[k].min(lo[k]));
            high = std::array::from_fn(|k| high[k].max(hi[k]));
        }
        (0..3).all(|k| f32::from(high[k].saturating_sub(low[k])) <= 2.0 * color_error)
    }

    /// Least and greatest emission of a piece, sRGB-encoded.
    fn emission_range(&self, triangle: u32, vertices: &[DVec3], voxel_size: f64) -> [[u8; 3]; 2] {
        let own = &self.look(triangle).properties;
        let shown = |emission: Vec3| encode_srgb(emission.min(Vec3::ONE));
        let bounds = own.emission_map.as_ref().and_then(|map| {
            let range = own.emission_range.as_ref()?;
            let mip = &map.texture.mips[0];
            let density = self.map_density(triangle, Vec2::new(mip.width as f32, mip.height as f32), &map.uv_transform);
            self.color_bounds(triangle, vertices, range, |uv| map.uv_transform.apply(uv.into()).into(), density)
        });
        match bounds {
            Some([lo, hi]) => [shown(own.emission * lo), shown(own.emission * hi)],
            None if own.emission_map.is_some() => {
                let normal = Vec3A::from(self.normals[triangle as usize]);
                let (_, centroid) = area_and_centroid(vertices, normal);
                [shown(self.properties_at(triangle, centroid, voxel_size).emission.into()); 2]
            }
            None => [shown(own.emission); 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_material_of_most_area_wins_and_the_lowest_of_equals() {
        assert_eq!(most([].into_iter()), 0);
        assert_eq!(most([(7, 0.1)].into_iter()), 7);
        assert_eq!(most([(7, 0.4), (3, 0.3), (3, 0.3)].into_iter()), 3);
        assert_eq!(most([(9, 0.5), (4, 0.5)].into_iter()), 4);
        assert_eq!(most([(4, 0.5), (9, 0.5)].into_iter()), 4);
        assert_eq!(most([(0, 0.5), (9, 0.75)].into_iter()), 9);
    }

    #[test]
    fn sums_become_means() {
        let part = |emission: f32, opacity: f32, number| Extra {
            emission: [emission; 3],
            roughness: 0.5,
            metalness: 1.0,
            opacity,
            number,
        };
        let sum = Extra::of_parts([(3.0, part(8.0, 1.0, 2).of(3.0)), (1.0, part(0.0, 0.0, 1).of(1.0))].into_iter());
        let read = |kind: u32, format: ComponentFormat| {
            let column = Column::new(kind, format);
            format.decode(&sum.encode(4.0, &column)).used().to_vec()
        };
        assert_eq!(read(attachment::EMISSION, ComponentFormat::EMISSION), [6.0; 3]);
        assert_eq!(read(attachment::ROUGHNESS_METALNESS, ComponentFormat::ROUGHNESS_METALNESS), [128.0 / 255.0, 1.0]);
        assert_eq!(read(attachment::OPACITY, ComponentFormat::OPACITY), [191.0 / 255.0]);
        assert_eq!(read(attachment::MATERIAL, ComponentFormat::MATERIAL), [2.0]);
    }
}
