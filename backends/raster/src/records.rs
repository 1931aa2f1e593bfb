//! Triangles as a tile's shaders read them, and the work of the compute shader.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::tiles::Tile;
use crate::{Method, RasterError};

/// How far outside of the grid a corner may lie, in edges of the grid.
pub(crate) const FARTHEST: f64 = 256.0;
/// Most voxels along a triangle that is rasterized: beyond, rounding moves its edges by more than they are moved outwards for it.
pub(crate) const LONGEST: f64 = 8192.0;
/// Columns along each side of an item of work.
const ITEM_COLUMNS: i32 = 16;
/// A border of voxels that a surface is nearer to than this, in edges of the grid, is in the surface: rounding in double precision may have
/// moved it. A quarter of the margin of the builder, which counts it to both sides as well.
const ON_BORDER: f64 = 1.0 / (1u64 << 48) as f64;
/// A border that a surface is further away from than this is not in it, for the builder neither.
const OFF_BORDER: f64 = 1.0 / (1u64 << 44) as f64;

/// Bits of [`Record::flags`], for what double precision knows and single precision would not. Axes are u, v, w: w is the axis of projection.
mod flags {
    /// The slopes are not known well enough to test the plane.
    pub(super) const NEEDLE: u32 = 4;
    /// Along axis `k`: whether the bounding box meets the voxels at its ends is not known.
    pub(super) fn unsure(k: usize) -> u32 {
        8 << k
    }
    /// Along axis `k`: the first voxel that the box meets is the one before the origin.
    pub(super) fn before(k: usize) -> u32 {
        64 << k
    }
    /// Edge number `edge` does not change along axis `k`.
    pub(super) fn along(edge: usize, k: usize) -> u32 {
        512 << (3 * edge + k)
    }
    /// The triangle is perpendicular to the axis of projection.
    pub(super) const FLAT: u32 = 1 << 18;
}

/// A triangle, relative to a tile. `kernels/common.wgsl` has the same struct.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct Record {
    /// The voxel that coordinates are relative to, from the tile's corner.
    origin: [i32; 3],
    /// Bits 0 and 1: the axis of projection. The others: see [`flags`].
    flags: u32,
    corners: [[f32; 3]; 3],
    /// How the coordinate along the axis of projection grows with the next axis and the one after it.
    slope: [f32; 2],
    /// Largest coordinate of a corner.
    extent: f32,
    /// The last voxel that the bounding box meets along u, v and w, from the origin.
    last: [i32; 3],
}

/// Columns of one triangle: the record, the first column, and the numbers of columns; see `kernels/compute.wgsl`.
pub(crate) type Item = [u32; 3];

/// The axis that a triangle is projected along, and its slopes: those of its plane over the plane of projection.
fn projection(corners: &[DVec3; 3], method: Method) -> (usize, [f64; 2], f64) {
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let size = normal.abs();
    let axis = match method {
        Method::FixedAxis => 2,
        _ if size.x >= size.y && size.x >= size.z => 0,
        _ if size.y >= size.z => 1,
        _ => 2,
    };
    let slope = [(axis + 1) % 3, (axis + 2) % 3].map(|other| -normal[other] / normal[axis]);
    (axis, slope, size[axis])
}

/// Largest distance between two points of a triangle along an axis, measured from the voxel of its lowest coordinates.
fn low_and_extent(corners: &[DVec3; 3]) -> (DVec3, f64) {
    let origin = corners[0].min(corners[1]).min(corners[2]).floor();
    let high = corners[0].max(corners[1]).max(corners[2]);
    (origin, (high - origin).max_element())
}

impl Record {
    /// A triangle with corners in voxels of the grid.
    pub(crate) fn new(corners: &[DVec3; 3], (tile, voxels): (&Tile, f64), method: Method) -> Self {
        let (origin, extent) = low_and_extent(corners);
        let (axis, slope, size) = projection(corners, method);
        // Rounding of the normal in double precision, over its largest component: where that is more than single precision's own
        // rounding, the slopes are not used.
        let error = 2f64.powi(-50) * extent * extent / size;
        let needle = method != Method::FixedAxis && !(error <= 2f64.powi(-26) && slope.iter().all(|s| s.is_finite()));
        let finite = |s: f64| if s.is_finite() { s.clamp(-1e9, 1e9) as f32 } else { 0.0 };
        let from_tile = origin - DVec3::from(tile.corner.map(f64::from));
        let (flags, last) = known(corners, origin, axis, voxels);
        Self {
            origin: from_tile.to_array().map(|x| x as i32),
            flags: axis as u32 | flags | if needle { flags::NEEDLE } else { 0 },
            corners: corners.map(|corner| (corner - origin).as_vec3().to_array()),
            slope: slope.map(finite),
            extent: extent as f32,
            last,
        }
    }

