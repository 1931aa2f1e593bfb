//! STL, text and binary. Parsed here, because the available libraries take a binary file whose header begins with "solid"
//! for text, stop at the first of several solids, and round the coordinates of text to single precision.
//!
//! The normals of the facets are not used: the winding of the corners gives the same normal and is more often right. Corners
//! at the same position become one vertex.

use std::collections::HashMap;
use std::io::{self, Read};
use std::path::Path;
use std::str::Lines;

use esvo_format::srgb::decode_f64 as srgb_to_linear;

use super::assembly::{Assembly, Part};
use super::error::{ImportError, one_line};
use super::file::text_of;
use super::loss::Loss;
use super::numbers::number;
use crate::mesh::MAX_ELEMENTS;
use crate::mesh::{Material, Mesh};

/// Bytes before the triangles of a binary file: a comment, and the number of triangles.
pub(super) const HEADER: usize = 84;

/// Bytes per triangle in a binary file: normal, three corners, and two bytes in which some programs write a colour.
pub(super) const FACET: usize = 50;

/// Reads an STL file whose first bytes are `head`, at least [`HEAD`] of them or all, followed by those of `rest`; together `length`
/// bytes. A binary file is not held in memory.
pub(super) fn load(path: &Path, head: &[u8], rest: impl Read, length: u64) -> Result<Mesh, ImportError> {
    let failed = |source| ImportError::Read { path: path.into(), source };
    let mut assembly = Assembly::default();
    let mut soup = Soup::default();
    let mut all = head.chain(rest);
    if is_text(head, length) {
        let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
        all.read_to_end(&mut bytes).map_err(failed)?;
        read_text(&text_of(&bytes), &mut soup, &mut assembly)
    } else {
        read_binary(head, &mut all, length, &mut soup, &mut assembly).map_err(failed)?
    }
    .map_err(|what| ImportError::malformed(path, what))?;
    // Nothing asks for them any more, and what follows needs memory, too.
    soup.by_place = HashMap::new();
    let materials = (!soup.colors.is_empty()).then(|| (soup.materials(), std::mem::take(&mut soup.triangle_colors)));
    assembly.append_all(path, soup.part)?;
    match materials {
        None => assembly.mesh.materials.push(Material::default()),
        Some((materials, of_triangles)) => {
            assembly.mesh.materials = materials;
            assembly.mesh.triangle_materials = of_triangles;
        }
    }
    Ok(assembly.finish())
}

/// Bytes that tell whether a file is text.
pub(super) const HEAD: usize = 1024;

/// Whether the file is text. Text begins with "solid", but so do the comments of some binary files. These have either the
/// exact length for their number of triangles, or bytes that never occur in text. Without "solid", text has facets.
pub(super) fn is_text(bytes: &[u8], length: u64) -> bool {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return true;
    }
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    let begins = |word: &[u8]| start.get(..word.len()).is_some_and(|s| s.eq_ignore_ascii_case(word));
    let fits = declared(bytes).is_some_and(|count| (HEADER + FACET * count) as u64 == length);
    (begins(b"solid") || begins(b"facet")) && !fits && !bytes[..bytes.len().min(HEAD)].contains(&0)
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
    /// The index of the material of each colour; `None` is the plain colour. Empty if no facet has a colour.
    colors: HashMap<Option<Rgb>, u32>,
    /// The material of each triangle, if there are colours.
    triangle_colors: Vec<u32>,
}

/// Red, green and blue as stored, and the value that stands for 1: 31 for the colour of a facet, 255 for that of the whole
/// object in the header of Materialise Magics.
type Rgb = ([u8; 3], u8);

impl Soup {
    /// Gives the triangles from `first` on a colour. Those before keep theirs; the plain one, if there was none yet.
    fn color(&mut self, first: usize, color: Option<Rgb>) {
        if color.is_none() && self.colors.is_empty() {
            return;
        }
        if self.colors.is_empty() && first > 0 {
            self.colors.insert(None, 0);
            self.triangle_colors.resize(first, 0);
        }
        let next = self.colors.len() as u32;
        let index = *self.colors.entry(color).or_insert(next);
        self.triangle_colors.resize(self.part.triangles.len(), index);
    }

