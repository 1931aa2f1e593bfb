//! PLY (ASCII, and binary of both byte orders), read by `ply-rs-bw`.

use std::path::Path;

use esvo_format::srgb::decode_f64 as srgb_to_linear;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult};

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::image::{TextureStore, find_file, has_holes};
use crate::mesh::{Material, Mesh};

/// Reads a PLY file. If a comment `TextureFile` names a texture, it is searched in the file's folder.
pub(super) fn load(path: &Path, bytes: &[u8]) -> Result<Mesh, ImportError> {
    let fail = |e: ParseError| ImportError::malformed(path, message(e));
    let mut reader = Reader::new(bytes);
    let header = Parser::<Ignored>::new().read_header(&mut reader).map_err(fail)?;
    check_counts(path, &header, bytes.len())?;

    let mut assembly = Assembly::default();
    let mut vertices: Option<Vec<Vertex>> = None;
    let mut faces: Vec<(&str, Vec<Indices>)> = Vec::new();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                vertices = Some(Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?);
            }
            "face" | "tristrips" => {
                warn_unread(element, &mut assembly);
                let lists = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?;
                faces.push((name, lists));
            }
            _ => {
                Parser::<Ignored>::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?;
            }
        }
    }
    let Some(vertices) = vertices else {
        return Err(ImportError::malformed(path, "the header declares no element 'vertex'"));
    };
    if faces.is_empty() {
        return Err(ImportError::unsupported(path, "the file is a point cloud: it declares no element 'face'"));
    }
    let material = material_of(path, &header, &mut assembly)?;
    let definition = &header.elements["vertex"];
    let mut part = part_of(path, definition, &vertices)?;
    for (name, lists) in &faces {
        for (number, list) in lists.iter().enumerate() {
            list.triangulate(*name == "tristrips", vertices.len(), &mut part.triangles)
                .map_err(|what| ImportError::malformed(path, format!("{name} {number}: {what}")))?;
        }
    }
    assembly.mesh.materials.push(material);
    assembly.append(path, &part, None)?;
    Ok(assembly.finish())
}

/// The message of the library without the state of its parser.
fn message(error: ParseError) -> String {
    let text = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    one_line(text.split(" Error: ParseError {").next().unwrap_or(&text))
}

/// Refuses element counts that do not fit into the file, before they cause allocations or loops.
fn check_counts(path: &Path, header: &Header, file_bytes: usize) -> Result<(), ImportError> {
    for (name, element) in &header.elements {
        // Each property takes at least one byte; in ASCII each element also takes a line break.
        let smallest = match header.encoding {
            Encoding::Ascii => element.properties.len().max(1),
            _ => element.properties.len(),
        };
        if element.count > 0 && (smallest == 0 || element.count > file_bytes / smallest) {
            return Err(ImportError::malformed(
                path,
                format!(
                    "the header declares {} elements '{name}', more than {file_bytes} bytes can hold",
                    element.count
                ),
            ));
        }
    }
    Ok(())
}

fn warn_unread(element: &ElementDef, assembly: &mut Assembly) {
    if element.properties.contains_key("texcoord") {
        assembly.warn("texture coordinates per face corner are not read");
    }
    if element.properties.contains_key("red") {
        assembly.warn("colours per face are not read");
    }
}

fn material_of(path: &Path, header: &Header, assembly: &mut Assembly) -> Result<Material, ImportError> {
    let vertex = &header.elements["vertex"].properties;
    let plain = if vertex.contains_key("red") || vertex.contains_key("diffuse_red") {
        // The vertices have the colour.
        Material { base_color: [1.0; 4], ..Material::default() }
    } else {
        Material::default()
    };
    let Some(name) = header.comments.iter().find_map(|c| c.trim().strip_prefix("TextureFile ")) else {
        return Ok(plain);
    };
    let name = name.trim();
    if !UV_NAMES.iter().any(|pair| pair.iter().all(|n| vertex.contains_key(*n))) {
        assembly.warn(format!("the texture {name} is not used: the vertices have no texture coordinates"));
        return Ok(plain);
    }
    let file = find_file(path.parent().unwrap_or(Path::new("")), name);
    let texture = match &file {
        Some(file) => TextureStore::default().load(path, file)?,
        None => None,
    };
    let Some(texture) = texture else {
        assembly.warn(format!("the texture {name} is missing; using a plain colour"));
        return Ok(plain);
    };
    let alpha_cutoff = has_holes(&texture).then_some(0.5);
    Ok(Material {
        name: name.into(),
        base_color: [1.0; 4],
        texture: Some(texture),
        alpha_cutoff,
        ..Material::default()
    })
}

/// The names of properties that hold texture coordinates.
const UV_NAMES: [[&str; 2]; 4] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];

