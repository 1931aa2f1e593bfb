//! Plain values: uncompressed colours and normals, one per voxel or one per corner of a voxel (spec sections 8.5 and
//! 8.6).

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::RawNormal;

/// The value mask of an entry of a plain attachment, and the distance in words from the start of the attachment to the
/// first value.
pub(crate) fn plain_entry(word: u32) -> (u8, usize) {
    (word as u8, (word >> 8) as usize)
}

/// Number of values that an entry of a plain attachment refers to: one for each voxel in its mask, and one that all
/// other voxels share.
pub(crate) fn plain_count(mask: u8, valid: u8) -> usize {
    mask.count_ones() as usize + usize::from(valid & !mask != 0)
}

/// Index of the value of child `child` among them.
pub(crate) fn plain_rank(mask: u8, child: u8) -> usize {
    let below = if mask >> child & 1 != 0 { mask & ((1 << child) - 1) } else { mask };
    below.count_ones() as usize
}

/// Bit of a corner mask: values for the corners of the descriptor's own voxel follow the others.
pub(crate) const OWN_CUBE: u32 = 1 << 27;

/// A colour and a normal at a corner of a voxel.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct CornerValue {
    /// Red, green and blue, sRGB-encoded, and alpha. Alpha 0 means that the corner has no value, as no surface is near
    /// it.
    pub color: [u8; 4],
    /// Normal.
    pub normal: RawNormal,
}

/// Corners of the children of one voxel: a lattice of 3 x 3 x 3 points, x fastest.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct NodeCorners {
    /// Bits 0 to 26: the points that have a value. Bit 27: eight values for the corners `x + 2 y + 4 z` of the voxel
    /// itself follow; they are for children of which some corner has no value. The bits above are zero.
    pub mask: u32,
    /// Index of the first value. The others follow in the order of the bits.
    pub first: u32,
}

impl NodeCorners {
    /// Number of values.
    pub fn count(self) -> usize {
        (self.mask & (OWN_CUBE - 1)).count_ones() as usize + if self.mask & OWN_CUBE != 0 { 8 } else { 0 }
    }

    /// The mask bits of the corners of child `child`, in the order of the corners.
    pub(crate) fn of_child(child: u8) -> [u32; 8] {
        std::array::from_fn(|k| {
            let along = |axis: usize| u32::from(child >> axis & 1) + (k as u32 >> axis & 1);
            1 << (along(0) + 3 * along(1) + 9 * along(2))
        })
    }

    /// Whether all corners of child `child` have a value in the lattice.
    pub fn has_child(self, child: u8) -> bool {
        Self::of_child(child).iter().all(|bit| self.mask & bit != 0)
    }

    /// Index of the value of the point with this bit. The bit must be set in the mask.
    pub(crate) fn rank(self, bit: u32) -> usize {
        (self.mask & (bit - 1)).count_ones() as usize
    }

    /// The cell that child `child` lies in. `values` are those from index [`first`](Self::first) on.
    pub(crate) fn cell(self, child: u8, values: &[CornerValue]) -> Option<CornerCell> {
        if self.has_child(child) {
            let mut corners = [CornerValue::default(); 8];
            for (corner, bit) in corners.iter_mut().zip(Self::of_child(child)) {
                *corner = *values.get(self.rank(bit))?;
            }
            return Some(CornerCell { corners, low: Vec3::ZERO, size: 1.0 });
        }
        let own = (self.mask & OWN_CUBE != 0).then(|| self.rank(OWN_CUBE))?;
        let corners = *values.get(own..)?.first_chunk::<8>()?;
        Some(CornerCell { corners, low: Vec3::ZERO, size: 1.0 }.child(child))
    }
}

/// Values at the corners of a cube, and the place of a voxel in that cube.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CornerCell {
    /// At corner `x + 2 y + 4 z`.
    pub corners: [CornerValue; 8],
    /// Lower corner of the voxel in the cube, whose edge is 1.
    pub low: Vec3,
    /// Edge of the voxel; the edge of the cube is 1.
    pub size: f32,
}

impl CornerCell {
    /// The cell of octant `child` of the voxel.
    pub(crate) fn child(self, child: u8) -> Self {
        let size = self.size * 0.5;
        let offset = Vec3::from([0, 1, 2].map(|axis| f32::from(child >> axis & 1)));
        Self { low: self.low + offset * size, size, ..self }
    }

