//! Options of [`displace`](super::displace).

use glam::DVec3;

use crate::mesh::MAX_ELEMENTS;
use crate::mesh::maps::HeightMap;
use crate::{BuildError, Mesh};

/// How [`displace`](super::displace) moves surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplaceOptions {
    /// Factor for the amplitudes and biases of all height maps. Finite.
    pub scale: f64,
    /// Longest side of the small triangles in mesh units; where the texels of the height map are larger, the size of a texel
    /// is used instead. Above zero and finite.
    pub cell: f64,
    /// Most triangles that may result from those with height maps and their neighbours. If there would be more, cells are
    /// made larger, with a warning. At least 1. [`build_displaced`](crate::build_displaced) keeps to the cells, and limits the
    /// triangles of each subtree instead, about.
    pub max_triangles: usize,
}

/// Value of `max_triangles` in [`DisplaceOptions::for_levels`].
const MAX_TRIANGLES: usize = 1 << 24;

/// Largest displacement, in units of the mesh's largest extent: far above any sensible value, and far below overflow.
const MAX_REACH: f64 = 1000.0;

impl DisplaceOptions {
    /// Cells twice as large as the finest voxels of an octree of `levels` over `mesh`, and at most 16.8 million triangles.
    #[must_use]
    pub fn for_levels(mesh: &Mesh, levels: u32, scale: f64) -> Self {
        let cell = 2.0 * extent(mesh).unwrap_or(1.0) * (-f64::from(levels)).exp2();
        Self { scale, cell: if cell > 0.0 { cell } else { 1.0 }, max_triangles: MAX_TRIANGLES }
    }

    pub(super) fn check(&self) -> Result<(), BuildError> {
        let bad = |name, value: String, range| Err(BuildError::Setting { name, value, range });
        if !self.scale.is_finite() {
            return bad("displacement scale", format!("{:?}", self.scale), "a finite number");
        }
        if !(self.cell > 0.0 && self.cell.is_finite()) {
            return bad("displacement cell", format!("{:?}", self.cell), "above zero and finite");
        }
        if self.max_triangles == 0 || self.max_triangles > MAX_ELEMENTS {
            return bad("displacement triangles", self.max_triangles.to_string(), "between 1 and 134217728");
        }
        Ok(())
    }

    /// Refuses displacements larger than [`MAX_REACH`]: they are a mistake.
    pub(super) fn check_reach(&self, mesh: &Mesh) -> Result<(), BuildError> {
        let Some(extent) = extent(mesh).filter(|&e| e > 0.0) else { return Ok(()) };
        let of = |map: &HeightMap| (f64::from(map.amplitude.abs()) + f64::from(map.bias.abs())) * self.scale.abs();
        let reach = mesh.materials.iter().filter_map(|m| m.height_map.as_ref()).map(of).fold(0.0, f64::max);
        if reach <= MAX_REACH * extent {
            return Ok(());
        }
        let value = format!("up to {reach:?} in a mesh whose largest extent is {extent:?}");
        Err(BuildError::Setting { name: "displacement", value, range: "at most 1000 times that extent" })
    }
}

/// The longest side of the mesh's bounding box.
fn extent(mesh: &Mesh) -> Option<f64> {
    mesh.bounds().map(|(low, high)| (DVec3::from(high) - DVec3::from(low)).max_element())
}
