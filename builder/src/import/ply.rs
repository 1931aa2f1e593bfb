//! PLY (ASCII, and binary of both byte orders).

use std::collections::HashMap;
use std::path::Path;

use esvo_format::srgb::decode_f64 as srgb_to_linear;
use glam::DVec3;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::file::text_of;
use super::foreign::ply_points;
use super::image::{TextureStore, has_holes};
use super::loss::Loss;
use super::names::find_file;
use super::ply_file::{Element, Encoding, Header, Row, Type, Values, read_header};
use super::polygon::{Split, Splitter};
use crate::mesh::{Material, Mesh};

/// Reads a PLY file. Textures that comments `TextureFile` name are searched in the file's folder.
pub(super) fn load(path: &Path, bytes: &[u8]) -> Result<Mesh, ImportError> {
    let fail = |what: String| ImportError::malformed(path, what);
    let (header, rest) = read_header(bytes).map_err(fail)?;
    check_counts(path, &header, bytes.len())?;
    let no_vertices = || ImportError::malformed(path, "the header declares no element 'vertex'");
    let declares = |names: &[&str]| header.elements.iter().any(|element| names.contains(&&*element.name));
    if !declares(&["vertex"]) {
        return Err(no_vertices());
    }
    if !declares(&["face", "tristrips"]) {
        return Err(ImportError::unsupported(path, ply_points()));
    }
    let text;
    let mut values = match header.encoding {
        Encoding::Ascii => {
            text = text_of(rest);
            Values::text(&header, &text)
        }
        _ => Values::binary(&header, rest),
    };

    let mut assembly = Assembly::default();
    let mut vertices = None;
    let mut faces = Faces::default();
    let mut row = Row::default();
    for element in &header.elements {
        let mut kind = match element.name.as_str() {
            "vertex" => {
                warn_of_incomplete(element, &NORMALS, "normals", &mut assembly);
                warn_of_incomplete(element, &UVS, "texture coordinates", &mut assembly);
                warn_of_incomplete(element, &COLORS, "colours", &mut assembly);
                Kind::Vertices(Box::new(Vertices::new(element).map_err(fail)?))
            }
            "face" | "tristrips" => {
                warn_of_incomplete(element, &COLORS, "colours", &mut assembly);
                Kind::Faces(FaceReader::new(element))
            }
            _ => Kind::Ignored,
        };
        for number in 0..element.count {
            values.read(element, number, &mut row).map_err(fail)?;
            match &mut kind {
                Kind::Vertices(vertices) => vertices.add(&row),
                Kind::Faces(reader) => reader.add(&row, number, &mut faces),
                Kind::Ignored => {}
            }
        }
        match kind {
            Kind::Vertices(read) => vertices = Some(*read),
            Kind::Faces(_) | Kind::Ignored => {}
        }
    }
    let mut vertices = vertices.ok_or_else(no_vertices)?;
    if let Values::Text(text) = &values {
        let what =
            ["line with more values than the header declares", "lines with more values than the header declares"];
        assembly.mesh.warnings.extend(text.longer.warning(what, "the rest of each is ignored"));
    }
    vertices.finish(&mut assembly);
    let corners = faces.split(path, &vertices.part.positions, &mut assembly)?;
    vertices.check_positions(path, &corners)?;
    Builder { path, header: &header, vertices, faces, assembly }.build(&corners)
}

/// What the rows of an element are read as.
enum Kind<'a> {
    Vertices(Box<Vertices>),
    Faces(FaceReader<'a>),
    Ignored,
}

/// Refuses element counts that do not fit into the file, before they cause allocations or loops.
fn check_counts(path: &Path, header: &Header, file_bytes: usize) -> Result<(), ImportError> {
    for Element { name, count, properties } in &header.elements {
        // Each property takes at least one byte; in ASCII each element also takes a line break.
        let smallest = match header.encoding {
            Encoding::Ascii => properties.len().max(1),
            _ => properties.len(),
        };
        if *count > 0 && (smallest == 0 || *count > file_bytes / smallest) {
            return Err(ImportError::malformed(
                path,
                format!("the header declares {count} elements '{name}', more than {file_bytes} bytes can hold"),
            ));
        }
    }
    Ok(())
}

const NORMALS: [[&str; 3]; 1] = [["nx", "ny", "nz"]];

