//! The text of an OBJ file in the form that `tobj` reads correctly.
//!
//! Alone, `tobj` would misread or refuse: attributes of which only some faces have texture coordinates or normals, or only
//! some vertices colours (the arrays shift against the positions); continued lines; indices out of range; numbers like
//! `1.#IND`; colours with alpha. It splits all polygons into fans, which is right only for convex ones.

use std::collections::HashMap;
use std::fmt::Write;
use std::path::Path;

use glam::DVec3;

use super::error::{ImportError, one_line};
use super::loss::Loss;
use super::names::continued;
use super::numbers::{finite, finite_array, number};
use super::polygon::{Split, Splitter};

/// The text for `tobj`, and what `tobj` would not return.
#[derive(Debug, Default)]
pub(super) struct Prepared {
    pub(super) text: String,
    /// The values of the `mtllib` statements.
    pub(super) libraries: Vec<String>,
    /// Names of the materials used, in order of first use.
    pub(super) material_names: Vec<String>,
    /// Index of each name in `material_names`.
    material_numbers: HashMap<String, usize>,
    pub(super) warnings: Vec<String>,
    /// For each line of `text`, the number of the source line it came from and whether it holds a position.
    pub(super) lines: Vec<(u32, bool)>,
    /// Free-form curves and surfaces.
    pub(super) free_form: Loss,
    /// Points and lines.
    pub(super) thin: Loss,
    /// Number of vertices.
    pub(super) vertices: usize,
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

/// Calls `visit` with the line number, the keyword in lower case and the value of every statement. Lines that end with a
/// backslash are joined with the next one, if there is one. Comments are left out, but in names `#` is a character like any
/// other.
fn statements<E>(source: &str, mut visit: impl FnMut(u32, &str, &str) -> Result<(), E>) -> Result<(), E> {
    // The keyword of a statement that goes on in the next line, and what it has of its value. Empty if there is none.
    let (mut begun, mut so_far) = (String::new(), String::new());
    let mut last = 0;
    for (number, raw) in source.lines().enumerate() {
        let number = u32::try_from(number + 1).unwrap_or(u32::MAX);
        last = number;
        let line = raw.trim();
        if !begun.is_empty() {
            let name = is_name(&begun);
            let part = if name { line } else { without_comment(line).trim_end() };
            match continued(part, name) {
                Some(part) => so_far.extend([part, " "]),
                None => {
                    so_far.push_str(part);
                    visit(number, &begun, so_far.trim())?;
                    begun.clear();
                }
            }
            continue;
        }
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let lower;
        let key = if key.bytes().any(|b| b.is_ascii_uppercase()) {
            lower = key.to_ascii_lowercase();
            &lower
        } else {
            key
        };
        let name = is_name(key);
        let (key, value) = if name {
            (key, value.trim())
        } else {
            (key.split('#').next().unwrap_or(""), if key.contains('#') { "" } else { without_comment(value).trim() })
        };
        // A statement may consist of a keyword and the backslash.
        let bare = key.strip_suffix('\\').filter(|_| value.is_empty());
        if let Some((key, value)) = bare.map(|key| (key, "")).or(continued(value, name).map(|value| (key, value))) {
            begun.push_str(key);
            so_far.clear();
            so_far.extend([value, " "]);
        } else if !key.is_empty() {
            visit(number, key, value)?;
        }
    }
    if begun.is_empty() { Ok(()) } else { visit(last, &begun, so_far.trim()) }
}

/// Whether the value of a statement is a name.
fn is_name(key: &str) -> bool {
    matches!(key, "mtllib" | "usemtl")
}

/// What comes before a comment. The `#` in `1.#IND` and the like begins none.
fn without_comment(text: &str) -> &str {
    let number = |at: usize| {
        let word = text.get(at + 1..at + 4).unwrap_or("");
        text[..at].ends_with("1.") && ["ind", "inf", "qna", "sna"].iter().any(|n| word.eq_ignore_ascii_case(n))
    };
    text.match_indices('#').find(|(at, _)| !number(*at)).map_or(text, |(at, _)| &text[..at])
}

/// What the lists of a file contain, known before its faces are read.
#[derive(Debug, Default)]
struct Lists {
    /// NaN where a position cannot be read.
    positions: Vec<DVec3>,
    /// For each texture coordinate, whether it can be read and is finite.
    textures: Vec<bool>,
    normals: usize,
    /// The largest component of any vertex colour, if there is one.
    brightest: Option<f64>,
}

impl Lists {
    fn of(source: &str) -> Self {
        let mut lists = Self::default();
        let _ = statements(source, |_, key, value| {
            match key {
                "v" => {
                    let mut words = value.split_whitespace();
                    let mut coordinate = || words.next().and_then(number).unwrap_or(f64::NAN);
                    let position = DVec3::new(coordinate(), coordinate(), coordinate());
                    let more: Vec<&str> = words.take(4).collect();
                    let weight = match more.as_slice() {
                        [weight] => number(weight).unwrap_or(f64::NAN),
                        _ => 1.0,
                    };
                    if more.len() >= 3 {
                        let color = more[..3].iter().filter_map(|word| finite(word));
                        lists.brightest = Some(color.fold(lists.brightest.unwrap_or(0.0), f64::max));
                    }
                    lists.positions.push(if weight == 1.0 { position } else { position / weight });
                }
                "vt" => {
                    let mut words = value.split_whitespace();
                    let (u, v) = (words.next().and_then(finite), words.next().map_or(Some(0.0), finite));
                    lists.textures.push(u.is_some() && v.is_some());
                }
                "vn" => lists.normals += 1,
                _ => {}
            }
            Ok::<(), ()>(())
        });
        lists
    }

