//! Names of numbered pictures.

use std::path::{Path, PathBuf};

/// The names of `count` frames: a number from 1 before the extension, with as many digits for all, three or more.
pub(crate) fn names(output: &Path, count: u32) -> Vec<PathBuf> {
    let stem = output.file_stem().unwrap_or_default();
    let digits = count.to_string().len().max(3);
    let name = |number: u32| {
        let mut name = stem.to_owned();
        name.push(format!("-{number:0digits$}"));
        if let Some(extension) = output.extension() {
            name.push(".");
            name.push(extension);
        }
        output.with_file_name(name)
    };
    (1..=count).map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_like_their_names() {
        let names = |count| names(Path::new("a.b/turn.0.png"), count);
        assert_eq!(names(2), [Path::new("a.b/turn.0-001.png"), Path::new("a.b/turn.0-002.png")]);
        let many = names(1000);
        assert!(many.is_sorted() && many[999] == Path::new("a.b/turn.0-1000.png"));
        assert_eq!(many[0], Path::new("a.b/turn.0-0001.png"));
    }
}
