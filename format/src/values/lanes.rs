//! Sums and weights of vectors of four lanes, for the block encoders.

use glam::Vec4;

/// The sum of the lanes. The order of the additions is the same on every machine, as the bytes of files depend on it.
pub(crate) fn sum(v: Vec4) -> f32 {
    let [a, b, c, d] = v.to_array();
    (a + b) + (c + d)
}

/// The sums of the lanes of three vectors.
pub(crate) fn sums(v: [Vec4; 3]) -> [f32; 3] {
    [sum(v[0]), sum(v[1]), sum(v[2])]
}

/// One in the first `count` lanes, zero in the others.
pub(crate) fn weights<const G: usize>(count: f32) -> [Vec4; G] {
    let mut weights = [Vec4::ZERO; G];
    let mut lane = Vec4::new(0.5, 1.5, 2.5, 3.5);
    for four in &mut weights {
        *four = Vec4::select(lane.cmplt(Vec4::splat(count)), Vec4::ONE, Vec4::ZERO);
        lane += Vec4::splat(4.0);
    }
    weights
}
