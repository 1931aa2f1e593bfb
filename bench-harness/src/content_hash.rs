//! SHA-256 of what was measured, by which records name it.

use esvo_format::Octree;
use sha2::{Digest, Sha256};

/// SHA-256 of an octree's image in memory.
pub fn image_key(octree: &Octree) -> String {
    let mut hash = Sha256::new();
    let mut bytes = Vec::with_capacity(8 << 12);
    for slots in octree.slots().chunks(1 << 12) {
        bytes.clear();
        slots.iter().for_each(|slot| bytes.extend(slot.to_le_bytes()));
        hash.update(&bytes);
    }
    hex(&hash.finalize())
}

/// Hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}
