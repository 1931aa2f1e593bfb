//! Cells with attributes, from which an octree is made.

use super::MAX_LEVELS;
use crate::BuildError;

/// The leaves of an octree, all on one level, without contours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cells {
    /// The level of the cells, 1 to 21: their edge is `2^-levels` of the root cube's.
    pub levels: u32,
    /// The [Morton codes](super::morton()) of the cells, ascending and distinct, at least one.
    pub codes: Vec<u64>,
    /// The colour of each cell, sRGB-encoded; or empty, and no colours are stored.
    pub colors: Vec<[u8; 3]>,
    /// The unit shading normal of each cell, with an error of length of at most 1e-3; or empty, and no normals are stored.
    pub normals: Vec<[f32; 3]>,
}

impl Cells {
    /// Checks the rules that the fields name.
    ///
    /// # Errors
    /// The first rule that is broken, and where.
    pub fn check(&self) -> Result<(), BuildError> {
        if !(1..=MAX_LEVELS).contains(&self.levels) {
            return Err(BuildError::Setting {
                name: "levels",
                value: self.levels.to_string(),
                range: "between 1 and 21 for cells",
            });
        }
        if self.codes.is_empty() {
            return Err(BuildError::Cells("there are none; an octree needs at least one".into()));
        }
        check_codes(self.levels, &self.codes)?;
        for (what, found) in [("colours", self.colors.len()), ("normals", self.normals.len())] {
            if found != 0 && found != self.codes.len() {
                let cells = self.codes.len();
                return Err(BuildError::Cells(format!(
                    "there are {found} {what} for {cells} cells; give one for each cell or none"
                )));
            }
        }
        // Written so that it holds for NaN.
        let is_unit = |n: &[f32; 3]| (n.iter().map(|x| x * x).sum::<f32>().sqrt() - 1.0).abs() <= 1e-3;
        if let Some(bad) = self.normals.iter().position(|n| !is_unit(n)) {
            return Err(BuildError::Cells(format!(
                "the normal of cell {bad} is {:?}; it must have the length 1",
                self.normals[bad]
            )));
        }
        Ok(())
    }
}

/// Checks that codes on a level of at most [`MAX_LEVELS`] are ascending, distinct, and those of cells in the root cube.
pub(super) fn check_codes(level: u32, codes: &[u64]) -> Result<(), BuildError> {
    if let Some(i) = codes.windows(2).position(|pair| pair[0] >= pair[1]) {
        return Err(BuildError::Cells(format!(
            "code {} of cell {} is not above code {} before it; sort the codes and remove those that occur twice",
            codes[i + 1],
            i + 1,
            codes[i]
        )));
    }
    // The last is the largest.
    match codes.last() {
        Some(last) if last >> (3 * level) != 0 => Err(BuildError::Cells(format!(
            "code {last} of cell {} is outside of the root cube; on level {level} codes must be below 8^{level}",
            codes.len() - 1
        ))),
        _ => Ok(()),
    }
}
