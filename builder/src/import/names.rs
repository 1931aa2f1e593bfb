//! Names of files and materials as programs write them in OBJ, MTL and PLY files, the files they stand for, and where a
//! backslash at the end of a line is no part of a name.

use std::fs;
use std::path::{Component, Path, PathBuf};

/// What a name may stand for, the name as written first: without quotes, with escaped blanks, without what follows `#`, with
/// `%20` and the like decoded. A name may really contain any of these, so the name as written goes first.
pub(super) fn spellings(name: &str) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    let mut add = |spelling: &str| {
        let spelling = spelling.trim();
        if !spelling.is_empty() && !all.iter().any(|s| s == spelling) {
            all.push(spelling.to_owned());
        }
    };
    let name = name.trim();
    let before_comment = name.split_once(" #").or(name.split_once("\t#")).map_or(name, |(before, _)| before).trim_end();
    for text in [name, before_comment] {
        add(text);
        let bare = unquoted(text);
        add(bare);
        add(&bare.replace("\\ ", " "));
        if bare.contains('%') {
            add(&percent_encoding::percent_decode_str(bare).decode_utf8_lossy());
        }
    }
    all
}

/// `text` without quotes around it.
fn unquoted(text: &str) -> &str {
    let inner = |quote: char| text.strip_prefix(quote)?.strip_suffix(quote);
    inner('"').or(inner('\'')).unwrap_or(text)
}

/// Splits a list of names at blanks, except at those that are escaped or within quotes.
pub(super) fn split_names(list: &str) -> Vec<String> {
    let mut names = vec![String::new()];
    let mut quote = None;
    let mut chars = list.chars().peekable();
    while let Some(c) = chars.next() {
        let last = names.len() - 1;
        match c {
            '"' | '\'' if quote == Some(c) => quote = None,
            '"' | '\'' if quote.is_none() && names[last].is_empty() => quote = Some(c),
            '\\' if chars.peek() == Some(&' ') => names[last].extend(chars.next()),
            _ if c.is_whitespace() && quote.is_none() => names.push(String::new()),
            _ => names[last].push(c),
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// What comes before the backslash at the end of a line, which joins it with the next one. `is_name`: the value of the
/// statement is a name, whose last character can be a backslash; a backslash after a blank still joins.
pub(super) fn continued(line: &str, is_name: bool) -> Option<&str> {
    line.strip_suffix('\\').filter(|start| !is_name || start.is_empty() || start.ends_with(char::is_whitespace))
}

/// Whether two names stand for the same file. Names of files that do not exist are compared as written.
pub(super) fn same_file(dir: &Path, a: &str, b: &str) -> bool {
    let file = |name| find_file(dir, name).map(|file| file.canonicalize().unwrap_or(file));
    match (file(a), file(b)) {
        (None, None) => a == b,
        (a, b) => a == b,
    }
}

/// Finds the file that `name` stands for: in `dir` by the name in any of its [`spellings`], with Windows separators, or by
/// the last part of the name. If there is none, the only file whose name differs in the case of its letters.
pub(super) fn find_file(dir: &Path, name: &str) -> Option<PathBuf> {
    let spelled = spellings(name);
    let candidates = |spelling: &String| {
        let slashed = spelling.replace('\\', "/");
        let last = Path::new(&slashed).file_name().map(PathBuf::from);
        [Some(PathBuf::from(spelling)), Some(PathBuf::from(slashed)), last].into_iter().flatten()
    };
    let exact = spelled.iter().flat_map(candidates).map(|path| dir.join(path)).find(|path| path.is_file());
    exact.or_else(|| spelled.iter().flat_map(candidates).find_map(|path| find_in_any_case(dir, &path)))
}

/// The only file in `dir` whose relative path is `path` except for the case of letters.
fn find_in_any_case(dir: &Path, path: &Path) -> Option<PathBuf> {
    let mut found = dir.to_path_buf();
    for component in path.components() {
        match component {
            Component::Normal(name) => {
                let exact = found.join(name);
                if exact.exists() {
                    found = exact;
                    continue;
                }
                let wanted = name.to_str()?.to_lowercase();
                let folder = if found.as_os_str().is_empty() { Path::new(".") } else { &found };
                let entries = fs::read_dir(folder).ok()?.flatten().map(|entry| entry.file_name());
                let mut same = entries.filter(|n| n.to_str().is_some_and(|n| n.to_lowercase() == wanted));
                let (only, None) = (same.next()?, same.next()) else { return None };
                found.push(only);
            }
            Component::CurDir | Component::ParentDir => found.push(component),
            // Only files below the folder of the mesh are searched in this way.
            Component::Prefix(_) | Component::RootDir => return None,
        }
    }
    found.is_file().then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_as_written_goes_first() {
        assert_eq!(spellings("Material #25"), ["Material #25", "Material"]);
        assert_eq!(spellings(" \"a b.png\" # c"), ["\"a b.png\" # c", "\"a b.png\"", "a b.png"]);
        assert_eq!(spellings("my\\ a.mtl"), ["my\\ a.mtl", "my a.mtl"]);
        assert_eq!(spellings("a%20b"), ["a%20b", "a b"]);
        assert_eq!(spellings("b#1.mtl"), ["b#1.mtl"]);
        assert_eq!(spellings("  "), [""; 0]);
    }

    #[test]
    fn lists_of_names_are_split_at_blanks_that_separate() {
        assert_eq!(
            split_names("a.mtl  my\\ b.mtl \"c d.mtl\" e\\f.mtl it's"),
            ["a.mtl", "my b.mtl", "c d.mtl", "e\\f.mtl", "it's"]
        );
        assert_eq!(split_names(" \"open"), ["open"]);
    }

    #[test]
    fn files_are_found_in_another_case_if_only_one_fits() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        fs::create_dir(dir.join("Maps")).unwrap();
        for name in ["Maps/Brick.PNG", "two.png", "TWO.png", "b#1.mtl", "a b.png"] {
            fs::write(dir.join(name), "").unwrap();
        }
        let found = |name: &str| {
            find_file(dir, name).map(|path| path.strip_prefix(dir).unwrap().to_str().unwrap().replace('\\', "/"))
        };
        assert_eq!(found("maps\\brick.png").as_deref(), Some("Maps/Brick.PNG"));
        assert_eq!(found("C:\\x\\A B.PNG").as_deref(), Some("a b.png"));
        assert_eq!(found("two.png").as_deref(), Some("two.png"));
        assert_eq!(found("Two.png"), None, "two files fit");
        assert_eq!(found("b#1.mtl").as_deref(), Some("b#1.mtl"));
        assert_eq!(found("\"B#1.mtl\"").as_deref(), Some("b#1.mtl"));
        assert_eq!((found("Maps"), found("none"), found("")), (None, None, None));
    }
}
