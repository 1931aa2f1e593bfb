//! Octrees and rays that are hard for a caster, each ray made from a number of its own, so that one can be cast again alone.

mod octrees;
mod rays;

pub use octrees::{DATA_SETS, DataSet, Symmetry, data_sets, sphere};
pub use rays::{Kind, Target, leaks, ray};

use crate::testing::sample::Noise;

/// Noise that differs for neighbouring numbers.
pub fn noise(seed: u64) -> Noise {
    // Two rounds of a mixing function: the generator alone would start similarly for similar seeds.
    let mut x = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    for _ in 0..2 {
        x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^= x >> 31;
    }
    Noise(x)
}

/// One of these.
fn one_of<T: Copy>(noise: &mut Noise, all: &[T]) -> T {
    all[((noise.number() * all.len() as f64) as usize).min(all.len() - 1)]
}
