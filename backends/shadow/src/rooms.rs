//! Closed rooms with walls of one voxel, to count the rays that leave them.

use std::collections::HashSet;

use glam::{DMat3, DQuat, DVec3, EulerRot, IVec3};

use crate::error::ShadowError;
use crate::trace::{FRACTION_BITS, Ray};
use crate::volume::Volume;

/// Which neighbours of a voxel inside a room are wall, if they are not inside too.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Wall {
    /// Those with a common face: the thinnest wall there is. Its voxels touch each other in edges and corners.
    Faces,
    /// Those with a common face or edge.
    Edges,
    /// Those with a common face, edge or corner.
    Corners,
}

impl Wall {
    /// All of them, the thinnest first.
    pub const ALL: [Self; 3] = [Self::Faces, Self::Edges, Self::Corners];

    fn reach(self) -> i32 {
        match self {
            Self::Faces => 1,
            Self::Edges => 2,
            Self::Corners => 3,
        }
    }
}

/// A closed room in a volume: voxels inside, which are empty, and the wall around them.
#[derive(Debug)]
pub struct Room {
    /// The wall.
    pub volume: Volume,
    /// Voxels inside.
    pub inside: Vec<[i32; 3]>,
}

impl Room {
    /// A box whose sides are turned, or a ball. All edges of the volume are `edge` voxels long.
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn new(edge: u32, mips: u32, wall: Wall, turned: Option<DMat3>) -> Result<Self, ShadowError> {
        let middle = f64::from(edge) * 0.5;
        let within = |voxel: IVec3| {
            let at = voxel.as_dvec3() + 0.5 - middle;
            match turned {
                // The diagonal of the box stays within the volume.
                Some(turned) => {
                    let size = DVec3::new(0.50, 0.42, 0.33) * middle;
                    (turned.transpose() * at).abs().cmplt(size).all()
                }
                None => at.length() < middle * 0.8,
            }
        };
        let cells = (0..edge.pow(3) as i32).map(|i| {
            let edge = edge as i32;
            IVec3::new(i % edge, i / edge % edge, i / edge / edge)
        });
        let inside: Vec<IVec3> = cells.filter(|voxel| within(*voxel)).collect();
        let set: HashSet<IVec3> = inside.iter().copied().collect();
        let ways = (0..27).map(|i| IVec3::new(i % 3, i / 3 % 3, i / 9) - 1);
        let ways: Vec<IVec3> = ways.filter(|way| way.abs().element_sum() <= wall.reach()).collect();
        let mut volume = Volume::new([edge; 3], mips)?;
        let neighbours = inside.iter().flat_map(|voxel| ways.iter().map(move |way| *voxel + *way));
        volume.set(neighbours.filter(|voxel| !set.contains(voxel)).map(|voxel| voxel.to_array()));
        Ok(Self { volume, inside: inside.iter().map(|voxel| voxel.to_array()).collect() })
    }

    /// Boxes turned in `turns` ways, the first along the axes, and a ball.
    ///
    /// # Errors
    /// As [`Volume::new`].
    pub fn all(edge: u32, mips: u32, wall: Wall, turns: u32) -> Result<Vec<Self>, ShadowError> {
        let turn = |i: u32| {
            let angle = f64::from(i) * 0.137;
            DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, angle, 2.0 * angle, 3.1 * angle))
        };
        (0..turns).map(|i| Some(turn(i))).chain([None]).map(|turned| Self::new(edge, mips, wall, turned)).collect()
    }

    /// Rays from inside the room to far outside, without end: half of them along diagonals, through corners and middles of voxels, the others anywhere. A seed has the
    /// same rays on all machines.
    pub fn rays(&self, seed: u64) -> impl Iterator<Item = Ray> {
        let mut state = seed;
        let mut below = move |end: u32| {
            // Knuth's linear congruential generator for 64 bits.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % u64::from(end)) as i32
        };
        let unit = 1 << FRACTION_BITS;
        let one = move || {
            let voxel = self.inside[below(self.inside.len() as u32) as usize];
            let kind = below(4);
            let from = voxel.map(|c| {
                let within = match kind {
                    0 => [0, unit][below(2) as usize],
                    1 => unit / 2,
                    _ => below(unit as u32 + 1),
                };
                c * unit + within
            });
            let way: [i32; 3] = std::array::from_fn(|_| match kind {
                0 | 1 => (below(5) - 2) * 40 * unit,
                _ => (below(2001) - 1000) * 13,
            });
            // Long enough to leave the room.
            let far = way.iter().map(|d| d.abs()).max().unwrap_or(0).max(1);
            Ray::exact(from, way.map(|d| (i64::from(d) * 65_535 / i64::from(far)) as i32))
        };
        // A direction of zero is no ray.
        std::iter::repeat_with(one).flatten()
    }
}
