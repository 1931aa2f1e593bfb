//! The vertices and faces of PLY files as their rows give them, and the triangles of the faces.

use std::path::Path;

use esvo_format::srgb::decode_f64 as srgb_to_linear;
use glam::DVec3;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::loss::Loss;
use super::ply_file::{Element, Row, Type};
use super::polygon::{Split, Splitter};

pub(super) const NORMALS: [[&str; 3]; 1] = [["nx", "ny", "nz"]];

/// The names of properties that hold texture coordinates.
pub(super) const UVS: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// The names of properties that hold colours.
pub(super) const COLORS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// Warns if an element has only some of the properties that make up an attribute. Names of one letter can mean anything, and
/// do not count.
pub(super) fn warn_of_incomplete<const N: usize>(
    element: &Element,
    sets: &[[&str; N]],
    what: &str,
    assembly: &mut Assembly,
) {
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
pub(super) struct ColorPlaces {
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
pub(super) fn linear_colors(colors: &mut [[f32; 3]], of: &str, assembly: &mut Assembly) {
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
pub(super) struct Vertices {
    pub(super) part: Part,
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
    pub(super) color: Option<ColorPlaces>,
    /// Normals, texture coordinates, and colours that cannot be read or are not finite.
    bad: [Loss; 3],
}

impl Vertices {
    pub(super) fn new(element: &Element) -> Result<Self, String> {
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

    pub(super) fn add(&mut self, row: &Row) {
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

    pub(super) fn finish(&mut self, assembly: &mut Assembly) {
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
    pub(super) fn check_positions(&mut self, path: &Path, corners: &[[Corner; 3]]) -> Result<(), ImportError> {
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
pub(super) struct Corner {
    pub(super) vertex: u32,
    /// The face, and the place of the corner in its list of vertices.
    pub(super) face: u32,
    place: u32,
}

/// What is read of one element of faces.
pub(super) struct FaceReader<'a> {
    name: &'a str,
    strips: bool,
    indices: Option<usize>,
    uvs: Option<usize>,
    texture: Option<usize>,
    color: Option<ColorPlaces>,
}

impl<'a> FaceReader<'a> {
    pub(super) fn new(element: &'a Element) -> Self {
        Self {
            name: &element.name,
            strips: element.name == "tristrips",
            indices: element.list(&["vertex_indices", "vertex_index"]),
            uvs: element.list(&["texcoord"]),
            texture: element.scalar("texnumber"),
            color: ColorPlaces::of(element),
        }
    }

    pub(super) fn add(&mut self, row: &Row, number: usize, faces: &mut Faces) {
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
pub(super) struct Faces {
    /// The vertices of all faces, one face after the other, and where each face ends.
    indices: Vec<f64>,
    pub(super) ends: Vec<usize>,
    strips: Vec<bool>,
    /// The first face of each element, and the element's name.
    names: Vec<(usize, String)>,
    /// As `indices`: texture coordinates per corner. May be shorter.
    pub(super) uvs: Vec<Option<[f32; 2]>>,
    bad_uvs: Loss,
    bad_colors: Loss,
    /// As `ends`: the number of the texture. May be shorter.
    pub(super) textures: Vec<Option<f64>>,
    /// As `ends`: colours; at first sRGB-encoded. May be shorter.
    pub(super) colors: Vec<[f32; 3]>,
}

impl Faces {
    /// Where the corners of a face begin in `indices`.
    fn start(&self, face: usize) -> usize {
        if face == 0 { 0 } else { self.ends[face - 1] }
    }

    /// Splits all faces and strips into triangles.
    pub(super) fn split(
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

    pub(super) fn uv(&self, corner: &Corner) -> Option<[f32; 2]> {
        *self.uvs.get(self.start(corner.face as usize) + corner.place as usize)?
    }
}
