//! The terms of the page. The first time that a text has one, the template links it to its meaning.

/// A term.
pub(super) struct Term {
    /// The part of its address after `term-`.
    pub(super) id: &'static str,
    pub(super) name: &'static str,
    pub(super) meaning: &'static str,
    /// What is linked to it, in lower case.
    words: &'static [&'static str],
}

const fn term(id: &'static str, name: &'static str, words: &'static [&'static str], meaning: &'static str) -> Term {
    Term { id, name, meaning, words }
}

/// All terms, in the order of the list.
pub(super) const TERMS: &[Term] = &[
    term(
        "levels",
        "octree, levels",
        &["levels"],
        "A cube of space is divided into eight again and again, where there is surface. With one level more, voxels are half as large.",
    ),
    term("root-cube", "root cube", &["root cube"], "The cube that an octree divides: all of the scene is in it."),
    term(
        "contours",
        "cubes, contours",
        &["contours", "cubes", "cubical"],
        "A voxel is drawn as a cube, or as the part of the cube between two parallel planes that fit the surface: its contour.",
    ),
    term(
        "beam",
        "beam",
        &["beam optimization", "beam"],
        "A coarse picture is cast first; it tells where the rays of the full picture may start. Hits stay the same.",
    ),
    term(
        "ends",
        "termination: rays end at voxels of 1 pixel",
        &["rays end at", "ends at"],
        "A ray does not go down into a voxel that looks at most as large as this many pixels. 0.5 is finer than 1, 4 is coarser.",
    ),
    term(
        "exact",
        "exact answer",
        &["exact answer"],
        "Where a ray hits the triangles themselves, computed in double precision. Errors are against it.",
    ),
    term(
        "depth-error",
        "depth error in pixels",
        &["depth error", "error in pixels"],
        "Distance along the ray between the octree's surface and the exact answer, in sizes of a pixel there. 90 %: of 90 % of the rays \
         that hit, the error is at most this.",
    ),
    term(
        "flip",
        "FLIP",
        &["flip"],
        "How different two pictures look, from 0 (not at all) to 1: that of the octree and that of the triangles.",
    ),
    term(
        "range",
        "range of times, tie",
        &["within the spread", "ties"],
        "32.6 to 40.2 ms: the least time of all rounds, and the lower quartile of the rounds. Settings whose ranges overlap cannot be told \
         apart: they tie.",
    ),
    term("front", "Pareto front", &["pareto front"], "The settings that no other beats in both time and error."),
    term(
        "reference",
        "reference",
        &["reference caster", "reference"],
        "The plain caster on the processor, written to be read. All other engines are compared with it.",
    ),
    term(
        "oracle",
        "oracle",
        &["oracle"],
        "A judge of hits in double precision. It derives how far rounding may move a hit, and finds wrong what is farther off. It judges \
         the reference.",
    ),
    term(
        "cpu",
        "cpu",
        &["cpu"],
        "The fast caster on the processor, by several instruction sets (scalar, SSE2, AVX2, arrays).",
    ),
    term("wgpu", "wgpu", &["wgpu"], "The caster on GPUs by the library wgpu: a compute shader in WGSL."),
    term("ash", "ash", &["ash"], "The caster on GPUs by Vulkan itself: a compute shader in GLSL."),
    term("triangles", "triangles", &["triangles"], "The mesh itself, cast without an octree, through a tree of boxes."),
    term(
        "llvmpipe",
        "llvmpipe, software Vulkan",
        &["llvmpipe", "software vulkan"],
        "A Vulkan driver that runs on the processor. It shows that answers are right; its times say nothing about a GPU.",
    ),
    term(
        "needs",
        "far pointers, tests of sizes, frames",
        &["far pointers", "test of sizes", "spare frames"],
        "Code that a small octree does not use: pointers to children far away in memory; the test whether a voxel is small enough to end a \
         ray; room on the stack for levels that the octree does not have.",
    ),
    term(
        "stand-in",
        "stand-in",
        &["stand-in"],
        "A generated mesh that replaces one that is not available. Its figures are not those of the original.",
    ),
    term("quartiles", "± %", &[], "Half the distance between the quartiles over the rounds, beside their median."),
];

/// A part of a text.
#[derive(Clone, Copy)]
pub(super) enum Piece<'a> {
    Plain(&'a str),
    /// What stood between backquotes.
    Code(&'a str),
    /// A term, at the first place where the text has it.
    Word(&'static Term, &'a str),
}

/// The parts of a text, in its order.
pub(super) fn pieces(text: &str) -> Vec<Piece<'_>> {
    let mut known = Vec::new();
    let mut pieces = Vec::new();
    for (index, part) in text.split('`').enumerate() {
        match index % 2 {
            _ if part.is_empty() => {}
            1 => pieces.push(Piece::Code(part)),
            _ => link(part, &mut known, &mut pieces),
        }
    }
    pieces
}

/// Cuts a text at the terms that were not met before.
fn link<'a>(text: &'a str, known: &mut Vec<&'static str>, pieces: &mut Vec<Piece<'a>>) {
    let lower = text.to_ascii_lowercase();
    let mut start = 0;
    while start < text.len() {
        let words = TERMS.iter().filter(|term| !known.contains(&term.id));
        let words = words.flat_map(|term| term.words.iter().map(move |word| (term, *word)));
        let found = words.filter_map(|(term, word)| Some((find_word(&lower, start, word)?, term, word)));
        // The first; of those that begin together, the longest.
        let Some((at, term, word)) = found.min_by_key(|(at, _, word)| (*at, usize::MAX - word.len())) else { break };
        if at > start {
            pieces.push(Piece::Plain(&text[start..at]));
        }
        start = at + word.len();
        pieces.push(Piece::Word(term, &text[at..start]));
        known.push(term.id);
    }
    if start < text.len() {
        pieces.push(Piece::Plain(&text[start..]));
    }
}

/// Where a word stands alone at or after `start`.
fn find_word(text: &str, start: usize, word: &str) -> Option<usize> {
    let of_word = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    text[start..].match_indices(word).map(|(at, _)| start + at).find(|&at| {
        let (before, after) = (text[..at].chars().next_back(), text[at + word.len()..].chars().next());
        !before.is_some_and(of_word) && !after.is_some_and(of_word)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> String {
        let show = |piece: &Piece| match *piece {
            Piece::Plain(text) => text.to_owned(),
            Piece::Code(text) => format!("`{text}`"),
            Piece::Word(term, text) => format!("[{text}:{}]", term.id),
        };
        pieces(text).iter().map(show).collect()
    }

    #[test]
    fn terms_are_linked_once_and_as_whole_words() {
        assert_eq!(
            shown("Contours and cubes: the beam optimization of `cpu`, cpu-like, cpu."),
            "[Contours:contours] and cubes: the [beam optimization:beam] of `cpu`, cpu-like, [cpu:cpu]."
        );
        assert_eq!(shown("× crash µs beams"), "× crash µs beams");
        assert_eq!(shown(""), "");
    }

    #[test]
    fn terms_differ() {
        for (index, term) in TERMS.iter().enumerate() {
            assert!(TERMS[..index].iter().all(|other| other.id != term.id && other.name != term.name));
            assert!(term.words.iter().all(|word| **word == word.to_ascii_lowercase()));
        }
    }
}
