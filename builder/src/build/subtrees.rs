//! A build of a displaced mesh, subtree by subtree: the small triangles of one subtree at a time for each thread.
//!
//! The octree is divided from the root until a cube holds few enough small triangles, estimated from the [tiles](Tiles) that meet
//! it. For such a cube its part of the displaced mesh is made, built like any other mesh, and dropped. All that the recursion
//! asks about the surface in a voxel depends on the triangles that meet the voxel, and for the kinds of their edges on the
//! triangles at edges that meet it. So a part has the triangles that meet the cube and a margin around it, and everything below
//! the cube is as of the whole mesh, in every bit.
//!
//! Voxels above are those with a descendant. Their attributes are means of their children. They have no contours, and pass no
//! slabs down: a whole build gives none to a voxel with so much surface, either.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use esvo_format::{BlockStore, Tree, Voxel as TreeVoxel, pack};
use glam::{DMat4, DVec3};

use super::journal::Journal;
use super::progress::Progress;
use super::recursion::{Cube, Part, Recursion, block_nodes, cut, set_components};
use crate::displace::{Bounds, Parts, Source, Tiles};
use crate::surface::attributes::Mean;
use crate::surface::prepared::place;
use crate::surface::properties::columns;
use crate::surface::{Look, Surface};
use crate::{BuildError, BuildSettings, DisplaceOptions, Mesh};

/// Most small triangles of one subtree, about. Fixed, so that the octree depends neither on the memory nor on the threads.
const MOST: usize = 1 << 18;
/// Bytes for a small triangle, its prepared surface and its pieces.
const BYTES_PER_TRIANGLE: usize = 400;
/// Subtrees have at least so many levels: the fewer, the more of their triangles are in several.
const LEAST_LEVELS: u32 = 4;
/// Roots of subtrees are on this level at most: a path fits into 32 bits.
const DEEPEST: u32 = 9;
/// A part reaches this far beyond its cube, in edges of the cube: more than the clearance with which voxels look at edges.
const MARGIN: f64 = 2e-6;

/// A displaced mesh, ready to be built subtree by subtree.
pub(super) struct Subtrees<'a> {
    settings: &'a BuildSettings,
    parts: Parts<'a>,
    tiles: Tiles,
    pub(super) octree_to_mesh: DMat4,
    looks: Arc<[Look]>,
    /// Most small triangles of a subtree.
    most: f64,
}

/// What a build found.
pub(super) struct Found {
    /// Number of the root block; `None` if there is no surface.
    pub(super) root: Option<u32>,
    /// Small triangles.
    pub(super) triangles: u64,
    /// Those among them without an area.
    pub(super) dropped: u64,
}

/// A finished subtree.
#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Finished {
    pub(super) part: Waiting,
    pub(super) voxels: u64,
    /// Small triangles whose first corner is in the cube.
    pub(super) triangles: u64,
    /// Those among them without an area.
    pub(super) dropped: u64,
}

/// A finished subtree that waits for the others, as bytes: the descriptors of all subtrees that are not in a block yet would take
/// gigabytes on deep levels, and less than a tenth of it in this form. `None` if nothing is in it.
#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Waiting(Option<Vec<u8>>);

impl Waiting {
    fn new(part: Option<&Part>) -> Result<Self, BuildError> {
        let mut bytes = part.map(postcard::to_stdvec).transpose().map_err(Self::failed)?;
        bytes.iter_mut().for_each(Vec::shrink_to_fit);
        Ok(Self(bytes))
    }

    fn part(self) -> Result<Option<Part>, BuildError> {
        self.0.map(|bytes| postcard::from_bytes(&bytes)).transpose().map_err(Self::failed)
    }

    fn failed(error: postcard::Error) -> BuildError {
        BuildError::io(Path::new("a finished subtree"), std::io::Error::other(error))
    }
}

/// A subtree to be built.
struct Task {
    /// Slots from the root to its cube.
    path: Vec<usize>,
    cube: Cube,
    /// The triangles of the mesh that may meet it, ascending.
    triangles: Vec<u32>,
    /// Approximate number of small triangles.
    count: f64,
}

impl Task {
    /// The path as a number: a one, then three bits for each slot.
    fn number(&self) -> u32 {
        self.path.iter().fold(1, |number, &slot| number << 3 | slot as u32)
    }
}

/// Part of a [displaced](crate::displace) mesh: its triangles that meet a cube, which are diced when they are asked for.
#[derive(Clone, Copy)]
pub struct DisplacedPart<'a>(Which<'a>);

