//! Material libraries of OBJ files: the few statements that decide colour and holes.
//!
//! Read here and not by `tobj`: that stops with a panic at a colour of fewer than three numbers, drops a whole library for
//! one bad line, and leaves the options of texture statements in the file name.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::ImportError;
use super::assembly::Assembly;
use super::image::{TextureStore, texture_of};
use super::texture::srgb_to_linear;
use crate::mesh::{Material, Texture};

/// One `newmtl` block.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// `Kd` as written: display values, 0..=1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// `d`, or one minus `Tr`.
    pub(super) opacity: Option<f64>,
    pub(super) diffuse_map: Option<String>,
    pub(super) opacity_map: Option<String>,
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
            // `d -halo f` makes the rim of a surface more opaque: its factor is still the opacity seen head on.
            "d" => number_in(value.trim_start_matches("-halo")).map(|d| material.opacity = Some(d)).is_some(),
            // Where both are given, `d` is the one the format defines.
            "Tr" => number_in(value).map(|tr| material.opacity = material.opacity.or(Some(1.0 - tr))).is_some(),
            "map_Kd" => map_file(value).map(|file| material.diffuse_map = Some(file)).is_some(),
            "map_d" | "map_opacity" => map_file(value).map(|file| material.opacity_map = Some(file)).is_some(),
            _ => true,
        };
        if !understood {
            warnings.push(format!("line {}: cannot read '{}'; it is ignored", number + 1, super::one_line(line)));
        }
    }
    (materials, warnings)
}

fn number_in(value: &str) -> Option<f64> {
    value.split_whitespace().next()?.parse().ok().filter(|x: &f64| x.is_finite())
}

/// One number stands for all three. Spectral and CIE XYZ colours are not read.
fn rgb(value: &str) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> =
        value.split_whitespace().take(3).map(|w| w.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match numbers?.as_slice() {
        [r, g, b] => Some([*r, *g, *b]),
        [grey] => Some([*grey; 3]),
        _ => None,
    }
}

/// The file name of a texture statement, past its options. The name itself may contain spaces.
fn map_file(value: &str) -> Option<String> {
    let mut rest = value.trim();
    while rest.starts_with('-') {
        let (option, after) = rest.split_once(char::is_whitespace)?;
        // How many words the option takes; those of variable length take numbers only.
        let (words, numeric) = match option {
            "-o" | "-s" | "-t" => (3, true),
            "-mm" => (2, true),
            "-blendu" | "-blendv" | "-cc" | "-clamp" | "-texres" | "-bm" | "-boost" | "-imfchan" | "-type" => {
                (1, false)
            }
            _ => break,
        };
        rest = after.trim_start();
        for _ in 0..words {
            let (word, after) = rest.split_once(char::is_whitespace)?;
            if numeric && word.parse::<f64>().is_err() {
                break;
            }
            rest = after.trim_start();
        }
    }
    (!rest.is_empty()).then(|| rest.to_owned())
}

/// Turns a library's material into the builder's, reading its textures.
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
        // The format multiplies texture and Kd, but some exporters write a black Kd beside every texture.
        assembly.warn(format!("material {label}: Kd is black; taking the colour from the texture alone"));
        kd = [1.0; 3];
    }
    let [r, g, b] = kd.map(|x| srgb_to_linear(x.clamp(0.0, 1.0)) as f32);
    let holes = texture.as_deref().is_some_and(has_holes);
    Ok(Material {
        name: label.into(),
        base_color: [r, g, b, opacity as f32],
        texture,
        // Relative to the opacity of the whole material, so that thin glass is not one large hole.
        alpha_cutoff: holes.then_some(0.5 * opacity as f32),
        ..Material::default()
    })
}

/// The colour texture, with the opacity map as its alpha if there is one.
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
        // The alpha channel of the colour texture is meant.
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

/// Whether the alpha of a texture cuts holes into the surface (leaves, fences), rather than making all of it thin (glass):
/// somewhere nothing is left of the surface, and somewhere most of it is.
pub(super) fn has_holes(texture: &Texture) -> bool {
    let (low, high) = texture.alpha_range();
    low < 16 && high >= 128
}

/// Where a file named in an OBJ or MTL file lies: as written, with Windows separators, or beside the library.
pub(super) fn find_file(dir: &Path, name: &str) -> Option<PathBuf> {
    let slashed = name.replace('\\', "/");
    let candidates = [dir.join(name), dir.join(&slashed), dir.join(Path::new(&slashed).file_name()?)];
    candidates.into_iter().find(|path| path.is_file())
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
}
