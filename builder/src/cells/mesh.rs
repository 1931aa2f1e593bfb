//! The cells that the triangles of a mesh meet.

use super::list::check_codes;
use super::walk::{Parent, Walk};
use super::{MAX_LEVELS, PreparedMesh};
use crate::BuildError;
use crate::clip;

/// The triangles that meet each of some cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellTriangles {
    /// Where the triangles of each cell begin, and the end of the last.
    starts: Vec<usize>,
    triangles: Vec<u32>,
}

impl CellTriangles {
    /// The triangles that meet the cell at this index of the list that was asked for, as indices into
    /// [`PreparedMesh::corners`], ascending. Empty if none meets it.
    ///
    /// # Panics
    /// If the list has no such cell.
    pub fn of(&self, cell: usize) -> &[u32] {
        &self.triangles[self.starts[cell]..self.starts[cell + 1]]
    }
}

/// Which cells of a level a mesh meets. See [the module](crate::cells) for what counts as meeting.
impl PreparedMesh {
    /// The cells of a level that the mesh meets, as [Morton codes](super::morton()), ascending and distinct. `level` is 1 to 21,
    /// and may differ from the level that the mesh was prepared for.
    ///
    /// Computed on all threads of the current rayon pool. The result does not depend on their number.
    ///
    /// # Errors
    /// A level out of its range.
    pub fn cells(&self, level: u32) -> Result<Vec<u64>, BuildError> {
        check_level(level)?;
        let corners = self.corners();
        let visit = |parent: Parent, cells: &mut Vec<u64>| {
            let Parent { centre, code, pieces, arena } = parent;
            let mut slots = 0;
            for piece in pieces {
                slots |= arena.slots(piece, corners, centre);
                if slots == 0xff {
                    break;
                }
            }
            cells.extend((0..8).filter(|slot| slots >> slot & 1 != 0).map(|slot| code << 3 | slot));
        };
        Ok(Walk { corners, level, wants: |_, _| true, visit }.run())
    }

    /// The triangles that meet each of these cells, which are [Morton codes](super::morton()) on a level of 1 to 21, ascending
    /// and distinct. The cells need not be those that the mesh meets. Time is proportional to the surface around the cells.
    ///
    /// # Errors
    /// A level out of its range; codes that are not ascending, or not below `8^level`.
    pub fn triangles_in(&self, level: u32, cells: &[u64]) -> Result<CellTriangles, BuildError> {
        check_level(level)?;
        check_codes(level, cells)?;
        let corners = self.corners();
        let wants = |code: u64, cube_level: u32| {
            let shift = 3 * (level - cube_level);
            let first = cells.partition_point(|&cell| cell < code << shift);
            cells.get(first).is_some_and(|&cell| cell >> shift == code)
        };
        let visit = |parent: Parent, found: &mut Vec<(usize, u32)>| {
            let Parent { centre, code, pieces, arena } = parent;
            let first = cells.partition_point(|&cell| cell < code << 3);
            let asked = cells[first..].iter().take_while(|&&cell| cell >> 3 == code).count();
            let meeting: Vec<(u32, u8)> =
                pieces.iter().map(|piece| (piece.triangle, arena.slots(piece, corners, centre))).collect();
            for cell in first..first + asked {
                let slot = cells[cell] & 7;
                found.extend(meeting.iter().filter(|(_, slots)| slots >> slot & 1 != 0).map(|(t, _)| (cell, *t)));
            }
        };
        let found = Walk { corners, level, wants, visit }.run();
        let mut starts = vec![0; cells.len() + 1];
        for (cell, _) in &found {
            starts[cell + 1] += 1;
        }
        for cell in 0..cells.len() {
            starts[cell + 1] += starts[cell];
        }
        Ok(CellTriangles { starts, triangles: found.into_iter().map(|(_, triangle)| triangle).collect() })
    }

    /// Whether a triangle, an index into [`corners`](Self::corners), meets the cell with the coordinates `at` on `level`. False
    /// for a cell that does not exist. The level is 0 to 23; on deeper levels there are no cells.
    ///
    /// [`cells`](Self::cells) has a cell exactly if this holds for one of the triangles. Allocates nothing.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn meets(&self, triangle: usize, at: [u32; 3], level: u32) -> bool {
        level <= 23 && at.iter().all(|x| x >> level == 0) && clip::meets(&self.corners()[triangle], at, level)
    }
}

fn check_level(level: u32) -> Result<(), BuildError> {
    if (1..=MAX_LEVELS).contains(&level) {
        return Ok(());
    }
    Err(BuildError::Setting { name: "level", value: level.to_string(), range: "between 1 and 21" })
}
