//! The volume: all bytes of a bounded world.

use std::ops::Range;

use rayon::prelude::*;

use super::{Occupancy, octant};
use crate::error::ShadowError;
use crate::extent::Extent;

/// The most voxels along an axis.
pub const MAX_VOXELS: u32 = 8192;
/// The most mips: cells of 2^6 voxels are the largest that rays are traced through.
pub const MAX_MIPS: u32 = 5;

/// One bit for each voxel of a bounded world, in bytes of eight neighbours, with mips.
///
/// Byte `x + w (y + h z)` of the base level has the voxels of a cube of two voxels: bit `i + 2 j + 4 k` is voxel `(2x + i, 2y + j, 2z + k)`. A byte of a mip has
/// a bit for each byte of the level below, in the same order, which is set if that byte is not zero. A level has half the bytes
/// along each axis of the one below, rounded up.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Volume {
    voxels: [u32; 3],
    levels: Vec<Level>,
    /// Those of all levels, one after the other, and [`PADDING`].
    bytes: Vec<u8>,
}

/// Zeros after the last byte, so that four bytes can be read from the place of each.
pub(crate) const PADDING: usize = 3;

/// Where the bytes of one level are; x is fastest.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Level {
    size: [usize; 3],
    bytes: Range<usize>,
}

impl Level {
    /// Place of a cell's byte among those of the level.
    fn at(&self, cell: [usize; 3]) -> usize {
        cell[0] + self.size[0] * (cell[1] + self.size[1] * cell[2])
    }
}

fn level_size(voxels: [u32; 3], level: u32) -> [u64; 3] {
    voxels.map(|n| u64::from(n).div_ceil(2 << level))
}

impl Volume {
    /// Bytes of a world of so many voxels along each axis: the sum, over the base level and the mips `k` = 0 to `mips`, of the product over the axes of
    /// the voxels divided by 2^(k+1), rounded up.
    ///
    /// ```
    /// // 100 m x 100 m x 25 m at 5 cm, and the same in powers of two: 256 + 32 + 4 MiB.
    /// assert_eq!(esvo_shadow::Volume::bytes_needed([2000, 2000, 500], 2), 285_187_500);
    /// assert_eq!(esvo_shadow::Volume::bytes_needed([2048, 2048, 512], 2), (256 + 32 + 4) << 20);
    /// ```
    pub fn bytes_needed(voxels: [u32; 3], mips: u32) -> u64 {
        (0..=mips).map(|level| level_size(voxels, level).iter().product::<u64>()).sum()
    }

    /// An empty world with voxels 0 to `voxels` - 1 along each axis.
    ///
    /// # Errors
    /// No voxel, or more than [`MAX_VOXELS`] along an axis; more than [`MAX_MIPS`] mips; not enough memory.
    pub fn new(voxels: [u32; 3], mips: u32) -> Result<Self, ShadowError> {
        if voxels.iter().any(|&n| n == 0 || n > MAX_VOXELS) {
            return Err(ShadowError::Size(voxels));
        }
        if mips > MAX_MIPS {
            return Err(ShadowError::Mips(mips));
        }
        let bytes_needed = Self::bytes_needed(voxels, mips);
        let mut end = 0;
        let level = |level| {
            let size = level_size(voxels, level).map(|n| n as usize);
            let start = end;
            end += size.iter().product::<usize>();
            Level { size, bytes: start..end }
        };
        let levels = (0..=mips).map(level).collect();
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(end + PADDING).map_err(|_| ShadowError::Memory(bytes_needed))?;
        bytes.resize(end + PADDING, 0);
        Ok(Self { voxels, levels, bytes })
    }

    /// Voxels along each axis.
    pub fn voxels(&self) -> [u32; 3] {
        self.voxels
    }

    /// Number of mips above the base level.
    pub fn mips(&self) -> u32 {
        self.levels.len() as u32 - 1
    }

    /// Bytes of all levels.
    pub fn bytes(&self) -> u64 {
        (self.bytes.len() - PADDING) as u64
    }

    /// The bytes of the base level (0) or a mip, x fastest, and how many there are along each axis.
    ///
    /// # Panics
    /// If there is no such mip.
    pub fn level(&self, mip: u32) -> ([usize; 3], &[u8]) {
        let level = &self.levels[mip as usize];
        (level.size, &self.bytes[level.bytes.clone()])
    }

    /// The bytes of all levels, one after the other, and [`PADDING`].
    pub(crate) fn all_bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Place of the first byte of the base level (0) or a mip among [`all_bytes`](Self::all_bytes).
    pub(crate) fn start_of(&self, mip: u32) -> usize {
        self.levels[mip as usize].bytes.start
    }

    /// All base cells.
    pub fn extent(&self) -> Extent {
        Extent { low: [0; 3], high: self.levels[0].size.map(|n| n as i32) }
    }

    /// Whether a voxel is set; voxels outside of the world are not.
    pub fn get(&self, voxel: [i32; 3]) -> bool {
        self.occupied(0, voxel)
    }

