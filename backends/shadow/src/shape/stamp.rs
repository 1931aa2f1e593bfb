//! The voxels of one object.

use crate::extent::Extent;
use crate::volume::octant;

/// Voxels within an extent, a byte for each base cell as in a [`Volume`](crate::Volume), x fastest.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Stamp {
    extent: Extent,
    bytes: Vec<u8>,
}

impl Stamp {
    /// No voxel of an extent.
    pub(crate) fn new(extent: Extent) -> Self {
        Self { extent, bytes: vec![0; extent.cells() as usize] }
    }

    /// What it covers.
    pub fn extent(&self) -> Extent {
        self.extent
    }

    /// Number of voxels.
    pub fn voxels(&self) -> u64 {
        self.bytes.iter().map(|byte| u64::from(byte.count_ones())).sum()
    }

    /// Whether a voxel is set.
    pub fn get(&self, voxel: [i32; 3]) -> bool {
        let cell = voxel.map(|c| c >> 1);
        let inside = (0..3).all(|axis| cell[axis] >= self.extent.low[axis] && cell[axis] < self.extent.high[axis]);
        inside && self.bytes[self.at(cell)] & 1 << octant(voxel) != 0
    }

    fn at(&self, cell: [i32; 3]) -> usize {
        let size = self.extent.size();
        let place: [usize; 3] = std::array::from_fn(|axis| (cell[axis] - self.extent.low[axis]) as usize);
        place[0] + size[0] * (place[1] + size[1] * place[2])
    }

    /// Sets a voxel within the extent.
    pub(crate) fn set(&mut self, voxel: [i32; 3]) {
        let at = self.at(voxel.map(|c| c >> 1));
        self.bytes[at] |= 1 << octant(voxel);
    }

    /// Inverts the voxels of a row from `voxel` on to the end of the extent.
    pub(crate) fn invert_from(&mut self, voxel: [i32; 3]) {
        let row = octant([0, voxel[1], voxel[2]]);
        let both = 0b11 << row;
        let at = self.at(voxel.map(|c| c >> 1));
        let end = self.at([self.extent.high[0] - 1, voxel[1] >> 1, voxel[2] >> 1]);
        self.bytes[at] ^= if voxel[0] & 1 == 0 { both } else { 0b10 << row };
        self.bytes[at + 1..=end].iter_mut().for_each(|byte| *byte ^= both);
    }

    /// Adds all voxels of another with the same extent.
    pub(crate) fn merge(&mut self, other: &Self) {
        debug_assert_eq!(self.extent, other.extent);
        self.bytes.iter_mut().zip(&other.bytes).for_each(|(to, from)| *to |= from);
    }

    /// Adds the voxels of a row of base cells along x, from `cell` on, to `row`.
    pub fn merge_row_into(&self, cell: [i32; 3], row: &mut [u8]) {
        let whole = Extent { low: cell, high: [cell[0] + row.len() as i32, cell[1] + 1, cell[2] + 1] };
        let part = whole.intersection(&self.extent);
        if part.is_empty() {
            return;
        }
        let from = self.at(part.low);
        let to = (part.low[0] - cell[0]) as usize;
        let count = part.size()[0];
        row[to..to + count].iter_mut().zip(&self.bytes[from..from + count]).for_each(|(to, from)| *to |= from);
    }

    /// The base cells that have voxels, each with its byte.
    pub fn cells(&self) -> impl Iterator<Item = ([i32; 3], u8)> {
        let (low, size) = (self.extent.low, self.extent.size());
        self.bytes.iter().enumerate().filter(|(_, byte)| **byte != 0).map(move |(i, &byte)| {
            let within = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            (std::array::from_fn(|axis| low[axis] + within[axis] as i32), byte)
        })
    }
}
