//! A world without bounds: bricks of voxels where there are any.

use std::collections::HashMap;

use super::{Occupancy, octant};
use crate::extent::Extent;

/// Level of a brick: 16 voxels along its edge.
const BRICK: u32 = 4;
/// Level of the cells that are known above bricks: 64 voxels.
const GROUP: u32 = 6;

/// Bytes of the brick's base cells and of its two mips, x fastest, as in a [`Volume`](crate::Volume).
#[derive(Clone, PartialEq, Eq, Debug)]
struct Brick {
    base: [u8; 512],
    mip: [u8; 64],
    mip2: [u8; 8],
}

/// One bit for each voxel, in bricks of 16 x 16 x 16 voxels that lie where voxels are, found by a hash of their place.
///
/// A brick has the bytes of its base cells (512) and of two mips (64 and 8), laid out as in a [`Volume`](crate::Volume). Above it, cells of 64 voxels
/// are known. Voxels may lie anywhere within 2^21 voxels of the origin.
#[derive(Clone, Default, Debug)]
pub struct Bricks {
    places: HashMap<[i32; 3], u32>,
    groups: HashMap<[i32; 3], u32>,
    bricks: Vec<Brick>,
}

fn at(cell: [i32; 3], bits: u32) -> usize {
    let mask = (1 << bits) - 1;
    let [x, y, z] = cell.map(|c| (c & mask) as usize);
    x | y << bits | z << (2 * bits)
}

impl Bricks {
    /// An empty world.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of bricks.
    pub fn bricks(&self) -> usize {
        self.bricks.len()
    }

    /// Bytes of bricks and of the tables that find them, with the room that the tables keep free.
    pub fn bytes(&self) -> u64 {
        // A slot of a table has a key, a value and one byte of the hash.
        let slot = size_of::<([i32; 3], u32)>() + 1;
        let slots = [self.places.capacity(), self.groups.capacity()].map(|n| n * 8 / 7);
        (self.bricks.len() * size_of::<Brick>() + slots.iter().sum::<usize>() * slot) as u64
    }

    /// Whether a voxel is set.
    pub fn get(&self, voxel: [i32; 3]) -> bool {
        self.occupied(0, voxel)
    }

    fn brick(&self, place: [i32; 3]) -> Option<&Brick> {
        self.places.get(&place).map(|&index| &self.bricks[index as usize])
    }

    /// Sets voxels.
    pub fn set(&mut self, voxels: impl IntoIterator<Item = [i32; 3]>) {
        for voxel in voxels {
            let bit = 1 << octant(voxel);
            self.merge_byte(voxel.map(|c| c >> 1), bit);
        }
    }

    /// Sets the voxels of a base cell whose bits are set in `byte`.
    pub fn merge_byte(&mut self, cell: [i32; 3], byte: u8) {
        if byte == 0 {
            return;
        }
        let place = cell.map(|c| c >> (BRICK - 1));
        let index = *self.places.entry(place).or_insert_with(|| {
            *self.groups.entry(place.map(|c| c >> (GROUP - BRICK))).or_default() += 1;
            self.bricks.push(Brick { base: [0; 512], mip: [0; 64], mip2: [0; 8] });
            self.bricks.len() as u32 - 1
        });
        let brick = &mut self.bricks[index as usize];
        brick.base[at(cell, 3)] |= byte;
        let above = cell.map(|c| c >> 1);
        brick.mip[at(above, 2)] |= 1 << octant(cell);
        brick.mip2[at(above.map(|c| c >> 1), 1)] |= 1 << octant(above);
    }

    /// Adds the voxels of a row of base cells along x, from `cell` on, to `row`.
    pub fn merge_row_into(&self, cell: [i32; 3], row: &mut [u8]) {
        let mut x = cell[0];
        let mut rest = row;
        while !rest.is_empty() {
            let count = ((8 - (x & 7)) as usize).min(rest.len());
            let (part, others) = rest.split_at_mut(count);
            if let Some(brick) = self.brick([x >> 3, cell[1] >> 3, cell[2] >> 3]) {
                let start = at([x, cell[1], cell[2]], 3);
                part.iter_mut().zip(&brick.base[start..start + count]).for_each(|(to, from)| *to |= from);
            }
            x += count as i32;
            rest = others;
        }
    }

    /// The base cells that have voxels, each with its byte, in no particular order.
    pub fn cells(&self) -> impl Iterator<Item = ([i32; 3], u8)> {
        self.places.iter().flat_map(|(place, &index)| {
            let brick = &self.bricks[index as usize];
            let cell = move |i: usize| {
                let within = [i & 7, i >> 3 & 7, i >> 6].map(|c| c as i32);
                (std::array::from_fn(|axis| place[axis] * 8 + within[axis]), brick.base[i])
            };
            (0..512).map(cell).filter(|(_, byte)| *byte != 0)
        })
    }

    /// The least extent around all voxels, to the edges of bricks.
    pub fn extent(&self) -> Extent {
        let brick = |place: &[i32; 3]| Extent { low: place.map(|c| c * 8), high: place.map(|c| c * 8 + 8) };
        self.places.keys().fold(Extent { low: [0; 3], high: [0; 3] }, |all, place| all.around(&brick(place)))
    }
}

impl Occupancy for Bricks {
    fn coarsest(&self) -> u32 {
        GROUP
    }

    fn occupied(&self, level: u32, cell: [i32; 3]) -> bool {
        if level > BRICK {
            // The level between bricks and groups is not stored: its cells are as the group around them.
            return self.groups.contains_key(&cell.map(|c| c >> (GROUP - level)));
        }
        let Some(brick) = self.brick(cell.map(|c| c >> (BRICK - level))) else { return false };
        match level {
            0 => brick.base[at(cell.map(|c| c >> 1), 3)] & 1 << octant(cell) != 0,
            1 => brick.base[at(cell, 3)] != 0,
            2 => brick.mip[at(cell, 2)] != 0,
            3 => brick.mip2[at(cell, 1)] != 0,
            _ => true,
        }
    }

    fn bounds(&self) -> Option<[[i32; 3]; 2]> {
        None
    }
}
