//! What there is of files on servers in a program that is built without them: an error.

use std::convert::Infallible;
use std::path::Path;

use esvo_format::file::ObjectEntry;
use esvo_format::{Octree, Region};

use super::{RemoteArguments, shown};
use crate::fail::Failure;

fn absent<T>(path: &Path) -> Result<T, Failure> {
    let what = "this program was built without files on servers; build it with them, `cargo build --release --features remote`, or download the file first";
    Err(format!("{}: {what}", shown(path)).into())
}

/// There are none.
pub(crate) fn remove_copies() {}

/// There is none.
pub(crate) struct Copy(Infallible);

impl Copy {
    pub(crate) fn of(path: &Path, _: &RemoteArguments) -> Result<Self, Failure> {
        absent(path)
    }

    pub(crate) fn path(&self) -> &Path {
        match self.0 {}
    }
}

/// There is none.
pub(crate) struct Served(Infallible);

impl Served {
    pub(crate) fn open(path: &Path, _: &RemoteArguments) -> Result<Self, Failure> {
        absent(path)
    }

    pub(crate) fn objects(&self) -> &[ObjectEntry] {
        match self.0 {}
    }

    pub(crate) fn has_index(&self) -> bool {
        match self.0 {}
    }

    pub(crate) fn octree_by(&mut self, _: impl Fn(usize, &Region) -> u32) -> Result<Octree, Failure> {
        match self.0 {}
    }

    pub(crate) fn counts(&self) -> (u64, u64, u64) {
        match self.0 {}
    }

    pub(crate) fn about(&self) -> String {
        match self.0 {}
    }
}