/// The vertices as a part that has no triangles yet.
fn part_of(path: &Path, definition: &ElementDef, vertices: &[Vertex]) -> Result<Part, ImportError> {
    let has = |name: &str| definition.properties.contains_key(name);
    if let Some(missing) = ["x", "y", "z"].into_iter().find(|name| !has(name)) {
        return Err(ImportError::malformed(path, format!("the vertices have no property '{missing}'")));
    }
    if let Some(bad) = vertices.iter().position(|v| !v.position.iter().all(|x| x.is_finite())) {
        return Err(ImportError::malformed(path, format!("vertex {bad} is not finite; repair or remove it")));
    }
    let mut part = Part { positions: vertices.iter().map(|v| v.position).collect(), ..Part::default() };
    if ["nx", "ny", "nz"].iter().all(|n| has(n)) {
        part.normals = vertices
            .iter()
            .map(|v| glam::DVec3::from(v.normal.map(f64::from)).normalize_or_zero().as_vec3().to_array())
            .collect();
    }
    if UV_NAMES.iter().any(|pair| pair.iter().all(|n| has(n))) {
        // In textured PLY files v points up.
        part.uvs = vertices.iter().map(|v| [v.uv[0], 1.0 - v.uv[1]]).collect();
    }
    if ["red", "green", "blue"].iter().all(|n| has(n) || has(&format!("diffuse_{n}"))) {
        part.colors = vertices
            .iter()
            .map(|v| {
                v.color.map(|x| srgb_to_linear(f64::from(if x.is_finite() { x.clamp(0.0, 1.0) } else { 1.0 })) as f32)
            })
            .collect();
    }
    Ok(part)
}

#[derive(Debug, Default)]
struct Vertex {
    position: [f64; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    /// Encoded as sRGB, 0..=1.
    color: [f32; 3],
}

impl Vertex {
    /// Sets a property. `unit` is the value that stands for 1 in a colour of this type; 1 for floating point.
    fn set(&mut self, name: &str, value: f64, unit: f64) -> PropertyAccessResult {
        match name {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            "nx" => self.normal[0] = value as f32,
            "ny" => self.normal[1] = value as f32,
            "nz" => self.normal[2] = value as f32,
            "s" | "u" | "texture_u" | "texture_s" => self.uv[0] = value as f32,
            "t" | "v" | "texture_v" | "texture_t" => self.uv[1] = value as f32,
            "red" | "diffuse_red" => self.color[0] = (value / unit) as f32,
            "green" | "diffuse_green" => self.color[1] = (value / unit) as f32,
            "blue" | "diffuse_blue" => self.color[2] = (value / unit) as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match property {
            // By convention, colours are 0 to 255 in the wider types, too, except for unsigned 16-bit values.
            Property::Char(x) => self.set(name, f64::from(x), 127.0),
            Property::UChar(x) => self.set(name, f64::from(x), 255.0),
            Property::Short(x) => self.set(name, f64::from(x), 255.0),
            Property::UShort(x) => self.set(name, f64::from(x), 65535.0),
            Property::Int(x) => self.set(name, f64::from(x), 255.0),
            Property::UInt(x) => self.set(name, f64::from(x), 255.0),
            Property::Float(x) => self.set(name, f64::from(x), 1.0),
            Property::Double(x) => self.set(name, x, 1.0),
            _ => PropertyAccessResult::Ignored,
        }
    }
}

/// The vertex indices of one face, or of one chain of triangle strips, separated by -1.
#[derive(Debug, Default)]
struct Indices {
    list: Vec<i64>,
}

impl Indices {
    fn triangulate(&self, strips: bool, vertices: usize, triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
        let checked = |i: i64| {
            u32::try_from(i)
                .ok()
                .filter(|&i| (i as usize) < vertices)
                .ok_or_else(|| format!("it refers to vertex {i}, but there are only {vertices}"))
        };
        if strips {
            for strip in self.list.split(|&i| i == -1) {
                let strip = strip.iter().map(|&i| checked(i)).collect::<Result<Vec<_>, _>>()?;
                for (k, w) in strip.windows(3).enumerate() {
                    let [a, b, c] = [w[0], w[1], w[2]];
                    // Repeated vertices only join parts of a strip.
                    if a != b && b != c && c != a {
                        triangles.push(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                    }
                }
            }
        } else {
            let face = self.list.iter().map(|&i| checked(i)).collect::<Result<Vec<_>, _>>()?;
            if let [first, rest @ ..] = face.as_slice() {
                triangles.extend(rest.windows(2).map(|w| [*first, w[0], w[1]]));
            }
        }
        Ok(())
    }
}

impl PropertyAccess for Indices {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.list = match property {
            Property::ListChar(x) => x.into_iter().map(i64::from).collect(),
            Property::ListUChar(x) => x.into_iter().map(i64::from).collect(),
            Property::ListShort(x) => x.into_iter().map(i64::from).collect(),
            Property::ListUShort(x) => x.into_iter().map(i64::from).collect(),
            Property::ListInt(x) => x.into_iter().map(i64::from).collect(),
            Property::ListUInt(x) => x.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element that is read past and dropped.
#[derive(Debug)]
struct Ignored;

impl PropertyAccess for Ignored {
    fn new() -> Self {
        Self
    }
}
