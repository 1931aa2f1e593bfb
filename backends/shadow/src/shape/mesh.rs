//! Meshes: their surface, and what they enclose.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;

use super::stamp::Stamp;
use super::{check_box, solid, surface};
use crate::error::ShadowError;
use crate::extent::Extent;
use crate::grid::{Grid, Pose};

/// Corners are rounded to 1/256 of a voxel, and from there on all is exact.
pub(super) const UNIT: i64 = 256;

/// A mesh of triangles.
///
/// In a pose its corners are rounded to 1/256 of a voxel. Of the mesh with these corners, the voxels are exact: those that the surface meets, be it in
/// a corner, and, if it is solid, those too whose middle it encloses.
#[derive(Clone, Debug)]
pub struct Mesh {
    corners: Arc<[DVec3]>,
    triangles: Arc<[[u32; 3]]>,
    solid: bool,
}

impl Mesh {
    /// The surface of these triangles, of indices of corners.
    ///
    /// # Errors
    /// An index without a corner; a corner that is not finite.
    pub fn surface(corners: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, ShadowError> {
        if let Some(i) = corners.iter().position(|corner| !corner.is_finite()) {
            return Err(ShadowError::Shape(format!("corner {i} of a mesh is {}; repair the mesh", corners[i])));
        }
        if let Some(i) = triangles.iter().position(|triangle| triangle.iter().any(|&c| c as usize >= corners.len())) {
            return Err(ShadowError::Shape(format!(
                "triangle {i} has corners {:?}, and the mesh has {}",
                triangles[i],
                corners.len()
            )));
        }
        Ok(Self { corners: corners.into(), triangles: triangles.into(), solid: false })
    }

    /// A closed mesh: its surface, and what it encloses. What it encloses twice counts as outside.
    ///
    /// # Errors
    /// As [`surface`](Self::surface); an edge that does not have as many triangles on one side as on the other. Corners at the same place count as one.
    pub fn solid(corners: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, ShadowError> {
        let mut mesh = Self::surface(corners, triangles)?;
        let mut numbers = HashMap::new();
        let mut number = |corner: u32| {
            // Adding 0 makes -0 and 0 one.
            let place = mesh.corners[corner as usize].to_array().map(|x| (x + 0.0).to_bits());
            let count = numbers.len();
            *numbers.entry(place).or_insert(count)
        };
        let mut edges: HashMap<(usize, usize), i64> = HashMap::new();
        for triangle in mesh.triangles.iter() {
            let [a, b, c] = triangle.map(&mut number);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                // An edge and the same in the other direction cancel.
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        let open = edges.iter().filter(|((a, b), count)| a != b && **count != 0).count();
        if open > 0 {
            return Err(ShadowError::Shape(format!(
                "a solid needs a closed mesh whose triangles face one way, and {open} edges of this one have no triangle on one side. \
                 Repair the mesh, or take its surface"
            )));
        }
        mesh.solid = true;
        Ok(mesh)
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }

    pub(super) fn voxels(&self, pose: &Pose, grid: &Grid) -> Result<Stamp, ShadowError> {
        let voxels = |corner: &DVec3| grid.to_voxels(pose.apply(*corner));
        let corners: Vec<DVec3> = self.corners.iter().map(voxels).collect();
        let (low, high) = bounds(corners.iter().copied());
        check_box(low, high)?;
        let units: Vec<[i64; 3]> =
            corners.iter().map(|corner| (*corner * UNIT as f64).round().as_i64vec3().to_array()).collect();
        let unit = |voxel: fn(f64) -> f64, at: DVec3| {
            (at * UNIT as f64).round().to_array().map(|x| voxel(x / UNIT as f64) as i32)
        };
        // A corner in a plane touches the voxels below it.
        let extent = Extent::of_voxels(unit(|x| x.ceil() - 1.0, low), unit(f64::floor, high));
        let mut stamp =
            Stamp::new(if self.triangles.is_empty() { Extent { low: [0; 3], high: [0; 3] } } else { extent });
        for triangle in self.triangles.iter() {
            surface::add(&mut stamp, triangle.map(|corner| units[corner as usize]));
        }
        if self.solid {
            let mut inside = Stamp::new(stamp.extent());
            for triangle in self.triangles.iter() {
                solid::invert(&mut inside, triangle.map(|corner| units[corner as usize]));
            }
            stamp.merge(&inside);
        }
        Ok(stamp)
    }
}

/// Least and greatest place along each axis; zero if there is none.
pub(super) fn bounds(mut places: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let Some(first) = places.next() else { return (DVec3::ZERO, DVec3::ZERO) };
    places.fold((first, first), |(low, high), place| (low.min(place), high.max(place)))
}
