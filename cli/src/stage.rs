//! What a picture shows: an octree's objects, or those that a scene list places.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use esvo_core::Object;
use esvo_format::{Octree, join};
use esvo_scenes::SceneList;
use glam::DMat4;

use crate::fail::Failure;
use crate::files::{extension, name_file, open};
use crate::memory::check_memory;

/// Extension of scene lists.
pub(crate) const LIST: &str = "toml";

/// Octrees in one, and its objects at their places.
pub(crate) struct Stage {
    pub(crate) octree: Arc<Octree>,
    /// Numbers of objects, and where they are placed; `None`: where the file says.
    placed: Vec<(usize, Option<DMat4>)>,
}

impl Stage {
    /// Opens an octree or, of a file with the extension [`LIST`], the octrees of a scene list: each file once.
    pub(crate) fn open(path: &Path, verify: bool) -> Result<Self, Failure> {
        if extension(path) == LIST {
            return Self::of_list(path, verify);
        }
        Ok(Self::of(open(path, verify)?))
    }

    /// All objects of an octree, where it says.
    pub(crate) fn of(octree: Octree) -> Self {
        let placed = (0..octree.objects().len()).map(|object| (object, None)).collect();
        Self { octree: Arc::new(octree), placed }
    }

    fn of_list(path: &Path, verify: bool) -> Result<Self, Failure> {
        let list = SceneList::load(path)?;
        let mut octrees: Vec<Octree> = Vec::new();
        let mut numbers: HashMap<PathBuf, usize> = HashMap::new();
        // Number of the octree and of its object, and the place.
        let mut wanted = Vec::new();
        for place in &list.places {
            let of_place = |what: &dyn std::fmt::Display| {
                Failure::Message(format!("{}: place {} (line {}): {what}", path.display(), place.number, place.line))
            };
            // Two names of one file are one octree. A file that does not exist is named by the error of opening it.
            let name = place.file.canonicalize().unwrap_or_else(|_| place.file.clone());
            let number = match numbers.get(&name) {
                Some(number) => *number,
                None => {
                    let octree = open(&place.file, verify).map_err(|failure| match failure {
                        Failure::Message(what) => of_place(&what),
                        Failure::Pipe => Failure::Pipe,
                    })?;
                    octrees.push(octree);
                    numbers.insert(name, octrees.len() - 1);
                    octrees.len() - 1
                }
            };
            let count = octrees[number].objects().len();
            let objects = match place.object {
                None => 0..count,
                Some(object) if object < count => object..object + 1,
                Some(object) => {
                    let what = format!("`object` is {}; {} has {count}", object + 1, place.file.display());
                    return Err(of_place(&what));
                }
            };
            wanted.extend(objects.map(|object| (number, object, place.mesh_to_scene)));
        }
        let first: Vec<usize> = octrees
            .iter()
            .scan(0, |next, octree| {
                let first = *next;
                *next += octree.objects().len();
                Some(first)
            })
            .collect();
        let placed = wanted.into_iter().map(|(number, object, place)| (first[number] + object, Some(place))).collect();
        let octree = if octrees.len() == 1 {
            octrees.remove(0)
        } else {
            let bytes = octrees.iter().map(|octree| size_of_val(octree.slots())).sum();
            check_memory(bytes, &format!("{}: {} octrees", path.display(), octrees.len()))?;
            join(&octrees.iter().collect::<Vec<_>>()).map_err(|error| name_file(path, error))?
        };
        Ok(Self { octree: Arc::new(octree), placed })
    }

    /// The objects.
    pub(crate) fn objects(&self) -> Vec<Object<'_>> {
        let all = Object::all(&self.octree);
        let object =
            |(number, place): &(usize, Option<DMat4>)| place.map_or(all[*number], |place| all[*number].placed(place));
        self.placed.iter().map(object).collect()
    }
}
