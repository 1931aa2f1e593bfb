//! Texture statements of material libraries: options and a file name.

use super::image::Channel;
use super::numbers::number;
use crate::mesh::Wrap;
use crate::mesh::maps::UvTransform;

/// A texture statement.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MapStatement {
    /// The name as written, without quotes.
    pub(super) file: String,
    /// `-bm`: factor for bumps.
    pub(super) bump_factor: f64,
    /// `-mm`: the value that 0 stands for, and the factor for values.
    pub(super) base: f64,
    pub(super) gain: f64,
    /// `-imfchan`
    pub(super) channel: Option<Channel>,
    /// `-s`: factors of the texture coordinates.
    scale: [f64; 2],
    /// `-o`: added to the texture coordinates after `-s`.
    offset: [f64; 2],
    /// `-clamp on`
    clamp: bool,
    /// Whether `-t` asks for turbulence, which is not applied.
    pub(super) turbulent: bool,
}

impl MapStatement {
    /// How the image is read outside of 0..=1.
    pub(super) fn wrap(&self) -> [Wrap; 2] {
        [if self.clamp { Wrap::Clamp } else { Wrap::Repeat }; 2]
    }

    /// From the texture coordinates of the mesh (`v` downwards) to those of the image. In the file, `v` points up.
    pub(super) fn uv_transform(&self) -> UvTransform {
        let ([su, sv], [ou, ov]) = (self.scale, self.offset);
        if (self.scale, self.offset) == ([1.0; 2], [0.0; 2]) {
            return UvTransform::IDENTITY;
        }
        UvTransform { rows: [[su as f32, 0.0, ou as f32], [0.0, sv as f32, (1.0 - sv - ov) as f32]] }
    }
}

/// Reads options and a file name, which may be quoted and may contain blanks. Options may also follow the name. `None` if
/// there is no file name.
pub(super) fn map_statement(value: &str) -> Option<MapStatement> {
    let mut map = MapStatement {
        file: String::new(),
        bump_factor: 1.0,
        base: 0.0,
        gain: 1.0,
        channel: None,
        scale: [1.0; 2],
        offset: [0.0; 2],
        clamp: false,
        turbulent: false,
    };
    let rest = take_options(value.trim(), &mut map);
    let (name, map) = name_and_options(rest, map);
    let name = name.trim();
    (!name.is_empty() && !name.starts_with('#')).then(|| MapStatement { file: name.to_owned(), ..map })
}

/// The file name at the start of `text`, and the map with the options that follow the name.
fn name_and_options(text: &str, map: MapStatement) -> (&str, MapStatement) {
    for quote in ['"', '\''] {
        if let Some((name, after)) = text.strip_prefix(quote).and_then(|rest| rest.split_once(quote))
            && let Some(map) = only_options(after, &map)
        {
            return (name, map);
        }
    }
    // The name ends where nothing but options follows. Otherwise they are part of the name.
    let blanks = text.char_indices().filter(|(_, c)| c.is_whitespace());
    let ends = blanks.map(|(at, _)| at).filter(|&at| text[at..].trim_start().starts_with('-'));
    for at in ends {
        if let Some(map) = only_options(&text[at..], &map) {
            return (&text[..at], map);
        }
    }
    (text, map)
}

/// `map` with the options in `text`; `None` if there is anything else, except for a comment.
fn only_options(text: &str, map: &MapStatement) -> Option<MapStatement> {
    let mut map = map.clone();
    let rest = take_options(text.trim(), &mut map);
    (rest.is_empty() || rest.starts_with('#')).then_some(map)
}

/// Applies the options at the start of `text` and returns what follows them.
fn take_options<'a>(mut text: &'a str, map: &mut MapStatement) -> &'a str {
    while text.starts_with('-') {
        let (option, after) = next_word(text);
        let Some(rest) = take_option(&option.to_ascii_lowercase(), after, map) else { break };
        text = rest;
    }
    text
}

/// Applies one option and returns what follows it; `None` if it is none. Arguments that are missing are left out: the next
/// word then belongs to the name.
fn take_option<'a>(option: &str, after: &'a str, map: &mut MapStatement) -> Option<&'a str> {
    let pair = |numbers: &[f64], kept: [f64; 2]| std::array::from_fn(|k| numbers.get(k).copied().unwrap_or(kept[k]));
    let (numbers, rest) = match option {
        "-o" | "-s" | "-t" => take_numbers(after, 3),
        "-mm" => take_numbers(after, 2),
        "-bm" | "-boost" => take_numbers(after, 1),
        "-texres" => {
            return Some(take_word(after, |word| {
                word.starts_with(|c: char| c.is_ascii_digit()) && !word.contains('.')
            }));
        }
        "-blendu" | "-blendv" | "-cc" => return Some(take_word(after, is_switch)),
        "-clamp" => {
            map.clamp = !next_word(after).0.eq_ignore_ascii_case("off");
            return Some(take_word(after, is_switch));
        }
        "-imfchan" => {
            let channel = channel(next_word(after).0);
            map.channel = channel.or(map.channel);
            return Some(take_word(after, |word| self::channel(word).is_some()));
        }
        "-type" => return Some(take_word(after, is_reflection)),
        "-colorspace" => return Some(next_word(after).1),
        _ => return None,
    };
    match option {
        "-o" => map.offset = pair(&numbers, map.offset),
        "-s" => map.scale = pair(&numbers, map.scale),
        "-t" => map.turbulent = numbers.iter().any(|x| *x != 0.0),
        "-mm" => [map.base, map.gain] = pair(&numbers, [map.base, map.gain]),
        "-bm" => map.bump_factor = numbers.first().copied().unwrap_or(map.bump_factor),
        _ => {}
    }
    Some(rest)
}

