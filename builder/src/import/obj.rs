//! Wavefront OBJ. `tobj` parses the geometry, after this module has brought the text into a form that it reads correctly.
//!
//! Alone, `tobj` would misread: attributes of which only some faces have texture coordinates or normals, or only some
//! vertices colours (the arrays shift against the positions); continued lines; indices far out of range. Polygons are split
//! into fans, which is exact for convex polygons.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use esvo_format::srgb::decode_f64 as srgb_to_linear;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::file::{read_file, text_of};
use super::image::{TextureStore, find_file};
use super::mtl;
use crate::mesh::{Material, Mesh};

/// Reads an OBJ file. Materials and textures are searched in its folder.
pub(super) fn load(path: &Path, bytes: &[u8]) -> Result<Mesh, ImportError> {
    let text = text_of(bytes);
    let prepared = prepare(path, &text)?;
    let mut assembly = Assembly::default();
    for warning in &prepared.warnings {
        assembly.warn(warning);
    }
    let dir = path.parent().unwrap_or(Path::new(""));
    let libraries = Libraries::read(dir, &prepared.libraries, &mut assembly)?;
    let models = parse(path, &prepared)?;

    let mut store = TextureStore::default();
    let mut converted: HashMap<(usize, bool), u32> = HashMap::new();
    for tobj::Model { mesh, .. } in models {
        let Some(mut part) = part_of(&mesh) else { continue };
        let name = mesh.material_id.and_then(|id| prepared.material_names.get(id));
        let found = name.and_then(|name| libraries.by_name.get(name).copied());
        if let (Some(name), None) = (name, found) {
            assembly.warn(format!("no material library defines {name}; using a plain colour"));
        }
        // The index after the last material of the libraries stands for the plain material.
        let textured = !part.uvs.is_empty();
        let key = (found.unwrap_or(libraries.materials.len()), textured || found.is_none());
        part.material = match converted.get(&key) {
            Some(&index) => index,
            None => {
                let mut material = match found {
                    Some(i) => {
                        let (library, material) = &libraries.materials[i];
                        mtl::convert(material, path, library.parent().unwrap_or(dir), &mut store, &mut assembly)?
                    }
                    None => Material::default(),
                };
                if material.texture.is_some() && !textured {
                    assembly.warn(format!(
                        "some faces of material {} have no texture coordinates; they get its plain colour",
                        material.name
                    ));
                    (material.texture, material.alpha_cutoff) = (None, None);
                }
                if !textured {
                    (material.normal_map, material.height_map) = (None, None);
                }
                let index = assembly.mesh.materials.len() as u32;
                assembly.mesh.materials.push(material);
                converted.insert(key, index);
                index
            }
        };
        assembly.append(path, &part, None)?;
    }
    Ok(assembly.finish())
}

/// All materials of all libraries, each with the path of its library.
struct Libraries {
    materials: Vec<(PathBuf, mtl::MtlMaterial)>,
    /// Index into `materials`. The first definition of a name is used.
    by_name: HashMap<String, usize>,
}

impl Libraries {
    fn read(dir: &Path, statements: &[String], assembly: &mut Assembly) -> Result<Self, ImportError> {
        let mut materials: Vec<(PathBuf, mtl::MtlMaterial)> = Vec::new();
        let mut read = Vec::new();
        for statement in statements {
            // A statement may name several files, or one file whose name contains spaces.
            let names = match find_file(dir, statement) {
                Some(_) => vec![statement.as_str()],
                None => statement.split_whitespace().collect(),
            };
            for name in names {
                let Some(file) = find_file(dir, name) else {
                    assembly.warn(format!("the material library {name} is missing"));
                    continue;
                };
                if read.contains(&file) {
                    continue;
                }
                let bytes = read_file(&file)?;
                let (found, warnings) = mtl::parse(&text_of(&bytes));
                for warning in warnings {
                    assembly.warn(format!("{name}: {warning}"));
                }
                materials.extend(found.into_iter().map(|m| (file.clone(), m)));
                read.push(file);
            }
        }
        let mut by_name = HashMap::new();
        for (index, (_, material)) in materials.iter().enumerate() {
            by_name.entry(material.name.clone()).or_insert(index);
        }
        Ok(Self { materials, by_name })
    }
}

/// The text for `tobj`, and what `tobj` would not return.
#[derive(Debug, Default)]
struct Prepared {
    text: String,
    /// The values of the `mtllib` statements.
    libraries: Vec<String>,
    /// Names of the materials used, in order of first use.
    material_names: Vec<String>,
    /// Index of each name in `material_names`.
    material_numbers: HashMap<String, usize>,
    warnings: Vec<String>,
    /// For each line of `text`, the number of the source line it came from and whether it holds a position.
    lines: Vec<(u32, bool)>,
}

