//! Wavefront OBJ. `tobj` parses the geometry, after [`obj_text`](super::obj_text) has brought the text into a form that it
//! reads correctly.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use esvo_format::srgb::decode_f64 as srgb_to_linear;

use super::assembly::{Assembly, Part};
use super::error::ImportError;
use super::file::{read_file, text_of};
use super::foreign::POINTS as POINTS_ADVICE;
use super::image::TextureStore;
use super::mtl;
use super::mtl_material::{Converted, Converter};
use super::names::{find_file, spellings, split_names};
use super::obj_text::{Prepared, prepare};
use crate::mesh::maps::UvTransform;
use crate::mesh::{Material, Mesh};

/// Reads an OBJ file. Materials and textures are searched in its folder.
pub(super) fn load(path: &Path, bytes: Vec<u8>) -> Result<Mesh, ImportError> {
    let mut prepared = prepare(path, &text_of(&bytes))?;
    // What follows needs memory, too.
    drop(bytes);
    let mut assembly = Assembly::default();
    for warning in &prepared.warnings {
        assembly.warn(warning);
    }
    let dir = path.parent().unwrap_or(Path::new(""));
    let libraries = Libraries::read(dir, &prepared.libraries, &mut assembly);
    let models = parse(path, &prepared)?;
    (prepared.text, prepared.lines) = Default::default();
    let material_of = |mesh: &tobj::Mesh| {
        let name = mesh.material_id.and_then(|id| prepared.material_names.get(id));
        (name, name.and_then(|name| libraries.find(name)))
    };
    let is_visible = |mesh: &tobj::Mesh| !material_of(mesh).1.is_some_and(|i| libraries.materials[i].1.is_invisible());
    let any_visible = models.iter().any(|model| !model.mesh.indices.is_empty() && is_visible(&model.mesh));

    let mut store = TextureStore::default();
    let mut converted: HashMap<Look, (u32, UvTransform)> = HashMap::new();
    for tobj::Model { mesh, .. } in models {
        if mesh.indices.is_empty() {
            continue;
        }
        let (name, found) = material_of(&mesh);
        if let (Some(name), None) = (name, found) {
            let name = if name.is_empty() { "the material with the empty name" } else { name };
            assembly.warn(format!("no material library defines {name}; using a plain colour"));
        }
        let look = Look {
            material: found,
            textured: !mesh.texcoords.is_empty() || found.is_none(),
            colored: !mesh.vertex_color.is_empty() && found.is_none(),
        };
        let (index, uv_transform) = match converted.get(&look) {
            Some(&known) => known,
            None => {
                let Converted { material, uv_transform } =
                    libraries.convert(look, path, any_visible, &mut store, &mut assembly);
                let index = assembly.mesh.materials.len() as u32;
                assembly.mesh.materials.push(material);
                converted.insert(look, (index, uv_transform));
                (index, uv_transform)
            }
        };
        let part = Part { material: index, ..part_of(&mesh, &uv_transform) };
        assembly.append_all(path, part)?;
    }
    if assembly.mesh.triangles.is_empty() && !prepared.free_form.is_empty() {
        let found = prepared.free_form.warning(["free-form curve or surface", "free-form curves and surfaces"], "");
        let found = found.unwrap_or_default();
        let what = format!("{} and no polygons; convert them to polygons", found.trim_end_matches("; "));
        return Err(ImportError::unsupported(path, what));
    }
    if assembly.mesh.triangles.is_empty() && prepared.vertices > 0 {
        let thin = prepared.thin.warning(["point or line", "points and lines"], "only polygons are read");
        let found =
            thin.unwrap_or_else(|| format!("it has {} vertices and no faces; {POINTS_ADVICE}", prepared.vertices));
        return Err(ImportError::unsupported(path, format!("the mesh has no triangles: {found}")));
    }
    if !any_visible && !assembly.mesh.triangles.is_empty() {
        for material in &mut assembly.mesh.materials {
            material.alpha_cutoff = None;
        }
        assembly.warn("d is 0 in the materials of all faces; they are drawn as if they were opaque");
    }
    Ok(assembly.finish())
}

/// What decides about the material of a part.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Look {
    /// Index into the materials of the libraries; `None` for the plain material.
    material: Option<usize>,
    /// Whether textures can be used: the part has texture coordinates.
    textured: bool,
    /// Whether the colours of the vertices are all the colour there is.
    colored: bool,
}

