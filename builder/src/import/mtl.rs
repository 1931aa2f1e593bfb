//! Material libraries of OBJ files: the statements about colour, holes and surface detail.
//!
//! Not read by `tobj`, because `tobj` panics at a colour of fewer than three numbers, drops a whole library for one bad
//! line, and leaves the options of texture statements in the file name.

use std::path::Path;
use std::sync::Arc;

use esvo_format::srgb::decode_f64 as srgb_to_linear;

use super::assembly::Assembly;
use super::error::{ImportError, one_line};
use super::image::{Channel, TextureStore, find_file, has_holes, texture_of};
use crate::mesh::maps::{HeightMap, NormalMap, UvTransform};
use crate::mesh::{Material, Texture};

/// One `newmtl` block.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// `Kd` as written: sRGB-encoded, 0..=1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// `d`, or one minus `Tr`.
    pub(super) opacity: Option<f64>,
    pub(super) diffuse_map: Option<String>,
    pub(super) opacity_map: Option<String>,
    /// `norm` or `map_Kn`: not part of the original format, but written by exporters.
    pub(super) normal_map: Option<MapStatement>,
    /// `bump` or `map_bump`.
    pub(super) bump_map: Option<MapStatement>,
    /// `disp` or `map_disp`.
    pub(super) displacement_map: Option<MapStatement>,
}

/// A texture statement with the options that change values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MapStatement {
    pub(super) file: String,
    /// `-bm`: factor for bumps.
    bump_factor: f64,
    /// `-mm`: the value that 0 stands for, and the factor for values.
    base: f64,
    gain: f64,
    /// `-imfchan`
    channel: Channel,
}

/// Reads a library. Statements that cannot be read are skipped and returned as warnings.
pub(super) fn parse(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    let mut warnings = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let Some((key, value)) = line.split_once(char::is_whitespace) else { continue };
        let value = value.trim();
        if key == "newmtl" {
            materials.push(MtlMaterial { name: value.into(), ..MtlMaterial::default() });
            continue;
        }
        let Some(material) = materials.last_mut() else { continue };
        let understood = match key {
            "Kd" => rgb(value).map(|rgb| material.diffuse = Some(rgb)).is_some(),
            // `d -halo f` makes the rim of a surface more opaque; the factor is still the opacity seen head on.
            "d" => number_in(value.trim_start_matches("-halo")).map(|d| material.opacity = Some(d)).is_some(),
            // `d` takes precedence, because the format defines it.
            "Tr" => number_in(value).map(|tr| material.opacity = material.opacity.or(Some(1.0 - tr))).is_some(),
            "map_Kd" => map_statement(value).map(|map| material.diffuse_map = Some(map.file)).is_some(),
            "map_d" | "map_opacity" => map_statement(value).map(|map| material.opacity_map = Some(map.file)).is_some(),
            "norm" | "map_Kn" => map_statement(value).map(|map| material.normal_map = Some(map)).is_some(),
            "bump" | "map_bump" | "map_Bump" => map_statement(value).map(|map| material.bump_map = Some(map)).is_some(),
            "disp" | "map_disp" | "map_Disp" => {
                map_statement(value).map(|map| material.displacement_map = Some(map)).is_some()
            }
            _ => true,
        };
        if !understood {
            warnings.push(format!("line {}: cannot read '{}'; it is ignored", number + 1, one_line(line)));
        }
    }
    (materials, warnings)
}

fn number_in(value: &str) -> Option<f64> {
    value.split_whitespace().next()?.parse().ok().filter(|x: &f64| x.is_finite())
}

