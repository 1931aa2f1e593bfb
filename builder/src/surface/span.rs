//! The range of colours and normals over a piece of surface, and how far a voxel's decoded attributes are from it.

use glam::Vec3A;

/// Least and greatest value of each sRGB-encoded channel and of each component of the unit normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Span {
    pub color: [[u8; 3]; 2],
    pub normal: [Vec3A; 2],
}

impl Span {
    /// Of no surface.
    pub(crate) const EMPTY: Self = Self { color: [[u8::MAX; 3], [0; 3]], normal: [Vec3A::MAX, Vec3A::MIN] };

    /// Of surface that looks the same everywhere.
    pub(crate) fn of(color: [u8; 3], normal: Vec3A) -> Self {
        Self { color: [color; 2], normal: [normal; 2] }
    }

    pub(crate) fn extend(&mut self, other: &Self) {
        for k in 0..3 {
            self.color[0][k] = self.color[0][k].min(other.color[0][k]);
            self.color[1][k] = self.color[1][k].max(other.color[1][k]);
        }
        self.extend_normal(other.normal);
    }

    pub(crate) fn extend_normal(&mut self, [lo, hi]: [Vec3A; 2]) {
        self.normal = [self.normal[0].min(lo), self.normal[1].max(hi)];
    }

    /// The range of the normals, turned to the other side if `side` is -1.
    pub(crate) fn normal_times(&self, side: f32) -> [Vec3A; 2] {
        let [lo, hi] = self.normal;
        if side < 0.0 { [-hi, -lo] } else { [lo, hi] }
    }

    /// Whether all colours are within `bound` steps of 1/256 of a decoded colour, channels 0 to 1.
    pub(crate) fn color_within(&self, decoded: [f32; 3], bound: f32) -> bool {
        let steps = |byte: u8, k: usize| (f32::from(byte) * (256.0 / 255.0) - decoded[k] * 256.0).abs();
        (0..3).all(|k| steps(self.color[0][k], k) <= bound && steps(self.color[1][k], k) <= bound)
    }

    /// Whether some colour is within `bound` steps of 1/256 of all. If not, no voxel can represent them.
    pub(crate) fn color_fits(&self, bound: f32) -> bool {
        let [lo, hi] = self.color;
        (0..3).all(|k| f32::from(hi[k].saturating_sub(lo[k])) * (256.0 / 255.0) <= 2.0 * bound)
    }

    /// Whether all normals are within `bound` of a decoded one, in each component.
    pub(crate) fn normal_within(&self, decoded: Vec3A, bound: f32) -> bool {
        let [lo, hi] = self.normal;
        (decoded - lo).max(hi - decoded).max_element() <= bound
    }

    /// Whether some normal is within `bound` of all.
    pub(crate) fn normal_fits(&self, bound: f32) -> bool {
        (self.normal[1] - self.normal[0]).max_element() <= 2.0 * bound
    }
}