/// All materials of all libraries, each with the path of its library.
struct Libraries {
    materials: Vec<(PathBuf, mtl::MtlMaterial)>,
    /// Index into `materials`. The first definition of a name is used.
    by_name: HashMap<String, usize>,
    /// Other spellings of the names, in lower case; `None` where they are ambiguous.
    by_spelling: HashMap<String, Option<usize>>,
}

impl Libraries {
    fn read(dir: &Path, statements: &[String], assembly: &mut Assembly) -> Self {
        let mut materials: Vec<(PathBuf, mtl::MtlMaterial)> = Vec::new();
        let mut read = Vec::new();
        for statement in statements {
            // A statement may name several files, or one file whose name contains spaces.
            let names = match find_file(dir, statement) {
                Some(_) => vec![statement.clone()],
                None => split_names(statement),
            };
            for name in names {
                let Some(file) = find_file(dir, &name) else {
                    assembly.warn(format!("the material library {name} is missing"));
                    continue;
                };
                if read.contains(&file) {
                    continue;
                }
                let what = format!("the material library {name}");
                let content = read_file(&file).map(Some);
                let Some(bytes) = assembly.or_warn(content, &what, "its materials get a plain colour") else {
                    continue;
                };
                let (found, warnings) = mtl::parse(&text_of(&bytes));
                for warning in warnings {
                    assembly.warn(format!("{name}: {warning}"));
                }
                materials.extend(found.into_iter().map(|m| (file.clone(), m)));
                read.push(file);
            }
        }
        let mut by_name = HashMap::new();
        let mut by_spelling = HashMap::new();
        for (index, (_, material)) in materials.iter().enumerate() {
            if *by_name.entry(material.name.clone()).or_insert(index) != index {
                continue;
            }
            for spelling in spellings(&material.name) {
                let known = by_spelling.entry(spelling.to_lowercase()).or_insert(Some(index));
                if *known != Some(index) {
                    *known = None;
                }
            }
        }
        Self { materials, by_name, by_spelling }
    }

    /// The material that a `usemtl` statement means: by its name as written, or else by another spelling that only one
    /// material has.
    fn find(&self, name: &str) -> Option<usize> {
        let spelled = || spellings(name).iter().find_map(|s| *self.by_spelling.get(&s.to_lowercase())?);
        self.by_name.get(name).copied().or_else(spelled)
    }

    fn convert(
        &self,
        look: Look,
        obj: &Path,
        any_visible: bool,
        store: &mut TextureStore,
        assembly: &mut Assembly,
    ) -> Converted {
        let Some(index) = look.material else {
            let mut material = Material::default();
            if look.colored {
                material.base_color = [1.0; 4];
            }
            return Converted { material, uv_transform: UvTransform::IDENTITY };
        };
        let (library, source) = &self.materials[index];
        let dir = library.parent().unwrap_or(Path::new(""));
        let mut converted = Converter { obj, dir, any_visible, store, assembly }.convert(source);
        if !look.textured {
            let material = &mut converted.material;
            if material.texture.is_some() {
                assembly.warn(format!(
                    "some faces of material {} have no texture coordinates; they get its plain colour",
                    material.name
                ));
                material.texture = None;
                if !source.is_invisible() {
                    material.alpha_cutoff = None;
                }
            }
            (material.normal_map, material.height_map) = (None, None);
        }
        converted
    }
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

/// The triangles of one `tobj` model, all of which have the same attributes (see [`prepare`]).
fn part_of(mesh: &tobj::Mesh, uv_transform: &UvTransform) -> Part {
    let triples = |values: &[f64]| values.as_chunks::<3>().0.to_vec();
    // The builder needs unit length, which the format does not guarantee. Zero marks a missing normal.
    let unit = |n: [f64; 3]| glam::DVec3::from(n).normalize_or_zero().as_vec3().to_array();
    // In this format v points up.
    let uv = |&[u, v]: &[f64; 2]| {
        let uv = [u as f32, (1.0 - v) as f32];
        let moved = if *uv_transform == UvTransform::IDENTITY { uv } else { uv_transform.apply(uv) };
        moved.map(|x| if x.is_finite() { x } else { 0.0 })
    };
    let color = |c: [f64; 3]| c.map(|x| srgb_to_linear(if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 }) as f32);
    Part {
        positions: triples(&mesh.positions),
        normals: triples(&mesh.normals).into_iter().map(unit).collect(),
        uvs: mesh.texcoords.as_chunks::<2>().0.iter().map(uv).collect(),
        colors: triples(&mesh.vertex_color).into_iter().map(color).collect(),
        triangles: mesh.indices.as_chunks::<3>().0.to_vec(),
        ..Part::default()
    }
}
