//! Materials of a library as [`Material`]s, with their textures.

use std::path::Path;
use std::sync::Arc;

use esvo_format::srgb::decode_f64 as srgb_to_linear;
use image::RgbaImage;
use image::imageops::{FilterType, resize};

use super::assembly::Assembly;
use super::image::{Channel, TextureStore, has_holes, texture_of};
use super::map_statement::MapStatement;
use super::mtl::MtlMaterial;
use super::names::{find_file, same_file};
use crate::mesh::maps::{HeightMap, NormalMap, UvTransform};
use crate::mesh::properties::Properties;
use crate::mesh::{MAX_TEXTURE_SIDE, Material, Texture};

/// The least alpha of a material that is not to be seen at all: above its opacity, which is 0.
const INVISIBLE: f32 = 0.5;

/// A material, and what its faces' texture coordinates have to go through first.
#[derive(Clone)]
pub(super) struct Converted {
    pub(super) material: Material,
    /// From the coordinates in the file to those of the colour texture.
    pub(super) uv_transform: UvTransform,
}

/// Converts the materials of a library of one OBJ file.
pub(super) struct Converter<'a> {
    pub(super) obj: &'a Path,
    /// The folder of the library.
    pub(super) dir: &'a Path,
    /// Whether any face of the file has a material that is not invisible. Otherwise all are drawn.
    pub(super) any_visible: bool,
    pub(super) store: &'a mut TextureStore,
    pub(super) assembly: &'a mut Assembly,
}

