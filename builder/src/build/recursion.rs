//! The recursion from the root cube to the leaves. Subtrees that have become large enough are packed into blocks and stored.
//!
//! Sibling cubes are split two by two, in the order of their slots, because their children share a block of attributes
//! (`build/pair.rs`).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use esvo_format::{AssembleOptions, BlockStore, Tree, Voxel as TreeVoxel, pack};
use glam::DVec3;
use rayon::prelude::*;

use super::journal::{Finished, Journal};
use super::pair::{Bounds, Child, Decider, Found, Pair, Parent};
use super::progress::Progress;
use super::share::{Top, top_key};
use crate::clip::{Arena, Piece};
use crate::shape::plane::Through;
use crate::shape::shaper::Shaper;
use crate::surface::Surface;
use crate::surface::attributes::Mean;
use crate::{BuildError, BuildSettings};

/// Voxels down to this level are built as separate parallel tasks.
const PARALLEL_LEVELS: u32 = 5;
/// Level of the cubes that are recorded in the journal when they are finished.
pub(super) const JOURNAL_LEVEL: u32 = 4;

/// Share of the settings' bound of the shape that voxels keep to. With the whole of it, depths in a picture were up to 5 % further
/// off than those of the authors' octrees of the same settings; with this share they are nearer, and files are still smaller
/// (results/README.md).
const STRICTNESS: f64 = 0.8;

/// A cube of the octree.
#[derive(Clone, Copy)]
pub(crate) struct Cube {
    pub(crate) centre: DVec3,
    pub(crate) size: f64,
    pub(crate) level: u32,
}

impl Cube {
    pub(crate) const ROOT: Self = Self { centre: DVec3::splat(0.5), size: 1.0, level: 0 };

    pub(crate) fn child(&self, slot: usize) -> Self {
        let quarter = self.size * 0.25;
        let offset = std::array::from_fn(|axis| if slot >> axis & 1 != 0 { quarter } else { -quarter });
        Self { centre: self.centre + DVec3::from(offset), size: self.size * 0.5, level: self.level + 1 }
    }

    /// Lower corner in units of 2^-23 of the root, and scale. Exact: corners are multiples of 2^-23.
    pub(super) fn address(&self) -> ([u32; 3], u32) {
        let corner = (self.centre - self.size * 0.5) * f64::from(1u32 << 23);
        (corner.to_array().map(|c| c as u32), 23 - self.level)
    }
}

pub(crate) struct Recursion<'a> {
    pub(super) surface: &'a Surface<'a>,
    pub(super) settings: &'a BuildSettings,
    pub(super) decider: Decider<'a>,
    /// Whether the voxels of this build are cubes without holes, so that the short way is taken (`build/cubes.rs`).
    pub(super) cubes_only: bool,
    store: &'a BlockStore,
    journal: Option<&'a Journal>,
    /// Subtrees with more nodes than this become blocks.
    block_nodes: usize,
    /// In a build of a part: the paths of the cubes on [`JOURNAL_LEVEL`] that belong to it, and the nodes above these cubes.
    share: Option<&'a BTreeSet<u32>>,
    tops: Option<Mutex<BTreeMap<u32, Top>>>,
    progress: &'a (dyn Fn(Progress) + Sync),
    /// Finished parts of the root cube, in units of `1 / 8^PARALLEL_LEVELS`.
    done: AtomicU64,
    voxels: AtomicU64,
    failed: AtomicBool,
    error: Mutex<Option<BuildError>>,
}

/// A cube to be split.
#[derive(Clone, Copy)]
pub(super) struct Split<'a> {
    pub(super) cube: Cube,
    /// The slots that lead from the root to the cube, three bits each, the last slot lowest.
    pub(super) path: u32,
    pub(super) surface: Source<'a>,
    pub(super) bounds: &'a Bounds,
}

/// Where the surface in a cube comes from.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    /// Pieces in the worker's list: the first, and the one after the last.
    Pieces(usize, usize),
    /// One triangle that cuts through the cube.
    Through(&'a Through),
}

