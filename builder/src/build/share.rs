//! How a build is shared out: which cubes belong to which part, and the nodes above these cubes.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use esvo_format::Voxel as TreeVoxel;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::pair::Child;
use super::recursion::JOURNAL_LEVEL;
use crate::cells::{Parent, Walk};
use crate::surface::PreparedMesh;
use crate::surface::attributes::Mean;
use crate::{BuildError, BuildSettings, Mesh};

/// Number of parts that a build can be shared out to.
pub(crate) const PARTS: RangeInclusive<u32> = 1..=4096;

/// A node above the cubes that are shared out, before its subtrees are there.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Top {
    voxels: [Option<TreeVoxel>; 8],
    /// Of the leaves.
    means: [Mean; 8],
    /// Whether the block of attributes is kept as it was tested.
    pub keeps: bool,
}

impl Top {
    pub(super) fn of(children: &[Child; 8], keeps: bool) -> Self {
        let leaf = |child: &Child| child.voxel.is_some_and(|voxel| voxel.leaf);
        Self {
            voxels: std::array::from_fn(|slot| children[slot].voxel),
            means: std::array::from_fn(
                |slot| if leaf(&children[slot]) { children[slot].mean } else { Mean::default() },
            ),
            keeps,
        }
    }

    pub(super) fn children(&self) -> [Child; 8] {
        std::array::from_fn(|slot| {
            let mut child = Child::default();
            (child.voxel, child.mean) = (self.voxels[slot], self.means[slot]);
            child
        })
    }
}

/// A number for each cube: its path after a bit that is set.
pub(super) fn top_key(path: u32, level: u32) -> u32 {
    1 << (3 * level) | path
}

/// A part of a build, as planned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlannedPart {
    /// Its number, from 1.
    pub part: u32,
    /// Cubes of level 4 with surface.
    pub cubes: u32,
    /// Pieces of triangles in these cubes.
    pub pieces: u64,
    /// What it is expected to cost: voxels that the deepest level would hold if all geometry were divided down to it, as of
    /// [`expected_leaves`](crate::expected_leaves).
    pub voxels: f64,
}

/// Which cubes of level 4 belong to which part of a build. It follows from the mesh, the deepest level and the number of parts.
///
/// A part has a run of cubes in Morton order; the runs cost about the same.
pub struct BuildPlan {
    parts: Vec<PlannedPart>,
    /// Paths of the cubes of each part.
    cubes: Vec<BTreeSet<u32>>,
}

impl BuildPlan {
    /// Plans a build.
    ///
    /// # Errors
    /// A number of parts that is not 1 to 4096; a setting out of its range; a mesh that is not valid or has no surface.
    pub fn new(mesh: &Mesh, settings: &BuildSettings, parts: u32) -> Result<Self, BuildError> {
        settings.check()?;
        if !PARTS.contains(&parts) {
            return Err(BuildError::Setting { name: "parts", value: parts.to_string(), range: "1 to 4096" });
        }
        Ok(Self::of(&PreparedMesh::new(mesh, settings.levels)?.corners, settings.levels, parts))
    }

    pub(super) fn of(corners: &[[DVec3; 3]], levels: u32, parts: u32) -> Self {
        let estimate = |parent: Parent, found: &mut Vec<Estimate>| {
            let voxels = parent.pieces.iter().map(|piece| grown(parent.arena.vertices(piece, corners), levels)).sum();
            found.push(Estimate { path: parent.code as u32, pieces: parent.pieces.len() as u64, voxels });
        };
        // With fewer levels there is nothing below the cubes.
        let estimates: Vec<Estimate> = if levels > JOURNAL_LEVEL {
            Walk { corners, level: JOURNAL_LEVEL + 1, wants: |_, _| true, visit: estimate }.run()
        } else {
            Vec::new()
        };
        let total: f64 = estimates.iter().map(|cube| cube.voxels).sum();
        let empty = |part| PlannedPart { part, cubes: 0, pieces: 0, voxels: 0.0 };
        let mut plan = Self { parts: (1..=parts).map(empty).collect(), cubes: vec![BTreeSet::new(); parts as usize] };
        let mut before = 0.0;
        for cube in &estimates {
            // The part that has the middle of the cube's cost.
            let middle = (before + cube.voxels * 0.5) / total;
            before += cube.voxels;
            let part = ((middle * f64::from(parts)) as usize).min(parts as usize - 1);
            plan.cubes[part].insert(cube.path);
            let planned = &mut plan.parts[part];
            planned.cubes += 1;
            planned.pieces += cube.pieces;
            planned.voxels += cube.voxels;
        }
        plan
    }

    /// What each part has.
    pub fn parts(&self) -> &[PlannedPart] {
        &self.parts
    }

    /// The paths of the cubes of a part; `part` counts from 1.
    pub(super) fn cubes(&self, part: u32) -> &BTreeSet<u32> {
        &self.cubes[part as usize - 1]
    }
}

/// What a cube of level 4 is expected to cost.
struct Estimate {
    path: u32,
    pieces: u64,
    voxels: f64,
}

/// The volume of a polygon grown by a voxel, in voxels: see `expectation.rs`.
fn grown(vertices: &[DVec3], levels: u32) -> f64 {
    let scale = f64::from(levels).exp2();
    let (mut low, mut high, mut shadows) = (DVec3::INFINITY, DVec3::NEG_INFINITY, DVec3::ZERO);
    for v in vertices {
        (low, high) = (low.min(*v), high.max(*v));
    }
    for edge in vertices[1..].windows(2) {
        shadows += (edge[0] - vertices[0]).cross(edge[1] - vertices[0]);
    }
    1.0 + (high - low).element_sum() * scale + shadows.abs().element_sum() * 0.5 * scale * scale
}