    /// The materials of all colours.
    fn materials(&self) -> Vec<Material> {
        let mut materials = vec![Material::default(); self.colors.len()];
        for (color, &index) in &self.colors {
            if let Some((rgb, one)) = color {
                let [r, g, b] = rgb.map(|x| srgb_to_linear(f64::from(x) / f64::from(*one)) as f32);
                let name = format!("colour {} {} {} of {one}", rgb[0], rgb[1], rgb[2]);
                materials[index as usize] = Material { name, base_color: [r, g, b, 1.0], ..Material::default() };
            }
        }
        materials
    }

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

/// Reads the facets of a binary file. `all` begins with the header, which is in `head`, too. The outer error is one of reading, the
/// inner one says what is wrong with the content.
fn read_binary(
    head: &[u8],
    all: &mut impl Read,
    length: u64,
    soup: &mut Soup,
    assembly: &mut Assembly,
) -> io::Result<Result<(), String>> {
    let Some(declared) = declared(head) else {
        return Ok(Err(format!("neither begins with 'solid' nor has the {HEADER} bytes of a binary header")));
    };
    let facets = length.saturating_sub(HEADER as u64);
    let held = usize::try_from(facets / FACET as u64).unwrap_or(usize::MAX);
    // Programs that do not know the number when they write the header leave blanks, 0 or -1 there.
    let unknown = matches!(declared as u32, 0 | 0x2020_2020 | u32::MAX) && held > 0;
    if unknown {
        assembly.warn(format!(
            "the header declares {declared} triangles, which stands for an unknown number; the file holds {held}, which are read"
        ));
    }
    let count = if unknown { held } else { declared };
    if held < count {
        return Ok(Err(format!("the header declares {count} triangles, but the file ends after {held}")));
    }
    let more = facets - (count * FACET) as u64;
    if more > 0 {
        let declared = if unknown { "that fit into the file" } else { "that the header declares" };
        assembly.warn(format!("{more} bytes after the {count} triangles {declared} are not read"));
    }
    soup.part.triangles.reserve_exact(count.min(MAX_ELEMENTS));
    let colors = Colors::of(&head[..HEADER - 4]);
    all.read_exact(&mut [0; HEADER])?;
    let mut bytes = vec![0; FACET << 12];
    let mut number = 0;
    while number < count {
        let some = &mut bytes[..FACET * (count - number).min(1 << 12)];
        all.read_exact(some)?;
        for facet in some.as_chunks::<FACET>().0 {
            if let Err(what) = read_facet(facet, number, &colors, soup) {
                return Ok(Err(what));
            }
            number += 1;
        }
    }
    Ok(Ok(()))
}

fn read_facet(facet: &[u8; FACET], number: usize, colors: &Colors, soup: &mut Soup) -> Result<(), String> {
    let float = |at: usize| f64::from(f32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]));
    let corners: [[f64; 3]; 3] = std::array::from_fn(|c| std::array::from_fn(|k| float(12 + 12 * c + 4 * k)));
    if let Some(c) = corners.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(format!("corner {c} of triangle {number} is not finite; repair or remove it"));
    }
    soup.add(corners)?;
    soup.color(number, colors.of_facet(u16::from_le_bytes([facet[48], facet[49]])));
    Ok(())
}

/// How colours of facets are written in the last two bytes of each.
enum Colors {
    /// VisCAM, SolidView and others: blue, green, red from the lowest bit on, and the highest bit set if there is a colour.
    OfFacets,
    /// Materialise Magics: red, green, blue from the lowest bit on, and the highest bit set if the facet has the colour of
    /// the whole object, which is in the header.
    WithDefault([u8; 3]),
}

impl Colors {
    /// By the header: Magics writes `COLOR=` and four bytes there.
    fn of(header: &[u8]) -> Self {
        const KEY: &[u8] = b"COLOR=";
        let found = header.windows(KEY.len() + 4).find(|w| w.starts_with(KEY));
        found.map_or(Self::OfFacets, |w| Self::WithDefault([w[KEY.len()], w[KEY.len() + 1], w[KEY.len() + 2]]))
    }

    fn of_facet(&self, word: u16) -> Option<Rgb> {
        let five = |shift: u32| (word >> shift & 31) as u8;
        let flagged = word >> 15 != 0;
        match self {
            Self::OfFacets => flagged.then(|| ([five(10), five(5), five(0)], 31)),
            Self::WithDefault(color) if flagged => Some((*color, 255)),
            Self::WithDefault(_) => Some(([five(0), five(5), five(10)], 31)),
        }
    }
}

