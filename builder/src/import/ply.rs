//! PLY (ASCII, and binary of both byte orders).

use std::path::Path;

use super::assembly::Assembly;
use super::error::ImportError;
use super::file::text_of;
use super::foreign::ply_points;
use super::ply_elements::{COLORS, FaceReader, Faces, NORMALS, UVS, Vertices, warn_of_incomplete};
use super::ply_file::{Element, Encoding, Header, Row, Values, read_header};
use super::ply_mesh::Builder;
use crate::mesh::Mesh;

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
