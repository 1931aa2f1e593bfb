//! A small deterministic generator (splitmix64).

use glam::DVec3;

pub(crate) struct Random(pub u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// In `0.0..1.0`, a multiple of `2^-bits`; at most 53 bits.
    pub(crate) fn unit(&mut self, bits: u32) -> f64 {
        (self.next() >> 1 >> (63 - bits)) as f64 / (1u64 << bits) as f64
    }

    pub(crate) fn point(&mut self, bits: u32) -> DVec3 {
        DVec3::new(self.unit(bits), self.unit(bits), self.unit(bits))
    }
}