/// Reads facets from text. Line ends mean no more than blanks, and words may be in any case.
fn read_text(text: &str, soup: &mut Soup, assembly: &mut Assembly) -> Result<(), String> {
    let mut corners: Vec<[f64; 3]> = Vec::new();
    // The line where the facet begins.
    let mut facet = None;
    let mut words = Words::new(text);
    let mut colors = Loss::default();
    while let Some((number, word)) = words.next() {
        let mut key = word.to_ascii_lowercase();
        if key == "end" {
            // `end facet` is `endfacet`.
            key.extend(words.next().map(|(_, word)| word.to_ascii_lowercase()));
        }
        match key.as_str() {
            // The name of a solid may be any text, up to the end of the line or, if all is in one line, the first facet.
            "solid" | "endsolid" => words.skip_name(),
            "facet" => {
                if let Some(start) = facet.replace(number) {
                    return Err(format!("line {number}: a facet begins inside that of line {start}"));
                }
                corners.clear();
            }
            "normal" => words.skip_numbers(),
            "vertex" => {
                if facet.is_none() {
                    return Err(format!("line {number}: a vertex outside of a facet"));
                }
                // Shortened only for the error: the line may be the whole file.
                let line = words.line;
                let unreadable = || format!("line {number}: cannot read '{}' as a vertex", one_line(line));
                let mut corner = [0.0; 3];
                for x in &mut corner {
                    let (_, word) = words.next().ok_or_else(unreadable)?;
                    *x = self::number(word).ok_or_else(unreadable)?;
                }
                if !corner.iter().all(|x| x.is_finite()) {
                    return Err(format!("line {number}: the vertex is not finite; repair or remove it"));
                }
                corners.push(corner);
                words.skip_numbers();
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
            "outer" | "loop" | "endloop" => {}
            "color" => {
                colors.add(|| format!("line {number}"));
                words.skip_numbers();
            }
            // A name without a blank before it.
            _ if key.starts_with("endsolid") || key.starts_with("solid") => words.skip_name(),
            _ => assembly.warn(format!("line {number}: '{}' is no STL statement; it is ignored", one_line(word))),
        }
    }
    let what = ["colour in an STL text", "colours in an STL text"];
    colors.warning(what, "colours are read from binary files only").into_iter().for_each(|line| assembly.warn(line));
    match facet {
        Some(start) => Err(format!("the file ends inside the facet of line {start}")),
        None => Ok(()),
    }
}

/// The words of a text with the numbers of their lines.
struct Words<'a> {
    lines: Lines<'a>,
    number: usize,
    /// The current line.
    line: &'a str,
    /// What is left of the line.
    rest: &'a str,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Self { lines: text.lines(), number: 0, line: "", rest: "" }
    }

    fn next(&mut self) -> Option<(usize, &'a str)> {
        while self.rest.trim_start().is_empty() {
            self.line = self.lines.next()?;
            self.rest = self.line;
            self.number += 1;
        }
        let rest = self.rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        self.rest = &rest[end..];
        Some((self.number, &rest[..end]))
    }

    /// Skips a name: the rest of the line up to `facet normal`, in any case.
    fn skip_name(&mut self) {
        const FACET: &[u8] = b"facet";
        let begins = |text: &str, word: &[u8]| {
            text.as_bytes().get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word))
        };
        let rest = self.rest;
        let starts = |&at: &usize| {
            let after = rest[at + FACET.len()..].trim_start();
            rest[..at].ends_with(char::is_whitespace) && begins(after, b"normal")
        };
        let words = rest.as_bytes().windows(FACET.len()).enumerate();
        let mut facets = words.filter(|(_, word)| word.eq_ignore_ascii_case(FACET)).map(|(at, _)| at);
        self.rest = facets.find(starts).map_or("", |at| &rest[at..]);
    }

    /// Skips up to three words of the line that are numbers.
    fn skip_numbers(&mut self) {
        for _ in 0..3 {
            let rest = self.rest.trim_start();
            let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
            if self::number(&rest[..end]).is_none() {
                return;
            }
            self.rest = &rest[end..];
        }
    }
}