/// A colour. A single number stands for all three components. Spectral and CIE XYZ colours are not read.
fn rgb(value: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> =
        value.split_whitespace().take(3).map(|w| w.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match numbers?.as_slice() {
        [r, g, b] => Some([*r, *g, *b]),
        [grey] => Some([*grey; 3]),
        _ => None,
    }
}

/// A texture statement: options, then a file name, which may contain spaces. `None` if there is no file name.
fn map_statement(value: &str) -> Option<MapStatement> {
    let mut map =
        MapStatement { file: String::new(), bump_factor: 1.0, base: 0.0, gain: 1.0, channel: Channel::default() };
    let mut rest = value.trim();
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace)?;
        // The number of words that follow the option. Options with a variable number take only numbers.
        let (words, numeric) = match option {
            "-o" | "-s" | "-t" => (3, true),
            "-mm" => (2, true),
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-texres" | "-bm" | "-boost" | "-imfchan" | "-type" => {
                (1, false)
            }
            _ => break,
        };
        rest = after.trim_start();
        for position in 0..words {
            let (word, after) = rest.split_once(char::is_whitespace)?;
            let number = word.parse::<f64>();
            if numeric && number.is_err() {
                break;
            }
            let number = number.ok().filter(|x| (*x as f32).is_finite());
            match (option, position) {
                ("-bm", _) => map.bump_factor = number.unwrap_or(map.bump_factor),
                ("-mm", 0) => map.base = number.unwrap_or(map.base),
                ("-mm", _) => map.gain = number.unwrap_or(map.gain),
                ("-imfchan", _) => map.channel = channel(word),
                _ => {}
            }
            rest = after.trim_start();
        }
    }
    rest.clone_into(&mut map.file);
    (!map.file.is_empty()).then_some(map)
}

fn channel(word: &str) -> Channel {
    match word {
        "r" => Channel::Red,
        "g" => Channel::Green,
        "b" => Channel::Blue,
        "m" => Channel::Alpha,
        // Luminance. Also for depth, which needs an image format that this importer does not read.
        _ => Channel::Luminance,
    }
}

/// Converts a library's material into a [`Material`] and reads its textures.
pub(super) fn convert(
    source: &MtlMaterial,
    obj: &Path,
    library_dir: &Path,
    store: &mut TextureStore,
    assembly: &mut Assembly,
) -> Result<Material, ImportError> {
    let label = if source.name.is_empty() { "(unnamed)" } else { &source.name };
    let mut kd = source.diffuse.unwrap_or(if source.diffuse_map.is_some() { [1.0; 3] } else { [0.8; 3] });
    let opacity = source.opacity.unwrap_or(1.0).clamp(0.0, 1.0);
    let mut texture = None;
    if let Some(file) = &source.diffuse_map {
        match find_file(library_dir, file) {
            Some(image) => texture = Some(load_maps(source, obj, library_dir, &image, label, store, assembly)?),
            None => assembly.warn(format!("material {label}: the texture {file} is missing; using a plain colour")),
        }
    } else if source.opacity_map.is_some() {
        assembly.warn(format!("material {label}: map_d without map_Kd is not supported; the material is opaque"));
    }
    if texture.is_some() && kd == [0.0; 3] {
        // The format multiplies the texture by Kd, but some exporters write a black Kd with every texture.
        assembly.warn(format!("material {label}: Kd is black; taking the colour from the texture alone"));
        kd = [1.0; 3];
    }
    let (normal_map, height_map) = detail(source, obj, library_dir, label, store, assembly)?;
    let [r, g, b] = kd.map(|x| srgb_to_linear(x.clamp(0.0, 1.0)) as f32);
    let holes = texture.as_deref().is_some_and(has_holes);
    Ok(Material {
        name: label.into(),
        base_color: [r, g, b, opacity as f32],
        texture,
        // Relative to the opacity of the whole material: otherwise thin glass would be one large hole.
        alpha_cutoff: holes.then_some(0.5 * opacity as f32),
        normal_map,
        height_map,
    })
}

/// The normal map and the height map of a material.
fn detail(
    source: &MtlMaterial,
    obj: &Path,
    library_dir: &Path,
    label: &str,
    store: &mut TextureStore,
    assembly: &mut Assembly,
) -> Result<(Option<NormalMap>, Option<HeightMap>), ImportError> {
    let mut find = |map: Option<&MapStatement>, what: &str| {
        let map = map?;
        let found = find_file(library_dir, &map.file).map(|file| (map.clone(), file));
        if found.is_none() {
            assembly.warn(format!("material {label}: the {what} {} is missing; it is left out", map.file));
        }
        found
    };
    let mut normals = find(source.normal_map.as_ref(), "normal map");
    let mut heights = find(source.displacement_map.as_ref().or(source.bump_map.as_ref()), "height map");
    if let Some((_, file)) = &heights
        && store.holds_normals(obj, file)?
    {
        let line = format!("material {label}: {} holds normals, not heights; it is used as normal map", file.display());
        assembly.warn(line);
        normals = normals.or(heights.take());
    }
    let normal_map = match normals {
        Some((map, file)) => store.load_normals(obj, &file)?.map(|texture| NormalMap {
            texture,
            scale: map.bump_factor as f32,
            uv_transform: UvTransform::IDENTITY,
        }),
        None => None,
    };
    let height_map = match heights {
        Some((map, file)) => store.load_heights(obj, &file, map.channel)?.map(|texture| HeightMap {
            texture,
            amplitude: (map.bump_factor * map.gain) as f32,
            bias: (map.bump_factor * map.base) as f32,
            uv_transform: UvTransform::IDENTITY,
        }),
        None => None,
    };
    Ok((normal_map, height_map))
}

