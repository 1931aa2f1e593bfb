//! The mesh of a PLY file from its vertices and faces: parts by texture, with attributes per corner where faces have them.

use std::collections::HashMap;
use std::path::Path;

use super::assembly::{Assembly, Part};
use super::error::ImportError;
use super::image::{TextureStore, has_holes};
use super::loss::Loss;
use super::names::find_file;
use super::ply_elements::{Corner, Faces, Vertices, linear_colors};
use super::ply_file::Header;
use crate::mesh::{Material, Mesh};

/// Puts the mesh together.
pub(super) struct Builder<'a> {
    pub(super) path: &'a Path,
    pub(super) header: &'a Header,
    pub(super) vertices: Vertices,
    pub(super) faces: Faces,
    pub(super) assembly: Assembly,
}

impl Builder<'_> {
    pub(super) fn build(mut self, corners: &[[Corner; 3]]) -> Result<Mesh, ImportError> {
        let textures = self.texture_names();
        if !self.faces.uvs.iter().any(Option::is_some) {
            self.faces.uvs.clear();
        }
        let has_uvs = !self.vertices.part.uvs.is_empty() || self.faces.uvs.iter().any(Option::is_some);
        if !self.vertices.part.colors.is_empty() && !self.faces.colors.is_empty() {
            self.assembly.warn("both the vertices and the faces have colours; those of the vertices are used");
            self.faces.colors.clear();
        }
        linear_colors(&mut self.faces.colors, "faces", &mut self.assembly);
        if !has_uvs && let Some(name) = textures.first() {
            self.assembly.warn(format!("the texture {name} is not used: the vertices have no texture coordinates"));
        }
        let textures = if has_uvs { textures } else { Vec::new() };
        if textures.len() > 1 && self.faces.textures.is_empty() {
            let (count, name) = (textures.len(), &textures[0]);
            let line = format!("the file names {count} textures, but its faces do not say which; only {name} is used");
            self.assembly.warn(line);
        }

        // The texture of each face that has one: its number, if it is one of those named.
        let mut unknown = Loss::default();
        let numbers: Vec<Option<usize>> = (0..self.faces.ends.len())
            .map(|face| match self.faces.textures.get(face) {
                Some(Some(number)) if textures.len() > 1 => {
                    let found = Some(*number as usize).filter(|&n| *number >= 0.0 && n < textures.len());
                    if found.is_none() && *number != -1.0 {
                        unknown.add(|| format!("face {face}: texture {number} of {}", textures.len()));
                    }
                    found
                }
                _ => (!textures.is_empty()).then_some(0),
            })
            .collect();
        let what =
            ["face with a texture that the file does not name", "faces with a texture that the file does not name"];
        unknown.warning(what, "they get the plain colour").into_iter().for_each(|line| self.assembly.warn(line));

        let per_corner =
            !self.faces.uvs.is_empty() || !self.faces.colors.is_empty() || numbers.iter().any(|n| *n != numbers[0]);
        let mut store = TextureStore::default();
        if !per_corner {
            let name = numbers.first().copied().flatten().and_then(|n| textures.get(n));
            let name = name.or(textures.first());
            let material = self.material(name.map(String::as_str), &mut store);
            let mut part = std::mem::take(&mut self.vertices.part);
            part.triangles = corners.iter().map(|t| t.map(|corner| corner.vertex)).collect();
            self.assembly.mesh.materials.push(material);
            self.assembly.append(self.path, &part, None)?;
            return Ok(self.assembly.finish());
        }
        let mut groups: HashMap<Option<usize>, usize> = HashMap::new();
        let mut parts: Vec<(Part, HashMap<CornerKey, u32>)> = Vec::new();
        for triangle in corners {
            let uvs = triangle.map(|corner| self.faces.uv(&corner));
            // Without texture coordinates of its corners, a face has those of its vertices, if the file has no others.
            let textured = if self.faces.uvs.is_empty() { has_uvs } else { uvs.iter().all(Option::is_some) };
            let texture = numbers[triangle[0].face as usize].filter(|_| textured);
            let group = *groups.entry(texture).or_insert(parts.len());
            if group == parts.len() {
                let material = self.material(texture.map(|n| textures[n].as_str()), &mut store);
                self.assembly.mesh.materials.push(material);
                parts.push((Part { material: group as u32, ..Part::default() }, HashMap::new()));
            }
            let (part, known) = &mut parts[group];
            let mut corner = |k: usize| self.corner(&triangle[k], uvs[k], part, known);
            let indices = [corner(0), corner(1), corner(2)];
            part.triangles.push(indices);
        }
        for (part, _) in &parts {
            self.assembly.append(self.path, part, None)?;
        }
        Ok(self.assembly.finish())
    }

    /// The index in `part` of a vertex with the attributes of a corner.
    fn corner(
        &self,
        corner: &Corner,
        uv: Option<[f32; 2]>,
        part: &mut Part,
        known: &mut HashMap<CornerKey, u32>,
    ) -> u32 {
        let from = &self.vertices.part;
        let vertex = corner.vertex as usize;
        let uv = if self.faces.uvs.is_empty() { from.uvs.get(vertex).copied() } else { Some(uv.unwrap_or_default()) };
        let color = match self.faces.colors.get(corner.face as usize) {
            Some(color) => Some(*color),
            // Strips next to faces with colours.
            None if !self.faces.colors.is_empty() => Some([1.0; 3]),
            None => from.colors.get(vertex).copied(),
        };
        let key = (corner.vertex, uv.map(|uv| uv.map(f32::to_bits)), color.map(|color| color.map(f32::to_bits)));
        let next = part.positions.len() as u32;
        let index = *known.entry(key).or_insert(next);
        if index == next {
            part.positions.push(from.positions[vertex]);
            part.normals.extend(from.normals.get(vertex));
            part.uvs.extend(uv);
            part.colors.extend(color);
        }
        index
    }

    /// The names in comments `TextureFile`.
    fn texture_names(&self) -> Vec<String> {
        const KEY: &str = "TextureFile";
        let named = |comment: &String| {
            let (key, name) = comment.trim().split_once(char::is_whitespace)?;
            key.eq_ignore_ascii_case(KEY).then(|| name.trim().to_owned())
        };
        self.header.comments.iter().filter_map(named).filter(|name| !name.is_empty()).collect()
    }

    /// The material with the texture of this name, or a plain one.
    fn material(&mut self, texture: Option<&str>, store: &mut TextureStore) -> Material {
        let colored = self.header.elements.iter().any(|element| match element.name.as_str() {
            "vertex" => {
                self.vertices.color.is_some() || element.scalar("red").or(element.scalar("diffuse_red")).is_some()
            }
            _ => !self.faces.colors.is_empty(),
        });
        let plain = if colored {
            // The vertices or the faces have the colour.
            Material { base_color: [1.0; 4], ..Material::default() }
        } else {
            Material::default()
        };
        let Some(name) = texture else { return plain };
        let file = find_file(self.path.parent().unwrap_or(Path::new("")), name);
        let loaded = file.map_or(Ok(None), |file| store.load(self.path, &file));
        let Some(texture) = self.assembly.or_warn(loaded, &format!("the texture {name}"), "using a plain colour")
        else {
            return plain;
        };
        let alpha_cutoff = has_holes(&texture).then_some(0.5);
        Material {
            name: name.into(),
            base_color: [1.0; 4],
            texture: Some(texture),
            alpha_cutoff,
            ..Material::default()
        }
    }
}

/// A vertex, and the bits of its texture coordinates and colour.
type CornerKey = (u32, Option<[u32; 2]>, Option<[u32; 3]>);
