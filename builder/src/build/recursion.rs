//! The recursion from the root cube to the leaves. Subtrees that have become large enough are packed into blocks and stored.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use esvo_format::{AssembleOptions, BlockStore, RawNormal, Tree, Voxel as TreeVoxel, pack};
use glam::DVec3;
use rayon::prelude::*;

use super::journal::Journal;
use super::progress::Progress;
use crate::clip::{Arena, Piece};
use crate::shape::plane::Through;
use crate::shape::shaper::Shaper;
use crate::shape::slab::Slabs;
use crate::shape::voxel::Shape;
use crate::surface::Surface;
use crate::surface::attributes::{AttributeBounds, Mean, attributes};
use crate::surface::voxel::VoxelSurface;
use crate::{BuildError, BuildSettings};

/// Voxels down to this level are built as separate parallel tasks.
const PARALLEL_LEVELS: u32 = 5;
/// Level of the cubes that are recorded in the journal when they are finished.
const JOURNAL_LEVEL: u32 = 4;

/// A cube of the octree.
#[derive(Clone, Copy)]
pub(crate) struct Cube {
    pub(crate) centre: DVec3,
    size: f64,
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
    fn address(&self) -> ([u32; 3], u32) {
        let corner = (self.centre - self.size * 0.5) * f64::from(1u32 << 23);
        (corner.to_array().map(|c| c as u32), 23 - self.level)
    }
}

pub(crate) struct Recursion<'a> {
    pub(crate) surface: &'a Surface<'a>,
    pub(crate) settings: &'a BuildSettings,
    /// Largest distance of a voxel's shape from the surface, in octree units.
    deviation: f64,
    limits: AttributeBounds,
    store: &'a BlockStore,
    journal: Option<&'a Journal>,
    /// Subtrees with more nodes than this become blocks.
    block_nodes: usize,
    progress: &'a (dyn Fn(Progress) + Sync),
    /// Finished parts of the root cube, in units of `1 / 8^PARALLEL_LEVELS`.
    done: AtomicU64,
    voxels: AtomicU64,
    failed: AtomicBool,
    error: Mutex<Option<BuildError>>,
}

/// The result for one child slot.
#[derive(Clone, Default)]
struct Child {
    /// `None` if there is no surface in the slot.
    voxel: Option<TreeVoxel>,
    /// What bounds the child's shape; only used if it is not a leaf.
    bounds: Bounds,
    /// The mean that its attributes are encoded from.
    mean: Mean,
}

/// What is known about the shape of a voxel from the voxel and its ancestors.
#[derive(Clone, Default)]
struct Bounds {
    /// The shape is within the error bound, and so in every part of the voxel: only attributes can require finer voxels.
    fits: bool,
    /// If not `fits`: the slabs that bound the shape.
    slabs: Slabs,
}

/// Boxed, so that only a pointer is moved.
type ChildrenBox = Box<[Child; 8]>;