/// The means of the attributes in one or two cubes; `None` for a cube without surface.
type Means = [Option<Mean>; 2];

/// A finished voxel.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Part {
    pub(crate) voxel: TreeVoxel,
    /// What is below it; `None` for a leaf.
    pub(crate) tree: Option<Tree>,
    /// The mean that its attributes are encoded from.
    pub(crate) mean: Mean,
}

/// What one thread needs on its way down the octree.
#[derive(Default)]
pub(super) struct Worker {
    pub(super) arena: Arena,
    shaper: Shaper,
    /// Stack of the pieces in the voxels on the current path and in their siblings.
    pub(super) pieces: Vec<Piece>,
    sorted: Vec<(u8, Piece)>,
    /// Unused storage for the children of two cubes. Taken while the cubes are processed, and put back after.
    pairs: Vec<Box<Pair>>,
    pub(super) tree: Tree,
    pub(super) voxels: u64,
}

/// Appends pieces to a list in the order of their slots. Returns where the pieces of each slot begin, and the end of the last.
pub(crate) fn append_by_slot(of_slots: &[(u8, Piece)], list: &mut Vec<Piece>) -> [usize; 9] {
    let mut counts = [0; 8];
    for (slot, _) in of_slots {
        counts[usize::from(*slot)] += 1;
    }
    let mut ends = [list.len(); 9];
    for slot in 0..8 {
        ends[slot + 1] = ends[slot] + counts[slot];
    }
    list.resize(ends[8], Piece::whole(0));
    let mut next = ends;
    for (slot, piece) in of_slots {
        let place = &mut next[usize::from(*slot)];
        list[*place] = *piece;
        *place += 1;
    }
    ends
}

/// The number of nodes above which a subtree becomes a block.
///
/// Larger subtrees of a node's children have become blocks before the node is considered. So a block has at most eight times
/// as many nodes, plus the group of siblings at its root: even if every group has an odd size and every pointer is far, it
/// fits into `block_slots`.
pub(crate) fn block_nodes(options: &AssembleOptions) -> usize {
    (options.block_slots / 64).max(1) as usize
}

/// Turns the subtree of a node that has just been closed into a block if it has more than `block_nodes` nodes.
pub(crate) fn cut(
    tree: &mut Tree,
    node: usize,
    cube: &Cube,
    block_nodes: usize,
    settings: &BuildSettings,
    store: &BlockStore,
) -> Result<(), BuildError> {
    if tree.nodes.len() - node > block_nodes && cube.level > 0 {
        let detached = tree.detach(node);
        // If this fails, the detached node is missing from the tree. The build fails, so nobody reads the tree.
        tree.attach(store.put(pack(&detached, Some(cube.address()), &settings.assemble)?)?);
    }
    Ok(())
}

/// Ends a node whose children's subtrees have been pushed. `found` has the mean of each child that is not a leaf; `None`: alpha cuts out all of
/// the surface in it, or the surface passes it within the margin, and it is removed. Sets the attributes of the others unless the
/// block `keeps` them as they are. Returns the mean of all children; `None`, and the node is gone, if none is left.
pub(super) fn end_node(
    tree: &mut Tree,
    node: usize,
    children: &mut [Child; 8],
    found: &[Option<Mean>; 8],
    keeps: bool,
    settings: &BuildSettings,
) -> Option<Mean> {
    let stores = settings.stores_attributes() || !tree.columns.is_empty();
    for (slot, child) in children.iter_mut().enumerate() {
        if child.voxel.is_none_or(|voxel| voxel.leaf) {
            continue;
        }
        match found[slot] {
            Some(mean) => {
                if !keeps && settings.stores_attributes() {
                    let (color, normal) = mean.encode();
                    let (color, normal) = settings.wanted(color, normal);
                    tree.set_attributes(node, slot, color, normal);
                }
                child.mean = mean;
            }
            None => {
                tree.remove_voxel(node, slot);
                child.voxel = None;
            }
        }
    }
    let left = || children.iter().filter(|child| child.voxel.is_some()).map(|child| &child.mean);
    if left().next().is_none() {
        tree.cancel(node);
        return None;
    }
    if !tree.columns.is_empty() {
        for (slot, child) in children.iter().enumerate().filter(|(_, child)| child.voxel.is_some()) {
            set_components(tree, node, slot, &child.mean);
        }
    }
    tree.close(node);
    Some(if stores { Mean::of_parts(left()) } else { Mean::default() })
}

