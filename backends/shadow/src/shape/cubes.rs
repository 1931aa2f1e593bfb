//! Cubes of one size: voxel models, and octrees at a level.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::check_box;
use super::mesh::bounds;
use super::stamp::Stamp;
use crate::error::ShadowError;
use crate::extent::Extent;
use crate::grid::{Grid, Pose};
use crate::volume::Bricks;

/// What places in voxels are off by, at most.
const ROUNDING: f64 = 1e-7;

/// Which voxels of the world a turned cube fills.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Rule {
    /// Those whose middle lies in it. Objects keep their size; what is thinner than a voxel may be lost, and what is one voxel thin may get holes that
    /// a ray slips through diagonally.
    Middle,
    /// Those that it meets. Objects grow by up to a voxel on each side; nothing is lost.
    Touch,
}

/// Cubes of one size on a grid of their own.
#[derive(Clone, Debug)]
pub struct Cubes {
    full: Arc<Bricks>,
    /// Cubes that have a neighbour missing: all others lie inside.
    shell: Arc<[[i32; 3]]>,
    low: [i32; 3],
    high: [i32; 3],
    edge: f64,
    rule: Rule,
}

impl Cubes {
    /// Cubes with this edge, in the world's unit: cube `(i, j, k)` reaches from `edge * (i, j, k)` to the next, from the object's own origin.
    ///
    /// # Errors
    /// An edge that is not above 0; a cube more than 2^20 cubes from the origin.
    pub fn new(cubes: impl IntoIterator<Item = [i32; 3]>, edge: f64, rule: Rule) -> Result<Self, ShadowError> {
        if !(edge > 0.0 && edge.is_finite()) {
            return Err(ShadowError::Shape(format!("cubes with an edge of {edge} were given; edges are above 0")));
        }
        let mut full = Bricks::new();
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        let mut list = Vec::new();
        for cube in cubes {
            if let Some(far) = cube.iter().find(|c| c.unsigned_abs() > 1 << 20) {
                return Err(ShadowError::Shape(format!(
                    "a cube at {far} was given; cubes are within 2^20 of the origin"
                )));
            }
            if full.get(cube) {
                continue;
            }
            full.set([cube]);
            list.push(cube);
            for axis in 0..3 {
                low[axis] = low[axis].min(cube[axis]);
                high[axis] = high[axis].max(cube[axis] + 1);
            }
        }
        let exposed = |cube: &[i32; 3]| {
            (0..3).any(|axis| {
                [-1, 1].iter().any(|way| {
                    let mut beside = *cube;
                    beside[axis] += way;
                    !full.get(beside)
                })
            })
        };
        list.retain(exposed);
        if list.is_empty() {
            (low, high) = ([0; 3], [0; 3]);
        }
        Ok(Self { shell: list.into(), full: Arc::new(full), low, high, edge, rule })
    }

    /// Number of cubes that are not surrounded by others.
    pub fn shell(&self) -> usize {
        self.shell.len()
    }

