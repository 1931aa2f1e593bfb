//! Materials of glTF: colour with its texture and holes, and normal maps. `gltf_properties` has the rest.
//!
//! The colour is the base colour. Where that is black, so that all the colour there is comes from emission, it is the
//! emitted colour.

use std::collections::HashMap;
use std::sync::Arc;

use gltf::json;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::AlphaMode;
use gltf::json::texture::Info;
use gltf::json::validation::Checked;

use super::assembly::Assembly;
use super::error::{ImportError, one_line};
use super::gltf_data::Source;
use super::gltf_properties::is_glossy;
use super::gltf_texture::{Known, read, wrap_of};
use super::image::{TextureStore, has_holes};
use crate::mesh::maps::{LinearTexture, NormalMap, UvTransform};
use crate::mesh::properties::Properties;
use crate::mesh::{Material, Texture, Wrap};

/// Which texture coordinates a material reads, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coordinates {
    /// The number of the `TEXCOORD` attribute.
    pub(super) set: u32,
    /// The transform of `KHR_texture_transform`, or the identity.
    pub(super) transform: UvTransform,
}

impl Coordinates {
    fn of(set: u32, transform: Option<&TextureTransform>) -> Self {
        let Some(t) = transform else { return Self { set, transform: UvTransform::IDENTITY } };
        let (sin, cos) = t.rotation.0.sin_cos();
        let ([sx, sy], [ox, oy]) = (t.scale.0, t.offset.0);
        let rows = [[cos * sx, sin * sy, ox], [-sin * sx, cos * sy, oy]];
        Self { set: t.tex_coord.unwrap_or(set), transform: UvTransform { rows } }
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
    /// The same of the textures of the emission, and of roughness and metalness.
    pub(super) emission_map: Option<UvTransform>,
    pub(super) surface_map: Option<UvTransform>,
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

/// What the opacity of vertices does to a primitive.
#[derive(Clone, Copy, Debug)]
pub(super) struct VertexAlpha {
    /// Vertices with less are holes, whatever the texture says.
    pub(super) least: f32,
    /// Whether the opacity also decides which texels are holes.
    pub(super) scales_texture: bool,
    /// The cutoff of the material.
    pub(super) cutoff: f32,
}

/// The least opacity that an 8-bit channel can have above 0, halved: what is less than this is invisible.
const INVISIBLE: f32 = 0.5 / 255.0;
/// Channels of at most this count as black: JPEG images are black only up to noise.
const BLACK: u8 = 3;

/// Converts materials when a primitive first uses them. Each has up to two forms: with its textures and without.
#[derive(Default)]
pub(super) struct Materials {
    store: TextureStore,
    converted: HashMap<(Option<usize>, bool), u32>,
    /// Forms of a material of the mesh with less opacity, in steps of 1/255.
    faded: HashMap<(u32, u8), u32>,
    invisible: Option<u32>,
    /// Whether the colour of a material is what it emits.
    emits: HashMap<usize, bool>,
    colors: Known<Texture>,
    normals: Known<LinearTexture<3>>,
    /// Whether textures of properties are read.
    pub(super) property_maps: bool,
}

impl Materials {
    /// None yet.
    pub(super) fn new(property_maps: bool) -> Self {
        Self { property_maps, ..Self::default() }
    }

    /// Which coordinates `material` needs from the vertices; `None` if it has no textures.
    pub(super) fn wanted(
        &mut self,
        source: &Source<'_>,
        material: Option<usize>,
        assembly: &mut Assembly,
    ) -> Result<Option<Wanted>, ImportError> {
        let Some(index) = material else { return Ok(None) };
        let materials = &source.root.materials;
        let material = materials.get(index).ok_or_else(|| source.out_of_range("material", index, materials.len()))?;
        let color = match self.color_texture(source, index, material)? {
            Some(info) => {
                let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
                Some(Coordinates::of(info.tex_coord, transform))
            }
            None => None,
        };
        let of = |info: &Info| {
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            Coordinates::of(info.tex_coord, transform)
        };
        let emission =
            material.emissive_texture.as_ref().filter(|_| emission(material) != [0.0; 3] && self.property_maps);
        let emission = emission.map(of);
        let surface = material.pbr_metallic_roughness.metallic_roughness_texture.as_ref().map(of);
        let surface = surface.filter(|_| !is_glossy(material) && self.property_maps);
        let wanted = |coordinates: Coordinates, textured: bool, normal_map: Option<UvTransform>| {
            let relative = |own: Option<Coordinates>| {
                let own = own.filter(|own| own.set == coordinates.set)?;
                own.transform.after_undoing(&coordinates.transform)
            };
            let (emission_map, surface_map) = (relative(emission), relative(surface));
            Some(Wanted { coordinates, textured, normal_map, emission_map, surface_map })
        };
        let Some(normal) = &material.normal_texture else {
            let first = color.or(emission).or(surface);
            return Ok(first.and_then(|coordinates| wanted(coordinates, color.is_some(), None)));
        };
        let transform = normal.extensions.as_ref().and_then(|e| e.others.get("KHR_texture_transform"));
        let transform: Option<TextureTransform> =
            transform.map(|value| json::deserialize::from_value(value.clone())).transpose().map_err(|e| {
                source.malformed(format!("material {index}: the transform of its normal map: {}", one_line(e)))
            })?;
        let normal = Coordinates::of(normal.tex_coord, transform.as_ref());
        let Some(color) = color else {
            return Ok(wanted(normal, false, Some(UvTransform::IDENTITY)));
        };
        let same_set = normal.set == color.set;
        let normal_map = if same_set { normal.transform.after_undoing(&color.transform) } else { None };
        if normal_map.is_none() {
            assembly.warn(format!(
                "material {index}: its normal map needs other texture coordinates than its colour; it is left out"
            ));
        }
        Ok(wanted(color, true, normal_map))
    }

    /// Whether the colour of a material, which [`Self::wanted`] has accepted, is what it emits.
    pub(super) fn emits(&self, material: Option<usize>) -> bool {
        material.is_some_and(|index| self.emits.get(&index) == Some(&true))
    }

    /// The texture that gives a material its colour: that of its emission where the base colour is black. If that has none,
    /// the texture of the base colour if it cuts holes.
    fn color_texture<'m>(
        &mut self,
        source: &Source<'_>,
        index: usize,
        material: &'m json::Material,
    ) -> Result<Option<&'m Info>, ImportError> {
        let base = BaseColor::of(material);
        let emits = match self.emits.get(&index) {
            Some(&known) => known,
            None => {
                let emits = emission(material) != [0.0; 3] && self.is_black(source, &base)?;
                self.emits.insert(index, emits);
                emits
            }
        };
        Ok(match (&material.emissive_texture, base.texture) {
            (_, texture) if !emits => texture,
            (Some(emitted), _) => Some(emitted),
            (None, Some(texture)) if self.texture_with_holes(source, material, texture)?.is_some() => Some(texture),
            (None, _) => None,
        })
    }

