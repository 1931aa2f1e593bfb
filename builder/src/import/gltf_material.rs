//! Materials of glTF: base colour with its texture and holes, and normal maps.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode;
use gltf::json::texture::{Info, WrappingMode};
use gltf::json::validation::Checked;
use image::DynamicImage;

use super::assembly::Assembly;
use super::error::{ImportError, one_line};
use super::gltf_data::{Resource, Source};
use super::image::{TextureStore, has_holes, normals_of, texture_of};
use crate::mesh::maps::{LinearTexture, NormalMap, UvTransform};
use crate::mesh::{Material, Texture};

/// Which texture coordinates a material reads, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coordinates {
    /// The number of the `TEXCOORD` attribute.
    pub(super) set: u32,
    /// The transform of `KHR_texture_transform`, or the identity.
    pub(super) transform: UvTransform,
    /// Whether coordinates outside 0..=1 repeat the image. [`Texture::sample`] always repeats it.
    pub(super) repeats: bool,
}

impl Coordinates {
    fn of(set: u32, transform: Option<&TextureTransform>, repeats: bool) -> Self {
        let Some(t) = transform else { return Self { set, transform: UvTransform::IDENTITY, repeats } };
        let (sin, cos) = t.rotation.0.sin_cos();
        let ([sx, sy], [ox, oy]) = (t.scale.0, t.offset.0);
        let rows = [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]];
        Self { set: t.tex_coord.unwrap_or(set), transform: UvTransform { rows }, repeats }
    }
}

/// Which texture coordinates a material needs from the vertices of a primitive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// The coordinates of the colour texture or, without one, of the normal map. The coordinates of the mesh have this
    /// transform applied.
    pub(super) coordinates: Coordinates,
    /// Whether there is a colour texture.
    pub(super) textured: bool,
    /// The transform from the coordinates of the mesh to those of the normal map, if there is one that can be used.
    pub(super) normal_map: Option<UvTransform>,
}

/// The parts of a glTF material that are read.
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

/// Converts materials when a primitive first uses them. Each has up to two forms: with its textures and without.
#[derive(Default)]
pub(super) struct Materials {
    store: TextureStore,
    converted: HashMap<(Option<usize>, bool), u32>,
    embedded: HashMap<usize, Arc<Texture>>,
    embedded_normals: HashMap<usize, Arc<LinearTexture<3>>>,
}

/// Where the image of a texture is.
enum Picture {
    /// In an existing file.
    File(PathBuf),
    /// Embedded: the index of the image and its decoded pixels.
    Embedded(usize, DynamicImage),
    /// Embedded and already converted: the index of the image.
    Known(usize),
}

impl Materials {
    /// Which coordinates `material` needs from the vertices; `None` if it has no textures.
    pub(super) fn wanted(
        source: &Source<'_>,
        material: Option<usize>,
        assembly: &mut Assembly,
    ) -> Result<Option<Wanted>, ImportError> {
        let Some(index) = material else { return Ok(None) };
        let materials = &source.root.materials;
        let material = materials.get(index).ok_or_else(|| source.out_of_range("material", index, materials.len()))?;
        let color = match BaseColor::of(material).texture {
            Some(info) => {
                let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
                Some(coordinates(source, info.index.value(), info.tex_coord, transform)?)
            }
            None => None,
        };
        let Some(normal) = &material.normal_texture else {
            return Ok(color.map(|coordinates| Wanted { coordinates, textured: true, normal_map: None }));
        };
        let transform = normal.extensions.as_ref().and_then(|e| e.others.get("KHR_texture_transform"));
        let transform: Option<TextureTransform> =
            transform.map(|value| json::deserialize::from_value(value.clone())).transpose().map_err(|e| {
                source.malformed(format!("material {index}: the transform of its normal map: {}", one_line(e)))
            })?;
        let normal = coordinates(source, normal.index.value(), normal.tex_coord, transform.as_ref())?;
        let Some(color) = color else {
            let identity = Some(UvTransform::IDENTITY);
            return Ok(Some(Wanted { coordinates: normal, textured: false, normal_map: identity }));
        };
        let same_set = normal.set == color.set;
        let normal_map = if same_set { normal.transform.after_undoing(&color.transform) } else { None };
        if normal_map.is_none() {
            assembly.warn(format!(
                "material {index}: its normal map needs other texture coordinates than its colour; it is left out"
            ));
        }
        Ok(Some(Wanted { coordinates: color, textured: true, normal_map }))
    }