impl Converter<'_> {
    /// Converts a material and reads its textures. One that is missing or cannot be decoded is left out with a warning.
    pub(super) fn convert(&mut self, source: &MtlMaterial) -> Converted {
        let label = if source.name.is_empty() { "(unnamed)" } else { &source.name };
        let mut kd = source.diffuse.unwrap_or(if source.diffuse_map.is_some() { [1.0; 3] } else { [0.8; 3] });
        let opacity = source.opacity();
        let found = self.texture(source, label);
        if found.is_some() && kd == [0.0; 3] && source.diffuse_map.is_some() {
            // The format multiplies the texture by Kd, but some exporters write a black Kd with every texture.
            self.assembly.warn(format!("material {label}: Kd is black; taking the colour from the texture alone"));
            kd = [1.0; 3];
        }
        let (texture, uv_transform) = match found {
            Some((texture, statement)) => (Some(texture), statement.uv_transform()),
            None => (None, UvTransform::IDENTITY),
        };
        for (statement, what) in [(&source.diffuse_map, "map_Kd"), (&source.opacity_map, "map_d")] {
            if statement.as_ref().is_some_and(|s| s.turbulent) {
                self.assembly.warn(format!("material {label}: the turbulence (-t) of {what} is not applied"));
            }
        }
        let (normal_map, height_map) = self.detail(source, label, &uv_transform);
        let [r, g, b] = kd.map(|x| srgb_to_linear(x.clamp(0.0, 1.0)) as f32);
        let holes = texture.as_deref().is_some_and(has_holes);
        let alpha_cutoff = if source.is_invisible() {
            if self.any_visible {
                self.assembly.warn(format!("material {label}: d is 0; its faces are invisible and leave no voxels"));
            }
            Some(INVISIBLE)
        } else {
            // Relative to the opacity of the whole material: otherwise thin glass would be one large hole.
            holes.then_some(0.5 * opacity as f32)
        };
        let material = Material {
            name: label.into(),
            base_color: [r, g, b, opacity as f32],
            texture,
            alpha_cutoff,
            normal_map,
            height_map,
            properties: self.properties(source),
        };
        Converted { material, uv_transform }
    }

    /// Emission, roughness and metalness where the library has them. `d` and, between 0 and 1, `Tr` are opacity: many programs write
    /// `Tr 1` for opaque materials.
    fn properties(&self, source: &MtlMaterial) -> Properties {
        let part = |x: Option<f64>, otherwise: f32| x.map_or(otherwise, |x| x.clamp(0.0, 1.0) as f32);
        let most = esvo_format::MAX_RGB9E5;
        Properties {
            emission: source.emission.unwrap_or_default().map(|x| x.clamp(0.0, most) as f32),
            roughness: part(source.roughness, 1.0),
            metalness: part(source.metalness, 0.0),
            blends: source.dissolve.is_some_and(|d| d < 1.0)
                || source.transparency.is_some_and(|tr| tr > 0.0 && tr < 1.0),
            number: self.assembly.mesh.materials.len() as u32 + 1,
            ..Properties::default()
        }
    }

    /// The colour texture, with the opacity map, if any, as its alpha, and the statement whose coordinates it has.
    fn texture<'s>(&mut self, source: &'s MtlMaterial, label: &str) -> Option<(Arc<Texture>, &'s MapStatement)> {
        let color = source.diffuse_map.as_ref();
        let mask = source.opacity_map.as_ref();
        // A mask in the file of the colours stands for their alpha channel, unless it names another channel.
        let is_alpha = |mask: &MapStatement, color: &MapStatement| {
            matches!(mask.channel, None | Some(Channel::Alpha)) && same_file(self.dir, &mask.file, &color.file)
        };
        let mask = mask.filter(|mask| !color.is_some_and(|color| is_alpha(mask, color)));
        let plain = |statement: &MapStatement| statement.base == 0.0 && statement.gain == 1.0;
        if let (Some(statement), None) = (color, mask)
            && plain(statement)
        {
            let (obj, wrap) = (self.obj, statement.wrap());
            let file = find_file(self.dir, &statement.file);
            let loaded = file.map_or(Ok(None), |file| self.store.load_wrapped(obj, &file, wrap));
            let what = format!("material {label}: the texture {}", statement.file);
            return self.assembly.or_warn(loaded, &what, "using a plain colour").map(|texture| (texture, statement));
        }
        let colors = color.and_then(|statement| {
            let what = format!("material {label}: the texture {}", statement.file);
            let mut pixels = self.pixels(statement, &what, "using a plain colour")?;
            if !plain(statement) {
                let scaled = |x: u8| ((statement.base * 255.0 + statement.gain * f64::from(x)) + 0.5) as u8;
                pixels.pixels_mut().for_each(|p| (0..3).for_each(|k| p.0[k] = scaled(p.0[k])));
            }
            Some((pixels, statement))
        });
        let alphas = mask.and_then(|statement| {
            let what = format!("material {label}: the opacity map {}", statement.file);
            Some((self.pixels(statement, &what, "the material is opaque")?, statement))
        });
        let (pixels, statement) = match (colors, alphas) {
            (None, None) => return None,
            (Some((colors, statement)), None) => (colors, statement),
            (None, Some((mask, statement))) => {
                let white = RgbaImage::from_pixel(mask.width(), mask.height(), image::Rgba([255; 4]));
                (with_alpha(white, &mask, statement.channel), statement)
            }
            (Some((colors, statement)), Some((mask, of_mask))) => {
                if of_mask.uv_transform() != statement.uv_transform() {
                    self.assembly.warn(format!(
                        "material {label}: -s and -o of the opacity map {} differ from those of the texture; the \
                         texture's are used for both",
                        of_mask.file
                    ));
                }
                // The finer of both decides, so that no detail is lost.
                let size = (colors.width().max(mask.width()), colors.height().max(mask.height()));
                let (width, height) = (size.0.min(MAX_TEXTURE_SIDE), size.1.min(MAX_TEXTURE_SIDE));
                let fitted = |pixels: RgbaImage| match pixels.dimensions() == (width, height) {
                    true => pixels,
                    false => resize(&pixels, width, height, FilterType::Triangle),
                };
                // Both have been counted, but a wide and a tall image together can have far more texels.
                let texels = |image: &RgbaImage| u64::from(image.width()) * u64::from(image.height());
                let more = (u64::from(width) * u64::from(height)).saturating_sub(texels(&colors) + texels(&mask));
                let room = self.store.charge(self.obj, &of_mask.file, more).map(Some);
                let what = format!("material {label}: the opacity map {} at the size of the texture", of_mask.file);
                match self.assembly.or_warn(room, &what, "the material is opaque") {
                    Some(()) => (with_alpha(fitted(colors), &fitted(mask), of_mask.channel), statement),
                    None => (colors, statement),
                }
            }
        };
        let made = texture_of(self.obj, &statement.file, &pixels).map(Some);
        let what = format!("material {label}: the texture {}", statement.file);
        let texture = self.assembly.or_warn(made, &what, "using a plain colour")?;
        let texture = Arc::new(Arc::unwrap_or_clone(texture).with_wrap(statement.wrap()));
        Some((texture, statement))
    }

    /// The pixels of a texture.
    fn pixels(&mut self, statement: &MapStatement, what: &str, consequence: &str) -> Option<RgbaImage> {
        let file = find_file(self.dir, &statement.file);
        let loaded = file.map(|file| self.store.load_pixels(self.obj, &file)).transpose();
        self.assembly.or_warn(loaded, what, consequence)
    }

    /// The normal map and the height map of a material whose colour texture has the coordinates `base`.
    fn detail(
        &mut self,
        source: &MtlMaterial,
        label: &str,
        base: &UvTransform,
    ) -> (Option<NormalMap>, Option<HeightMap>) {
        let dir = self.dir;
        let mut find = |map: Option<&MapStatement>, what: &str| {
            let map = map?;
            let found = find_file(dir, &map.file).map(|file| (map.clone(), file));
            if found.is_none() {
                let line = format!("material {label}: the {what} {} is missing; it is left out", map.file);
                self.assembly.warn(line);
            }
            found
        };
        let mut normals = find(source.normal_map.as_ref(), "normal map");
        let mut heights = find(source.displacement_map.as_ref().or(source.bump_map.as_ref()), "height map");
        if let Some((map, file)) = &heights {
            let what = format!("material {label}: the height map {}", map.file);
            let disguised = self.store.holds_normals(self.obj, file).map(Some);
            match self.assembly.or_warn(disguised, &what, "it is left out") {
                None => heights = None,
                Some(false) => {}
                Some(true) => {
                    let line = format!(
                        "material {label}: {} holds normals, not heights; it is used as normal map",
                        file.display()
                    );
                    self.assembly.warn(line);
                    normals = normals.or(heights.take());
                }
            }
        }
        let normal_map = normals.and_then(|(map, file)| {
            let what = format!("material {label}: the normal map {}", map.file);
            let loaded = self.store.load_normals(self.obj, &file, map.wrap());
            let texture = self.assembly.or_warn(loaded, &what, "it is left out")?;
            let uv_transform = self.relative(&map, base, &what);
            Some(NormalMap { texture, scale: map.bump_factor as f32, uv_transform })
        });
        let height_map = heights.and_then(|(map, file)| {
            let what = format!("material {label}: the height map {}", map.file);
            let loaded = self.store.load_heights(self.obj, &file, map.channel.unwrap_or_default());
            let texture = self.assembly.or_warn(loaded, &what, "it is left out")?;
            let texture = if map.wrap() == texture.wrap {
                texture
            } else {
                Arc::new(Arc::unwrap_or_clone(texture).with_wrap(map.wrap()))
            };
            let uv_transform = self.relative(&map, base, &what);
            // A product of two finite numbers can be infinite.
            let height = |x: f64| x.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32;
            Some(HeightMap {
                texture,
                amplitude: height(map.bump_factor * map.gain),
                bias: height(map.bump_factor * map.base),
                uv_transform,
            })
        });
        (normal_map, height_map)
    }

    /// From the coordinates that the vertices get, those of the colour texture, to those of `map`.
    fn relative(&mut self, map: &MapStatement, base: &UvTransform, what: &str) -> UvTransform {
        map.uv_transform().after_undoing(base).unwrap_or_else(|| {
            self.assembly.warn(format!("{what} is read at the coordinates of the texture, whose -s is 0"));
            UvTransform::IDENTITY
        })
    }
}

