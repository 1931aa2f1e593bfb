//! A walk from the root cube to the cubes that triangles meet: the recursion of a build without shapes and attributes.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::build::{Cube, append_by_slot};
use crate::clip::{Arena, Piece};

/// Cubes on this level are walked as separate parallel tasks.
const PARALLEL_LEVELS: u32 = 5;

/// A cube with surface in it whose children are on the level of the walk.
pub(crate) struct Parent<'a> {
    /// Its centre.
    pub centre: DVec3,
    /// Its Morton code.
    pub code: u64,
    /// The pieces of triangles in it, triangles ascending.
    pub pieces: &'a [Piece],
    /// Holds the vertices of the pieces.
    pub arena: &'a mut Arena,
}

/// Where a walk goes and what it collects.
pub(crate) struct Walk<'a, W, V> {
    /// Corners of the triangles in octree space.
    pub corners: &'a [[DVec3; 3]],
    /// The level of the cubes that are looked for, at least 1.
    pub level: u32,
    /// Whether to go on in the cube with this Morton code on this level.
    pub wants: W,
    /// Adds what is found in the children of a cube to the list.
    pub visit: V,
}

/// A cube that is walked by one thread.
struct Task {
    cube: Cube,
    code: u64,
    arena: Arena,
    pieces: Vec<Piece>,
}

/// What one thread needs on its way down.
#[derive(Default)]
struct Worker {
    arena: Arena,
    /// Stack of the pieces in the cubes on the current path and in their siblings.
    pieces: Vec<Piece>,
    sorted: Vec<(u8, Piece)>,
}

impl<W, V> Walk<'_, W, V>
where
    W: Fn(u64, u32) -> bool + Sync,
    V: Sync,
{
    /// Visits all cubes that are wanted, in ascending order of their codes, on all threads. Returns what they added.
    pub(crate) fn run<T: Send>(&self) -> Vec<T>
    where
        V: Fn(Parent, &mut Vec<T>),
    {
        let pieces = (0..self.corners.len() as u32).map(Piece::whole).collect();
        let tasks = self.divide(Task { cube: Cube::ROOT, code: 0, arena: Arena::default(), pieces });
        let parts: Vec<Vec<T>> = tasks.into_par_iter().map(|task| self.work(task)).collect();
        let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
        for mut part in parts {
            all.append(&mut part);
        }
        all
    }

    /// The parts of a task, in the order of their codes.
    fn divide(&self, mut task: Task) -> Vec<Task> {
        let level = task.cube.level;
        if task.pieces.is_empty() || !(self.wants)(task.code, level) {
            return Vec::new();
        }
        if level >= PARALLEL_LEVELS.min(self.level - 1) {
            return vec![task];
        }
        let mut lists: [Vec<Piece>; 8] = Default::default();
        for piece in &task.pieces {
            task.arena.split(piece, self.corners, task.cube.centre, |slot, part| lists[slot].push(part));
        }
        let arena = &task.arena;
        (lists.into_par_iter().enumerate())
            .flat_map(|(slot, pieces)| {
                let (mut own, mut moved) = (Arena::default(), Vec::new());
                own.extend(arena, &pieces, &mut moved);
                let (cube, code) = (task.cube.child(slot), task.code << 3 | slot as u64);
                self.divide(Task { cube, code, arena: own, pieces: moved })
            })
            .collect()
    }

    fn work<T>(&self, task: Task) -> Vec<T>
    where
        V: Fn(Parent, &mut Vec<T>),
    {
        let mut found = Vec::new();
        let all = 0..task.pieces.len();
        let mut worker = Worker { arena: task.arena, pieces: task.pieces, sorted: Vec::new() };
        self.descend(&mut worker, task.cube, task.code, all, &mut found);
        found
    }

    /// `range` are the worker's pieces in the cube, at least one.
    fn descend<T>(&self, worker: &mut Worker, cube: Cube, code: u64, range: Range<usize>, found: &mut Vec<T>)
    where
        V: Fn(Parent, &mut Vec<T>),
    {
        if cube.level + 1 == self.level {
            let Worker { arena, pieces, .. } = worker;
            (self.visit)(Parent { centre: cube.centre, code, pieces: &pieces[range], arena }, found);
            return;
        }
        let arena_mark = worker.arena.mark();
        let pieces_mark = worker.pieces.len();
        worker.sorted.clear();
        for piece in &worker.pieces[range] {
            let sorted = &mut worker.sorted;
            worker.arena.split(piece, self.corners, cube.centre, |slot, part| sorted.push((slot as u8, part)));
        }
        let ends = append_by_slot(&worker.sorted, &mut worker.pieces);
        for slot in (0..8).filter(|&slot| ends[slot] < ends[slot + 1]) {
            let code = code << 3 | slot as u64;
            if (self.wants)(code, cube.level + 1) {
                self.descend(worker, cube.child(slot), code, ends[slot]..ends[slot + 1], found);
            }
        }
        worker.pieces.truncate(pieces_mark);
        worker.arena.truncate(arena_mark);
    }
}
