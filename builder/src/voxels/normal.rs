//! Shading normals of voxels: away from the voxels around them.

use glam::Vec3A;
use rayon::prelude::*;

/// The bits of a Morton code that belong to the x coordinate; those of y and z are one and two places higher.
const AXIS: u64 = 0x9249_2492_4924_9249;

/// The Morton code of the next voxel along an axis, towards higher coordinates if `up`; `None` at the end of the `levels`
/// levels of the octree.
fn neighbour(code: u64, axis: usize, up: bool, levels: u32) -> Option<u64> {
    let mask = (AXIS << axis) & ((1u64 << (3 * levels)) - 1);
    let own = code & mask;
    let moved = if up {
        if own == mask {
            return None;
        }
        // The carry passes through the bits of the other axes.
        (own | !mask).wrapping_add(1) & mask
    } else {
        if own == 0 {
            return None;
        }
        own.wrapping_sub(1) & mask
    };
    Some(code & !mask | moved)
}

/// The unit normal of each voxel: the sum of the directions in which there is no voxel among its 26 neighbours. Where these
/// cancel out, as in a wall that is one voxel thick, the positive direction of the first axis with nothing on either side;
/// inside of the model, the z axis. `codes` are the ascending Morton codes of all voxels.
pub(super) fn normals(codes: &[u64], levels: u32) -> Vec<[f32; 3]> {
    codes.par_iter().map(|&code| normal(codes, code, levels).to_array()).collect()
}

fn normal(codes: &[u64], code: u64, levels: u32) -> Vec3A {
    let step = |from: Option<u64>, axis: usize, by: i32| match by {
        0 => from,
        _ => from.and_then(|code| neighbour(code, axis, by > 0, levels)),
    };
    let is_empty = |[x, y, z]: [i32; 3]| {
        let at = step(step(step(Some(code), 0, x), 1, y), 2, z);
        at.is_none_or(|at| codes.binary_search(&at).is_err())
    };
    let mut sum = Vec3A::ZERO;
    for direction in 0..27 {
        let direction = [direction % 3 - 1, direction / 3 % 3 - 1, direction / 9 - 1];
        if direction != [0; 3] && is_empty(direction) {
            sum += Vec3A::from(direction.map(|x| x as f32)).normalize();
        }
    }
    // The sums of rounded unit vectors that cancel out are not exactly zero.
    if sum.length() > 1e-3 {
        return sum.normalize();
    }
    let along = |axis: usize, by: i32| std::array::from_fn(|k| if k == axis { by } else { 0 });
    let open = (0..3).find(|&axis| is_empty(along(axis, 1)) && is_empty(along(axis, -1)));
    match open {
        Some(0) => Vec3A::X,
        Some(1) => Vec3A::Y,
        _ => Vec3A::Z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells::morton;

    #[test]
    fn neighbours_have_the_codes_of_their_places() {
        const LEVELS: u32 = 5;
        for i in 0..32 * 32 * 32u32 {
            let at = [i % 32, i / 32 % 32, i / 1024];
            for axis in 0..3 {
                for up in [false, true] {
                    let mut next = at.map(i64::from);
                    next[axis] += if up { 1 } else { -1 };
                    let expected = next.iter().all(|x| (0..32).contains(x)).then(|| morton(next.map(|x| x as u32)));
                    assert_eq!(neighbour(morton(at), axis, up, LEVELS), expected, "{at:?} {axis} {up}");
                }
            }
        }
        let far = [0x1f_ffff, 0x12_3456, 0x0f_edcb];
        assert_eq!(neighbour(morton(far), 0, true, 21), None);
        assert_eq!(neighbour(morton(far), 1, true, 21), Some(morton([0x1f_ffff, 0x12_3457, 0x0f_edcb])));
    }

    #[test]
    fn normals_point_away_from_the_model() {
        let mut codes: Vec<u64> = (0..27u32).map(|i| morton([1 + i % 3, 1 + i / 3 % 3, 1 + i / 9])).collect();
        codes.sort_unstable();
        let found = normals(&codes, 3);
        let of = |at| Vec3A::from_array(found[codes.binary_search(&morton(at)).unwrap()]);
        assert!((of([2, 2, 3]) - Vec3A::Z).length() < 1e-6);
        assert!((of([1, 2, 2]) + Vec3A::X).length() < 1e-6);
        assert!((of([3, 3, 3]) - Vec3A::ONE.normalize()).length() < 1e-6);
        assert_eq!(of([2, 2, 2]), Vec3A::Z);
        // A wall that is one voxel thick.
        let mut codes: Vec<u64> = (0..9u32).map(|i| morton([4, i % 3, i / 3])).collect();
        codes.sort_unstable();
        let found = normals(&codes, 3);
        assert_eq!(found[codes.binary_search(&morton([4, 1, 1])).unwrap()], [1.0, 0.0, 0.0]);
    }
}
