//! Morton codes of voxels: bit `3 i + axis` is bit `i` of a coordinate.

/// The code of a voxel; coordinates below 2^21.
#[must_use]
pub fn code(at: [u32; 3]) -> u64 {
    let spread = |x: u32| {
        let mut s = u64::from(x) & 0x1f_ffff;
        s = (s | s << 32) & 0x001f_0000_0000_ffff;
        s = (s | s << 16) & 0x001f_0000_ff00_00ff;
        s = (s | s << 8) & 0x100f_00f0_0f00_f00f;
        s = (s | s << 4) & 0x10c3_0c30_c30c_30c3;
        (s | s << 2) & 0x1249_2492_4924_9249
    };
    spread(at[0]) | spread(at[1]) << 1 | spread(at[2]) << 2
}

/// The voxel with this code.
#[must_use]
pub fn cell(code: u64) -> [u32; 3] {
    let squeeze = |code: u64| {
        let mut s = code & 0x1249_2492_4924_9249;
        s = (s | s >> 2) & 0x10c3_0c30_c30c_30c3;
        s = (s | s >> 4) & 0x100f_00f0_0f00_f00f;
        s = (s | s >> 8) & 0x001f_0000_ff00_00ff;
        s = (s | s >> 16) & 0x001f_0000_0000_ffff;
        ((s | s >> 32) & 0x1f_ffff) as u32
    };
    [squeeze(code), squeeze(code >> 1), squeeze(code >> 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_cells() {
        assert_eq!(code([1, 0, 0]), 1);
        assert_eq!(code([0, 2, 1]), 0b010_100);
        for at in [[0, 0, 0], [4095, 1, 2048], [0x1f_ffff, 0x15_5555, 0x0a_aaaa]] {
            assert_eq!(cell(code(at)), at);
        }
    }
}