/// Up to `most` numbers at the start of `text`, and what follows them. Those that are infinite or NaN, or that single
/// precision cannot hold, end the list but are read past.
fn take_numbers(mut text: &str, most: usize) -> (Vec<f64>, &str) {
    let mut numbers = Vec::new();
    let mut usable = true;
    for _ in 0..most {
        let (word, after) = next_word(text);
        let Some(x) = number(word) else { break };
        usable &= (x as f32).is_finite();
        if usable {
            numbers.push(x);
        }
        text = after;
    }
    (numbers, text)
}

/// What follows the first word of `text` if `expected` holds for that word; `text` otherwise.
fn take_word(text: &str, expected: impl Fn(&str) -> bool) -> &str {
    let (word, after) = next_word(text);
    if expected(word) { after } else { text }
}

/// The first word of `text`, and the rest without blanks at its start.
fn next_word(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

fn is_switch(word: &str) -> bool {
    ["on", "off"].iter().any(|s| word.eq_ignore_ascii_case(s))
}

fn is_reflection(word: &str) -> bool {
    let word = word.to_ascii_lowercase();
    let sides = ["top", "bottom", "front", "back", "left", "right", "side"];
    word == "sphere" || word.strip_prefix("cube_").is_some_and(|side| sides.contains(&side))
}

fn channel(word: &str) -> Option<Channel> {
    match word.to_ascii_lowercase().as_str() {
        "r" => Some(Channel::Red),
        "g" => Some(Channel::Green),
        "b" => Some(Channel::Blue),
        "m" => Some(Channel::Alpha),
        // Luminance. Also for depth, which needs an image format that this importer does not read.
        "l" | "z" => Some(Channel::Luminance),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(value: &str) -> MapStatement {
        map_statement(value).unwrap_or_else(|| panic!("no name in '{value}'"))
    }

    #[test]
    fn names_are_found_between_options() {
        for (value, name) in [
            ("a.png", "a.png"),
            ("my tex.png", "my tex.png"),
            ("-s 2 2 my tex.png", "my tex.png"),
            ("-o 0.1 a.png", "a.png"),
            ("-O 1 2 3 -S 1 1 1 -T 0 0 0 a.png", "a.png"),
            ("-blendu off -blendv on -cc on -clamp on -texres 512 -mm 0 1 -boost 2 -type sphere a.png", "a.png"),
            ("-type cube_top -imfchan l -colorspace sRGB a.png", "a.png"),
            ("a.png -bm 1", "a.png"),
            ("-s 2 a b.png -o 0.5 0.5 -clamp on", "a b.png"),
            ("a.png -bm 1 # rough", "a.png"),
            ("\"my tex.png\"", "my tex.png"),
            ("-bm 0.5 \"my tex.png\" -s 2 2", "my tex.png"),
            ("'a b.png'", "a b.png"),
            ("maps\\x.bmp", "maps\\x.bmp"),
            ("a #1.png", "a #1.png"),
            ("a -s.png", "a -s.png"),
            ("wood - dark.png", "wood - dark.png"),
            ("-unknown a.png", "-unknown a.png"),
            ("-clamp a.png", "a.png"),
            ("-texres 512.png", "512.png"),
            ("-imfchan red.png", "red.png"),
            ("a.png -s", "a.png"),
        ] {
            assert_eq!(read(value).file, name, "{value}");
        }
        for none in ["", "-bm", "-s 1 1 1", "-clamp on", "# a.png", "\"\""] {
            assert!(map_statement(none).is_none_or(|map| map.file == none), "{none}");
        }
        assert_eq!(map_statement("-s 1 1 1"), None);
    }

    #[test]
    fn options_have_one_to_three_numbers() {
        let transform = |value: &str| read(value).uv_transform();
        assert_eq!(transform("a.png"), UvTransform::IDENTITY);
        assert_eq!(transform("-s 1 1 1 -o 0 0 0 a.png"), UvTransform::IDENTITY);
        assert_eq!(transform("-s 2 a.png").rows, [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(transform("-s 2 4 a.png").rows, [[2.0, 0.0, 0.0], [0.0, 4.0, -3.0]]);
        assert_eq!(transform("a.png -o .5 .25 1").rows, [[1.0, 0.0, 0.5], [0.0, 1.0, -0.25]]);
        assert_eq!(transform("-s nan 2 -o 1e99 a.png"), UvTransform::IDENTITY);
        assert_eq!((read("-clamp on a").wrap(), read("-clamp off a").wrap()), ([Wrap::Clamp; 2], [Wrap::Repeat; 2]));
        assert_eq!((read("-mm 0.5 a").base, read("-mm 0.5 a").gain), (0.5, 1.0));
        assert_eq!((read("-mm 0.5 2 a").base, read("a -mm 0.5 2").gain), (0.5, 2.0));
        assert_eq!((read("-bm 2 a").bump_factor, read("-imfchan M a").channel), (2.0, Some(Channel::Alpha)));
        assert!(read("-t 0 1 a").turbulent && !read("-t 0 0 0 a").turbulent);
    }
}
