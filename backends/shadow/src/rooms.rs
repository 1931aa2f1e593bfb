//! Closed rooms with walls of one voxel, to count the rays that leave them.

use std::collections::HashSet;

use glam::{DMat3, DVec3, IVec3};

use crate::error::ShadowError;
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
}
