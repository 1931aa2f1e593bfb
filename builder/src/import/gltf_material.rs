//! Materials of glTF: base colour, its texture, and where that leaves holes.

use std::collections::HashMap;
use std::sync::Arc;

use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::texture::{Info, WrappingMode};
use gltf::json::validation::Checked;

use super::ImportError;
use super::assembly::Assembly;
use super::gltf_data::{Resource, Source};
use super::image::{TextureStore, texture_of};
use super::mtl::has_holes;
use crate::mesh::{Material, Texture};

/// How a material reads its texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coordinates {
    /// The number of the `TEXCOORD` attribute.
    pub(super) set: u32,
    /// `KHR_texture_transform`: what takes `[u, v, 1]` to the coordinates to use.
    rows: [[f32; 3]; 2],
    /// Whether coordinates past 0..=1 repeat the image; the only way [`Texture::sample`] knows.
    pub(super) repeats: bool,
}

impl Coordinates {
    fn of(info: &Info, repeats: bool) -> Self {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        let plain = Self { set: info.tex_coord, rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], repeats };
        let Some(t) = transform else { return plain };
        let (sin, cos) = t.rotation.0.sin_cos();
        let ([sx, sy], [ox, oy]) = (t.scale.0, t.offset.0);
        Self {
            set: t.tex_coord.unwrap_or(info.tex_coord),
            rows: [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]],
            repeats,
        }
    }

    pub(super) fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        self.rows.map(|[a, b, c]| a * u + b * v + c)
    }
}

/// The parts of a glTF material that matter here.
struct BaseColor<'a> {
    factor: [f32; 4],
    texture: Option<&'a Info>,
}

impl<'a> BaseColor<'a> {
    fn of(material: &'a json::Material) -> Self {
        let pbr = &material.pbr_metallic_roughness;
        let plain = Self { factor: pbr.base_color_factor.0, texture: pbr.base_color_texture.as_ref() };
        match material.extensions.as_ref().and_then(|e| e.pbr_specular_glossiness.as_ref()) {
            Some(old) => Self { factor: old.diffuse_factor.0, texture: old.diffuse_texture.as_ref() },
            None => plain,
        }
    }
}

/// Converts materials when a primitive first uses them, each in up to two forms: with its texture and without.
#[derive(Default)]
pub(super) struct Materials {
    store: TextureStore,
    converted: HashMap<(Option<usize>, bool), u32>,
    embedded: HashMap<usize, Arc<Texture>>,
}

impl Materials {
    /// How the texture of `material` wants its coordinates, or `None` if it has no texture.
    pub(super) fn coordinates(
        source: &Source<'_>,
        material: Option<usize>,
    ) -> Result<Option<Coordinates>, ImportError> {
        let Some(index) = material else { return Ok(None) };
        let materials = &source.root.materials;
        let material = materials.get(index).ok_or_else(|| source.out_of_range("material", index, materials.len()))?;
        let Some(info) = BaseColor::of(material).texture else { return Ok(None) };
        let textures = &source.root.textures;
        let texture = textures
            .get(info.index.value())
            .ok_or_else(|| source.out_of_range("texture", info.index.value(), textures.len()))?;
        let sampler = texture.sampler.and_then(|s| source.root.samplers.get(s.value()));
        let repeats = sampler.is_none_or(|s| {
            [&s.wrap_s, &s.wrap_t].into_iter().all(|w| matches!(w, Checked::Valid(WrappingMode::Repeat)))
        });
        Ok(Some(Coordinates::of(info, repeats)))
    }

    /// The index in the mesh of the material, which [`Self::coordinates`] has accepted; `None`: the default one.
    pub(super) fn index(
        &mut self,
        source: &Source<'_>,
        material: Option<usize>,
        textured: bool,
        assembly: &mut Assembly,
    ) -> Result<u32, ImportError> {
        if let Some(&index) = self.converted.get(&(material, textured)) {
            return Ok(index);
        }
        let converted = match material.and_then(|i| Some((i, source.root.materials.get(i)?))) {
            Some((index, material)) => self.convert(source, index, material, textured, assembly)?,
            None => Material { base_color: [1.0; 4], ..Material::default() },
        };
        let index = assembly.mesh.materials.len() as u32;
        assembly.mesh.materials.push(converted);
        self.converted.insert((material, textured), index);
        Ok(index)
    }

