//! What materials of glTF have besides colour and normals: emission, roughness and metalness, opacity, and their number.

use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;

use super::assembly::Assembly;
use super::error::ImportError;
use super::gltf_data::Source;
use super::gltf_material::{Materials, Wanted, emission, unit};
use crate::mesh::properties::{Properties, PropertyMap};

/// Extension with a number that multiplies the emission.
const STRENGTH: &str = "KHR_materials_emissive_strength";
/// Largest emission: what octrees can hold.
const MOST: f32 = esvo_format::MAX_RGB9E5 as f32;

/// Whether a material has glossiness instead of roughness, which counts then as its colour does.
pub(super) fn is_glossy(material: &json::Material) -> bool {
    material.extensions.as_ref().is_some_and(|e| e.pbr_specular_glossiness.is_some())
}

impl Materials {
    /// The properties of a material. Textures are left out without coordinates; their mean counts then.
    pub(super) fn properties(
        &mut self,
        source: &Source<'_>,
        index: usize,
        material: &json::Material,
        wanted: Option<&Wanted>,
        name: &str,
        assembly: &mut Assembly,
    ) -> Result<Properties, ImportError> {
        let pbr = &material.pbr_metallic_roughness;
        let strength =
            material.extensions.as_ref().and_then(|e| e.others.get(STRENGTH)?.get("emissiveStrength")?.as_f64());
        let strength = strength.filter(|x| x.is_finite() && *x >= 0.0).unwrap_or(1.0) as f32;
        let mut own = Properties {
            emission: emission(material).map(|x| (x * strength).min(MOST)),
            colored_by_emission: self.emits(Some(index)),
            roughness: unit(pbr.roughness_factor.0),
            metalness: unit(pbr.metallic_factor.0),
            blends: matches!(material.alpha_mode, Checked::Valid(AlphaMode::Blend)),
            number: u32::try_from(index).map_or(0, |index| index.saturating_add(1)),
            ..Properties::default()
        };
        if let Some(info) =
            material.emissive_texture.as_ref().filter(|_| own.emission != [0.0; 3] && self.property_maps)
        {
            match self.texture(source, info.index.value())? {
                Ok(texture) => match wanted.and_then(|w| w.emission_map) {
                    Some(uv_transform) => own.emission_map = Some(PropertyMap { texture, uv_transform }),
                    None => {
                        assembly.warn(elsewhere(name, "emission"));
                        let mean = texture.sample([0.5; 2], f32::MAX);
                        own.emission = std::array::from_fn(|k| own.emission[k] * mean[k]);
                    }
                },
                Err(why) => assembly.warn(format!("material {name}: {why}; using a plain emission")),
            }
        }
        if is_glossy(material) {
            let glossiness = material.extensions.as_ref().and_then(|e| e.pbr_specular_glossiness.as_ref());
            own.roughness = 1.0 - glossiness.map_or(1.0, |g| unit(g.glossiness_factor.0));
            own.metalness = 0.0;
        } else if let Some(info) = pbr.metallic_roughness_texture.as_ref().filter(|_| self.property_maps) {
            match self.normals(source, info.index.value())? {
                Ok(texture) => match wanted.and_then(|w| w.surface_map) {
                    Some(uv_transform) => own.surface_map = Some(PropertyMap { texture, uv_transform }),
                    None => {
                        assembly.warn(elsewhere(name, "roughness and metalness"));
                        let [_, green, blue] = texture.sample([0.5; 2], f32::MAX);
                        (own.roughness, own.metalness) = (own.roughness * green, own.metalness * blue);
                    }
                },
                Err(why) => assembly.warn(format!("material {name}: {why}; using a plain roughness and metalness")),
            }
        }
        Ok(own)
    }
}

fn elsewhere(name: &str, what: &str) -> String {
    format!(
        "material {name}: the texture of its {what} needs other texture coordinates than its colour; its mean is used"
    )
}
