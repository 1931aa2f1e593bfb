//! The contents of an octree in the order of its voxels, regardless of its layout; and damaged files.

use esvo_format::{Octree, oct};
use glam::Vec3;

use super::Rng;

/// A voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Content {
    pub(crate) level: u32,
    pub(crate) slot: u8,
    pub(crate) leaf: bool,
    pub(crate) contour: Option<u32>,
    pub(crate) color: Option<[f32; 3]>,
    pub(crate) normal: Option<Vec3>,
}

/// The voxels of an object in depth-first order.
pub(crate) fn contents(octree: &Octree, object: usize) -> Vec<Content> {
    octree.sound().expect("a sound octree");
    let mut found = Vec::new();
    add(octree, octree.objects()[object].root_slot as u32, 1, &mut found);
    found
}

fn add(octree: &Octree, parent: u32, level: u32, found: &mut Vec<Content>) {
    let descriptor = octree.descriptor(parent);
    for slot in (0..8).filter(|slot| descriptor.valid_mask() >> slot & 1 != 0) {
        let child = octree.child(parent, slot);
        found.push(Content {
            level,
            slot,
            leaf: child.is_none(),
            contour: octree.contour(parent, slot).map(|contour| contour.0),
            color: octree.color(parent, slot),
            normal: octree.normal(parent, slot),
        });
        if let Some(child) = child {
            add(octree, child, level + 1, found);
        }
    }
}

/// Compares every voxel, bit by bit.
pub(crate) fn same(a: &[Content], b: &[Content]) {
    for (index, (a, b)) in a.iter().zip(b).enumerate() {
        assert_eq!(a, b, "voxel {index}");
    }
    assert_eq!(a.len(), b.len());
}

/// Reads the truncated file, and `rounds` variants each with one flipped bit, one replaced word, many replaced bytes.
/// Returns the number of refused variants. All others must be sound.
pub(crate) fn damage(bytes: &[u8], seed: u64, rounds: usize) -> usize {
    let mut rng = Rng(seed);
    let mut refused = 0;
    let mut read = |bytes: &[u8]| match oct::from_bytes(bytes) {
        Ok(imported) => imported.octree.sound().expect("what is imported is sound"),
        Err(error) => {
            assert!(!error.to_string().is_empty());
            refused += 1;
        }
    };
    for _ in 0..rounds / 4 {
        read(&bytes[..rng.below(bytes.len() as u64) as usize]);
    }
    // Damage to bytes that are not zero is more likely to have an effect.
    let used: Vec<usize> = (0..bytes.len() / 4).filter(|word| bytes[4 * word..4 * word + 4] != [0; 4]).collect();
    for round in 0..rounds {
        let mut bytes = bytes.to_vec();
        let word = 4 * used[rng.below(used.len() as u64) as usize];
        match round % 3 {
            0 => bytes[word + rng.below(4) as usize] ^= 1 << rng.below(8),
            1 => {
                let values = [0, 1, 2, 0x7fff_ffff, 0x8000_0000, u32::MAX, u32::MAX - 1, rng.bits() as u32 >> 20];
                bytes[word..word + 4].copy_from_slice(&values[rng.below(8) as usize].to_le_bytes());
            }
            _ => (0..20).for_each(|_| bytes[4 * used[rng.below(used.len() as u64) as usize]] = rng.bits() as u8),
        }
        read(&bytes);
    }
    refused
}
