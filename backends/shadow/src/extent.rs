//! Boxes of the volume, and clusters of them.

/// A box of base cells, half open: from `low` up to but without `high`. A base cell is two voxels wide and one byte of the volume.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Extent {
    /// Least cell along each axis.
    pub low: [i32; 3],
    /// One past the greatest cell along each axis.
    pub high: [i32; 3],
}

impl Extent {
    /// The least extent that has the voxels from `low` to `high`, both included.
    pub fn of_voxels(low: [i32; 3], high: [i32; 3]) -> Self {
        Self { low: low.map(|v| v >> 1), high: high.map(|v| (v >> 1) + 1) }
    }

    /// Whether it has no cell.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.low[axis] >= self.high[axis])
    }

    /// Cells along each axis; zero where there is none.
    pub fn size(&self) -> [usize; 3] {
        std::array::from_fn(|axis| self.high[axis].saturating_sub(self.low[axis]).max(0) as usize)
    }

    /// Number of cells, which is the number of bytes in the base level of the volume.
    pub fn cells(&self) -> u64 {
        self.size().map(|n| n as u64).iter().product()
    }

    /// What both have.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|axis| self.low[axis].max(other.low[axis])),
            high: std::array::from_fn(|axis| self.high[axis].min(other.high[axis])),
        }
    }

    /// The least extent around both. One without cells does not count.
    #[must_use]
    pub fn around(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        Self {
            low: std::array::from_fn(|axis| self.low[axis].min(other.low[axis])),
            high: std::array::from_fn(|axis| self.high[axis].max(other.high[axis])),
        }
    }

    /// The cells one mip level up that have a cell of this.
    #[must_use]
    pub fn parents(&self) -> Self {
        Self { low: self.low.map(|x| x >> 1), high: self.high.map(|x| (x + 1) >> 1) }
    }
}

/// Merges extents until no merge saves anything. Rewriting or sending an extent costs its cells plus `each` cells; two are merged if the extent
/// around both costs no more than the two. With `each` 0 only those are merged that together fill a box. Extents without cells are left out.
///
/// Time grows with the square of the number of extents.
pub fn cluster(extents: &[Extent], each: u64) -> Vec<Extent> {
    let mut clusters: Vec<Extent> = extents.iter().filter(|extent| !extent.is_empty()).copied().collect();
    // Whoever grew is compared with all others again.
    let mut next = 0;
    while next < clusters.len() {
        let mut at = 0;
        while at < clusters.len() {
            if at == next {
                at += 1;
                continue;
            }
            let around = clusters[next].around(&clusters[at]);
            if around.cells() <= clusters[next].cells() + clusters[at].cells() + each {
                clusters[next] = around;
                clusters.swap_remove(at);
                if next == clusters.len() {
                    // The one that grew was the last, and has moved.
                    next = at;
                }
                at = 0;
            } else {
                at += 1;
            }
        }
        next += 1;
    }
    clusters
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(low: [i32; 3], edge: i32) -> Extent {
        Extent { low, high: low.map(|x| x + edge) }
    }

    #[test]
    fn neighbours_are_merged_and_strangers_are_not() {
        let extents = [cube([0; 3], 4), cube([4, 0, 0], 4), cube([100, 0, 0], 4)];
        assert_eq!(cluster(&extents, 0), [Extent { low: [0; 3], high: [8, 4, 4] }, extents[2]]);
        assert_eq!(cluster(&extents, 100_000).len(), 1);
        assert_eq!(cluster(&[cube([0; 3], 4), cube([1, 1, 1], 0)], 5), [cube([0; 3], 4)]);
    }

    #[test]
    fn every_cell_stays_in_a_cluster() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as i32 % 40
        };
        for each in [0, 10, 500] {
            let extents: Vec<_> = (0..60).map(|_| cube([random(), random(), random()], 1 + random() % 6)).collect();
            let clusters = cluster(&extents, each);
            for extent in &extents {
                assert!(clusters.iter().any(|cluster| cluster.intersection(extent) == *extent), "{extent:?} at {each}");
            }
            // No pair is left that a merge would make cheaper.
            for (i, a) in clusters.iter().enumerate() {
                for b in &clusters[i + 1..] {
                    assert!(a.around(b).cells() > a.cells() + b.cells() + each);
                }
            }
        }
    }
}