/// The names of properties that hold texture coordinates.
const UVS: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// The names of properties that hold colours.
const COLORS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// Warns if an element has only some of the properties that make up an attribute. Names of one letter can mean anything, and
/// do not count.
fn warn_of_incomplete<const N: usize>(element: &Element, sets: &[[&str; N]], what: &str, assembly: &mut Assembly) {
    if element.scalars(sets).is_some() {
        return;
    }
    for set in sets.iter().filter(|set| set[0].len() > 1) {
        let (there, missing): (Vec<&str>, Vec<&str>) = set.iter().partition(|name| element.scalar(name).is_some());
        if !there.is_empty() {
            let (name, there, missing) = (one_line(&element.name), there.join(", "), missing.join(", "));
            assembly.warn(format!("the element '{name}' has {there} but not {missing}; its {what} are left out"));
        }
    }
}

/// The places of three colour properties, and the value of each that stands for 1.
#[derive(Clone, Copy)]
struct ColorPlaces {
    places: [usize; 3],
    units: [f64; 3],
}

impl ColorPlaces {
    fn of(element: &Element) -> Option<Self> {
        let places = element.scalars(&COLORS)?;
        // By convention, colours are 0 to 255 in the wider types, too, except for unsigned 16-bit values.
        let units = places.map(|place| match element.properties[place].of {
            Type::I8 => 127.0,
            Type::U16 => 65535.0,
            Type::F32 | Type::F64 => 1.0,
            Type::U8 | Type::I16 | Type::I32 | Type::U32 => 255.0,
        });
        Some(Self { places, units })
    }

    /// A colour encoded as sRGB, 0..=1; `None` if it cannot be read or is not finite.
    fn read(&self, row: &Row) -> Option<[f32; 3]> {
        let color: [f32; 3] = std::array::from_fn(|k| (row.scalars[self.places[k]] / self.units[k]) as f32);
        color.iter().all(|x| x.is_finite()).then_some(color)
    }
}

/// Colours in linear RGB from colours encoded as sRGB. Those above 1 mean that all are 0 to 255.
fn linear_colors(colors: &mut [[f32; 3]], of: &str, assembly: &mut Assembly) {
    let brightest = colors.as_flattened().iter().filter(|x| x.is_finite()).fold(0.0f32, |most, x| most.max(*x));
    let scale = if brightest > 1.0 {
        assembly.warn(format!("the colours of the {of} reach {brightest}: they are taken as 0 to 255, not 0 to 1"));
        1.0 / 255.0
    } else {
        1.0
    };
    for x in colors.as_flattened_mut() {
        let encoded = if x.is_finite() { (*x * scale).clamp(0.0, 1.0) } else { 1.0 };
        *x = srgb_to_linear(f64::from(encoded)) as f32;
    }
}

/// Stands for a colour that is not there: it becomes white.
const NO_COLOR: [f32; 3] = [f32::NAN; 3];

/// What colours are that cannot be used, one and many.
const BAD_COLORS: [&str; 2] =
    ["colour that cannot be read or is not finite", "colours that cannot be read or are not finite"];

/// The vertices: a part without triangles.
struct Vertices {
    part: Part,
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
    color: Option<ColorPlaces>,
    /// Normals, texture coordinates, and colours that cannot be read or are not finite.
    bad: [Loss; 3],
}

impl Vertices {
    fn new(element: &Element) -> Result<Self, String> {
        let position = element.scalars(&[["x", "y", "z"]]).ok_or_else(|| {
            let missing = ["x", "y", "z"].into_iter().find(|name| element.scalar(name).is_none()).unwrap_or("x");
            format!("the vertices have no property '{missing}'")
        })?;
        Ok(Self {
            part: Part::default(),
            position,
            normal: element.scalars(&NORMALS),
            uv: element.scalars(&UVS),
            color: ColorPlaces::of(element),
            bad: Default::default(),
        })
    }

    fn add(&mut self, row: &Row) {
        let vertex = self.part.positions.len();
        self.part.positions.push(self.position.map(|place| row.scalars[place]));
        if let Some(places) = self.normal {
            // Single precision, as most files have it. Zero marks a missing normal.
            let n = DVec3::from(places.map(|place| f64::from(row.scalars[place] as f32)));
            if !n.is_finite() {
                self.bad[0].add(|| format!("vertex {vertex}"));
            }
            self.part.normals.push(n.normalize_or_zero().as_vec3().to_array());
        }
        if let Some(places) = self.uv {
            let [u, v] = places.map(|place| row.scalars[place] as f32);
            let finite = u.is_finite() && v.is_finite();
            if !finite {
                self.bad[1].add(|| format!("vertex {vertex}"));
            }
            // In textured PLY files v points up.
            self.part.uvs.push(if finite { [u, 1.0 - v] } else { [0.0, 1.0] });
        }
        if let Some(places) = &self.color {
            let color = places.read(row);
            if color.is_none() {
                self.bad[2].add(|| format!("vertex {vertex}"));
            }
            self.part.colors.push(color.unwrap_or(NO_COLOR));
        }
    }