    /// Appends the work of the compute shader for this triangle, record number `index`: its bounding box in the plane of projection,
    /// one column wider on each side, within the tile, in rectangles. Those that no edge comes near are left out.
    pub(crate) fn items(&self, index: u32, tile: &Tile, items: &mut Vec<Item>) {
        let axis = (self.flags & 3) as usize;
        let plane = [(axis + 1) % 3, (axis + 2) % 3];
        let corner = |c: usize| plane.map(|k| f64::from(self.corners[c][k]) + f64::from(self.origin[k]));
        let corners = [corner(0), corner(1), corner(2)];
        let range = |k: usize| {
            let low = corners[0][k].min(corners[1][k]).min(corners[2][k]);
            let high = corners[0][k].max(corners[1][k]).max(corners[2][k]);
            // A voxel that only touches the box counts, and single precision may have moved a corner.
            let slack = 0.01 + high.abs().max(low.abs()) * 1e-6;
            ((low - slack).floor().max(0.0) as i32, (high + slack).floor().min(f64::from(tile.edge) - 1.0) as i32)
        };
        let ((u0, u1), (v0, v1)) = (range(0), range(1));
        let small = u1 - u0 < ITEM_COLUMNS && v1 - v0 < ITEM_COLUMNS;
        let mut v = v0;
        while v <= v1 {
            let height = ITEM_COLUMNS.min(v1 - v + 1);
            let mut u = u0;
            while u <= u1 {
                let width = ITEM_COLUMNS.min(u1 - u + 1);
                if small || near(&corners, [u, v], [width, height]) {
                    items.push([index, (u | v << 16) as u32, (width | height << 16) as u32]);
                }
                u += width;
            }
            v += height;
        }
    }
}

/// What double precision knows of a triangle in voxels: flags, and the last voxel that its bounding box meets along u, v, w.
fn known(corners: &[DVec3; 3], origin: DVec3, axis: usize, voxels: f64) -> (u32, [i32; 3]) {
    let (on, off) = (ON_BORDER * voxels, OFF_BORDER * voxels);
    let mut flags = 0;
    let mut last = [0; 3];
    for k in 0..3 {
        let of = (axis + 1 + k) % 3;
        let [a, b, c] = [corners[0][of], corners[1][of], corners[2][of]];
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let from_border = |x: f64| (x - x.round()).abs();
        let in_border = |x: f64| from_border(x) <= on;
        let unsure = [low, high].iter().any(|&x| !in_border(x) && from_border(x) <= off);
        // The voxel on the other side of a border that the box ends in is met, too.
        let first = if in_border(low) { low.round() - 1.0 } else { low.floor() };
        last[k] = ((if in_border(high) { high.round() } else { high.floor() }) - origin[of]) as i32;
        flags |= if unsure { flags::unsure(k) } else { 0 };
        flags |= if first < origin[of] { flags::before(k) } else { 0 };
        for (edge, difference) in [b - a, c - b, a - c].into_iter().enumerate() {
            flags |= if difference.abs() <= on { flags::along(edge, k) } else { 0 };
        }
        flags |= if k == 2 && high - low <= on { flags::FLAT } else { 0 };
    }
    (flags, last)
}

/// Whether a rectangle of columns is not clearly outside of one of the triangle's edges.
fn near(corners: &[[f64; 2]; 3], low: [i32; 2], size: [i32; 2]) -> bool {
    let half = size.map(|s| f64::from(s) * 0.5);
    let middle = [f64::from(low[0]) + half[0], f64::from(low[1]) + half[1]];
    let area = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    (0..3).all(|edge| {
        let (p, q, r) = (corners[edge], corners[(edge + 1) % 3], corners[(edge + 2) % 3]);
        let side = area(p, q, r).signum();
        // A quarter of a column more than the rectangle.
        let reach = (half[0] + 0.25) * (q[1] - p[1]).abs() + (half[1] + 0.25) * (q[0] - p[0]).abs();
        area(p, q, middle) * side >= -reach
    })
}

/// Checks the corners of all triangles; `voxels` is the number of voxels along the grid's edge.
pub(crate) fn check(corners: &[[DVec3; 3]], voxels: f64, method: Method) -> Result<(), RasterError> {
    use rayon::prelude::*;
    if corners.len() > u32::MAX as usize {
        return Err(RasterError::TooManyTriangles(corners.len()));
    }
    let wrong = |(triangle, corners): (usize, &[DVec3; 3])| {
        let far = |x: &f64| !(x - 0.5).abs().le(&(FARTHEST + 0.5));
        if let Some(at) = corners.iter().flat_map(|corner| corner.to_array()).find(far) {
            return Some(RasterError::Corner { triangle, at });
        }
        let extent = low_and_extent(&corners.map(|corner| corner * voxels)).1;
        let too_long = method != Method::Compute && extent > LONGEST;
        too_long.then(|| RasterError::TooLong { triangle, voxels: extent.ceil() as u64, most: LONGEST as u64 })
    };
    corners.par_iter().enumerate().find_map_first(wrong).map_or(Ok(()), Err)
}

const _: () = assert!(size_of::<Record>() == 76);
