//! The order in which a list of rays is cast.

use esvo_core::Ray;

/// Bits of a coordinate of the origin that count.
const BITS: u32 = 5;

/// Indices of the rays, so that neighbours start near each other and go the same way: they read the same part of the octree,
/// and lanes of a packet stay together. Sorted by the signs of the direction, then by the origin along a Z-order curve.
pub(super) fn of(rays: &[Ray]) -> Vec<u32> {
    let mut keys: Vec<u64> = rays.iter().zip(0u64..).map(|(ray, index)| u64::from(key(ray)) << 32 | index).collect();
    keys.sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

fn key(ray: &Ray) -> u32 {
    let mut key = 0;
    for axis in 0..3 {
        let cells = (1 << BITS) as f32;
        // NaN becomes 0.
        let cell = ((ray.origin[axis] - 1.0) * cells).clamp(0.0, cells - 1.0) as u32;
        key |= (0..BITS).fold(0, |bits, bit| bits | (cell >> bit & 1) << (3 * bit)) << axis;
        key |= u32::from(ray.direction[axis] > 0.0) << (3 * BITS + axis as u32);
    }
    key
}

#[cfg(test)]
mod tests {
    use super::*;
    use esvo_core::testing::rays::incoherent;

    #[test]
    fn every_ray_is_named_once_and_those_that_go_together_are_neighbours() {
        let rays = incoherent(1000, 1);
        let order = of(&rays);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..1000).collect::<Vec<u32>>());
        let same_way = |a: &u32, b: &u32| {
            let [a, b] = [a, b].map(|index| rays[*index as usize].direction);
            (0..3).all(|axis| (a[axis] > 0.0) == (b[axis] > 0.0))
        };
        let together = order.windows(2).filter(|pair| same_way(&pair[0], &pair[1])).count();
        assert_eq!(together, 1000 - 8);
        assert!(of(&[]).is_empty());
    }
}