/// What one thread needs on its way down the octree.
#[derive(Default)]
struct Worker {
    arena: Arena,
    shaper: Shaper,
    /// Stack of the pieces in the voxels on the current path and in their siblings.
    pieces: Vec<Piece>,
    sorted: Vec<(u8, Piece)>,
    /// Unused storage for the children of a cube. Taken while the cube is processed, and put back after.
    children: Vec<ChildrenBox>,
    tree: Tree,
    voxels: u64,
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
            deviation: (-settings.contour_error).exp2() * 3f64.sqrt(),
            limits: AttributeBounds { color: settings.color_error as f32, normal: settings.normal_error as f32 },
            store,
            journal,
            block_nodes: block_nodes(&settings.assemble),
            progress,
            done: AtomicU64::new(0),
            voxels: AtomicU64::new(0),
            failed: AtomicBool::new(false),
            error: Mutex::new(None),
        }
    }

    /// Builds the octree and returns the number of the root block in the store; `None` if there is no surface.
    pub(crate) fn run(&self) -> Result<Option<u32>, BuildError> {
        let pieces: Vec<Piece> = (0..self.surface.len() as u32).map(Piece::whole).collect();
        let tree = self.split(Cube::ROOT, 0, &Arena::default(), pieces, &Bounds::default());
        if let Some(error) = self.error.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(error);
        }
        let Some(tree) = tree else { return Ok(None) };
        Ok(Some(self.store.put(pack(&tree, None, &self.settings.assemble)?)?))
    }

    /// Builds the subtree of a cube that is split, its children in parallel. `None` if there is no surface in it.
    ///
    /// `path` holds the slots that lead from the root to the cube, three bits each, the last slot lowest.
    fn split(&self, cube: Cube, path: u32, arena: &Arena, pieces: Vec<Piece>, ancestors: &Bounds) -> Option<Tree> {
        if self.failed.load(Ordering::Relaxed) {
            return None;
        }
        if cube.level != JOURNAL_LEVEL {
            return self.split_now(cube, path, arena, pieces, ancestors);
        }
        let Some(journal) = self.journal else { return self.split_now(cube, path, arena, pieces, ancestors) };
        if let Some((tree, voxels)) = journal.finished(path) {
            self.count(cube.level, voxels);
            return tree;
        }
        let before = self.voxels.load(Ordering::Relaxed);
        let tree = self.split_now(cube, path, arena, pieces, ancestors);
        if !self.failed.load(Ordering::Relaxed) {
            // With several threads some of these voxels belong to other cubes. They only affect the progress that a resumed
            // build shows.
            let voxels = self.voxels.load(Ordering::Relaxed) - before;
            if let Err(e) = journal.finish(path, tree.as_ref(), voxels, self.store) {
                self.fail(e);
            }
        }
        tree
    }

    fn split_now(&self, cube: Cube, path: u32, arena: &Arena, pieces: Vec<Piece>, ancestors: &Bounds) -> Option<Tree> {
        let mut own = Worker::default();
        own.tree.plain = self.settings.plain_attributes;
        let (own_arena, pieces) = arena.extract(&pieces);
        own.arena = own_arena;
        own.pieces = pieces;
        if cube.level >= PARALLEL_LEVELS {
            let all = 0..own.pieces.len();
            let found = self.descend(&mut own, cube, all, ancestors);
            self.count(cube.level, own.voxels);
            return found.map(|_| own.tree);
        }
        let mut lists: [Vec<Piece>; 8] = Default::default();
        for piece in std::mem::take(&mut own.pieces) {
            own.arena.split(&piece, &self.surface.corners, cube.centre, |slot, part| lists[slot].push(part));
        }
        let arena = &own.arena;
        let results: Vec<Option<(TreeVoxel, Option<Tree>)>> = (lists.into_par_iter().enumerate())
            .map(|(slot, mut pieces)| {
                let child_cube = cube.child(slot);
                let mut shaper = Shaper::default();
                self.remove_holes(arena, &mut pieces, |piece| piece);
                let mut child = Child::default();
                self.evaluate(&mut shaper, arena, &pieces, cube, slot, ancestors, &mut child);
                let Some(voxel) = child.voxel else {
                    self.count(child_cube.level, 0);
                    return None;
                };
                if voxel.leaf {
                    self.count(child_cube.level, 1);
                    return Some((voxel, None));
                }
                let tree = self.split(child_cube, path << 3 | slot as u32, arena, pieces, &child.bounds);
                // `None`: alpha cuts out all of the surface in the child.
                let tree = tree?;
                self.voxels.fetch_add(1, Ordering::Relaxed);
                Some((voxel, Some(tree)))
            })
            .collect();
        let children: [Option<TreeVoxel>; 8] = std::array::from_fn(|slot| results[slot].as_ref().map(|r| r.0));
        if children.iter().all(Option::is_none) {
            return None;
        }
        let mut tree = Tree::default();
        tree.plain = self.settings.plain_attributes;
        let node = tree.open(&children);
        for (_, subtree) in results.into_iter().flatten() {
            if let Some(subtree) = subtree {
                tree.append(&subtree);
            }
        }
        tree.close(node);
        self.cut(&mut tree, node, &cube);
        Some(tree)
    }

    /// As `split`, on one thread. If there is surface in the cube, its node is pushed to the worker's tree, and the mean of
    /// its attributes returned.
    fn descend(
        &self,
        worker: &mut Worker,
        cube: Cube,
        range: std::ops::Range<usize>,
        ancestors: &Bounds,
    ) -> Option<Mean> {
        if let [piece] = worker.pieces[range.clone()]
            && let Some(through) = Through::new(self.surface, piece.triangle, cube.centre, cube.size)
        {
            return self.descend_through(worker, cube, &through, ancestors);
        }
        let arena_mark = worker.arena.mark();
        let pieces_mark = worker.pieces.len();
        worker.sorted.clear();
        for piece in &worker.pieces[range] {
            let sorted = &mut worker.sorted;
            worker.arena.split(piece, &self.surface.corners, cube.centre, |slot, part| sorted.push((slot as u8, part)));
        }
        self.remove_holes(&worker.arena, &mut worker.sorted, |entry| &entry.1);
        let ends = append_by_slot(&worker.sorted, &mut worker.pieces);
        let mut children = worker.children.pop().unwrap_or_default();
        for (slot, child) in children.iter_mut().enumerate() {
            let pieces = &worker.pieces[ends[slot]..ends[slot + 1]];
            self.evaluate(&mut worker.shaper, &worker.arena, pieces, cube, slot, ancestors, child);
        }
        let mean = self.push_children(worker, &cube, &mut children, |worker, slot, child| {
            self.descend(worker, cube.child(slot), ends[slot]..ends[slot + 1], &child.bounds)
        });
        worker.children.push(children);
        worker.pieces.truncate(pieces_mark);
        worker.arena.truncate(arena_mark);
        mean
    }

    /// As `descend`, in a cube that one triangle cuts completely.
    fn descend_through(&self, worker: &mut Worker, cube: Cube, through: &Through, ancestors: &Bounds) -> Option<Mean> {
        let settings = self.settings;
        let (size, deepest) = (cube.size * 0.5, cube.level + 1 == settings.levels);
        let mut children = worker.children.pop().unwrap_or_default();
        for (slot, child) in children.iter_mut().enumerate() {
            child.voxel = None;
            let centre = cube.child(slot).centre;
            let height = through.height(centre);
            if !through.meets(height, size) {
                continue;
            }
            let bounds = &mut child.bounds;
            let mut shape = Shape { contour: None, fits: ancestors.fits };
            if !ancestors.fits && settings.contours {
                bounds.slabs.inherit(&ancestors.slabs, slot);
                shape = through.shape(height, size, &mut bounds.slabs, self.deviation, deepest);
            }
            bounds.fits = shape.fits;
            // The attributes come from a single sample, so they are uniform.
            let leaf = deepest || shape.fits;
            let mut voxel = TreeVoxel { contour: shape.contour, leaf, ..self.without_attributes() };
            if leaf {
                let attributes = through.attributes(self.surface, centre, height, size);
                child.mean = attributes.mean;
                (voxel.color, voxel.normal) = self.wanted(attributes.color, attributes.normal);
            }
            child.voxel = Some(voxel);
        }
        let mean = self.push_children(worker, &cube, &mut children, |worker, slot, child| {
            self.descend_through(worker, cube.child(slot), through, &child.bounds)
        });
        worker.children.push(children);
        mean
    }

    /// Pushes the node of a cube and, by calling `descend`, the subtrees of the children that are not leaves. Sets the
    /// attributes of these children. Returns the mean of all children.
    fn push_children(
        &self,
        worker: &mut Worker,
        cube: &Cube,
        children: &mut [Child; 8],
        descend: impl Fn(&mut Worker, usize, &Child) -> Option<Mean>,
    ) -> Option<Mean> {
        let mut count = children.iter().filter(|c| c.voxel.is_some()).count();
        worker.voxels += count as u64;
        if count == 0 {
            return None;
        }
        let node = worker.tree.open(&std::array::from_fn(|slot| children[slot].voxel));
        for (slot, child) in children.iter_mut().enumerate() {
            if child.voxel.is_none_or(|voxel| voxel.leaf) {
                continue;
            }
            match descend(worker, slot, child) {
                Some(mean) => {
                    let (color, normal) = mean.encode();
                    let (color, normal) = self.wanted(color, normal);
                    worker.tree.set_attributes(node, slot, color, normal);
                    child.mean = mean;
                }
                // Alpha cuts out all of the surface in the child, or the surface passes it within the margin.
                None => {
                    worker.tree.remove_voxel(node, slot);
                    child.voxel = None;
                    count -= 1;
                }
            }
        }
        if count == 0 {
            worker.tree.cancel(node);
            return None;
        }
        worker.tree.close(node);
        self.cut(&mut worker.tree, node, cube);
        Some(Mean::of_parts(children.iter().filter(|c| c.voxel.is_some()).map(|c| &c.mean)))
    }

    /// The attributes that the settings ask for.
    fn wanted(&self, color: [u8; 3], normal: RawNormal) -> (Option<[u8; 3]>, Option<RawNormal>) {
        (self.settings.colors.then_some(color), self.settings.normals.then_some(normal))
    }

    /// A voxel whose attributes are set later.
    fn without_attributes(&self) -> TreeVoxel {
        let (color, normal) = self.wanted([0; 3], RawNormal::default());
        TreeVoxel { color, normal, contour: None, leaf: false }
    }

    /// Turns the subtree of a node that has just been closed into a block if it is large enough.
    fn cut(&self, tree: &mut Tree, node: usize, cube: &Cube) {
        if tree.nodes.len() - node <= self.block_nodes || cube.level == 0 || self.failed.load(Ordering::Relaxed) {
            return;
        }
        let detached = tree.detach(node);
        let packed = pack(&detached, Some(cube.address()), &self.settings.assemble);
        // If this fails, the detached node is missing from the tree. The build fails, so nobody reads the tree.
        match packed.and_then(|block| self.store.put(block)) {
            Ok(block) => tree.attach(block),
            Err(e) => self.fail(e.into()),
        }
    }

    fn fail(&self, error: BuildError) {
        self.failed.store(true, Ordering::Relaxed);
        self.error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Decides the shape of a child voxel and whether it is a leaf, and computes the attributes of a leaf.
    #[expect(clippy::too_many_arguments, reason = "borrowed apart from each other")]
    fn evaluate(
        &self,
        shaper: &mut Shaper,
        arena: &Arena,
        pieces: &[Piece],
        parent: Cube,
        slot: usize,
        ancestors: &Bounds,
        child: &mut Child,
    ) {
        child.voxel = None;
        if pieces.is_empty() {
            return;
        }
        let (cube, settings) = (parent.child(slot), self.settings);
        let voxel = VoxelSurface { surface: self.surface, arena, pieces, centre: cube.centre, size: cube.size };
        let deepest = cube.level == settings.levels;
        let bounds = &mut child.bounds;
        let mut shape = Shape { contour: None, fits: ancestors.fits };
        if !ancestors.fits && settings.contours {
            bounds.slabs.inherit(&ancestors.slabs, slot);
            shape = shaper.shape(&voxel, &mut bounds.slabs, self.deviation, deepest);
        }
        bounds.fits = shape.fits;
        let mut found = TreeVoxel { contour: shape.contour, ..self.without_attributes() };
        // If the shape already forces a split, skip the attribute test; this voxel's attributes are averaged from its
        // children later.
        if deepest || shape.fits || cube.level <= PARALLEL_LEVELS {
            let limits = (shape.fits && !deepest).then_some(self.limits);
            let attributes = attributes(&voxel, limits);
            child.mean = attributes.mean;
            (found.color, found.normal) = self.wanted(attributes.color, attributes.normal);
            found.leaf = deepest || (shape.fits && attributes.uniform);
        }
        child.voxel = Some(found);
    }

    /// Removes pieces of cut-out materials that consist of holes only.
    fn remove_holes<T>(&self, arena: &Arena, list: &mut Vec<T>, piece: impl Fn(&T) -> &Piece) {
        if self.surface.has_holes {
            let corners = &self.surface.corners;
            list.retain(|entry| {
                let piece = piece(entry);
                !self.surface.is_hole(piece.triangle, arena.vertices(piece, corners))
            });
        }
    }

    /// Reports that a cube on this level, at most [`PARALLEL_LEVELS`], is finished.
    fn count(&self, level: u32, voxels: u64) {
        let parts = 1u64 << (3 * (PARALLEL_LEVELS - level));
        let done = self.done.fetch_add(parts, Ordering::Relaxed) + parts;
        let voxels = self.voxels.fetch_add(voxels, Ordering::Relaxed) + voxels;
        (self.progress)(Progress { done: done as f64 / (1u64 << (3 * PARALLEL_LEVELS)) as f64, voxels, resumed: 0 });
    }
}