/// Which attributes the corners of a face have besides a position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Corner {
    texture: bool,
    normal: bool,
}

/// The highest index (from 1) of a position, texture coordinate and normal in any face, each with the face's source line.
type Highest = [(usize, u32); 3];

const LISTS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

fn prepare(path: &Path, source: &str) -> Result<Prepared, ImportError> {
    let mut prepared = Prepared::default();
    prepared.text.reserve(source.len() + source.len() / 8);
    // Colours can be used only if all vertices have one.
    let (coloured, plain) = source.lines().fold((0usize, 0usize), |(coloured, plain), line| {
        let mut words = line.split_whitespace();
        match (words.next(), words.count()) {
            (Some("v"), 6..) => (coloured + 1, plain),
            (Some("v"), _) => (coloured, plain + 1),
            _ => (coloured, plain),
        }
    });
    let drop_colors = coloured > 0 && plain > 0;
    if drop_colors {
        prepared.warnings.push(format!("{plain} vertices have no colour; the colours of the others are ignored"));
    }

    // `tobj` keeps a material only if a library defines it. `parse` answers this line with a library of all numbers.
    prepared.line(0, false, format_args!("mtllib numbers"));
    let mut counts = [0usize; 3];
    let mut highest: Highest = [(0, 0); 3];
    let mut shape = None;
    let mut skipped = 0usize;
    let mut continued = String::new();
    for (number, raw) in source.lines().enumerate() {
        let number = u32::try_from(number + 1).unwrap_or(u32::MAX);
        let raw = raw.split('#').next().unwrap_or("");
        if let Some(start) = raw.trim_end().strip_suffix('\\') {
            continued.push_str(start);
            continued.push(' ');
            continue;
        }
        let joined;
        let line = if continued.is_empty() {
            raw.trim()
        } else {
            joined = std::mem::take(&mut continued) + raw;
            joined.trim()
        };
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match key {
            "v" => {
                counts[0] += 1;
                if drop_colors {
                    let kept = value.split_whitespace().take(3).collect::<Vec<_>>().join(" ");
                    prepared.line(number, true, format_args!("v {kept}"));
                } else {
                    prepared.line(number, true, format_args!("{line}"));
                }
            }
            "vt" => {
                counts[1] += 1;
                // One-dimensional coordinates are valid, but `tobj` requires two numbers.
                let second = if value.split_whitespace().nth(1).is_none() { " 0" } else { "" };
                prepared.line(number, false, format_args!("{line}{second}"));
            }
            "vn" => {
                counts[2] += 1;
                prepared.line(number, false, format_args!("{line}"));
            }
            "f" => {
                let corner = check_face(value, counts, number, &mut highest)
                    .map_err(|what| ImportError::malformed(path, format!("line {number}: {what}")))?;
                let Some(corner) = corner else {
                    skipped += 1;
                    continue;
                };
                // A new group makes `tobj` start a new model. So all faces of a model have the same attributes.
                if shape.replace(corner).is_some_and(|last| last != corner) {
                    prepared.line(number, false, format_args!("g"));
                }
                prepared.line(number, false, format_args!("{line}"));
            }
            "p" | "l" => skipped += 1,
            "mtllib" => prepared.libraries.push(value.trim().to_owned()),
            "usemtl" => {
                let index = prepared.material_number(value.trim());
                // Materials are renamed to numbers, so that any name is accepted, even an empty one.
                prepared.line(number, false, format_args!("usemtl {index}"));
            }
            _ => {}
        }
    }
    for (list, (&(index, line), count)) in highest.iter().zip(counts).enumerate() {
        if index > count {
            let what = LISTS[list];
            return Err(ImportError::malformed(
                path,
                format!("line {line}: a face refers to {what} {index}, but there are only {count}"),
            ));
        }
    }
    if skipped > 0 {
        prepared
            .warnings
            .push(format!("{skipped} points and lines were skipped; only triangles and polygons are read"));
    }
    Ok(prepared)
}

impl Prepared {
    fn material_number(&mut self, name: &str) -> usize {
        if let Some(&number) = self.material_numbers.get(name) {
            return number;
        }
        let number = self.material_names.len();
        self.material_names.push(name.to_owned());
        self.material_numbers.insert(name.to_owned(), number);
        number
    }

    fn line(&mut self, source_line: u32, position: bool, text: std::fmt::Arguments<'_>) {
        // Writing to a string never fails.
        let _ = self.text.write_fmt(text);
        self.text.push('\n');
        self.lines.push((source_line, position));
    }
}