    fn finish(&mut self, assembly: &mut Assembly) {
        linear_colors(&mut self.part.colors, "vertices", assembly);
        let bad = [
            self.bad[0].warning(
                ["normal that cannot be read or is not finite", "normals that cannot be read or are not finite"],
                "normals of the faces are used instead",
            ),
            self.bad[1].warning(
                [
                    "texture coordinate that cannot be read or is not finite",
                    "texture coordinates that cannot be read or are not finite",
                ],
                "0 is used instead",
            ),
            self.bad[2].warning(BAD_COLORS, "white is used instead"),
        ];
        bad.into_iter().flatten().for_each(|line| assembly.warn(line));
    }

    /// Refuses positions that are not finite, unless no face uses them.
    fn check_positions(&mut self, path: &Path, corners: &[[Corner; 3]]) -> Result<(), ImportError> {
        let positions = &mut self.part.positions;
        if positions.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            return Ok(());
        }
        let bad = |vertex: usize| !positions[vertex].iter().all(|x| x.is_finite());
        let used = corners.iter().flatten().map(|corner| corner.vertex as usize);
        if let Some(vertex) = used.filter(|&vertex| bad(vertex)).min() {
            return Err(ImportError::malformed(path, format!("vertex {vertex} is not finite; repair or remove it")));
        }
        // Nothing refers to the others: any position will do that does not change the bounds.
        if let Some([first, ..]) = corners.first() {
            let place = positions[first.vertex as usize];
            for p in positions.iter_mut().filter(|p| !p.iter().all(|x| x.is_finite())) {
                *p = place;
            }
        }
        Ok(())
    }
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
struct Corner {
    vertex: u32,
    /// The face, and the place of the corner in its list of vertices.
    face: u32,
    place: u32,
}

/// What is read of one element of faces.
struct FaceReader<'a> {
    name: &'a str,
    strips: bool,
    indices: Option<usize>,
    uvs: Option<usize>,
    texture: Option<usize>,
    color: Option<ColorPlaces>,
}

impl<'a> FaceReader<'a> {
    fn new(element: &'a Element) -> Self {
        Self {
            name: &element.name,
            strips: element.name == "tristrips",
            indices: element.list(&["vertex_indices", "vertex_index"]),
            uvs: element.list(&["texcoord"]),
            texture: element.scalar("texnumber"),
            color: ColorPlaces::of(element),
        }
    }

    fn add(&mut self, row: &Row, number: usize, faces: &mut Faces) {
        let indices = self.indices.map_or(&[][..], |place| row.list(place));
        faces.indices.extend_from_slice(indices);
        faces.ends.push(faces.indices.len());
        faces.strips.push(self.strips);
        if number == 0 {
            faces.names.push((faces.ends.len() - 1, self.name.to_owned()));
        }
        let face = faces.ends.len() - 1;
        if let Some(place) = self.uvs {
            let list = row.list(place);
            faces.uvs.resize(faces.indices.len() - indices.len(), None);
            let complete = !self.strips && list.len() == 2 * indices.len();
            if !complete && !list.is_empty() {
                faces.bad_uvs.add(|| format!("face {number}: {} numbers for {} corners", list.len(), indices.len()));
            }
            let usable = complete && list.iter().all(|x| (*x as f32).is_finite());
            if complete && !usable {
                faces.bad_uvs.add(|| format!("face {number}"));
            }
            for k in 0..indices.len() {
                faces.uvs.push(usable.then(|| [list[2 * k] as f32, 1.0 - list[2 * k + 1] as f32]));
            }
        }
        if let Some(place) = self.texture {
            faces.textures.resize(face, None);
            faces.textures.push(Some(row.scalars[place]));
        }
        if let Some(places) = &self.color {
            faces.colors.resize(face, NO_COLOR);
            let color = places.read(row);
            if color.is_none() {
                faces.bad_colors.add(|| format!("face {number}"));
            }
            faces.colors.push(color.unwrap_or(NO_COLOR));
        }
    }
}

