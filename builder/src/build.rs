//! The recursion from the root cube to the leaves.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use esvo_format::{Octree, Tree, Voxel as TreeVoxel, assemble};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::attributes::{AttributeBounds, attributes};
use crate::clip::{Arena, Piece};
use crate::shaper::{Shape, Shaper, Slabs, Voxel};
use crate::surface::Surface;
use crate::{BuildError, BuildSettings, Mesh};

/// Voxels down to this level are built as tasks of their own.
const PARALLEL_LEVELS: u32 = 5;

/// How far a build has come.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// 0 to 1.
    pub done: f64,
    /// Voxels so far.
    pub voxels: u64,
}

/// What a build took.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BuildStats {
    /// Triangles in the mesh.
    pub triangles: usize,
    /// Triangles left out because they have no area.
    pub dropped_triangles: usize,
    /// Preparing the mesh.
    pub prepare: Duration,
    /// Finding voxels, contours and attributes.
    pub voxelize: Duration,
    /// Laying out and encoding blocks.
    pub assemble: Duration,
}

impl BuildStats {
    /// All of it.
    pub fn total(&self) -> Duration {
        self.prepare + self.voxelize + self.assemble
    }
}

/// A finished build.
pub struct Built {
    /// The octree.
    pub octree: Octree,
    /// What it took.
    pub stats: BuildStats,
}

/// Builds an octree from a mesh on all threads of the current rayon pool. The result does not depend on their number.
///
/// `progress` is called now and then, from any thread.
///
/// # Errors
/// Settings out of range, a mesh without surface or with broken data.
pub fn build(mesh: &Mesh, settings: &BuildSettings, progress: &(dyn Fn(Progress) + Sync)) -> Result<Built, BuildError> {
    settings.check()?;
    let start = Instant::now();
    let surface = Surface::new(mesh, settings.levels)?;
    let prepare = start.elapsed();

    let start = Instant::now();
    let context = Context {
        surface: &surface,
        settings,
        deviation: (-settings.contour_error).exp2() * 3f64.sqrt(),
        limits: AttributeBounds { color: settings.color_error as f32, normal: settings.normal_error as f32 },
        progress,
        done: AtomicU64::new(0),
        voxels: AtomicU64::new(0),
    };
    let pieces: Vec<Piece> = (0..surface.len() as u32).map(Piece::whole).collect();
    let root = Cube { centre: DVec3::splat(0.5), size: 1.0, level: 0 };
    let tree = context.split(root, &Arena::default(), pieces, Bounds::Slabs(Slabs::default()));
    let voxelize = start.elapsed();
    let Some(tree) = tree else {
        return Err(BuildError::Mesh("all of its surface is cut out by alpha".into()));
    };

    let start = Instant::now();
    let mut octree = assemble(&tree, surface.octree_to_mesh, &settings.assemble)?;
    octree.set_meta(metadata(settings, mesh));
    let stats = BuildStats {
        triangles: mesh.triangles.len(),
        dropped_triangles: surface.dropped,
        prepare,
        voxelize,
        assemble: start.elapsed(),
    };
    Ok(Built { octree, stats })
}

fn metadata(settings: &BuildSettings, mesh: &Mesh) -> String {
    let meta = serde_json::json!({
        "generator": concat!("esvo-builder ", env!("CARGO_PKG_VERSION")),
        "triangles": mesh.triangles.len(),
        "settings": settings,
    });
    meta.to_string()
}

/// A cube of the octree.
#[derive(Clone, Copy)]
struct Cube {
    centre: DVec3,
    size: f64,
    level: u32,
}

impl Cube {
    fn child(&self, slot: usize) -> Self {
        let quarter = self.size * 0.25;
        let offset = std::array::from_fn(|axis| if slot >> axis & 1 != 0 { quarter } else { -quarter });
        Self { centre: self.centre + DVec3::from(offset), size: self.size * 0.5, level: self.level + 1 }
    }
}

struct Context<'a> {
    surface: &'a Surface<'a>,
    settings: &'a BuildSettings,
    /// Contour error in octree units.
    deviation: f64,
    limits: AttributeBounds,
    progress: &'a (dyn Fn(Progress) + Sync),
    /// Parts of 8^PARALLEL_LEVELS of the root cube.
    done: AtomicU64,
    voxels: AtomicU64,
}

/// A child voxel, and what its own children need if it is not a leaf.
struct Child {
    voxel: TreeVoxel,
    bounds: Bounds,
}

/// What the ancestors of a voxel say about its shape.
#[derive(Clone)]
enum Bounds {
    /// These contours bound it.
    Slabs(Slabs),
    /// It is within the error bound, so it is in every part of it: only attributes ask for finer voxels.
    Fits,
}

impl Bounds {
    fn for_child(&self, slot: usize) -> Self {
        match self {
            Self::Slabs(slabs) => Self::Slabs(slabs.for_child(slot)),
            Self::Fits => Self::Fits,
        }
    }
}

/// What one thread needs on the way down.
#[derive(Default)]
struct Worker {
    arena: Arena,
    shaper: Shaper,
    /// Stack of the pieces in the voxels on the current path and beside it.
    pieces: Vec<Piece>,
    sorted: Vec<(u8, Piece)>,
    tree: Tree,
}

