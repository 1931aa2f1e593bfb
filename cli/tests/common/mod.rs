//! Running the program in an empty folder.

#![allow(dead_code, reason = "each test file uses a part of it")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A box with a floor, 24 triangles.
pub(crate) const BOX: &str = "\
v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nv 0 0 1.5\nv 2 0 1.5\nv 2 1 1.5\nv 0 1 1.5
f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 4 3 7 8\nf 1 4 8 5\nf 2 3 7 6
v -1 -0.1 -1\nv 3 -0.1 -1\nv 3 -0.1 3\nv -1 -0.1 3\nf 9 10 11 12
";

/// An empty temporary folder to work in.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    /// Makes one.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("here")).unwrap();
        Self(folder)
    }

    /// A folder inside the temporary one, so that `../shared` is not found from there.
    fn here(&self) -> PathBuf {
        self.0.path().join("here")
    }

    /// The folder with the box in `box.obj` and its octree in `box.esvo`.
    pub(crate) fn with_octree() -> Self {
        let folder = Self::new();
        folder.put("box.obj", BOX);
        folder.ok(&["build", "box.obj", "-o", "box.esvo", "--levels", "6"]);
        folder
    }

    /// A path in it.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.here().join(name)
    }

    /// Writes a file.
    pub(crate) fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    /// Names of all files in it.
    pub(crate) fn files(&self) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(self.here())
            .unwrap()
            .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    /// The program, not started yet.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(Path::new(env!("CARGO_BIN_EXE_esvo")));
        command.args(arguments).current_dir(self.here()).stdin(Stdio::null()).env_remove("ESVO_SCENES");
        command
    }

    /// Runs it to its end.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs it; it must succeed. Returns standard output.
    pub(crate) fn ok(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{arguments:?}: {error}");
        String::from_utf8(out.stdout).unwrap()
    }

    /// Runs it; it must fail with this exit code and one line that starts with `error: ` and contains `what`, and leave
    /// the folder as it was.
    #[track_caller]
    pub(crate) fn fails(&self, arguments: &[&str], code: i32, what: &str) {
        let before = self.files();
        let out = self.run(arguments);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{arguments:?}: {error}");
        assert!(error.starts_with("error: "), "{arguments:?}: {error}");
        assert!(error.contains(what), "{arguments:?}: {error}");
        // Usage errors are clap's, with a hint below.
        assert!(code == 2 || error.trim_end().lines().count() == 1, "{arguments:?}: {error}");
        assert_eq!(self.files(), before, "{arguments:?} left something behind");
    }
}