    /// The index in the mesh of a material that [`Self::wanted`] has accepted, or, for `None`, of the default material.
    /// `wanted` is the result of that function if the vertices have these coordinates. If it is `None`, textures are left
    /// out.
    pub(super) fn index(
        &mut self,
        source: &Source<'_>,
        material: Option<usize>,
        wanted: Option<&Wanted>,
        assembly: &mut Assembly,
    ) -> Result<u32, ImportError> {
        let textured = wanted.is_some();
        if let Some(&index) = self.converted.get(&(material, textured)) {
            return Ok(index);
        }
        let converted = match material.and_then(|i| Some((i, source.root.materials.get(i)?))) {
            Some((index, material)) => self.convert(source, index, material, wanted, assembly)?,
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
        wanted: Option<&Wanted>,
        assembly: &mut Assembly,
    ) -> Result<Material, ImportError> {
        let name = material.name.clone().unwrap_or_else(|| format!("material {index}"));
        let color = BaseColor::of(material);
        let texture = match color.texture {
            Some(info) if wanted.is_some() => self.texture(source, info.index.value(), &name, assembly)?,
            _ => None,
        };
        let unit = |x: f32| if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 };
        let mut base_color = color.factor.map(unit);
        let glow = material.emissive_factor.0.map(unit);
        if base_color[..3] == [0.0; 3] && glow != [0.0; 3] {
            // A lamp: its base colour is black, but it emits light. Show the emitted colour.
            base_color[..3].copy_from_slice(&glow);
        }
        let alpha_cutoff = match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => Some(unit(material.alpha_cutoff.unwrap_or_default().0)),
            Checked::Valid(AlphaMode::Blend) if texture.as_deref().is_some_and(has_holes) => {
                assembly.warn(format!("material {name} blends; texels of less than half opacity become holes"));
                // Relative to the opacity of the whole material: otherwise thin glass would be one large hole.
                Some(0.5 * base_color[3])
            }
            Checked::Valid(_) => None,
            Checked::Invalid => return Err(source.malformed(format!("material {index} has an unknown alphaMode"))),
        };
        let normal_map = match (&material.normal_texture, wanted.and_then(|w| w.normal_map)) {
            (Some(info), Some(uv_transform)) => {
                let scale = if info.scale.is_finite() { info.scale } else { 1.0 };
                let texture = self.normals(source, info.index.value(), &name, assembly)?;
                texture.map(|texture| NormalMap { texture, scale, uv_transform })
            }
            _ => None,
        };
        Ok(Material { name, base_color, texture, alpha_cutoff, normal_map, height_map: None })
    }

    /// The colours of a texture. `None`, with a warning, if its file is missing or it has no image that can be read.
    fn texture(
        &mut self,
        source: &Source<'_>,
        texture: usize,
        material: &str,
        assembly: &mut Assembly,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        let known = |index| self.embedded.contains_key(&index);
        match picture(source, texture, &mut self.store, known)? {
            Ok(Picture::File(file)) => self.store.load(source.path, &file),
            Ok(Picture::Known(index)) => Ok(self.embedded.get(&index).cloned()),
            Ok(Picture::Embedded(index, image)) => {
                let made = texture_of(source.path, &embedded_name(index), &image.into_rgba8())?;
                self.embedded.insert(index, made.clone());
                Ok(Some(made))
            }
            Err(why) => {
                assembly.warn(format!("material {material}: {why}; using a plain colour"));
                Ok(None)
            }
        }
    }

    /// The normals of a texture. `None`, with a warning, if its file is missing or it has no image that can be read.
    fn normals(
        &mut self,
        source: &Source<'_>,
        texture: usize,
        material: &str,
        assembly: &mut Assembly,
    ) -> Result<Option<Arc<LinearTexture<3>>>, ImportError> {
        let known = |index| self.embedded_normals.contains_key(&index);
        match picture(source, texture, &mut self.store, known)? {
            Ok(Picture::File(file)) => self.store.load_normals(source.path, &file),
            Ok(Picture::Known(index)) => Ok(self.embedded_normals.get(&index).cloned()),
            Ok(Picture::Embedded(index, image)) => {
                let made = normals_of(source.path, &embedded_name(index), image)?;
                self.embedded_normals.insert(index, made.clone());
                Ok(Some(made))
            }
            Err(why) => {
                assembly.warn(format!("material {material}: {why}; its normal map is left out"));
                Ok(None)
            }
        }
    }
}

