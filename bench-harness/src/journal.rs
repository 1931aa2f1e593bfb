//! Finished parts of a long run, kept on disk: a run that was stopped goes on where it was.
//!
//! A journal is a folder beside the records, whose name begins with a dot. It has one file for what is measured and by which build, one for
//! each finished part, and the pictures of these parts. Every file is whole or absent. The folder is removed when the record is written.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use esvo_core::picture::read_picture;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::output::{NamedPicture, to_json, write_text};
use crate::system::machine::{Machine, slug};

/// The parts of a run that are finished.
#[derive(Debug, Default)]
pub struct Journal {
    /// `None`: nothing is kept.
    folder: Option<PathBuf>,
    /// The text of the file for what is measured.
    header: String,
    /// Whether parts of a former run are found; the first part that is kept removes them otherwise.
    resumed: Cell<bool>,
    /// Seconds of the parts that were found.
    found_seconds: Cell<f64>,
}

/// What a journal belongs to: parts of another build, machine or plan are of no use.
#[derive(PartialEq, Serialize, Deserialize)]
struct Header {
    commit: String,
    cpu: String,
    threads: usize,
    settings: serde_json::Value,
}

#[derive(Serialize, Deserialize)]
struct Part<T> {
    seconds: f64,
    result: T,
}

impl Journal {
    /// Keeps nothing and finds nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// The journal of a run of `kind` in `<results>/<machine>/.unfinished<kind>/`. `machine` replaces the name made from the processor.
    /// With `resume`, parts that are there are found by [`find`](Self::find); otherwise they are removed when the first part is kept.
    /// `settings` is all that the results depend on. Nothing is written before a part is kept.
    ///
    /// # Errors
    /// The system's. With `resume`: the parts are of another build or machine, or of other settings.
    pub fn open(
        results: &Path,
        machine: Option<&str>,
        kind: &str,
        settings: &impl Serialize,
        resume: bool,
    ) -> Result<Self, BenchError> {
        Self::open_in(&results.join(machine.map_or_else(|| Machine::detect().slug(), slug)), kind, settings, resume)
    }

    /// As [`open`](Self::open), in `<parent>/.unfinished<kind>/`: for records that lie in no folder of a machine.
    ///
    /// # Errors
    /// As there.
    pub fn open_in(parent: &Path, kind: &str, settings: &impl Serialize, resume: bool) -> Result<Self, BenchError> {
        let this = Machine::detect();
        let folder = parent.join(format!(".unfinished{kind}"));
        let file = folder.join("run.json");
        let failed = |what: String| BenchError::scene("journal", what);
        let settings = serde_json::to_value(settings).map_err(|e| failed(e.to_string()))?;
        let header = Header { commit: this.commit, cpu: this.cpu, threads: this.threads, settings };
        // A folder without this file was stopped before it had a part.
        let resumed = resume && file.is_file();
        if resumed {
            let kept: Header = read(&file)?;
            if let Some(what) = differing(&kept, &header) {
                return Err(BenchError::Matrix {
                    file: folder.display().to_string(),
                    what: format!("the run that was stopped had {what}; without --resume, a new one begins"),
                });
            }
        }
        let (folder, header) = (Some(folder), to_json(&header));
        Ok(Self { folder, header, resumed: Cell::new(resumed), ..Self::default() })
    }

    /// Makes the folder, in place of a former run's, if this is the first part that is kept.
    fn make(&self) -> Result<(), BenchError> {
        let Some(folder) = self.folder.as_ref().filter(|_| !self.resumed.replace(true)) else { return Ok(()) };
        self.remove()?;
        std::fs::create_dir_all(folder).map_err(|e| BenchError::io(folder, e))?;
        write_text(&folder.join("run.json"), &self.header)
    }

    /// The result of a part that is finished.
    ///
    /// # Errors
    /// A file that cannot be read or is no result of this kind.
    pub fn find<T: DeserializeOwned>(&self, part: &str) -> Result<Option<T>, BenchError> {
        let Some(file) = self.file(part).filter(|file| self.resumed.get() && file.exists()) else { return Ok(None) };
        let part: Part<T> = read(&file)?;
        self.found_seconds.set(self.found_seconds.get() + part.seconds);
        Ok(Some(part.result))
    }

    /// Keeps the result of a part, which took since `start`.
    ///
    /// # Errors
    /// The system's.
    pub fn keep(&self, part: &str, start: Instant, result: &impl Serialize) -> Result<(), BenchError> {
        let Some(file) = self.file(part) else { return Ok(()) };
        self.make()?;
        write_text(&file, &to_json(&Part { seconds: start.elapsed().as_secs_f64(), result }))
    }

    /// Finds the result of a part, or makes and keeps it.
    ///
    /// # Errors
    /// As for [`find`](Self::find) and [`keep`](Self::keep), and those of `make`.
    pub fn part<T: Serialize + DeserializeOwned>(
        &self,
        part: &str,
        make: impl FnOnce() -> Result<T, BenchError>,
    ) -> Result<T, BenchError> {
        if let Some(found) = self.find(part)? {
            return Ok(found);
        }
        let start = Instant::now();
        let made = make()?;
        self.keep(part, start, &made)?;
        Ok(made)
    }

