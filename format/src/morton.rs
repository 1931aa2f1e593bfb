//! Morton codes: the places of cubes on one level as numbers, in the order of a walk through the octree.

/// The 64-bit Morton code of coordinates below 2^21: bit `3 i + axis` is bit `i` of a coordinate.
///
/// In the order of their codes, cubes of one level follow each other as a depth-first walk in slot order finds them. The code
/// shifted right by 3 is that of the parent, and the lowest 3 bits are the slot. Higher bits of the coordinates are ignored.
pub fn morton(at: [u32; 3]) -> u64 {
    let spread = |x: u32| {
        let mut x = u64::from(x) & 0x1f_ffff;
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    spread(at[0]) | spread(at[1]) << 1 | spread(at[2]) << 2
}

/// The coordinates of a [Morton code](morton).
pub fn morton_place(code: u64) -> [u32; 3] {
    let gather = |code: u64| {
        let mut x = code & 0x1249_2492_4924_9249;
        x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
        x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
        x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
        x = (x | x >> 16) & 0x001f_0000_0000_ffff;
        ((x | x >> 32) & 0x1f_ffff) as u32
    };
    [gather(code), gather(code >> 1), gather(code >> 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_interleave_bits_and_give_the_place_back() {
        assert_eq!(morton([1, 0, 0]), 1);
        assert_eq!(morton([0, 1, 0]), 2);
        assert_eq!(morton([0, 0, 1]), 4);
        assert_eq!(morton([3, 0, 1]), 0b001_101);
        assert_eq!(morton([0x1f_ffff; 3]), (1 << 63) - 1);
        for axis in 0..3 {
            for bit in 0..21 {
                let mut at = [0; 3];
                at[axis] = 1 << bit;
                assert_eq!(morton(at), 1 << (3 * bit + axis as u32));
            }
        }
        for at in [[0; 3], [1, 2, 3], [0x1f_ffff, 0x12_3456, 0x0f_edcb], [0x15_5555, 0x0a_aaaa, 0x1f_ffff]] {
            assert_eq!(morton_place(morton(at)), at);
        }
    }
}