fn embedded_name(image: usize) -> String {
    format!("{image} (embedded)")
}

/// The coordinates for a texture: number of the attribute, transform, and whether the sampler repeats the image.
fn coordinates(
    source: &Source<'_>,
    texture: usize,
    set: u32,
    transform: Option<&TextureTransform>,
) -> Result<Coordinates, ImportError> {
    let textures = &source.root.textures;
    let entry = textures.get(texture).ok_or_else(|| source.out_of_range("texture", texture, textures.len()))?;
    let sampler = entry.sampler.and_then(|s| source.root.samplers.get(s.value()));
    let repeats = sampler
        .is_none_or(|s| [&s.wrap_s, &s.wrap_t].into_iter().all(|w| matches!(w, Checked::Valid(WrappingMode::Repeat))));
    Ok(Coordinates::of(set, transform, repeats))
}

/// The image of a texture, or the reason why there is none. Embedded images are decoded unless `known`.
fn picture(
    source: &Source<'_>,
    texture: usize,
    store: &mut TextureStore,
    known: impl Fn(usize) -> bool,
) -> Result<Result<Picture, String>, ImportError> {
    let textures = &source.root.textures;
    let entry = textures.get(texture).ok_or_else(|| source.out_of_range("texture", texture, textures.len()))?;
    let index = entry.source.value();
    if index == u32::MAX as usize {
        // The JSON parser's value for a texture without `source`: the image is in an extension.
        return Ok(Err(format!("texture {texture} has no PNG or JPEG image")));
    }
    let images = &source.root.images;
    let image = images.get(index).ok_or_else(|| source.out_of_range("image", index, images.len()))?;
    if known(index) {
        return Ok(Ok(Picture::Known(index)));
    }
    let decoded = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => match source.resolve(uri, &format!("image {index}"))? {
            Resource::File(file) if file.exists() => return Ok(Ok(Picture::File(file))),
            Resource::File(file) => return Ok(Err(format!("the texture {} is missing", file.display()))),
            Resource::Embedded { bytes } => store.decode(source.path, &embedded_name(index), &bytes, None)?,
        },
        (None, Some(view)) => {
            let (bytes, _) = source.view(view.value())?;
            store.decode(source.path, &embedded_name(index), bytes, None)?
        }
        (None, None) => return Err(source.malformed(format!("image {index} has neither uri nor bufferView"))),
    };
    Ok(Ok(Picture::Embedded(index, decoded)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_transforms_follow_the_extension() {
        let json = r#"{"index":0,"texCoord":1,"extensions":{"KHR_texture_transform":
            {"offset":[0.5,0.25],"rotation":1.5707963,"scale":[2,4],"texCoord":3}}}"#;
        let of = |json| {
            let info: Info = json::deserialize::from_str(json).unwrap();
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            Coordinates::of(info.tex_coord, transform, true)
        };
        let coordinates = of(json);
        assert_eq!(coordinates.set, 3);
        // Scaled, then turned so that (1, 0) becomes (0, -1) and (0, 1) becomes (1, 0), then moved.
        for (from, to) in [([0.0, 0.0], [0.5, 0.25]), ([1.0, 0.0], [0.5, -1.75]), ([0.0, 1.0], [4.5, 0.25])] {
            let found = coordinates.transform.apply(from);
            assert!((found[0] - to[0]).abs() < 1e-5 && (found[1] - to[1]).abs() < 1e-5, "{from:?}: {found:?}");
        }
        let plain = of(r#"{"index":0,"texCoord":1}"#);
        assert_eq!((plain.set, plain.transform.apply([0.3, 0.7])), (1, [0.3, 0.7]));
    }
}