    fn convert(
        &mut self,
        source: &Source<'_>,
        index: usize,
        material: &json::Material,
        textured: bool,
        assembly: &mut Assembly,
    ) -> Result<Material, ImportError> {
        let name = material.name.clone().unwrap_or_else(|| format!("material {index}"));
        let color = BaseColor::of(material);
        let texture = match color.texture {
            Some(info) if textured => self.texture(source, info.index.value(), &name, assembly)?,
            _ => None,
        };
        let unit = |x: f32| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 };
        let mut base_color = color.factor.map(unit);
        let glow = material.emissive_factor.0.map(unit);
        if base_color[..3] == [0.0; 3] && glow != [0.0; 3] {
            // A lamp: black under light, and seen by what it sends out.
            base_color[..3].copy_from_slice(&glow);
        }
        let alpha_cutoff = match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => Some(unit(material.alpha_cutoff.unwrap_or_default().0)),
            Checked::Valid(AlphaMode::Blend) if texture.as_deref().is_some_and(has_holes) => {
                assembly.warn(format!("material {name} blends; texels of less than half opacity become holes"));
                // Relative to the opacity of the whole, so that thin glass is not one large hole.
                Some(0.5 * base_color[3])
            }
            Checked::Valid(_) => None,
            Checked::Invalid => return Err(source.malformed(format!("material {index} has an unknown alphaMode"))),
        };
        Ok(Material { name, base_color, texture, alpha_cutoff, ..Material::default() })
    }

    /// The image of a texture; `None` with a warning if its file is missing or it has no image that can be read.
    fn texture(
        &mut self,
        source: &Source<'_>,
        texture: usize,
        material: &str,
        assembly: &mut Assembly,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        let textures = &source.root.textures;
        let entry = textures.get(texture).ok_or_else(|| source.out_of_range("texture", texture, textures.len()))?;
        let index = entry.source.value();
        if index == u32::MAX as usize {
            // What the JSON parser says for a texture without `source`: the image is left to an extension.
            assembly
                .warn(format!("material {material}: texture {texture} has no PNG or JPEG image; using a plain colour"));
            return Ok(None);
        }
        let images = &source.root.images;
        let image = images.get(index).ok_or_else(|| source.out_of_range("image", index, images.len()))?;
        if let Some(texture) = self.embedded.get(&index) {
            return Ok(Some(texture.clone()));
        }
        let name = format!("{index} (embedded)");
        let decoded = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match source.resolve(uri, &format!("image {index}"))? {
                Resource::File(file) => {
                    let found = self.store.load(source.path, &file)?;
                    if found.is_none() {
                        let missing = file.display();
                        assembly.warn(format!(
                            "material {material}: the texture {missing} is missing; using a plain colour"
                        ));
                    }
                    return Ok(found);
                }
                Resource::Embedded { bytes } => self.store.decode(source.path, &name, &bytes, None)?,
            },
            (None, Some(view)) => {
                let (bytes, _) = source.view(view.value())?;
                self.store.decode(source.path, &name, bytes, None)?
            }
            (None, None) => return Err(source.malformed(format!("image {index} has neither uri nor bufferView"))),
        };
        let texture = texture_of(source.path, &name, &decoded)?;
        self.embedded.insert(index, texture.clone());
        Ok(Some(texture))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_transforms_follow_the_extension() {
        let json = r#"{"index":0,"texCoord":1,"extensions":{"KHR_texture_transform":
            {"offset":[0.5,0.25],"rotation":1.5707963,"scale":[2,4],"texCoord":3}}}"#;
        let info: Info = json::deserialize::from_str(json).unwrap();
        let coordinates = Coordinates::of(&info, true);
        assert_eq!(coordinates.set, 3);
        // Scaled, then turned so that (1, 0) becomes (0, -1) and (0, 1) becomes (1, 0), then moved.
        for (from, to) in [([0.0, 0.0], [0.5, 0.25]), ([1.0, 0.0], [0.5, -1.75]), ([0.0, 1.0], [4.5, 0.25])] {
            let found = coordinates.apply(from);
            assert!((found[0] - to[0]).abs() < 1e-5 && (found[1] - to[1]).abs() < 1e-5, "{from:?}: {found:?}");
        }
        let plain: Info = json::deserialize::from_str(r#"{"index":0,"texCoord":1}"#).unwrap();
        assert_eq!(Coordinates::of(&plain, true).apply([0.3, 0.7]), [0.3, 0.7]);
    }
}