    /// Keeps the pictures of a part. Called before [`keep`](Self::keep), so that a finished part has all of its pictures.
    ///
    /// # Errors
    /// The system's.
    pub fn keep_pictures(&self, pictures: &[NamedPicture]) -> Result<(), BenchError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        self.make()?;
        pictures.iter().try_for_each(|picture| picture.write(folder).map(drop))
    }

    /// Finds pictures of a finished part by their names.
    ///
    /// # Errors
    /// A picture that is absent or cannot be read.
    pub fn find_pictures(&self, names: &[String]) -> Result<Vec<NamedPicture>, BenchError> {
        let Some(folder) = &self.folder else { return Ok(Vec::new()) };
        let find = |name: &String| {
            let path = folder.join(name);
            let picture = read_picture(&path).map_err(|e| BenchError::io(&path, e))?;
            Ok(NamedPicture { name: name.clone(), picture })
        };
        names.iter().map(find).collect()
    }

    /// Seconds that the parts took which were found.
    pub fn found_seconds(&self) -> f64 {
        self.found_seconds.get()
    }

    /// Removes the folder: the record has all of it.
    ///
    /// # Errors
    /// The system's.
    pub fn remove(&self) -> Result<(), BenchError> {
        match &self.folder {
            Some(folder) if folder.exists() => std::fs::remove_dir_all(folder).map_err(|e| BenchError::io(folder, e)),
            _ => Ok(()),
        }
    }

    fn file(&self, part: &str) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(format!("part-{}.json", slug(part))))
    }
}

/// In what the run of a journal differs.
fn differing(kept: &Header, now: &Header) -> Option<String> {
    if kept.commit != now.commit {
        return Some(format!("another build: {}, and this is {}", kept.commit, now.commit));
    }
    if (&kept.cpu, kept.threads) != (&now.cpu, now.threads) {
        return Some(format!("another machine: {}, {} threads", kept.cpu, kept.threads));
    }
    (kept.settings != now.settings).then(|| "other settings".into())
}

fn read<T: DeserializeOwned>(file: &Path) -> Result<T, BenchError> {
    let text = std::fs::read_to_string(file).map_err(|e| BenchError::io(file, e))?;
    serde_json::from_str(&text).map_err(|e| BenchError::Matrix {
        file: file.display().to_string(),
        what: format!("is no part of a run: {e}; without --resume, a new run begins"),
    })
}

#[cfg(test)]
mod tests {
    use esvo_core::picture::Picture;

    use super::*;

    #[test]
    fn parts_are_found_after_a_stop_and_not_without_resume() {
        let results = tempfile::tempdir().unwrap();
        let open = |settings: &str, resume| Journal::open(results.path(), Some("m"), "-x", &settings, resume);
        let picture = NamedPicture { name: "p.png".into(), picture: Picture::from_fn((2, 1), |x, _| [x as f32; 3]) };
        {
            let journal = open("a", true).unwrap();
            assert_eq!(journal.part("s/1", || Ok(7)).unwrap(), 7);
            journal.keep_pictures(std::slice::from_ref(&picture)).unwrap();
        }
        let journal = open("a", true).unwrap();
        assert_eq!(journal.part("s/1", || -> Result<i32, _> { panic!("was made again") }).unwrap(), 7);
        assert_eq!(journal.find::<i32>("s/2").unwrap(), None);
        assert_eq!(journal.find_pictures(&["p.png".into()]).unwrap(), [picture]);
        assert!(journal.found_seconds() >= 0.0);
        let error = open("b", true).unwrap_err().to_string();
        assert!(error.contains("other settings"), "{error}");
        // A new run begins, and the parts stay until it keeps one.
        let new = open("b", false).unwrap();
        assert_eq!(new.find::<i32>("s/1").unwrap(), None);
        assert_eq!(open("a", true).unwrap().find::<i32>("s/1").unwrap(), Some(7));
        new.part("s/2", || Ok(8)).unwrap();
        assert_eq!(new.find::<i32>("s/1").unwrap(), None);
        assert!(open("a", true).is_err());
        open("b", true).unwrap().remove().unwrap();
        assert_eq!(std::fs::read_dir(results.path().join("m")).unwrap().count(), 0);
    }

    #[test]
    fn a_part_that_failed_is_not_kept_and_a_damaged_one_is_named() {
        let results = tempfile::tempdir().unwrap();
        let journal = Journal::open(results.path(), Some("m"), "", &1, false).unwrap();
        assert!(!results.path().join("m").exists(), "nothing is written before a part is kept");
        journal.part("first", || Ok(1)).unwrap();
        assert!(journal.part("a", || -> Result<i32, _> { Err(BenchError::scene("s", "fails")) }).is_err());
        assert_eq!(journal.find::<i32>("a").unwrap(), None);
        std::fs::write(journal.file("b").unwrap(), "{").unwrap();
        let error = journal.find::<i32>("b").unwrap_err().to_string();
        assert!(error.contains("part-b.json") && error.contains("--resume"), "{error}");
        let none = Journal::none();
        assert_eq!(none.part("a", || Ok(3)).unwrap(), 3);
        assert_eq!(none.find::<i32>("a").unwrap(), None);
    }
}