#[derive(Clone, Copy)]
enum Which<'a> {
    /// A mesh of which nothing moves.
    Whole(&'a Mesh),
    Cube(&'a Subtrees<'a>, &'a Task),
}

impl<'a> DisplacedPart<'a> {
    pub(super) fn whole(mesh: &'a Mesh) -> Self {
        Self(Which::Whole(mesh))
    }

    fn of_cube(subtrees: &'a Subtrees<'a>, task: &'a Task) -> Self {
        Self(Which::Cube(subtrees, task))
    }

    /// The least and greatest corner of the cube in mesh units. The cubes of all parts fill the space that the displaced surface is in, and
    /// overlap in faces only. The part has every triangle of the displaced mesh that reaches into the cube, or up to a millionth of
    /// the cube's edge away from it.
    pub fn cube(&self) -> [[f64; 3]; 2] {
        match self.0 {
            Which::Whole(mesh) => {
                let (low, high) = mesh.bounds().unwrap_or_default();
                [low, high]
            }
            Which::Cube(subtrees, task) => {
                let Bounds { low, high } = subtrees.bounds_of(task.cube, 0.0);
                [low.to_array(), high.to_array()]
            }
        }
    }

    /// The triangles: those whose bounds meet the cube, in the order of the whole displaced mesh. There may be none.
    pub fn triangles(&self) -> Cow<'a, Mesh> {
        match self.0 {
            Which::Whole(mesh) => Cow::Borrowed(mesh),
            Which::Cube(subtrees, task) => {
                Cow::Owned(subtrees.parts.within(&task.triangles, &subtrees.bounds_of(task.cube, MARGIN)))
            }
        }
    }
}

/// How a cube is built.
enum Plan {
    /// Nothing meets it.
    Nothing,
    /// As the subtree with this number.
    Task(usize),
    /// From its children.
    Split(Box<[Plan; 8]>),
}

/// Stops the other threads if this one panics, as the caller's report of progress may.
struct StopOthers<'w>(&'w AtomicBool);

impl Drop for StopOthers<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

impl<'a> Subtrees<'a> {
    /// Dices nothing yet but the edges of the mesh, and finds the root cube.
    pub(super) fn new(
        source: &'a Source,
        options: &'a DisplaceOptions,
        settings: &'a BuildSettings,
    ) -> Result<Self, BuildError> {
        let parts = Parts::new(source, options);
        let most = options.max_triangles.min(MOST) as f64;
        // So that about a hundred fit into a subtree.
        let tiles = parts.tiles((most.sqrt() / 8.0).max(4.0) as u32);
        let Bounds { low, high } = parts.bounds(&tiles);
        if low.cmpgt(high).any() {
            return Err(BuildError::Mesh("none of its triangles has an area; a mesh needs at least one".into()));
        }
        let octree_to_mesh = place(low, high, settings.levels)?;
        let looks = Look::all(&source.mesh, settings.texture_test, settings.components);
        Ok(Self { settings, parts, tiles, octree_to_mesh, looks, most })
    }

    /// Bytes in memory besides the mesh: what all threads share, and what each needs for its subtree.
    pub(super) fn bytes(&self) -> (u64, u64) {
        let shared = self.parts.bytes() + self.tiles.list.len() * 40;
        (shared as u64, (self.most as usize * BYTES_PER_TRIANGLE) as u64)
    }

