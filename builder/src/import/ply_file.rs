//! The syntax of PLY files: header and values, in ASCII and in binary of both byte orders.
//!
//! Parsed here, because the available libraries refuse blank lines, lines that end with CR alone, and numbers like `.5`, `5.`
//! and `nan`.

use std::str::{Lines, SplitWhitespace};

use super::error::one_line;
use super::loss::Loss;
use super::numbers::number;

/// How the values after the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// A number in text; NaN if it cannot be read. Single precision is rounded once.
    fn parse(self, word: &str) -> f64 {
        match (self, word.parse::<f32>()) {
            (Self::F32, Ok(x)) => f64::from(x),
            (Self::F32, Err(_)) => number(word).map_or(f64::NAN, |x| f64::from(x as f32)),
            _ => number(word).unwrap_or(f64::NAN),
        }
    }
}

/// A property of an element: a number, or a list of numbers with the type of its length.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) of: Type,
    pub(super) length: Option<Type>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The place of a property that is a number.
    pub(super) fn scalar(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name && p.length.is_none())
    }

    /// The places of the properties of the first set that is there as a whole.
    pub(super) fn scalars<const N: usize>(&self, sets: &[[&str; N]]) -> Option<[usize; N]> {
        sets.iter().find_map(|names| {
            let mut places = [0; N];
            for (place, name) in places.iter_mut().zip(names) {
                *place = self.scalar(name)?;
            }
            Some(places)
        })
    }

    /// The place of a list by any of its names.
    pub(super) fn list(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&&*p.name) && p.length.is_some())
    }
}

#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) comments: Vec<String>,
    pub(super) elements: Vec<Element>,
    /// Number of lines.
    lines: usize,
}

/// Reads the header and returns it with the bytes that follow.
pub(super) fn read_header(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    let mut rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // Where lines end with CR alone, an LF after the last one belongs to the values.
    let end = rest.iter().position(|b| matches!(b, b'\n' | b'\r'));
    let cr_alone = end.is_some_and(|at| rest[at] == b'\r' && rest.get(at + 1) != Some(&b'\n'));
    let mut header = Header { encoding: Encoding::Ascii, comments: Vec::new(), elements: Vec::new(), lines: 0 };
    let mut encoding = None;
    loop {
        if rest.is_empty() {
            return Err(format!("line {}: the file ends within its header", header.lines + 1));
        }
        header.lines += 1;
        let end = if cr_alone { b'\r' } else { b'\n' };
        let length = rest.iter().position(|b| *b == end).unwrap_or(rest.len());
        let line = String::from_utf8_lossy(&rest[..length]);
        rest = rest.get(length + 1..).unwrap_or_default();
        let line = line.trim();
        let number = header.lines;
        let unreadable = || format!("line {number}: cannot read '{}' in the header", one_line(line));
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let words: Vec<&str> = value.split_whitespace().collect();
        match (key.to_ascii_lowercase().as_str(), words.as_slice()) {
            ("", _) | ("obj_info", _) => {}
            ("ply", _) if number == 1 => {}
            ("comment", _) => header.comments.push(value.trim().to_owned()),
            ("format", [name, ..]) => {
                encoding = Some(match *name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(unreadable()),
                });
            }
            ("element", [name, count]) => {
                let count = count.parse().map_err(|_| unreadable())?;
                header.elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
            }
            ("property", words) => {
                let (name, of, length) = match words {
                    ["list", length, of, name] => (name, Type::of(of), Some(Type::of(length).ok_or_else(unreadable)?)),
                    [of, name] => (name, Type::of(of), None),
                    _ => return Err(unreadable()),
                };
                let property = Property { name: (*name).into(), of: of.ok_or_else(unreadable)?, length };
                header.elements.last_mut().ok_or_else(unreadable)?.properties.push(property);
            }
            ("end_header", _) => break,
            _ => return Err(unreadable()),
        }
    }
    header.encoding = encoding.ok_or("the header names no format")?;
    Ok((header, rest))
}

/// One element: a number or a list for each property.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// The numbers, or the lengths of the lists.
    pub(super) scalars: Vec<f64>,
    /// The entries of all lists, one after the other.
    entries: Vec<f64>,
    /// For each property, where its list ends in `entries`.
    ends: Vec<usize>,
}

impl Row {
    /// The list of the property at `place`; empty for a number.
    pub(super) fn list(&self, place: usize) -> &[f64] {
        let start = if place == 0 { 0 } else { self.ends[place - 1] };
        &self.entries[start..self.ends[place]]
    }

    fn clear(&mut self) {
        self.scalars.clear();
        self.entries.clear();
        self.ends.clear();
    }
}

/// The values that follow the header, read in order.
pub(super) enum Values<'a> {
    Text(TextValues<'a>),
    Binary { rest: &'a [u8], big_endian: bool },
}

/// The words of an ASCII file. Every element begins on a new line, and may go on in the next ones; blank lines are skipped.
pub(super) struct TextValues<'a> {
    lines: Lines<'a>,
    words: SplitWhitespace<'a>,
    line: usize,
    /// Lines with more values than their element has.
    pub(super) longer: Loss,
}

impl<'a> Values<'a> {
    pub(super) fn text(header: &Header, text: &'a str) -> Self {
        let words = "".split_whitespace();
        Self::Text(TextValues { lines: text.lines(), words, line: header.lines, longer: Loss::default() })
    }