/// All faces and strips.
#[derive(Default)]
struct Faces {
    /// The vertices of all faces, one face after the other, and where each face ends.
    indices: Vec<f64>,
    ends: Vec<usize>,
    strips: Vec<bool>,
    /// The first face of each element, and the element's name.
    names: Vec<(usize, String)>,
    /// As `indices`: texture coordinates per corner. May be shorter.
    uvs: Vec<Option<[f32; 2]>>,
    bad_uvs: Loss,
    bad_colors: Loss,
    /// As `ends`: the number of the texture. May be shorter.
    textures: Vec<Option<f64>>,
    /// As `ends`: colours; at first sRGB-encoded. May be shorter.
    colors: Vec<[f32; 3]>,
}

impl Faces {
    /// Where the corners of a face begin in `indices`.
    fn start(&self, face: usize) -> usize {
        if face == 0 { 0 } else { self.ends[face - 1] }
    }

    /// Splits all faces and strips into triangles.
    fn split(
        &self,
        path: &Path,
        positions: &[[f64; 3]],
        assembly: &mut Assembly,
    ) -> Result<Vec<[Corner; 3]>, ImportError> {
        let mut triangles = Vec::with_capacity(self.ends.len());
        let mut splitter = Splitter::new();
        let mut places: Vec<DVec3> = Vec::new();
        let mut list: Vec<Corner> = Vec::new();
        let mut crossing = Loss::default();
        for face in 0..self.ends.len() {
            let start = self.start(face);
            let indices = &self.indices[start..self.ends[face]];
            let (first, name) = &self.names[self.names.partition_point(|(first, _)| *first <= face) - 1];
            let number = face - first;
            let corner = |(place, &index): (usize, &f64)| {
                let vertex = Some(index as u32).filter(|&i| f64::from(i) == index && (i as usize) < positions.len());
                let vertex = vertex.ok_or_else(|| {
                    let vertices = positions.len();
                    let what = format!("it refers to vertex {index}, but there are only {vertices}");
                    ImportError::malformed(path, format!("{name} {number}: {what}"))
                })?;
                Ok(Corner { vertex, face: face as u32, place: place as u32 })
            };
            if self.strips[face] {
                let numbered: Vec<(usize, &f64)> = indices.iter().enumerate().collect();
                for strip in numbered.split(|(_, index)| **index == -1.0) {
                    let strip = strip.iter().map(|&entry| corner(entry)).collect::<Result<Vec<_>, _>>()?;
                    for (k, w) in strip.windows(3).enumerate() {
                        let [a, b, c] = [w[0], w[1], w[2]];
                        // Repeated vertices only join parts of a strip.
                        if a.vertex != b.vertex && b.vertex != c.vertex && c.vertex != a.vertex {
                            triangles.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                        }
                    }
                }
                continue;
            }
            list.clear();
            for entry in indices.iter().enumerate() {
                list.push(corner(entry)?);
            }
            places.clear();
            places.extend(list.iter().map(|corner| DVec3::from(positions[corner.vertex as usize])));
            let split = splitter.split(&places);
            if matches!(split, Split::Crossing(_)) {
                crossing.add(|| format!("{name} {number}"));
            }
            match split {
                Split::Fan => {
                    if let [first, rest @ ..] = list.as_slice() {
                        triangles.extend(rest.windows(2).map(|w| [*first, w[0], w[1]]));
                    }
                }
                Split::Triangles(split) | Split::Crossing(split) => {
                    triangles.extend(split.iter().map(|t| t.map(|k| list[k as usize])));
                }
            }
        }
        let what = ["polygon whose edges cross", "polygons whose edges cross"];
        let crossing = crossing.warning(what, "its triangles may not cover it as meant");
        let what = [
            "face without a finite texture coordinate for each corner",
            "faces without a finite texture coordinate for each corner",
        ];
        let bad_uvs = self.bad_uvs.warning(what, "they get the plain colour");
        let bad_colors = self.bad_colors.warning(BAD_COLORS, "white is used instead");
        crossing.into_iter().chain(bad_uvs).chain(bad_colors).for_each(|line| assembly.warn(line));
        Ok(triangles)
    }

    fn uv(&self, corner: &Corner) -> Option<[f32; 2]> {
        *self.uvs.get(self.start(corner.face as usize) + corner.place as usize)?
    }
}

/// Puts the mesh together.
struct Builder<'a> {
    path: &'a Path,
    header: &'a Header,
    vertices: Vertices,
    faces: Faces,
    assembly: Assembly,
}

impl Builder<'_> {
    fn build(mut self, corners: &[[Corner; 3]]) -> Result<Mesh, ImportError> {
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