    /// Sets voxels, and their bits in the mips. Voxels outside of the world are left out.
    pub fn set(&mut self, voxels: impl IntoIterator<Item = [i32; 3]>) {
        let limits = self.voxels.map(|n| n as i32);
        for voxel in voxels {
            if (0..3).any(|axis| voxel[axis] < 0 || voxel[axis] >= limits[axis]) {
                continue;
            }
            let mut cell = voxel;
            for level in &self.levels {
                let bit = 1 << octant(cell);
                cell = cell.map(|c| c >> 1);
                let byte = &mut self.bytes[level.bytes.start + level.at(cell.map(|c| c as usize))];
                let before = *byte;
                *byte |= bit;
                if before != 0 {
                    // The levels above know of this byte.
                    break;
                }
            }
        }
    }

    /// Writes the base cells of an extent, and its mips. `write` gets the place of the first cell of a row along x and the row's bytes, and changes these.
    /// What of the extent is outside of the world is left out, and so are voxels of the last cells that are.
    pub fn rewrite(&mut self, extent: &Extent, mut write: impl FnMut([i32; 3], &mut [u8])) {
        let part = extent.intersection(&self.extent());
        if part.is_empty() {
            return;
        }
        let voxels = self.voxels.map(|n| n as i32);
        let base = &self.levels[0];
        for z in part.low[2]..part.high[2] {
            for y in part.low[1]..part.high[1] {
                let at = base.at([part.low[0] as usize, y as usize, z as usize]);
                let row = &mut self.bytes[at..at + part.size()[0]];
                write([part.low[0], y, z], row);
                let mut keep = 0xff;
                for (axis, place, odd) in [(1, y, 0x33), (2, z, 0x0f)] {
                    keep &= if 2 * place + 1 >= voxels[axis] { odd } else { 0xff };
                }
                if keep != 0xff {
                    row.iter_mut().for_each(|byte| *byte &= keep);
                }
                if 2 * part.high[0] > voxels[0]
                    && let Some(last) = row.last_mut()
                {
                    *last &= 0x55;
                }
            }
        }
        self.refresh_mips(&part);
    }

    /// Makes the mips above an extent of base cells anew.
    fn refresh_mips(&mut self, extent: &Extent) {
        let mut part = *extent;
        for mip in 1..self.levels.len() {
            part = part.parents();
            let (below, above) = (&self.levels[mip - 1], &self.levels[mip]);
            let (bytes, bytes_above) = self.bytes.split_at_mut(above.bytes.start);
            let bytes_below = &bytes[below.bytes.clone()];
            let [width, height, _] = above.size;
            let layer = |(z, bytes): (usize, &mut [u8])| {
                for y in part.low[1] as usize..part.high[1] as usize {
                    let row = &mut bytes[width * y + part.low[0] as usize..width * y + part.high[0] as usize];
                    row.fill(0);
                    for (j, k) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let (y, z) = (2 * y + j, 2 * z + k);
                        if y >= below.size[1] || z >= below.size[2] {
                            continue;
                        }
                        let start = below.at([2 * part.low[0] as usize, y, z]);
                        let end = below.at([(2 * part.high[0] as usize).min(below.size[0]), y, z]);
                        for (byte, pair) in row.iter_mut().zip(bytes_below[start..end].chunks(2)) {
                            let odd = pair.get(1).is_some_and(|&byte| byte != 0);
                            *byte |= (u8::from(pair[0] != 0) | u8::from(odd) << 1) << (2 * j + 4 * k);
                        }
                    }
                }
            };
            let layers = part.low[2] as usize * width * height..part.high[2] as usize * width * height;
            let first = part.low[2] as usize;
            let numbered = |(i, bytes)| layer((first + i, bytes));
            if part.cells() > 1 << 16 {
                bytes_above[layers].par_chunks_mut(width * height).enumerate().for_each(numbered);
            } else {
                bytes_above[layers].chunks_mut(width * height).enumerate().for_each(numbered);
            }
        }
    }
}

impl Occupancy for Volume {
    fn coarsest(&self) -> u32 {
        self.levels.len() as u32
    }

    #[inline]
    fn occupied(&self, level: u32, cell: [i32; 3]) -> bool {
        let (byte, mask) = match level {
            0 => (cell.map(|c| c >> 1), 1 << octant(cell)),
            _ => (cell, 0xff),
        };
        let Some(level) = self.levels.get(level.saturating_sub(1) as usize) else { return false };
        // Negative places are large as unsigned ones.
        let byte = byte.map(|c| c as u32 as usize);
        if byte[0] >= level.size[0] || byte[1] >= level.size[1] || byte[2] >= level.size[2] {
            return false;
        }
        self.bytes[level.bytes.start + level.at(byte)] & mask != 0
    }

    fn bounds(&self) -> Option<[[i32; 3]; 2]> {
        Some([[0; 3], self.voxels.map(|n| n as i32)])
    }
    fn dense(&self) -> Option<&Volume> {
        Some(self)
    }
}