    /// Colour (sRGB-encoded, alpha last, channels in `0.0..=1.0`) and unit normal at a point of the voxel, interpolated
    /// trilinearly between the corners. Coordinates of the point are 0 to 1 within the voxel. `None` if no corner with
    /// a weight above zero has a value.
    pub fn at(&self, point: Vec3) -> Option<([f32; 4], Vec3)> {
        let at = self.low + self.size * point;
        let (mut color, mut normal, mut sum) = (glam::Vec4::ZERO, Vec3::ZERO, 0.0);
        for (k, value) in self.corners.iter().enumerate() {
            let along = |axis: usize| if k >> axis & 1 != 0 { at[axis] } else { 1.0 - at[axis] };
            let weight = if value.color[3] == 0 { 0.0 } else { along(0) * along(1) * along(2) };
            color += weight * glam::Vec4::from(value.color.map(f32::from));
            normal += weight * value.normal.decode();
            sum += weight;
        }
        (sum > 0.0).then(|| ((color / (sum * 255.0)).to_array(), normal.normalize_or(Vec3::Z)))
    }

    /// Colour and normal at the centre of the voxel.
    pub fn middle(&self) -> Option<([f32; 4], Vec3)> {
        self.at(Vec3::splat(0.5))
    }

    /// The values at the eight corners of the voxel. Corners that are not corners of the cube are interpolated and
    /// rounded.
    pub(crate) fn of_voxel(&self) -> [CornerValue; 8] {
        if self.size == 1.0 {
            return self.corners;
        }
        std::array::from_fn(|k| {
            let point = Vec3::from([0, 1, 2].map(|axis| (k >> axis & 1) as f32));
            self.at(point).map_or(CornerValue::default(), |(color, normal)| CornerValue {
                color: color.map(|c| (c * 255.0).round() as u8),
                normal: RawNormal::encode(normal),
            })
        })
    }
}

/// The child slots in a mask, in order.
pub(crate) fn slots(mask: u8) -> impl Iterator<Item = u8> {
    (0..8).filter(move |slot| mask >> slot & 1 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(r: u8, alpha: u8, normal: Vec3) -> CornerValue {
        CornerValue { color: [r, 0, 0, alpha], normal: RawNormal::encode(normal) }
    }

    #[test]
    fn corners_are_interpolated_and_those_without_a_value_left_out() {
        let mut cell = CornerCell {
            corners: std::array::from_fn(|k| value(if k & 1 == 0 { 0 } else { 200 }, 255, Vec3::X)),
            low: Vec3::ZERO,
            size: 1.0,
        };
        let red = |cell: &CornerCell, x: f32| cell.at(Vec3::new(x, 0.3, 0.6)).unwrap().0[0] * 255.0;
        assert!((red(&cell, 0.25) - 50.0).abs() < 1e-3);
        assert!((cell.child(1).middle().unwrap().0[0] * 255.0 - 150.0).abs() < 1e-3);
        assert_eq!(cell.child(1).of_voxel().map(|v| v.color[0]), [100, 200, 100, 200, 100, 200, 100, 200]);
        for k in [1, 3, 5, 7] {
            cell.corners[k].color[3] = 0;
        }
        assert_eq!(red(&cell, 0.25), 0.0);
        assert_eq!(cell.at(Vec3::X), None, "only corners without a value");
        cell.corners = std::array::from_fn(|k| value(9, 255, if k & 4 == 0 { Vec3::X } else { Vec3::NEG_X }));
        assert_eq!(cell.middle().unwrap().1, Vec3::Z, "opposite normals");
    }

    #[test]
    fn children_find_their_corners_in_the_lattice() {
        let all = NodeCorners { mask: OWN_CUBE - 1, first: 0 };
        let values: Vec<CornerValue> = (0..27).map(|k| value(k, 255, Vec3::Y)).collect();
        let of = |child: u8| all.cell(child, &values).unwrap().corners.map(|v| v.color[0]);
        assert_eq!(of(0), [0, 1, 3, 4, 9, 10, 12, 13]);
        assert_eq!(of(7), [13, 14, 16, 17, 22, 23, 25, 26]);
        let none = NodeCorners { mask: 0, first: 0 };
        assert_eq!(none.cell(3, &values), None);
        let own = NodeCorners { mask: OWN_CUBE | 1, first: 0 };
        assert_eq!(own.count(), 9);
        let cell = own.cell(6, &values).unwrap();
        assert_eq!((cell.corners[0].color[0], cell.low, cell.size), (1, Vec3::new(0.0, 0.5, 0.5), 0.5));
        assert_eq!(own.cell(6, &values[..8]), None, "too few");
    }

    #[test]
    fn ranks_of_plain_values() {
        assert_eq!((plain_count(0b1010, 0b1111), plain_count(0b1111, 0b1111), plain_count(0, 1)), (3, 4, 1));
        assert_eq!([0, 1, 2, 3].map(|child| plain_rank(0b1010, child)), [2, 0, 2, 1]);
    }
}