    /// The texture of a base colour, if its opacity matters: unless the material is opaque or the texture is.
    fn texture_with_holes(
        &mut self,
        source: &Source<'_>,
        material: &json::Material,
        base: &Info,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        if matches!(material.alpha_mode, Checked::Valid(AlphaMode::Opaque)) {
            return Ok(None);
        }
        Ok(self.texture(source, base.index.value())?.ok().filter(|texture| texture.alpha_range().0 < 255))
    }

    /// Whether a base colour is black everywhere.
    fn is_black(&mut self, source: &Source<'_>, base: &BaseColor<'_>) -> Result<bool, ImportError> {
        if base.factor[..3].iter().all(|&x| x <= 0.0) {
            return Ok(true);
        }
        let Some(info) = base.texture else { return Ok(false) };
        let black = |t: &[u8; 4]| t[3] == 0 || t[..3].iter().all(|&c| c <= BLACK);
        Ok(self.texture(source, info.index.value())?.is_ok_and(|texture| texture.mips[0].texels.iter().all(black)))
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
            None => Material {
                base_color: [1.0; 4],
                // As of a material that says nothing.
                properties: Properties { metalness: 1.0, ..Properties::default() },
                ..Material::default()
            },
        };
        let index = push(converted, assembly);
        self.converted.insert((material, textured), index);
        Ok(index)
    }

    /// The index in the mesh of a material of which nothing is to be seen.
    pub(super) fn invisible(&mut self, assembly: &mut Assembly) -> u32 {
        *self.invisible.get_or_insert_with(|| {
            let name = "invisible".to_owned();
            push(Material { name, base_color: [0.0; 4], alpha_cutoff: Some(0.5), ..Material::default() }, assembly)
        })
    }

    /// The index in the mesh of a form of material `index` of the mesh with `opacity` 255ths of its opacity.
    pub(super) fn with_opacity(&mut self, index: u32, opacity: u8, assembly: &mut Assembly) -> u32 {
        if opacity == 255 {
            return index;
        }
        *self.faded.entry((index, opacity)).or_insert_with(|| {
            let mut material = assembly.mesh.materials[index as usize].clone();
            material.base_color[3] *= f32::from(opacity) / 255.0;
            push(material, assembly)
        })
    }

    /// What the opacity of vertices, of which the least is `lowest`, does to a primitive with a material, which has become
    /// material `index` of the mesh. `None` if it changes nothing.
    pub(super) fn vertex_alpha(
        &self,
        source: &Source<'_>,
        material: Option<usize>,
        index: u32,
        lowest: f32,
        assembly: &Assembly,
    ) -> Option<VertexAlpha> {
        let mode = source.root.materials.get(material?)?.alpha_mode;
        let material = assembly.mesh.materials.get(index as usize)?;
        let (texture, opacity) = (material.texture.as_deref(), material.base_color[3]);
        let (low, high) = texture.map_or((255, 255), Texture::alpha_range);
        match (mode, material.alpha_cutoff) {
            (Checked::Valid(AlphaMode::Mask), Some(cutoff)) => {
                let highest = opacity * f32::from(high) / 255.0;
                let least = if highest > 0.0 { cutoff / highest } else { f32::INFINITY };
                // Where the texture has holes, each opacity of the vertices moves their rims.
                let scales_texture = low < high;
                let matters = lowest < least || (scales_texture && lowest < 1.0);
                // Nothing of the material is to be seen: it needs no cuts.
                (matters && least.is_finite()).then_some(VertexAlpha { least, scales_texture, cutoff })
            }
            (Checked::Valid(AlphaMode::Blend), _) if lowest < INVISIBLE => {
                Some(VertexAlpha { least: INVISIBLE, scales_texture: false, cutoff: 0.0 })
            }
            _ => None,
        }
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
        let base = BaseColor::of(material);
        let mut texture = match self.color_texture(source, index, material)? {
            Some(info) if wanted.is_some_and(|w| w.textured) => match self.texture(source, info.index.value())? {
                Ok(texture) => Some(texture),
                Err(why) => {
                    assembly.warn(format!("material {name}: {why}; using a plain colour"));
                    None
                }
            },
            _ => None,
        };
        let mut base_color = base.factor.map(unit);
        if self.emits(Some(index)) {
            base_color[..3].copy_from_slice(&emission(material));
            texture = self.with_holes_of(source, material, texture, &name, assembly)?;
        }
        let alpha_cutoff = match material.alpha_mode {
            Checked::Valid(AlphaMode::Mask) => Some(unit(material.alpha_cutoff.unwrap_or_default().0)),
            Checked::Valid(AlphaMode::Blend) => {
                let highest = texture.as_deref().map_or(255, |texture| texture.alpha_range().1);
                if base_color[3] * f32::from(highest) / 255.0 < INVISIBLE {
                    assembly.warn(format!("material {name} blends and its opacity is 0; it is left out"));
                    Some(INVISIBLE)
                } else if texture.as_deref().is_some_and(has_holes) {
                    assembly.warn(format!("material {name} blends; texels of less than half opacity become holes"));
                    // Relative to the opacity of the whole material: otherwise thin glass would be one large hole.
                    Some(0.5 * base_color[3])
                } else {
                    None
                }
            }
            Checked::Valid(_) => None,
            Checked::Invalid => return Err(source.malformed(format!("material {index} has an unknown alphaMode"))),
        };
        let normal_map = match (&material.normal_texture, wanted.and_then(|w| w.normal_map)) {
            (Some(info), Some(uv_transform)) => {
                let scale = if info.scale.is_finite() { info.scale } else { 1.0 };
                match self.normals(source, info.index.value())? {
                    Ok(texture) => Some(NormalMap { texture, scale, uv_transform }),
                    Err(why) => {
                        assembly.warn(format!("material {name}: {why}; its normal map is left out"));
                        None
                    }
                }
            }
            _ => None,
        };
        let properties = self.properties(source, index, material, wanted, &name, assembly)?;
        Ok(Material { name, base_color, texture, alpha_cutoff, normal_map, height_map: None, properties })
    }

    /// For a material whose colour is what it emits: `found`, which is the texture of [`Self::color_texture`], with the opacity
    /// of the texture of the base colour, if that matters.
    fn with_holes_of(
        &mut self,
        source: &Source<'_>,
        material: &json::Material,
        found: Option<Arc<Texture>>,
        name: &str,
        assembly: &mut Assembly,
    ) -> Result<Option<Arc<Texture>>, ImportError> {
        let Some(emissive) = &material.emissive_texture else {
            // The texture of the base colour, if any: the factor alone is the colour.
            let white = |texture: Arc<Texture>| self.changed(source, &texture, name, |_, [.., a]| [255, 255, 255, a]);
            return found.map(white).transpose();
        };
        let opaque = match found {
            Some(texture) if texture.alpha_range().0 < 255 => {
                Some(self.changed(source, &texture, name, |_, [r, g, b, _]| [r, g, b, 255])?)
            }
            other => other,
        };
        let Some(info) = BaseColor::of(material).texture else { return Ok(opaque) };
        let Some(base) = self.texture_with_holes(source, material, info)? else { return Ok(opaque) };
        let place = |info: &Info| -> Result<(Coordinates, [Wrap; 2]), ImportError> {
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            Ok((Coordinates::of(info.tex_coord, transform), wrap_of(source, info.index.value())?))
        };
        let holes = &base.mips[0];
        match &opaque {
            Some(texture)
                if place(info)? == place(emissive)?
                    && (texture.mips[0].width, texture.mips[0].height) == (holes.width, holes.height) =>
            {
                self.changed(source, texture, name, |i, [r, g, b, _]| [r, g, b, holes.texels[i][3]]).map(Some)
            }
            _ => {
                assembly.warn(format!(
                    "material {name} shows what it emits, over a black base colour; the holes of its base colour texture, \
                     which has another size or place, are left out"
                ));
                Ok(opaque)
            }
        }
    }

    /// A texture of its own for a material, made from the number and the value of each texel of `texture`.
    fn changed(
        &mut self,
        source: &Source<'_>,
        texture: &Texture,
        material: &str,
        change: impl Fn(usize, [u8; 4]) -> [u8; 4],
    ) -> Result<Arc<Texture>, ImportError> {
        let mip = &texture.mips[0];
        self.store.charge(source.path, &format!("that of material {material}"), mip.texels.len() as u64)?;
        let texels: Vec<[u8; 4]> = mip.texels.iter().enumerate().map(|(i, &texel)| change(i, texel)).collect();
        // The size is that of a texture already.
        let made =
            Texture::from_rgba8(mip.width, mip.height, texels.as_flattened()).unwrap_or_else(|_| texture.clone());
        Ok(Arc::new(made.with_wrap(texture.wrap)))
    }

    /// The colours of a texture, or why they cannot be read.
    pub(super) fn texture(
        &mut self,
        source: &Source<'_>,
        texture: usize,
    ) -> Result<Result<Arc<Texture>, String>, ImportError> {
        read(source, texture, &mut self.store, &mut self.colors)
    }

    /// The channels of a texture, or why they cannot be read.
    pub(super) fn normals(
        &mut self,
        source: &Source<'_>,
        texture: usize,
    ) -> Result<Result<Arc<LinearTexture<3>>, String>, ImportError> {
        read(source, texture, &mut self.store, &mut self.normals)
    }
}

fn push(material: Material, assembly: &mut Assembly) -> u32 {
    assembly.mesh.materials.push(material);
    assembly.mesh.materials.len() as u32 - 1
}

pub(super) fn unit(x: f32) -> f32 {
    if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 }
}

/// The factor of the emitted colour.
pub(super) fn emission(material: &json::Material) -> [f32; 3] {
    material.emissive_factor.0.map(unit)
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
            Coordinates::of(info.tex_coord, transform)
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