/// Checks the indices of a face and updates the highest. Negative indices count back from the elements read so far. `None`
/// for a point or a line.
fn check_face(value: &str, counts: [usize; 3], line: u32, highest: &mut Highest) -> Result<Option<Corner>, String> {
    let mut shape = None;
    let mut corners = 0;
    for word in value.split_whitespace() {
        let mut parts = word.split('/');
        let mut present = [false; 3];
        for list in 0..3 {
            let Some(text) = parts.next() else { break };
            if text.is_empty() && list > 0 {
                continue;
            }
            let index: i64 = text.parse().map_err(|_| format!("cannot read the face corner '{}'", one_line(word)))?;
            let count = counts[list];
            let absolute = if index < 0 { count as i64 + index.max(-i64::MAX) + 1 } else { index };
            if absolute < 1 {
                return Err(format!("a face refers to {} {index}, but there are only {count} so far", LISTS[list]));
            }
            if absolute as usize > highest[list].0 {
                highest[list] = (absolute as usize, line);
            }
            present[list] = true;
        }
        if parts.next().is_some() {
            return Err(format!("cannot read the face corner '{}'", one_line(word)));
        }
        let corner = Corner { texture: present[1], normal: present[2] };
        if *shape.get_or_insert(corner) != corner {
            return Err("the corners of a face must all have the same attributes (v, v/vt, v//vn or v/vt/vn)".into());
        }
        corners += 1;
    }
    Ok(shape.filter(|_| corners >= 3))
}

fn parse(path: &Path, prepared: &Prepared) -> Result<Vec<tobj::Model>, ImportError> {
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let mut reader = prepared.text.as_bytes();
    let result = tobj::load_obj_buf(&mut reader, &options, |_| {
        let names = 0..prepared.material_names.len();
        let material = |i: usize| tobj::Material { name: i.to_string(), ..tobj::Material::default() };
        Ok((names.clone().map(material).collect(), names.map(|i| (i.to_string(), i)).collect()))
    });
    let (models, _) = result.map_err(|e| {
        // The reader has stopped after the line that it could not read.
        let taken = &prepared.text.as_bytes()[..prepared.text.len() - reader.len()];
        let read = taken.iter().filter(|&&b| b == b'\n').count();
        let line = prepared.lines.get(read.saturating_sub(1)).map_or(0, |&(line, _)| line);
        ImportError::malformed(path, format!("line {line}: {e}"))
    })?;
    for model in &models {
        if model.mesh.positions.iter().any(|x| !x.is_finite()) {
            return Err(non_finite(path, prepared));
        }
    }
    Ok(models)
}

/// Finds the line of the first vertex that is not finite.
fn non_finite(path: &Path, prepared: &Prepared) -> ImportError {
    let bad = |text: &str| text.split_whitespace().skip(1).any(|w| w.parse::<f64>().is_ok_and(|x| !x.is_finite()));
    let vertices = prepared.text.lines().zip(&prepared.lines).filter(|(_, (_, position))| *position);
    let found = vertices.zip(1u64..).find(|((text, _), _)| bad(text));
    match found {
        Some(((_, &(line, _)), vertex)) => {
            ImportError::malformed(path, format!("line {line}: vertex {vertex} is not finite; repair or remove it"))
        }
        None => ImportError::malformed(path, "a vertex overflows when divided by its weight"),
    }
}

/// The triangles of one `tobj` model; `None` if it has none. All its faces have the same attributes (see [`prepare`]).
fn part_of(mesh: &tobj::Mesh) -> Option<Part> {
    let triples = |values: &[f64]| values.as_chunks::<3>().0.to_vec();
    let mut part = Part {
        positions: triples(&mesh.positions),
        triangles: mesh.indices.as_chunks::<3>().0.to_vec(),
        ..Part::default()
    };
    if part.triangles.is_empty() {
        return None;
    }
    // The builder needs unit length, which the format does not guarantee. Zero marks a missing normal.
    part.normals = triples(&mesh.normals)
        .into_iter()
        .map(|n| glam::DVec3::from(n).normalize_or_zero().as_vec3().to_array())
        .collect();
    // In this format v points up.
    part.uvs = mesh.texcoords.as_chunks::<2>().0.iter().map(|&[u, v]| [u as f32, (1.0 - v) as f32]).collect();
    part.colors = triples(&mesh.vertex_color)
        .into_iter()
        .map(|c| c.map(|x| srgb_to_linear(if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 }) as f32))
        .collect();
    Some(part)
}