/// `colors` with a mask of the same size as alpha. Without a channel, that is the mask's alpha if it has any, else its red.
fn with_alpha(mut colors: RgbaImage, mask: &RgbaImage, channel: Option<Channel>) -> RgbaImage {
    let has_alpha = mask.pixels().any(|p| p.0[3] != 255);
    let luminance = |[r, g, b, _]: [u8; 4]| {
        // Rec. 709, as the image library converts to grey.
        ((2126 * u32::from(r) + 7152 * u32::from(g) + 722 * u32::from(b)) / 10_000) as u8
    };
    for (pixel, m) in colors.pixels_mut().zip(mask.pixels()) {
        pixel.0[3] = match channel {
            Some(Channel::Red) => m.0[0],
            Some(Channel::Green) => m.0[1],
            Some(Channel::Blue) => m.0[2],
            Some(Channel::Alpha) => m.0[3],
            Some(Channel::Luminance) => luminance(m.0),
            None if has_alpha => m.0[3],
            None => m.0[0],
        };
    }
    colors
}

#[cfg(test)]
mod tests {
    use super::super::mtl::parse;
    use super::*;

    #[test]
    fn an_opacity_map_counts_at_the_size_that_it_gets() {
        let folder = tempfile::tempdir().unwrap();
        for (name, width, height) in [("wide.png", 32, 1), ("tall.png", 1, 32)] {
            RgbaImage::from_pixel(width, height, image::Rgba([9; 4])).save(folder.path().join(name)).unwrap();
        }
        let source = parse("newmtl a\nmap_Kd wide.png\nmap_d tall.png\n").0.remove(0);
        // 64 texels are counted when both are read.
        for (budget, height) in [(32 * 32, 32), (32 * 32 - 1, 1)] {
            let (mut store, mut assembly) = (TextureStore::of_budget(budget), Assembly::default());
            let (obj, dir) = (Path::new("a.obj"), folder.path());
            let mut converter = Converter { obj, dir, any_visible: true, store: &mut store, assembly: &mut assembly };
            let texture = converter.convert(&source).material.texture.unwrap();
            assert_eq!((texture.mips[0].width, texture.mips[0].height), (32, height));
            let warnings = &assembly.mesh.warnings;
            assert_eq!(warnings.len(), usize::from(height == 1), "{warnings:?}");
            assert!(warnings.iter().all(|line| line.contains("tall.png") && line.ends_with("the material is opaque")));
        }
    }
}