    fn counts(&self) -> [usize; 3] {
        [self.positions.len(), self.textures.len(), self.normals]
    }
}

const LISTS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// One corner of a face: indices into the three lists, from 1; 0 for none.
type Corner = [usize; 3];

/// What had to be dropped.
#[derive(Debug, Default)]
struct Losses {
    textures: Loss,
    normals: Loss,
    colors: Loss,
    extra: Loss,
    /// Indices of texture coordinates and of normals that are not in the lists.
    dangling: [Loss; 2],
    /// Faces of which only some corners have texture coordinates, or normals.
    mixed: [Loss; 2],
    crossing: Loss,
}

impl Losses {
    fn warnings(&self) -> impl Iterator<Item = String> {
        let Self { textures, normals, colors, extra, dangling, mixed, crossing } = self;
        let unreadable = "that cannot be read or is not finite";
        let unreadables = "that cannot be read or are not finite";
        [
            textures.warning(
                [&format!("texture coordinate {unreadable}"), &format!("texture coordinates {unreadables}")],
                "faces that use them have no texture coordinates",
            ),
            normals.warning(
                [&format!("normal {unreadable}"), &format!("normals {unreadables}")],
                "normals of the faces are used instead",
            ),
            colors.warning(
                [&format!("vertex colour {unreadable}"), &format!("vertex colours {unreadables}")],
                "white is used instead",
            ),
            extra.warning(
                ["vertex with two numbers after its position", "vertices with two numbers after their position"],
                "these numbers are neither a weight nor a colour and are ignored",
            ),
            dangling[0].warning(
                [
                    "index of a texture coordinate that does not exist",
                    "indices of texture coordinates that do not exist",
                ],
                "these faces have no texture coordinates",
            ),
            dangling[1].warning(
                ["index of a normal that does not exist", "indices of normals that do not exist"],
                "normals of the faces are used instead",
            ),
            mixed[0].warning(
                [
                    "face with texture coordinates at some corners only",
                    "faces with texture coordinates at some corners only",
                ],
                "they are left out",
            ),
            mixed[1].warning(
                ["face with normals at some corners only", "faces with normals at some corners only"],
                "they are left out",
            ),
            crossing.warning(
                ["polygon whose edges cross", "polygons whose edges cross"],
                "its triangles may not cover it as meant",
            ),
        ]
        .into_iter()
        .flatten()
    }
}

/// Brings the text of an OBJ file into the form that `tobj` reads correctly.
pub(super) fn prepare(path: &Path, source: &str) -> Result<Prepared, ImportError> {
    let lists = Lists::of(source);
    let mut prepared = Prepared::default();
    prepared.text.reserve(source.len() + source.len() / 8);
    let color_scale = match lists.brightest {
        Some(brightest) if brightest > 1.0 => {
            prepared.warnings.push(format!("vertex colours reach {brightest}: they are taken as 0 to 255, not 0 to 1"));
            Some(1.0 / 255.0)
        }
        Some(_) => Some(1.0),
        None => None,
    };
    // `tobj` keeps a material only if a library defines it. `obj` answers this line with a library of all numbers.
    prepared.line(0, false, format_args!("mtllib numbers"));
    let mut losses = Losses::default();
    let mut counts = [0usize; 3];
    let mut splitter = Splitter::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut places: Vec<DVec3> = Vec::new();
    let mut shape = None;
    statements(source, |line, key, value| {
        match key {
            "v" => {
                let position = lists.positions[counts[0]];
                counts[0] += 1;
                write_position(&mut prepared, line, value, position, color_scale, &mut losses);
            }
            "vt" => {
                counts[1] += 1;
                write_texture(&mut prepared, line, value, lists.textures[counts[1] - 1], &mut losses);
            }
            "vn" => {
                counts[2] += 1;
                if finite_array::<3>(value).is_none() {
                    losses.normals.add(|| format!("line {line}"));
                    prepared.line(line, false, format_args!("vn 0 0 0"));
                } else if value.split_whitespace().take(3).all(|word| word.parse::<f64>().is_ok()) {
                    prepared.line(line, false, format_args!("vn {value}"));
                } else if let Some([x, y, z]) = finite_array(value) {
                    prepared.line(line, false, format_args!("vn {x} {y} {z}"));
                }
            }
            "f" | "fo" => {
                let kept = read_face(value, counts, &lists, line, &mut losses, &mut corners)
                    .map_err(|what| ImportError::malformed(path, format!("line {line}: {what}")))?;
                if corners.len() < 3 {
                    prepared.thin.add(|| format!("line {line}"));
                    return Ok(());
                }
                let attributes = corners[0].map(|index| index != 0);
                // A new group makes `tobj` start a new model. So all faces of a model have the same attributes.
                if shape.replace(attributes).is_some_and(|last| last != attributes) {
                    prepared.line(line, false, format_args!("g"));
                }
                places.clear();
                places.extend(corners.iter().map(|corner| lists.positions[corner[0] - 1]));
                let split = splitter.split(&places);
                if matches!(split, Split::Crossing(_)) {
                    losses.crossing.add(|| format!("line {line}"));
                }
                match split {
                    Split::Fan if kept => prepared.line(line, false, format_args!("f {value}")),
                    Split::Fan => write_face(&mut prepared, line, corners.iter()),
                    Split::Triangles(triangles) | Split::Crossing(triangles) => {
                        for triangle in triangles {
                            write_face(&mut prepared, line, triangle.iter().map(|&k| &corners[k as usize]));
                        }
                    }
                }
            }
            "p" | "l" => prepared.thin.add(|| format!("line {line}")),
            "mtllib" => prepared.libraries.push(value.to_owned()),
            "usemtl" => {
                let index = prepared.material_number(value);
                // Materials are renamed to numbers, so that any name is accepted, even an empty one.
                prepared.line(line, false, format_args!("usemtl {index}"));
            }
            "curv" | "curv2" | "surf" | "bsp" | "bzp" | "cdc" | "cdp" => {
                prepared.free_form.add(|| format!("line {line}: '{key}'"));
            }
            _ => {}
        }
        Ok(())
    })?;
    prepared.warnings.extend(losses.warnings());
    prepared.vertices = lists.positions.len();
    prepared.warnings.extend(prepared.thin.warning(["point or line", "points and lines"], "only polygons are read"));
    let what = ["free-form curve or surface", "free-form curves and surfaces"];
    prepared.warnings.extend(prepared.free_form.warning(what, "only polygons are read"));
    Ok(prepared)
}

/// Writes a vertex. `color_scale` is the factor of colours, if any vertex of the file has one; then those without are white.
fn write_position(
    prepared: &mut Prepared,
    line: u32,
    value: &str,
    position: DVec3,
    color_scale: Option<f64>,
    losses: &mut Losses,
) {
    let mut words = [""; 8];
    let mut count = 0;
    for (to, word) in words.iter_mut().zip(value.split_whitespace()) {
        *to = word;
        count += 1;
    }
    let plain = words[..count.min(4)].iter().all(|word| word.parse::<f64>().is_ok());
    // `tobj` names what is wrong with these.
    let refused = count < 3
        || words[..3].iter().any(|word| number(word).is_none())
        || (count == 4 && words[3].parse() == Ok(0.0));
    if refused || (plain && count <= 4 && color_scale.is_none()) {
        return prepared.line(line, true, format_args!("v {value}"));
    }
    if count == 5 {
        losses.extra.add(|| format!("line {line}"));
    }
    let color = color_scale.map(|scale| match count {
        ..6 => [1.0; 3],
        _ => match [finite(words[3]), finite(words[4]), finite(words[5])] {
            [Some(r), Some(g), Some(b)] => [r, g, b].map(|x| x * scale),
            _ => {
                losses.colors.add(|| format!("line {line}"));
                [1.0; 3]
            }
        },
    });
    let DVec3 { x, y, z } = position;
    match color {
        Some([r, g, b]) => prepared.line(line, true, format_args!("v {x} {y} {z} {r} {g} {b}")),
        None => prepared.line(line, true, format_args!("v {x} {y} {z}")),
    }
}

fn write_texture(prepared: &mut Prepared, line: u32, value: &str, usable: bool, losses: &mut Losses) {
    if !usable {
        losses.textures.add(|| format!("line {line}"));
        return prepared.line(line, false, format_args!("vt 0 0"));
    }
    let mut words = value.split_whitespace();
    let (u, v) = (words.next().unwrap_or("0"), words.next());
    // One-dimensional coordinates are valid, but `tobj` requires two numbers.
    match (u.parse::<f64>(), v.map(str::parse::<f64>)) {
        (Ok(_), None) => prepared.line(line, false, format_args!("vt {u} 0")),
        (Ok(_), Some(Ok(_))) => prepared.line(line, false, format_args!("vt {u} {}", v.unwrap_or("0"))),
        _ => {
            let [u, v] = [u, v.unwrap_or("0")].map(|word| finite(word).unwrap_or(0.0));
            prepared.line(line, false, format_args!("vt {u} {v}"));
        }
    }
}

fn write_face<'a>(prepared: &mut Prepared, line: u32, corners: impl Iterator<Item = &'a Corner>) {
    let mut text = String::from("f");
    for corner in corners {
        let _ = match corner {
            [v, 0, 0] => write!(text, " {v}"),
            [v, t, 0] => write!(text, " {v}/{t}"),
            [v, 0, n] => write!(text, " {v}//{n}"),
            [v, t, n] => write!(text, " {v}/{t}/{n}"),
        };
    }
    prepared.line(line, false, format_args!("{text}"));
}