    pub(super) fn voxels(&self, pose: &Pose, grid: &Grid) -> Result<Stamp, ShadowError> {
        if self.shell.is_empty() {
            return Ok(Stamp::new(Extent { low: [0; 3], high: [0; 3] }));
        }
        let place = |cube: DVec3| grid.to_voxels(pose.apply(cube * self.edge));
        let ends = [self.low, self.high].map(|end| DVec3::from(end.map(f64::from)));
        let corners = (0..8).map(|i| place(DVec3::from_array(std::array::from_fn(|axis| ends[i >> axis & 1][axis]))));
        let (low, high) = bounds(corners);
        check_box(low, high)?;
        let extent = Extent::of_voxels((low.ceil() - 1.0).as_ivec3().to_array(), high.floor().as_ivec3().to_array());
        let mut stamp = Stamp::new(extent);
        self.add_middles(&mut stamp, pose, grid, low, high);
        if self.rule == Rule::Touch && pose.rotation == DQuat::IDENTITY {
            let edge = self.edge / grid.voxel;
            let origin = place(DVec3::ZERO);
            for cube in self.shell.iter() {
                let low = origin + DVec3::from(cube.map(f64::from)) * edge;
                add_box(&mut stamp, low, low + edge);
            }
        } else if self.rule == Rule::Touch {
            let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * axis * (self.edge / grid.voxel));
            let origin = place(DVec3::ZERO);
            for cube in self.shell.iter() {
                let [i, j, k] = cube.map(f64::from);
                add_touched(&mut stamp, origin + axes[0] * i + axes[1] * j + axes[2] * k, axes);
            }
        }
        Ok(stamp)
    }

    /// The voxels whose middle lies in a cube.
    fn add_middles(&self, stamp: &mut Stamp, pose: &Pose, grid: &Grid, low: DVec3, high: DVec3) {
        let [low, high] = [low.floor().as_ivec3(), high.floor().as_ivec3()];
        let scale = 1.0 / self.edge;
        let along = pose.rotation.conjugate() * (DVec3::X * grid.voxel) * scale;
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                let first = DVec3::new(f64::from(low.x) + 0.5, f64::from(y) + 0.5, f64::from(z) + 0.5);
                let first = pose.undo(grid.to_world(first)) * scale;
                for x in low.x..=high.x {
                    let cube = (first + along * f64::from(x - low.x)).floor().as_ivec3().to_array();
                    if self.full.get(cube) {
                        stamp.set([x, y, z]);
                    }
                }
            }
        }
    }
}

/// Sets the voxels that a box along the axes meets. Rounding counts as meeting.
fn add_box(stamp: &mut Stamp, low: DVec3, high: DVec3) {
    let extent = stamp.extent();
    let (least, most) = (extent.low.map(|c| 2 * c), extent.high.map(|c| 2 * c - 1));
    let low = ((low - ROUNDING).ceil() - 1.0).as_ivec3().max(least.into());
    let high = (high + ROUNDING).floor().as_ivec3().min(most.into());
    for z in low.z..=high.z {
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                stamp.set([x, y, z]);
            }
        }
    }
}

/// Sets the voxels that a turned cube meets. `corner` and the three edges that leave it are in voxels. Rounding counts as meeting.
fn add_touched(stamp: &mut Stamp, corner: DVec3, edges: [DVec3; 3]) {
    let half = edges.map(|edge| edge * 0.5);
    let middle = corner + half[0] + half[1] + half[2];
    let reach = half[0].abs() + half[1].abs() + half[2].abs() + ROUNDING;
    let low = ((middle - reach).ceil() - 1.0).as_ivec3();
    let high = (middle + reach).floor().as_ivec3();
    let extent = stamp.extent();
    let (least, most) = (extent.low.map(|c| 2 * c), extent.high.map(|c| 2 * c - 1));
    // The axes of the cube, and the products of both sets of axes.
    let mut axes = [DVec3::ZERO; 12];
    for (i, edge) in edges.iter().enumerate() {
        let edge = edge.normalize();
        (axes[i], axes[3 + 3 * i]) = (edge, edge.cross(DVec3::X));
        (axes[4 + 3 * i], axes[5 + 3 * i]) = (edge.cross(DVec3::Y), edge.cross(DVec3::Z));
    }
    let reaches = axes.map(|axis| {
        let of_cube: f64 = half.iter().map(|half| half.dot(axis).abs()).sum();
        of_cube + axis.abs().element_sum() * 0.5 + ROUNDING
    });
    for z in low.z.max(least[2])..=high.z.min(most[2]) {
        for y in low.y.max(least[1])..=high.y.min(most[1]) {
            for x in low.x.max(least[0])..=high.x.min(most[0]) {
                let voxel = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) + 0.5;
                let apart = voxel - middle;
                if axes.iter().zip(&reaches).all(|(axis, reach)| apart.dot(*axis).abs() <= *reach) {
                    stamp.set([x, y, z]);
                }
            }
        }
    }
}