impl Context<'_> {
    /// Builds the subtree of a cube that is split, its children in parallel. `None` if nothing is in it.
    fn split(&self, cube: Cube, arena: &Arena, pieces: Vec<Piece>, ancestors: Bounds) -> Option<Tree> {
        let mut own = Worker::default();
        let (own_arena, pieces) = arena.extract(&pieces);
        own.arena = own_arena;
        own.pieces = pieces;
        if cube.level >= PARALLEL_LEVELS {
            let all = 0..own.pieces.len();
            let found = self.descend(&mut own, cube, all, ancestors);
            self.count(cube.level, own.tree.voxels());
            return found.then_some(own.tree);
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
                let child = self.evaluate(&mut shaper, arena, &pieces, cube, slot, &ancestors);
                let Some(mut child) = child else {
                    self.count(child_cube.level, 0);
                    return None;
                };
                if child.voxel.leaf {
                    self.count(child_cube.level, 0);
                    return Some((child.voxel, None));
                }
                let tree = self.split(child_cube, arena, pieces, child.bounds);
                child.voxel.leaf = tree.is_none();
                Some((child.voxel, tree))
            })
            .collect();
        let children: [Option<TreeVoxel>; 8] = std::array::from_fn(|slot| results[slot].as_ref().map(|r| r.0));
        if children.iter().all(Option::is_none) {
            return None;
        }
        let mut tree = Tree::default();
        let node = tree.open(&children);
        for (_, subtree) in results.into_iter().flatten() {
            if let Some(subtree) = subtree {
                tree.append(&subtree);
            }
        }
        tree.close(node);
        Some(tree)
    }

    /// The same on one thread. Returns whether anything is in the cube; if so its node has been pushed.
    fn descend(&self, worker: &mut Worker, cube: Cube, range: std::ops::Range<usize>, ancestors: Bounds) -> bool {
        let arena_mark = worker.arena.mark();
        let pieces_mark = worker.pieces.len();
        worker.sorted.clear();
        for piece in &worker.pieces[range] {
            let sorted = &mut worker.sorted;
            worker.arena.split(piece, &self.surface.corners, cube.centre, |slot, part| sorted.push((slot as u8, part)));
        }
        self.remove_holes(&worker.arena, &mut worker.sorted, |entry| &entry.1);
        let mut ends = [worker.pieces.len(); 9];
        for slot in 0..8 {
            let of_slot = worker.sorted.iter().filter(|(s, _)| *s == slot).map(|(_, piece)| *piece);
            worker.pieces.extend(of_slot);
            ends[slot as usize + 1] = worker.pieces.len();
        }
        let children: [Option<Child>; 8] = std::array::from_fn(|slot| {
            let pieces = &worker.pieces[ends[slot]..ends[slot + 1]];
            self.evaluate(&mut worker.shaper, &worker.arena, pieces, cube, slot, &ancestors)
        });
        let found = children.iter().any(Option::is_some);
        if found {
            let node = worker.tree.open(&std::array::from_fn(|slot| children[slot].as_ref().map(|c| c.voxel)));
            for (slot, child) in children.into_iter().enumerate() {
                let Some(child) = child.filter(|c| !c.voxel.leaf) else { continue };
                if !self.descend(worker, cube.child(slot), ends[slot]..ends[slot + 1], child.bounds) {
                    worker.tree.make_leaf(node, slot);
                }
            }
            worker.tree.close(node);
        }
        worker.pieces.truncate(pieces_mark);
        worker.arena.truncate(arena_mark);
        found
    }

    /// Decides what a child voxel looks like and whether it is a leaf; `None` if no surface is in it.
    fn evaluate(
        &self,
        shaper: &mut Shaper,
        arena: &Arena,
        pieces: &[Piece],
        parent: Cube,
        slot: usize,
        ancestors: &Bounds,
    ) -> Option<Child> {
        if pieces.is_empty() {
            return None;
        }
        let (cube, ancestors) = (parent.child(slot), ancestors.for_child(slot));
        let settings = self.settings;
        let voxel = Voxel { surface: self.surface, arena, pieces, centre: cube.centre, size: cube.size };
        let deepest = cube.level == settings.levels;
        let shape = match ancestors {
            Bounds::Fits => Shape { contour: None, slabs: Slabs::default(), fits: true },
            Bounds::Slabs(slabs) if settings.contours => shaper.shape(&voxel, slabs, self.deviation, deepest),
            Bounds::Slabs(slabs) => Shape { contour: None, slabs, fits: false },
        };
        // Where the shape asks for finer voxels anyway, whether the attributes do is of no interest.
        let limits = (shape.fits && !deepest).then_some(self.limits);
        let attributes = attributes(&voxel, limits);
        let voxel = TreeVoxel {
            color: settings.colors.then_some(attributes.color),
            normal: settings.normals.then_some(attributes.normal),
            contour: shape.contour,
            leaf: deepest || (shape.fits && attributes.uniform),
        };
        let bounds = if shape.fits { Bounds::Fits } else { Bounds::Slabs(shape.slabs) };
        Some(Child { voxel, bounds })
    }

    /// Takes out the pieces of cut-out materials that are all hole.
    fn remove_holes<T>(&self, arena: &Arena, list: &mut Vec<T>, piece: impl Fn(&T) -> &Piece) {
        if self.surface.has_holes {
            let corners = &self.surface.corners;
            list.retain(|entry| {
                let piece = piece(entry);
                !self.surface.is_hole(piece.triangle, arena.vertices(piece, corners))
            });
        }
    }

    /// Reports that a cube on this level, at most [`PARALLEL_LEVELS`], is done.
    fn count(&self, level: u32, voxels: u64) {
        let parts = 1u64 << (3 * (PARALLEL_LEVELS - level));
        let done = self.done.fetch_add(parts, Ordering::Relaxed) + parts;
        let voxels = self.voxels.fetch_add(voxels, Ordering::Relaxed) + voxels;
        (self.progress)(Progress { done: done as f64 / (1u64 << (3 * PARALLEL_LEVELS)) as f64, voxels });
    }
}
