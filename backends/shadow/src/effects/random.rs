//! Numbers that rays are chosen by.

use glam::{Vec2, Vec3};

/// Mixes the bits of a number.
fn hash(mut x: u32) -> u32 {
    // Multipliers of the finalizer of MurmurHash3.
    x = (x ^ x >> 16).wrapping_mul(0x85eb_ca6b);
    x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
    x ^ x >> 16
}

fn unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// Point `i` of a pixel in the unit square: points of a pixel are spread evenly (the R2 sequence), those of neighbours are shifted to anywhere.
pub(super) fn square(pixel: u32, i: u32, seed: u32) -> Vec2 {
    let key = hash(pixel ^ hash(seed.wrapping_add(0x9e37_79b9)));
    // 2^32 over the plastic number and over its square.
    let (a, b) = (i.wrapping_mul(3_242_174_889), i.wrapping_mul(2_447_445_414));
    Vec2::new(unit(key.wrapping_add(a)), unit(hash(key).wrapping_add(b)))
}

/// A point of the unit disk.
pub(super) fn disk(point: Vec2) -> Vec2 {
    Vec2::from_angle(std::f32::consts::TAU * point.x) * point.y.sqrt()
}

/// A direction around a normal, as often as its cosine is large.
pub(super) fn hemisphere(normal: Vec3, point: Vec2) -> Vec3 {
    let on_disk = disk(point);
    let (x, y) = normal.any_orthonormal_pair();
    let up = (1.0 - on_disk.length_squared()).max(0.0).sqrt();
    (x * on_disk.x + y * on_disk.y + normal * up.max(1e-3)).normalize()
}