    pub(super) fn binary(header: &Header, rest: &'a [u8]) -> Self {
        Self::Binary { rest, big_endian: header.encoding == Encoding::BigEndian }
    }

    /// Reads the next element into `row`. Fails where the file ends.
    pub(super) fn read(&mut self, element: &Element, number: usize, row: &mut Row) -> Result<(), String> {
        row.clear();
        for property in &element.properties {
            let missing = |place: String| {
                let Element { name, count, .. } = element;
                format!("{place}the file ends within {name} {number}, but the header declares {count}")
            };
            let Some(length) = self.number(property.length.unwrap_or(property.of)) else {
                return Err(missing(self.place()));
            };
            row.scalars.push(length);
            if property.length.is_some() {
                // A negative length is none; NaN is 0.
                for _ in 0..length as u64 {
                    let Some(entry) = self.number(property.of) else { return Err(missing(self.place())) };
                    row.entries.push(entry);
                }
            }
            row.ends.push(row.entries.len());
        }
        if let Self::Text(text) = self
            && text.words.next().is_some()
        {
            let line = text.line;
            text.longer.add(|| format!("line {line}"));
            text.words = "".split_whitespace();
        }
        Ok(())
    }

    /// The place for a message.
    fn place(&self) -> String {
        match self {
            Self::Text(text) => format!("line {}: ", text.line),
            Self::Binary { .. } => String::new(),
        }
    }

    fn number(&mut self, of: Type) -> Option<f64> {
        match self {
            Self::Text(text) => Some(of.parse(text.word()?)),
            Self::Binary { rest, big_endian } => {
                let (taken, after) = rest.split_at_checked(of.bytes())?;
                *rest = after;
                let mut bytes = [0; 8];
                let bytes = &mut bytes[..taken.len()];
                bytes.copy_from_slice(taken);
                if *big_endian {
                    bytes.reverse();
                }
                let word = bytes.iter().rev().fold(0u64, |word, byte| word << 8 | u64::from(*byte));
                Some(match of {
                    Type::I8 => f64::from(word as i8),
                    Type::U8 => f64::from(word as u8),
                    Type::I16 => f64::from(word as i16),
                    Type::U16 => f64::from(word as u16),
                    Type::I32 => f64::from(word as i32),
                    Type::U32 => f64::from(word as u32),
                    Type::F32 => f64::from(f32::from_bits(word as u32)),
                    Type::F64 => f64::from_bits(word),
                })
            }
        }
    }
}

impl<'a> TextValues<'a> {
    fn word(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next() {
                return Some(word);
            }
            self.words = self.lines.next()?.split_whitespace();
            self.line += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_all_line_ends_are_read() {
        let unix = "ply\nformat binary_little_endian 1.0\n\ncomment a  b\nobj_info x\nelement v 2\nproperty float x\n\
                    property list uint8 int l\nend_header\n";
        for text in [unix.to_owned(), unix.replace('\n', "\r\n"), unix.replace('\n', "\r"), format!("\u{feff}{unix}")] {
            let bytes = [text.as_bytes(), b"\n\x01"].concat();
            let (header, rest) = read_header(&bytes).unwrap();
            assert_eq!((header.encoding, rest), (Encoding::LittleEndian, &b"\n\x01"[..]), "{text:?}");
            assert_eq!((header.comments, header.lines), (vec!["a  b".to_owned()], 9));
            let [element] = &header.elements[..] else { panic!() };
            assert_eq!((element.scalar("x"), element.list(&["l"]), element.scalar("l")), (Some(0), Some(1), None));
        }
    }

    #[test]
    fn headers_that_cannot_be_read_are_named() {
        let error = |text: &str| read_header(text.as_bytes()).unwrap_err();
        assert_eq!(error("ply\nend_header\n"), "the header names no format");
        assert_eq!(error("ply\nformat ascii 1.0\n"), "line 3: the file ends within its header");
        for bad in ["format text 1.0", "element x", "element x -1", "property float y", "what", "property"] {
            assert_eq!(error(&format!("ply\n{bad}\n")), format!("line 2: cannot read '{bad}' in the header"));
        }
        assert_eq!(error("ply\nelement a 1\nproperty half x\n"), "line 3: cannot read 'property half x' in the header");
    }

    #[test]
    fn text_may_be_broken_into_lines_anyhow() {
        let header = "ply\nformat ascii 1.0\nelement v 3\nproperty float x\nproperty list uchar int l\nend_header\n";
        let (header, _) = read_header(header.as_bytes()).unwrap();
        let mut values = Values::text(&header, "\n\n.5 2 1\n\n2\n5. 0 7 7\n\tnan\t1 3");
        let mut row = Row::default();
        let mut next = |number| {
            values.read(&header.elements[0], number, &mut row).map(|()| (row.scalars[0], row.list(1).to_vec()))
        };
        assert_eq!(next(0).unwrap(), (0.5, vec![1.0, 2.0]));
        assert_eq!(next(1).unwrap(), (5.0, vec![]));
        let (x, list) = next(2).unwrap();
        assert!(x.is_nan() && list == [3.0]);
        assert_eq!(next(3).unwrap_err(), "line 13: the file ends within v 3, but the header declares 3");
        let Values::Text(text) = values else { panic!() };
        assert_eq!(text.longer.warning(["a", "b"], "c").unwrap(), "line 12: 1 a; c");
    }
}