/// The colour texture, with the opacity map, if any, as its alpha.
fn load_maps(
    source: &MtlMaterial,
    obj: &Path,
    library_dir: &Path,
    image: &Path,
    label: &str,
    store: &mut TextureStore,
    assembly: &mut Assembly,
) -> Result<Arc<Texture>, ImportError> {
    let shared = |store: &mut TextureStore| {
        let missing = || ImportError::malformed(obj, format!("the texture {} vanished", image.display()));
        store.load(obj, image)?.ok_or_else(missing)
    };
    let Some(file) = &source.opacity_map else { return shared(store) };
    let Some(mask_file) = find_file(library_dir, file) else {
        assembly.warn(format!("material {label}: the opacity map {file} is missing; the material is opaque"));
        return shared(store);
    };
    if mask_file == image {
        // The statement refers to the alpha channel of the colour texture.
        return shared(store);
    }
    let mask = store.load_pixels(obj, &mask_file)?;
    let mut pixels = store.load_pixels(obj, image)?;
    if mask.dimensions() != pixels.dimensions() {
        assembly
            .warn(format!("material {label}: the opacity map {file} differs in size from the texture; it is ignored"));
        return shared(store);
    }
    let mask_has_alpha = mask.pixels().any(|p| p.0[3] != 255);
    for (pixel, m) in pixels.pixels_mut().zip(mask.pixels()) {
        pixel.0[3] = if mask_has_alpha { m.0[3] } else { m.0[0] };
    }
    texture_of(obj, &image.display().to_string(), &pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_are_read_and_junk_is_reported() {
        let text = "Kd 1 0 0\nnewmtl a b\n\tKd 0.5\n Tr 0.25\nmap_Kd -s 1 1 1 -o 0.5 my tex.png\nKd spectral x.rfl\n\
                    newmtl glass\nKd 0.1 0.2 0.3 # comment\nd 0.1\nTr 0.9\nmap_d -clamp on mask.png\nNs junk\nnewmtl c\nd nan\n";
        let (materials, warnings) = parse(text);
        assert_eq!(materials.len(), 3);
        assert_eq!(materials[0].name, "a b");
        assert_eq!((materials[0].diffuse, materials[0].opacity), (Some([0.5; 3]), Some(0.75)));
        assert_eq!(materials[0].diffuse_map.as_deref(), Some("my tex.png"));
        assert_eq!((materials[1].diffuse, materials[1].opacity), (Some([0.1, 0.2, 0.3]), Some(0.1)));
        assert_eq!(materials[1].opacity_map.as_deref(), Some("mask.png"));
        assert_eq!(
            warnings,
            ["line 6: cannot read 'Kd spectral x.rfl'; it is ignored", "line 14: cannot read 'd nan'; it is ignored"]
        );
    }

    #[test]
    fn maps_of_detail_keep_the_options_that_change_values() {
        let text = "newmtl a\nbump first.png\nmap_bump -imfchan g -clamp on -bm 0.25 -s 1 1 1 b c.png\nnorm -bm 2 n.png\n\
                    map_disp -mm -0.5 3 d.png\nnewmtl b\nmap_Kn -bm\n";
        let (materials, warnings) = parse(text);
        let bump = materials[0].bump_map.as_ref().unwrap();
        assert_eq!((&*bump.file, bump.bump_factor, bump.channel), ("b c.png", 0.25, Channel::Green));
        let normal = materials[0].normal_map.as_ref().unwrap();
        assert_eq!((&*normal.file, normal.bump_factor), ("n.png", 2.0));
        let displacement = materials[0].displacement_map.as_ref().unwrap();
        assert_eq!((&*displacement.file, displacement.base, displacement.gain), ("d.png", -0.5, 3.0));
        assert_eq!(materials[1].normal_map, None);
        assert_eq!(warnings, ["line 7: cannot read 'map_Kn -bm'; it is ignored"]);
    }
}
