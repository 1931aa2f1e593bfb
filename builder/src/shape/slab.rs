//! Slabs (pairs of parallel planes) in the form that the builder computes with: in units of one voxel, from its centre.

use esvo_format::Contour;
use glam::{Vec3, Vec4};

use crate::shape::polyhedron::MAX_SLABS;

/// The slab `lo <= n·p <= hi` of a contour. Units of one voxel, `p` relative to its centre.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slab {
    pub n: Vec3,
    pub lo: f32,
    pub hi: f32,
}

impl Slab {
    pub(crate) fn of(contour: Contour) -> Self {
        let decoded = contour.decode();
        let n = Vec3::from(decoded.normal.map(|c| c as f32));
        Self { n, lo: decoded.lo() as f32, hi: decoded.hi() as f32 }
    }
}

/// `f32::min` without NaN handling, which costs several instructions.
pub(crate) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `f32::max` without NaN handling.
pub(crate) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// An interval from `lo` to `hi` along some direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    pub lo: f32,
    pub hi: f32,
}

impl Range {
    pub(crate) const NONE: Self = Self { lo: f32::MAX, hi: f32::MIN };

    /// The extent of the unit cube around the origin.
    pub(crate) fn of_cube(direction: Vec3) -> Self {
        let reach = direction.abs().element_sum() * 0.5;
        Self { lo: -reach, hi: reach }
    }

    pub(crate) fn add(&mut self, x: f32) {
        self.lo = lesser(self.lo, x);
        self.hi = greater(self.hi, x);
    }

    pub(crate) fn intersect(&mut self, other: &Self) {
        self.lo = greater(self.lo, other.lo);
        self.hi = lesser(self.hi, other.hi);
    }
}

impl Slab {
    /// The extent along `g` of the part of the unit cube around the origin that is inside the slab.
    ///
    /// The farthest point along `g` is a linear program with one constraint besides the box. By its dual it is the minimum
    /// over all `l` of `max(l hi, l lo) + |g - l n|₁ / 2`. This function is convex and piecewise linear with its corners at
    /// 0 and the `g_i / n_i`, so the minimum is at one of them.
    pub(crate) fn extent(&self, g: Vec3) -> Range {
        let Self { n, lo, hi } = *self;
        // One lane for each of the four corners. Where a component of n is zero, 0 is used again.
        let l = (g / n).extend(0.0);
        let l = Vec4::select(l.abs().cmple(Vec4::splat(f32::MAX)), l, Vec4::ZERO);
        let across = ((g.x - l * n.x).abs() + (g.y - l * n.y).abs() + (g.z - l * n.z).abs()) * 0.5;
        let (a, b) = (l * lo, l * hi);
        Range { lo: (a.min(b) - across).max_element(), hi: (a.max(b) + across).min_element() }
    }
}

/// The slabs of a voxel and its ancestors that still bound it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slabs {
    list: [Slab; MAX_SLABS],
    count: usize,
    /// A plane cuts through the whole voxel, and so through all of its descendants that it meets.
    pub plane: bool,
}

impl Default for Slabs {
    fn default() -> Self {
        Self { list: [Slab { n: Vec3::ZERO, lo: 0.0, hi: 0.0 }; MAX_SLABS], count: 0, plane: false }
    }
}

impl Slabs {
    /// Sets these to the slabs of the parent in the units of child `slot`, without those that do not bound the child.
    pub(crate) fn inherit(&mut self, parent: &Slabs, slot: usize) {
        let offset = Vec3::from(std::array::from_fn(|axis| if slot >> axis & 1 != 0 { 0.25 } else { -0.25 }));
        self.clear();
        self.plane = parent.plane;
        for s in parent.as_slice() {
            let at = s.n.dot(offset);
            let (lo, hi) = (2.0 * (s.lo - at), 2.0 * (s.hi - at));
            let reach = s.n.abs().element_sum() * 0.5;
            if lo > -reach || hi < reach {
                self.push(Slab { n: s.n, lo, hi });
            }
        }
    }

    pub(crate) fn clear(&mut self) {
        (self.count, self.plane) = (0, false);
    }

    pub(crate) fn as_slice(&self) -> &[Slab] {
        &self.list[..self.count]
    }

    /// Adds a slab, and drops the older ones that do not bound what it leaves of the voxel.
    pub(crate) fn add(&mut self, slab: Slab) {
        let mut kept = 0;
        // If the list is full, drop the oldest, which has become the widest.
        let first = usize::from(self.count == MAX_SLABS);
        for k in first..self.count {
            let old = self.list[k];
            let left = slab.extent(old.n);
            if left.lo < old.lo || left.hi > old.hi {
                self.list[kept] = old;
                kept += 1;
            }
        }
        self.count = kept;
        self.push(slab);
    }

    fn push(&mut self, slab: Slab) {
        self.list[self.count] = slab;
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::shape::polyhedron::Polyhedron;

    proptest! {
        #[test]
        fn the_extent_of_a_slab_is_that_of_the_cut_cube(
            n in prop::array::uniform3(-31.0f32..31.0), g in prop::array::uniform3(-1.0f32..1.0), zero in 0usize..8,
            middle in -0.9f32..0.9, thickness in 0.01f32..1.0,
        ) {
            let mut n = Vec3::from(n);
            for axis in (0..3).filter(|axis| zero >> axis & 1 != 0) {
                n[axis] = 0.0;
            }
            prop_assume!(n.length() > 1.0);
            let (g, reach) = (Vec3::from(g), n.abs().element_sum() * 0.5);
            let slab = Slab { n, lo: (middle - thickness) * reach, hi: (middle + thickness) * reach };
            let mut polyhedron = Polyhedron::default();
            polyhedron.cut(n, slab.hi, 6);
            polyhedron.cut(-n, -slab.lo, 7);
            let (lo, hi) = polyhedron.extent(g);
            let found = slab.extent(g);
            prop_assert!((found.lo - lo).abs() < 1e-4 && (found.hi - hi).abs() < 1e-4, "{found:?} for {lo} to {hi}");
        }
    }
}