/// Reads the corners of a face into `corners`; all of them then have the same attributes. Negative indices count back from
/// the elements read so far. Whether the text says the same as `corners`: nothing was dropped.
///
/// Fails for corners that cannot be read, and for positions that do not exist. Texture coordinates and normals that do not
/// exist, or that only some corners have, are dropped.
fn read_face(
    value: &str,
    counts: [usize; 3],
    lists: &Lists,
    line: u32,
    losses: &mut Losses,
    corners: &mut Vec<Corner>,
) -> Result<bool, String> {
    let all = lists.counts();
    let mut kept = true;
    corners.clear();
    for word in value.split_whitespace() {
        let unreadable = || format!("cannot read the face corner '{}'", one_line(word));
        let mut parts = word.split('/');
        let mut corner = [0; 3];
        for list in 0..3 {
            let Some(text) = parts.next() else { break };
            if text.is_empty() && list > 0 {
                continue;
            }
            let index = text.parse::<i64>().ok();
            let absolute = index.map(|i| if i < 0 { counts[list] as i64 + i.max(-i64::MAX) + 1 } else { i });
            match (index, absolute) {
                (_, Some(absolute)) if absolute >= 1 && absolute as usize <= all[list] => {
                    corner[list] = absolute as usize
                }
                (Some(index), Some(absolute)) if list == 0 => {
                    let so_far = if absolute < 1 { " so far" } else { "" };
                    let count = if absolute < 1 { counts[0] } else { all[0] };
                    return Err(format!("a face refers to {} {index}, but there are only {count}{so_far}", LISTS[0]));
                }
                _ if list == 0 => return Err(unreadable()),
                _ => {
                    let count = all[list];
                    losses.dangling[list - 1]
                        .add(|| format!("line {line}: {} {} of {count}", LISTS[list], one_line(text)));
                    kept = false;
                }
            }
        }
        if parts.next().is_some() {
            return Err(unreadable());
        }
        // The statement of an unusable texture coordinate has been reported.
        if corner[1] > 0 && !lists.textures[corner[1] - 1] {
            (corner[1], kept) = (0, false);
        }
        corners.push(corner);
    }
    // Where an index was dropped, that has been reported.
    let reported = !kept;
    for list in 1..3 {
        let with = corners.iter().filter(|corner| corner[list] != 0).count();
        if with > 0 && with < corners.len() {
            if !reported {
                losses.mixed[list - 1].add(|| format!("line {line}"));
            }
            kept = false;
            corners.iter_mut().for_each(|corner| corner[list] = 0);
        }
    }
    Ok(kept)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(source: &str) -> String {
        prepare(Path::new("a.obj"), source).unwrap().text.replace("mtllib numbers\n", "")
    }

    #[test]
    fn what_tobj_reads_correctly_is_left_alone() {
        let source = "v 0 0 0\nv 1 0 0\nv 1 1 0 2\nv 0 1 0\nvt 0.5 1\nvn 0 0 1\nf 1/1/1 2/1/1 -2/-1/-1\nf 1 2 3 4\n";
        assert_eq!(text(source), source.replace("f 1 2", "g\nf 1 2"));
    }

    #[test]
    fn statements_are_joined_and_cut_at_comments() {
        let mut found = Vec::new();
        let source = "V 1 \\\n 2 \\\n# no\n3\nf#x y\nusemtl a #1\nmtllib\\\n a\\b\\\n# x \\\nvn 1 2 3#4\nvn -1.#IND00 1.#qnan 1.#9\n";
        let _ = statements(source, |line, key, value| {
            found.push(format!("{line} {key} {value}"));
            Ok::<(), ()>(())
        });
        assert_eq!(
            found,
            [
                "3 v 1  2",
                "4 3 ",
                "5 f ",
                "6 usemtl a #1",
                "8 mtllib a\\b\\",
                "10 vn 1 2 3",
                "11 vn -1.#IND00 1.#qnan 1."
            ]
        );
    }

    #[test]
    fn the_end_of_the_text_ends_a_statement() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        for face in ["f 1 2 3", "f 1 2 3 \\", "f 1 \\\n2 3\\\n", "f\\\n1 2 3 \\\n\n", "\\\nf 1 2 3"] {
            let text = text(&format!("{vertices}{face}"));
            let words: Vec<&str> = text.split_whitespace().collect();
            assert!(words.ends_with(&["f", "1", "2", "3"]), "{face}: {text}");
        }
    }

    #[test]
    fn joining_lines_takes_time_in_proportion_to_their_length() {
        // A statement of 2 MB in 100,000 lines.
        let source = format!("g a \\\n{}\n", "bbbbbbbbbbbbbbbbbb \\\n".repeat(100_000));
        let start = std::time::Instant::now();
        assert_eq!(text(&source), "");
        assert!(start.elapsed() < std::time::Duration::from_secs(5), "{:?}", start.elapsed());
    }

    #[test]
    fn concave_faces_are_split_and_keep_their_attributes() {
        let notched = "v 0 0 0\nv 1 1 0\nv 0 3 0\nv 3 1 0\nvt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\nf 1/1 2/2 3/3 4/4\n";
        let text = text(notched);
        let faces: Vec<&str> = text.lines().filter(|line| line.starts_with('f')).collect();
        assert_eq!(faces.len(), 2);
        assert!(faces.iter().all(|f| f.contains("2/2") && f.contains("4/4")), "{faces:?}");
    }
}