    /// Builds the octree on this many threads.
    pub(super) fn run(
        &self,
        threads: usize,
        store: &BlockStore,
        journal: Option<&Journal>,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Found, BuildError> {
        let (tasks, children) = self.tasks();
        let mut finished = self.build(&tasks, threads, store, journal, progress)?;
        let mut found = Found { root: None, triangles: 0, dropped: 0 };
        for one in finished.values() {
            found.triangles += one.triangles;
            found.dropped += one.dropped;
        }
        if let Some((tree, _)) = self.join(Cube::ROOT, *children, &mut finished, store)? {
            found.root = Some(store.put(pack(&tree, None, &self.settings.assemble)?)?);
        }
        Ok(found)
    }

    /// The subtrees to be built, and how the children of the root cube come from them.
    fn tasks(&self) -> (Vec<Task>, Box<[Plan; 8]>) {
        let mut tasks = Vec::new();
        let all: Vec<u32> = (0..self.tiles.list.len() as u32).collect();
        let children = self.divide(Cube::ROOT, &mut Vec::new(), &all, &mut tasks);
        (tasks, children)
    }

    /// Divides a cube until its parts have few enough triangles. `tiles` are those that may meet it.
    fn divide(&self, cube: Cube, path: &mut Vec<usize>, tiles: &[u32], tasks: &mut Vec<Task>) -> Box<[Plan; 8]> {
        Box::new(std::array::from_fn(|slot| {
            let child = cube.child(slot);
            let bounds = self.bounds_of(child, MARGIN);
            let inside: Vec<u32> = tiles.iter().copied().filter(|&tile| self.tiles.meets(tile, &bounds)).collect();
            if inside.is_empty() {
                return Plan::Nothing;
            }
            path.push(slot);
            let count = inside.iter().map(|&tile| f64::from(self.tiles.list[tile as usize].count)).sum();
            let may_split = child.level + LEAST_LEVELS <= self.settings.levels && child.level < DEEPEST;
            let plan = if count > self.most && may_split {
                Plan::Split(self.divide(child, path, &inside, tasks))
            } else {
                let mut triangles: Vec<u32> =
                    inside.iter().map(|&tile| self.tiles.list[tile as usize].triangle).collect();
                triangles.dedup();
                tasks.push(Task { path: path.clone(), cube: child, triangles, count });
                Plan::Task(tasks.len() - 1)
            };
            path.pop();
            plan
        }))
    }

    /// A cube in mesh space, larger on all sides by `margin` of its edge.
    fn bounds_of(&self, cube: Cube, margin: f64) -> Bounds {
        let reach = cube.size * (0.5 + margin);
        let at = |p: DVec3| self.octree_to_mesh.w_axis.truncate() + p * self.octree_to_mesh.x_axis.x;
        Bounds { low: at(cube.centre - reach), high: at(cube.centre + reach) }
    }

    fn build(
        &self,
        tasks: &[Task],
        threads: usize,
        store: &BlockStore,
        journal: Option<&Journal>,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<HashMap<usize, Finished>, BuildError> {
        let all = tasks.iter().map(|task| task.count).sum::<f64>();
        let finished = Mutex::new((HashMap::new(), 0.0, 0));
        on_threads(tasks, threads, |number, task| {
            let one = match journal.and_then(|journal| journal.finished_part(task.number())) {
                Some(one) => one,
                None => {
                    let one = self.build_part(task, store)?;
                    if let Some(journal) = journal {
                        journal.finish_part(task.number(), &one, store)?;
                    }
                    one
                }
            };
            let mut finished = finished.lock().unwrap_or_else(PoisonError::into_inner);
            let (finished, done, voxels) = &mut *finished;
            *done += task.count;
            *voxels += one.voxels;
            finished.insert(number, one);
            progress(Progress { done: (*done / all).min(1.0), voxels: *voxels, resumed: 0 });
            Ok(())
        })?;
        Ok(finished.into_inner().unwrap_or_else(PoisonError::into_inner).0)
    }

    /// Passes the cubes whose subtrees would be built at once to `order`, and calls `visit` with those that it returns, one after the
    /// other, on all threads.
    pub(super) fn visit<T: Sync>(
        &self,
        threads: usize,
        order: impl FnOnce(&[DisplacedPart<'_>]) -> Vec<(usize, T)>,
        visit: impl Fn(&DisplacedPart<'_>, &T) + Sync,
    ) -> Result<(), BuildError> {
        let tasks = self.tasks().0;
        let parts: Vec<_> = tasks.iter().map(|task| DisplacedPart::of_cube(self, task)).collect();
        on_threads(&order(&parts), threads, |_, (part, with)| {
            if let Some(part) = parts.get(*part) {
                visit(part, with);
            }
            Ok(())
        })
    }

    fn build_part(&self, task: &Task, store: &BlockStore) -> Result<Finished, BuildError> {
        let finest = (-f64::from(self.settings.levels)).exp2();
        let margin = MARGIN.max(finest / task.cube.size);
        let mesh = self.parts.within(&task.triangles, &self.bounds_of(task.cube, margin));
        if mesh.triangles.is_empty() {
            return Ok(Finished::default());
        }
        let looks = Arc::clone(&self.looks);
        let surface = Surface::part(&mesh, self.octree_to_mesh, looks, self.settings);
        let corners = surface.corners.iter().map(|corners| corners[0]);
        let with_area = corners.filter(|&p| is_counted(task.cube, p)).count() as u64;
        let first = mesh.triangles.iter().map(|t| DVec3::from(mesh.positions[t[0] as usize]));
        let scale = 1.0 / self.octree_to_mesh.x_axis.x;
        let in_octree = |p: DVec3| (p - self.octree_to_mesh.w_axis.truncate()) * scale;
        let triangles = first.filter(|&p| is_counted(task.cube, in_octree(p))).count() as u64;
        if surface.len() == 0 {
            return Ok(Finished { triangles, dropped: triangles, ..Finished::default() });
        }
        let recursion = Recursion::new(&surface, self.settings, store, None, &|_| ());
        let part = recursion.part(&task.path)?;
        Ok(Finished {
            part: Waiting::new(part.as_ref())?,
            voxels: recursion.voxels(),
            triangles,
            dropped: triangles - with_area,
        })
    }

    /// Joins the finished children of a cube.
    fn join(
        &self,
        cube: Cube,
        children: [Plan; 8],
        finished: &mut HashMap<usize, Finished>,
        store: &BlockStore,
    ) -> Result<Option<(Tree, Mean)>, BuildError> {
        let mut parts: [Option<Part>; 8] = Default::default();
        for (slot, (part, plan)) in parts.iter_mut().zip(children).enumerate() {
            *part = match plan {
                Plan::Nothing => None,
                Plan::Task(task) => finished.remove(&task).map_or(Ok(None), |finished| finished.part.part())?,
                Plan::Split(children) => {
                    self.join(cube.child(slot), *children, finished, store)?.map(|(tree, mean)| {
                        let (color, normal) = mean.encode();
                        let color = self.settings.colors.then_some(color);
                        let normal = self.settings.normals.then_some(normal);
                        let voxel = TreeVoxel { color, normal, contour: None, leaf: false };
                        Part { voxel, tree: Some(tree), mean }
                    })
                }
            };
        }
        if parts.iter().all(Option::is_none) {
            return Ok(None);
        }
        let mut tree = Tree::default();
        tree.plain = self.settings.plain_attributes;
        tree.columns = columns(&self.looks);
        let node = tree.open(&std::array::from_fn(|slot| parts[slot].as_ref().map(|part| part.voxel)));
        for (slot, part) in parts.iter().enumerate() {
            let Some(part) = part else { continue };
            set_components(&mut tree, node, slot, &part.mean);
            if let Some(subtree) = &part.tree {
                tree.append(subtree);
            }
        }
        tree.close(node);
        let nodes = block_nodes(&self.settings.assemble);
        cut(&mut tree, node, &cube, nodes, self.settings, store)?;
        Ok(Some((tree, Mean::of_parts(parts.iter().flatten().map(|part| &part.mean)))))
    }
}

/// Calls `work` with all tasks, on this many threads. After an error no other task is begun.
fn on_threads<T: Sync>(
    tasks: &[T],
    threads: usize,
    work: impl Fn(usize, &T) -> Result<(), BuildError> + Sync,
) -> Result<(), BuildError> {
    // Each thread has a pool of its own. In a common one, a thread that waits for a part of its subtree would begin another
    // subtree meanwhile, and hold the triangles of both.
    let pools: Vec<_> = (0..threads.min(tasks.len()))
        .map(|_| rayon::ThreadPoolBuilder::new().num_threads(1).build())
        .collect::<Result<_, _>>()
        .map_err(|e| BuildError::Threads(e.to_string()))?;
    let (next, failed, error) = (AtomicUsize::new(0), AtomicBool::new(false), Mutex::new(None));
    let until_none_is_left = || {
        let _stop = StopOthers(&failed);
        while !failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(task) = tasks.get(number) else { return };
            if let Err(found) = work(number, task) {
                failed.store(true, Ordering::Relaxed);
                error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(found);
            }
        }
    };
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| pool.install(until_none_is_left));
        }
    });
    error.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
}

/// Whether a point is counted to a cube: each point to one cube of any that together fill the root cube. Points outside of the
/// root cube count to the nearest.
fn is_counted(cube: Cube, p: DVec3) -> bool {
    let p = p.clamp(DVec3::ZERO, DVec3::splat(1.0f64.next_down()));
    let low = cube.centre - cube.size * 0.5;
    p.cmpge(low).all() && p.cmplt(low + cube.size).all()
}

#[cfg(test)]
mod tests;
