//! STL, text and binary. Parsed here, because the available libraries take a binary file whose header begins with "solid"
//! for text, stop at the first of several solids, and round the coordinates of text to single precision.
//!
//! The normals of the facets are not used: the winding of the corners gives the same normal and is more often right. Corners
//! at the same position become one vertex.

use std::collections::HashMap;
use std::path::Path;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use crate::mesh::MAX_ELEMENTS;
use crate::mesh::{Material, Mesh};

/// Bytes before the triangles of a binary file: a comment, and the number of triangles.
const HEADER: usize = 84;

/// Bytes per triangle in a binary file: normal, three corners, and two bytes that are not used here.
const FACET: usize = 50;

/// Reads an STL file.
pub(super) fn load(path: &Path, bytes: &[u8]) -> Result<Mesh, ImportError> {
    let mut assembly = Assembly::default();
    let mut soup = Soup::default();
    if is_text(bytes) {
        read_text(&String::from_utf8_lossy(bytes), &mut soup, &mut assembly)
    } else {
        read_binary(bytes, &mut soup, &mut assembly)
    }
    .map_err(|what| ImportError::malformed(path, what))?;
    assembly.mesh.materials.push(Material::default());
    assembly.append(path, &soup.part, None)?;
    Ok(assembly.finish())
}

/// Whether the file is text. Text begins with "solid", but so do the comments of some binary files. These have either the
/// exact length for their number of triangles, or bytes that never occur in text.
fn is_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    let solid = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let fits = declared(bytes).is_some_and(|count| HEADER + FACET * count == bytes.len());
    solid && !fits && !bytes[..bytes.len().min(1024)].contains(&0)
}

/// The number of triangles declared in the header of a binary file.
fn declared(bytes: &[u8]) -> Option<usize> {
    let four = bytes.get(HEADER - 4..HEADER)?;
    Some(u32::from_le_bytes(four.try_into().ok()?) as usize)
}

/// Triangles, and the numbers of their corners by position.
#[derive(Default)]
struct Soup {
    part: Part,
    by_place: HashMap<[u64; 3], u32>,
}

impl Soup {
    fn add(&mut self, corners: [[f64; 3]; 3]) -> Result<(), String> {
        if self.part.triangles.len() >= MAX_ELEMENTS || self.part.positions.len() >= MAX_ELEMENTS - 3 {
            return Err(format!("the mesh has more than {MAX_ELEMENTS} triangles or vertices"));
        }
        let triangle = corners.map(|p| {
            // Zero and minus zero are the same position.
            let place = p.map(|x| (x + 0.0).to_bits());
            let next = self.part.positions.len() as u32;
            let vertex = *self.by_place.entry(place).or_insert(next);
            if vertex == next {
                self.part.positions.push(p);
            }
            vertex
        });
        self.part.triangles.push(triangle);
        Ok(())
    }
}

fn read_binary(bytes: &[u8], soup: &mut Soup, assembly: &mut Assembly) -> Result<(), String> {
    let count = declared(bytes)
        .ok_or_else(|| format!("neither begins with 'solid' nor has the {HEADER} bytes of a binary header"))?;
    let facets = &bytes[HEADER..];
    let held = facets.len() / FACET;
    if held < count {
        return Err(format!("the header declares {count} triangles, but the file ends after {held}"));
    }
    if facets.len() > count * FACET {
        let more = facets.len() - count * FACET;
        assembly.warn(format!("{more} bytes after the {count} triangles that the header declares are not read"));
    }
    for (number, facet) in facets.as_chunks::<FACET>().0.iter().take(count).enumerate() {
        let float = |at: usize| f64::from(f32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]));
        let corners: [[f64; 3]; 3] = std::array::from_fn(|c| std::array::from_fn(|k| float(12 + 12 * c + 4 * k)));
        if let Some(c) = corners.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(format!("corner {c} of triangle {number} is not finite; repair or remove it"));
        }
        soup.add(corners)?;
    }
    Ok(())
}

fn read_text(text: &str, soup: &mut Soup, assembly: &mut Assembly) -> Result<(), String> {
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut facet = None;
    for (number, line) in text.lines().enumerate() {
        let number = number + 1;
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { continue };
        match key.to_ascii_lowercase().as_str() {
            "facet" => {
                if let Some(start) = facet.replace(number) {
                    return Err(format!("line {number}: a facet begins inside that of line {start}"));
                }
                corners.clear();
            }
            "vertex" => {
                if facet.is_none() {
                    return Err(format!("line {number}: a vertex outside of a facet"));
                }
                let numbers: Option<Vec<f64>> = words.take(3).map(|w| w.parse().ok()).collect();
                let Some(&[x, y, z]) = numbers.as_deref() else {
                    return Err(format!("line {number}: cannot read '{}' as a vertex", one_line(line)));
                };
                if ![x, y, z].iter().all(|v: &f64| v.is_finite()) {
                    return Err(format!("line {number}: the vertex is not finite; repair or remove it"));
                }
                corners.push([x, y, z]);
            }
            "endfacet" => {
                let Some(start) = facet.take() else {
                    return Err(format!("line {number}: a facet ends that has not begun"));
                };
                if corners.len() != 3 {
                    let found = corners.len();
                    return Err(format!("line {start}: the facet has {found} corners; it must have 3"));
                }
                soup.add([corners[0], corners[1], corners[2]])?;
            }
            "solid" | "endsolid" | "outer" | "endloop" | "color" => {}
            _ => assembly.warn(format!("line {number}: '{}' is no STL statement; it is ignored", one_line(key))),
        }
    }
    match facet {
        Some(start) => Err(format!("the file ends inside the facet of line {start}")),
        None => Ok(()),
    }
}