/// Sets the components of a voxel, for which the tree has columns.
pub(super) fn set_components(tree: &mut Tree, node: usize, slot: usize, mean: &Mean) {
    for column in 0..tree.columns.len() {
        let words = mean.extra.encode(mean.weight, &tree.columns[column]);
        tree.set_components(node, slot, column, &words);
    }
}

impl<'a> Recursion<'a> {
    pub(crate) fn new(
        surface: &'a Surface<'a>,
        settings: &'a BuildSettings,
        store: &'a BlockStore,
        journal: Option<&'a Journal>,
        progress: &'a (dyn Fn(Progress) + Sync),
    ) -> Self {
        Self {
            surface,
            settings,
            decider: Decider {
                surface,
                settings,
                deviation: STRICTNESS * (-settings.contour_error).exp2() * 3f64.sqrt(),
            },
            cubes_only: !settings.contours && !surface.has_holes,
            store,
            journal,
            block_nodes: block_nodes(&settings.assemble),
            share: None,
            tops: None,
            progress,
            done: AtomicU64::new(0),
            voxels: AtomicU64::new(0),
            failed: AtomicBool::new(false),
            error: Mutex::new(None),
        }
    }

    /// Builds the octree and returns the number of the root block in the store; `None` if there is no surface.
    pub(crate) fn run(&self) -> Result<Option<u32>, BuildError> {
        let (worker, mean) = self.run_root();
        if let Some(error) = self.error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(error);
        }
        let Some(_) = mean else { return Ok(None) };
        Ok(Some(self.store.put(pack(&worker.tree, None, &self.settings.assemble)?)?))
    }

    /// Builds what is in these cubes of [`JOURNAL_LEVEL`] into the journal. Returns the nodes above these cubes, whole, by their
    /// [keys](top_key), and the number of voxels.
    pub(super) fn run_share(mut self, share: &'a BTreeSet<u32>) -> Result<(BTreeMap<u32, Top>, u64), BuildError> {
        (self.share, self.tops) = (Some(share), Some(Mutex::default()));
        self.run_root();
        if let Some(error) = self.error.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        let tops = self.tops.unwrap_or_default().into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok((tops, self.voxels.into_inner()))
    }

    /// Splits the root cube.
    fn run_root(&self) -> (Worker, Option<Mean>) {
        let mut worker = self.worker();
        worker.pieces = (0..self.surface.len() as u32).map(Piece::whole).collect();
        let surface = Source::Pieces(0, worker.pieces.len());
        let root = Split { cube: Cube::ROOT, path: 0, surface, bounds: &Bounds::default() };
        let [mean, _] = self.split(&mut worker, &[Some(root), None]);
        (worker, mean)
    }

    /// Builds the voxel that a path of slots leads to, with its subtree. `None` if there is no surface in it. The path is not
    /// empty.
    ///
    /// Of the surface only what is in the voxel needs to be there. The pieces are cut level by level as in a build from the root,
    /// so the result is the same in every bit, if the ancestors have no contours that bound the voxel, and if no leaf is so near to
    /// the voxel that it shares a block of attributes with the voxel's siblings.
    pub(crate) fn part(&self, path: &[usize]) -> Result<Option<Part>, BuildError> {
        let mut worker = self.worker();
        worker.pieces = (0..self.surface.len() as u32).map(Piece::whole).collect();
        let (mut parent, mut cube, mut range) = (Cube::ROOT, Cube::ROOT, 0..worker.pieces.len());
        for &slot in path {
            let ends = self.distribute(&mut worker, cube, range);
            (parent, cube, range) = (cube, cube.child(slot), ends[slot]..ends[slot + 1]);
        }
        let slot = path.last().copied().unwrap_or(0);
        let ends = std::array::from_fn(|end| if end <= slot { range.start } else { range.end });
        let Worker { arena, pieces, shaper, .. } = &mut worker;
        let found = Found::Pieces { arena, pieces, ends };
        let mut pair = Pair::default();
        let parents = [Some(Parent { cube: parent, found, bounds: &Bounds::default() }), None];
        self.decider.decide(shaper, &mut pair, &parents);
        let Child { voxel: Some(mut voxel), bounds, mut mean, .. } = pair.children[0][slot].clone() else {
            return Ok(None);
        };
        worker.voxels += 1;
        let mut tree = None;
        if !voxel.leaf {
            let split = Split { cube, path: 0, surface: Source::Pieces(range.start, range.end), bounds: &bounds };
            let [found, _] = self.split(&mut worker, &[Some(split), None]);
            if let Some(found) = found {
                let (color, normal) = found.encode();
                (voxel.color, voxel.normal) = self.settings.wanted(color, normal);
                (tree, mean) = (Some(std::mem::take(&mut worker.tree)), found);
            }
        }
        self.voxels.fetch_add(worker.voxels, Ordering::Relaxed);
        if let Some(error) = self.error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(error);
        }
        Ok((voxel.leaf || tree.is_some()).then_some(Part { voxel, tree, mean }))
    }

    /// The number of voxels so far.
    pub(crate) fn voxels(&self) -> u64 {
        self.voxels.load(Ordering::Relaxed)
    }

    fn worker(&self) -> Worker {
        let mut worker = Worker::default();
        worker.tree.plain = self.settings.plain_attributes;
        worker.tree.columns = self.surface.columns.clone();
        worker
    }

    /// Builds the subtrees of one or two sibling cubes, which are nodes of their parent, and pushes them to the worker's tree.
    fn split(&self, worker: &mut Worker, cubes: &[Option<Split>; 2]) -> Means {
        if self.cubes_only && cubes.iter().flatten().all(|split| split.cube.level >= PARALLEL_LEVELS) {
            return [0, 1].map(|k| self.push_cubes(worker, cubes[k].as_ref()?));
        }
        let (arena_mark, pieces_mark) = (worker.arena.mark(), worker.pieces.len());
        let through = |split: &Option<Split>| self.through(worker, split.as_ref()?);
        // Not `map`, which copies what it has made.
        let own: [Option<Through>; 2] = [through(&cubes[0]), through(&cubes[1])];
        let cubes: [Option<Split>; 2] = std::array::from_fn(|k| {
            let split = cubes[k]?;
            Some(Split { surface: own[k].as_ref().map_or(split.surface, Source::Through), ..split })
        });
        let ends = [0, 1].map(|k| match cubes[k] {
            Some(Split { cube, surface: Source::Pieces(first, end), .. }) => self.distribute(worker, cube, first..end),
            _ => [0; 9],
        });
        let mut pair = worker.pairs.pop().unwrap_or_default();
        let Worker { arena, pieces, shaper, .. } = worker;
        let parents = [0, 1].map(|k| {
            let Split { cube, surface, bounds, .. } = cubes[k]?;
            let found = match surface {
                Source::Pieces(..) => Found::Pieces { arena, pieces, ends: ends[k] },
                Source::Through(through) => Found::Through(through),
            };
            Some(Parent { cube, found, bounds })
        });
        self.decider.decide(shaper, &mut pair, &parents);
        let keeps = pair.keeps_attributes;
        let means = [0, 1].map(|k| {
            let children = &mut pair.children[k];
            cubes[k].and_then(|split| self.push(worker, &split, &ends[k], children, keeps))
        });
        worker.pairs.push(pair);
        worker.pieces.truncate(pieces_mark);
        worker.arena.truncate(arena_mark);
        means
    }

    /// The only triangle in a cube, if it cuts through all of it.
    #[inline(always)]
    pub(super) fn through(&self, worker: &Worker, split: &Split) -> Option<Through> {
        let Source::Pieces(first, end) = split.surface else { return None };
        if end - first != 1 {
            return None;
        }
        Through::new(self.surface, worker.pieces[first].triangle, split.cube.centre, split.cube.size)
    }

    /// Distributes the pieces in a cube to its children, and appends those of each child to the worker's list. Returns where
    /// the pieces of each child begin, and the end of the last.
    pub(super) fn distribute(&self, worker: &mut Worker, cube: Cube, range: Range<usize>) -> [usize; 9] {
        worker.sorted.clear();
        for piece in &worker.pieces[range] {
            let sorted = &mut worker.sorted;
            worker.arena.split(piece, &self.surface.corners, cube.centre, |slot, part| sorted.push((slot as u8, part)));
        }
        self.remove_holes(&worker.arena, &mut worker.sorted);
        append_by_slot(&worker.sorted, &mut worker.pieces)
    }

    /// Pushes the node of a cube and the subtrees of the children that are not leaves. Sets the attributes of these children
    /// unless the block `keeps` them as they are. Returns the mean of all children; `None`, and pushes nothing, if there are
    /// none.
    fn push(
        &self,
        worker: &mut Worker,
        split: &Split,
        ends: &[usize; 9],
        children: &mut [Child; 8],
        keeps: bool,
    ) -> Option<Mean> {
        let count = children.iter().filter(|c| c.voxel.is_some()).count();
        worker.voxels += count as u64;
        let level = split.cube.level + 1;
        if level <= PARALLEL_LEVELS {
            let ended = children.iter().filter(|c| c.voxel.is_none_or(|voxel| voxel.leaf)).count();
            self.count(level, ended as u64, std::mem::take(&mut worker.voxels));
        }
        if count == 0 {
            return None;
        }
        if let Some(tops) = self.tops.as_ref().filter(|_| split.cube.level < JOURNAL_LEVEL) {
            let mut tops = tops.lock().unwrap_or_else(PoisonError::into_inner);
            tops.insert(top_key(split.path, split.cube.level), Top::of(children, keeps));
        }
        let node = worker.tree.open(&std::array::from_fn(|slot| children[slot].voxel));
        let mut found = [None; 8];
        let (mut slots, mut inner) = ([0; 8], 0);
        for slot in (0..8).filter(|slot| children[*slot].voxel.is_some_and(|voxel| !voxel.leaf)) {
            (slots[inner], inner) = (slot, inner + 1);
        }
        let child = |slot: usize| Split {
            cube: split.cube.child(slot),
            path: split.path << 3 | slot as u32,
            surface: match split.surface {
                Source::Pieces(..) => Source::Pieces(ends[slot], ends[slot + 1]),
                through => through,
            },
            bounds: &children[slot].bounds,
        };
        let pairs = slots[..inner].chunks(2).map(|pair| [Some(child(pair[0])), pair.get(1).map(|slot| child(*slot))]);
        if level <= PARALLEL_LEVELS {
            let pairs: Vec<_> = pairs.collect();
            let parts: Vec<Finished> = pairs.par_iter().map(|pair| self.split_apart(worker, pair)).collect();
            for (k, part) in parts.into_iter().enumerate() {
                worker.tree.append(&part.tree);
                for (slot, mean) in slots[..inner].iter().skip(2 * k).zip(part.means) {
                    found[*slot] = mean;
                }
            }
        } else {
            for (k, pair) in pairs.enumerate() {
                let means = self.split(worker, &pair);
                for (slot, mean) in slots[..inner].iter().skip(2 * k).zip(means) {
                    found[*slot] = mean;
                }
            }
        }
        let mean = end_node(&mut worker.tree, node, children, &found, keeps, self.settings)?;
        self.cut(&mut worker.tree, node, &split.cube);
        Some(mean)
    }

    /// As `split`, for cubes of level [`PARALLEL_LEVELS`] or above, into a tree of their own.
    fn split_apart(&self, worker: &Worker, cubes: &[Option<Split>; 2]) -> Finished {
        let [Some(first), _] = cubes else { return Finished::default() };
        let level = first.cube.level;
        let journal = self.journal.filter(|_| level == JOURNAL_LEVEL);
        if self.failed.load(Ordering::Relaxed) {
            return Finished::default();
        }
        if level == JOURNAL_LEVEL && self.share.is_some_and(|share| !share.contains(&first.path)) {
            self.count(level, cubes.iter().flatten().count() as u64, 0);
            return Finished::default();
        }
        if let Some(finished) = journal.and_then(|journal| journal.finished(first.path)) {
            self.count(level, cubes.iter().flatten().count() as u64, finished.voxels);
            return finished;
        }
        let before = self.voxels.load(Ordering::Relaxed);
        let mut own = self.worker();
        let moved = [0, 1].map(|k| {
            let split = cubes[k]?;
            let Source::Pieces(first, end) = split.surface else { return Some(split) };
            let moved = own.take(worker, first..end);
            Some(Split { surface: Source::Pieces(moved.start, moved.end), ..split })
        });
        let means = self.split(&mut own, &moved);
        if level == PARALLEL_LEVELS {
            self.count(level, cubes.iter().flatten().count() as u64, own.voxels);
        }
        // With several threads some of these voxels belong to other cubes. They only affect the progress that a resumed build
        // shows.
        let voxels = self.voxels.load(Ordering::Relaxed) - before;
        let finished = Finished { tree: own.tree, means, voxels };
        if let Some(journal) = journal
            && !self.failed.load(Ordering::Relaxed)
            && let Err(e) = journal.finish(first.path, &finished, self.store)
        {
            self.fail(e);
        }
        finished
    }

    /// Turns the subtree of a node that has just been closed into a block if it is large enough.
    pub(super) fn cut(&self, tree: &mut Tree, node: usize, cube: &Cube) {
        // Above the cubes of a part, the tree is not whole.
        if self.failed.load(Ordering::Relaxed) || self.tops.is_some() && cube.level < JOURNAL_LEVEL {
            return;
        }
        if let Err(e) = cut(tree, node, cube, self.block_nodes, self.settings, self.store) {
            self.fail(e);
        }
    }

    fn fail(&self, error: BuildError) {
        self.failed.store(true, Ordering::Relaxed);
        self.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Removes pieces of cut-out materials that consist of holes only.
    fn remove_holes(&self, arena: &Arena, list: &mut Vec<(u8, Piece)>) {
        if self.surface.has_holes {
            let corners = &self.surface.corners;
            list.retain(|(_, piece)| !self.surface.is_hole(piece.triangle, arena.vertices(piece, corners)));
        }
    }

    /// Reports that some cubes on this level, at most [`PARALLEL_LEVELS`], are finished, and the number of their voxels.
    fn count(&self, level: u32, cubes: u64, voxels: u64) {
        let parts = cubes << (3 * (PARALLEL_LEVELS - level));
        let done = self.done.fetch_add(parts, Ordering::Relaxed) + parts;
        let voxels = self.voxels.fetch_add(voxels, Ordering::Relaxed) + voxels;
        (self.progress)(Progress { done: done as f64 / (1u64 << (3 * PARALLEL_LEVELS)) as f64, voxels, resumed: 0 });
    }
}

impl Worker {
    /// Appends copies of the pieces of another worker. Returns where they are.
    fn take(&mut self, other: &Self, range: Range<usize>) -> Range<usize> {
        let first = self.pieces.len();
        self.arena.extend(&other.arena, &other.pieces[range], &mut self.pieces);
        first..self.pieces.len()
    }
}
