//! Writing records, tables and pictures: every file is whole or as it was before.

use std::path::{Path, PathBuf};

use esvo_core::picture::{Picture, write_png};
use esvo_format::write_atomically;
use serde::Serialize;

use crate::BenchError;
use crate::system::machine::{Machine, slug};

/// A picture and the name of its file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NamedPicture {
    /// File name.
    pub name: String,
    /// The picture.
    pub picture: Picture,
}

/// Checks that files can be written below `results`, which need not exist. Call this before a long run.
///
/// # Errors
/// The system's, for the folder or the nearest one above it that exists.
pub fn check_writable(results: &Path) -> Result<(), BenchError> {
    let above = results.ancestors().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
    let existing = above.into_iter().find(|p| p.exists()).unwrap_or(Path::new("."));
    if !existing.is_dir() {
        let what = "is a file where a folder is needed; choose another path";
        return Err(BenchError::io(existing, std::io::Error::other(what)));
    }
    tempfile::tempfile_in(existing).map(drop).map_err(|e| BenchError::io(existing, e))
}

/// Writes a text file: under a temporary name first, which is then renamed, so that the file is whole or as it was before.
/// Every record, table and other text of this program is written by this function.
///
/// # Errors
/// The system's.
pub fn write_text(path: &Path, text: &str) -> Result<(), BenchError> {
    write_atomically(path, |out| out.write_all(text.as_bytes())).map_err(|e| BenchError::io(path, e))
}

/// A record as indented JSON with a line feed at the end, as files and standard output get it.
///
/// # Panics
/// A map of the record has keys that are not texts.
pub fn to_json(record: &impl Serialize) -> String {
    let mut json = serde_json::to_string_pretty(record).expect("records have text keys only");
    json.push('\n');
    json
}

impl NamedPicture {
    /// Writes the picture to a folder, whole or not at all, and returns its path.
    ///
    /// # Errors
    /// The system's; a picture whose bytes are not as many as its size says.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, BenchError> {
        let path = folder.join(&self.name);
        write_png(&path, &self.picture).map_err(|e| BenchError::io(&path, e))?;
        Ok(path)
    }
}

/// Makes the folder `<results>/<machine>/<date><kind>` and lets `fill` write its files. `name` replaces the name made from the
/// processor. A second run on the same day gets `<date><kind>.2`, and so on: nothing is overwritten. The folder appears under
/// its name when everything is in it. Returns its path.
///
/// # Errors
/// The system's, and those of `fill`.
pub(crate) fn write_folder(
    results: &Path,
    machine: &Machine,
    name: Option<&str>,
    kind: &str,
    fill: impl FnOnce(&Path) -> Result<(), BenchError>,
) -> Result<PathBuf, BenchError> {
    let parent = results.join(name.map_or_else(|| machine.slug(), slug));
    std::fs::create_dir_all(&parent).map_err(|e| BenchError::io(&parent, e))?;
    let temporary =
        tempfile::Builder::new().prefix(".esvo-").tempdir_in(&parent).map_err(|e| BenchError::io(&parent, e))?;
    fill(temporary.path())?;
    readable(temporary.path())?;
    let day = machine.day();
    for number in 1..10_000 {
        let name = if number == 1 { format!("{day}{kind}") } else { format!("{day}{kind}.{number}") };
        let folder = parent.join(name);
        if folder.exists() {
            continue;
        }
        std::fs::rename(temporary.path(), &folder).map_err(|e| BenchError::io(&folder, e))?;
        // The folder was renamed: there is nothing to remove.
        let _ = temporary.keep();
        return Ok(folder);
    }
    Err(BenchError::io(&parent, std::io::Error::other("too many runs of this day")))
}

/// Makes a folder readable for everybody; temporary folders are readable only for their owner.
fn readable(folder: &Path) -> Result<(), BenchError> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o755))
            .map_err(|e| BenchError::io(folder, e))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_whole_or_as_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("record.json");
        write_text(&path, "first").unwrap();
        write_text(&path, "second").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "second");
        let picture = Picture::from_fn((2, 1), |_, _| [0.5; 3]);
        let bad = NamedPicture { name: "bad.png".into(), picture: Picture { width: 3, ..picture.clone() } };
        assert!(bad.write(folder.path()).is_err());
        NamedPicture { name: "good.png".into(), picture }.write(folder.path()).unwrap();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
        let error = write_text(&folder.path().join("absent/record.json"), "x").unwrap_err().to_string();
        assert!(error.contains("absent"), "{error}");
    }

    #[test]
    fn a_folder_that_cannot_be_filled_does_not_appear() {
        let results = tempfile::tempdir().unwrap();
        let machine = Machine::detect();
        let failed = write_folder(results.path(), &machine, Some("m"), "-x", |folder| {
            write_text(&folder.join("a"), "a")?;
            Err(BenchError::scene("s", "fails"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read_dir(results.path().join("m")).unwrap().count(), 0);
        check_writable(&results.path().join("not/there/yet")).unwrap();
        write_text(&results.path().join("file"), "text").unwrap();
        for path in ["file", "file/below"] {
            let error = check_writable(&results.path().join(path)).unwrap_err().to_string();
            assert!(error.contains("file: is a file where a folder is needed"), "{error}");
        }
    }
}
