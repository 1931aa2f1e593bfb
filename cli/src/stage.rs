//! What a picture shows: an octree's objects, or those that a scene list places.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use esvo_core::Object;
use esvo_format::file::InstanceEntry;
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
        Self::of(open(path, verify)?).checked(path)
    }

    /// All objects of an octree, where it says, or its instances.
    pub(crate) fn of(octree: Octree) -> Self {
        let placed = match octree.instances() {
            [] => (0..octree.objects().len()).map(|object| (object, None)).collect(),
            instances => instances.iter().map(|one| (one.object as usize, Some(one.matrix()))).collect(),
        };
        Self { octree: Arc::new(octree), placed }
    }

    fn of_list(path: &Path, verify: bool) -> Result<Self, Failure> {
        let Listed { octree, instances, .. } = Listed::load(path, verify)?;
        let placed = instances.iter().map(|one| (one.object as usize, Some(one.matrix()))).collect();
        Self { octree: Arc::new(octree), placed }.checked(path)
    }

    /// Refuses places that leave an object without an inverse.
    fn checked(self, path: &Path) -> Result<Self, Failure> {
        for (number, (object, place)) in self.placed.iter().enumerate() {
            let Some(place) = place else { continue };
            let matrix = *place * self.octree.octree_to_mesh(*object);
            if !matrix.is_finite() || !matrix.inverse().is_finite() {
                let what = "together, its matrix and that of its object are too large or too small";
                return Err(format!("{}: instance {number}, of object {object}: {what}", path.display()).into());
            }
        }
        Ok(self)
    }

    /// The objects.
    pub(crate) fn objects(&self) -> Vec<Object<'_>> {
        let all = Object::all(&self.octree);
        let object =
            |(number, place): &(usize, Option<DMat4>)| place.map_or(all[*number], |place| all[*number].placed(place));
        self.placed.iter().map(object).collect()
    }
}

/// The octrees of a scene list in one, and what it places.
pub(crate) struct Listed {
    pub(crate) octree: Octree,
    pub(crate) instances: Vec<InstanceEntry>,
    /// Name of the place that an instance comes from.
    pub(crate) names: Vec<Option<String>>,
    /// The file that an object comes from.
    pub(crate) files: Vec<PathBuf>,
}

impl Listed {
    /// Opens the octrees of a list, each file once.
    pub(crate) fn load(path: &Path, verify: bool) -> Result<Self, Failure> {
        let list = SceneList::load(path)?;
        let mut octrees: Vec<Octree> = Vec::new();
        let mut numbers: HashMap<PathBuf, usize> = HashMap::new();
        // Number of the octree and of its object, and the place.
        let (mut wanted, mut names, mut files) = (Vec::new(), Vec::new(), Vec::new());
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
                    files.extend(octree.objects().iter().map(|_| place.file.clone()));
                    octrees.push(octree);
                    numbers.insert(name, octrees.len() - 1);
                    octrees.len() - 1
                }
            };
            let count = octrees[number].objects().len();
            // All of a file is its scene.
            let placed = match place.object {
                None => octrees[number].placed(),
                Some(object) if object < count => vec![InstanceEntry::new(object as u32, DMat4::IDENTITY)],
                Some(object) => {
                    let what = format!("`object` is {}; {} has {count}", object + 1, place.file.display());
                    return Err(of_place(&what));
                }
            };
            names.extend(placed.iter().map(|_| place.name.clone()));
            wanted.extend(placed.iter().map(|one| (number, one.object, place.mesh_to_scene * one.matrix())));
        }
        let first: Vec<u32> = octrees
            .iter()
            .scan(0, |next, octree| {
                let first = *next;
                *next += octree.objects().len() as u32;
                Some(first)
            })
            .collect();
        let instances = wanted
            .into_iter()
            .map(|(number, object, place)| InstanceEntry::new(first[number] + object, place))
            .collect();
        let octree = if octrees.len() == 1 {
            octrees.remove(0)
        } else {
            let bytes = octrees.iter().map(|octree| size_of_val(octree.slots())).sum();
            check_memory(bytes, &format!("{}: {} octrees", path.display(), octrees.len()))?;
            join(&octrees.iter().collect::<Vec<_>>()).map_err(|error| name_file(path, error))?
        };
        Ok(Self { octree, instances, names, files })
    }
}
