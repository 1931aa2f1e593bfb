//! Damaged files: reading them never panics or hangs, and damage covered by a checksum is detected.

mod common;

use common::patch::File;
use common::samples::samples;
use common::survive::survive;
use common::{Rng, bytes_of};
use esvo_format::{FormatError, Octree, ids};

#[test]
fn truncated_files_are_refused() {
    for (name, octree) in samples() {
        let bytes = bytes_of(&octree);
        assert!(!survive(&bytes), "{name} is fine as it is");
        let dense = 0..bytes.len().min(600);
        for length in dense.chain((600..bytes.len()).step_by(97)).chain(bytes.len() - 9..bytes.len()) {
            assert!(survive(&bytes[..length]), "{name} cut to {length} bytes");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert!(survive(&longer), "{name} with a byte more");
    }
}

#[test]
fn every_flipped_bit_of_header_directory_and_tables_is_found() {
    for (name, octree) in samples() {
        let bytes = bytes_of(&octree);
        let (data, _) = File(bytes.clone()).section(b"BLKS");
        let mut damaged = bytes.clone();
        // Before the block data, every byte is covered by a checksum or must be zero.
        for bit in 0..data.min(1024) * 8 {
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(survive(&damaged), "{name}: bit {} of byte {}", bit % 8, bit / 8);
            damaged[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn every_flipped_bit_of_a_block_is_found() {
    let mut rng = Rng(7);
    for (name, octree) in samples() {
        let bytes = bytes_of(&octree);
        let (data, length) = File(bytes.clone()).section(b"BLKS");
        let mut damaged = bytes.clone();
        for _ in 0..2000 {
            // Mostly in the first bytes of a block, which have the most structure.
            let within = if rng.chance(200) { rng.below(512) } else { rng.below(length as u64) };
            let (byte, bit) = (data + within as usize, rng.below(8));
            damaged[byte] ^= 1 << bit;
            assert!(survive(&damaged), "{name}: bit {bit} of byte {byte}");
            damaged[byte] ^= 1 << bit;
        }
    }
}

#[test]
fn damage_under_right_checksums_is_survived() {
    let mut rng = Rng(11);
    let mut found = 0;
    for (_, octree) in samples() {
        let bytes = bytes_of(&octree);
        let (data, length) = File(bytes.clone()).section(b"BLKS");
        for _ in 0..3000 {
            let mut file = File(bytes.clone());
            for _ in 0..=rng.below(4) {
                let byte = match rng.below(3) {
                    0 => 64 + rng.below(500) as usize,
                    1 => data + rng.below(512.min(length as u64)) as usize,
                    _ => 16 + rng.below(44) as usize,
                };
                file.0[byte] ^= 1 << rng.below(8);
            }
            let count = file.sections();
            if count < 100 && (0..count).map(|i| 64 + 32 * i).any(|at| file.0.get(at..at + 4) == Some(b"BLKT")) {
                let (at, table) = file.section(b"BLKT");
                if at.checked_add(table).is_some_and(|end| end <= file.0.len()) {
                    file.seal();
                }
            }
            found += u32::from(survive(&file.0));
        }
    }
    assert!(found > 1000, "only {found} of the changes were noticed");
}

#[test]
fn arbitrary_slots_are_survived() {
    // Random descriptors, with pointers to anywhere.
    let mut rng = Rng(13);
    for (_, octree) in samples() {
        let bytes = bytes_of(&octree);
        for _ in 0..500 {
            let mut file = File(bytes.clone());
            let array = file.u32(file.slot(0)) as u64;
            let slot = file.slot(1 + rng.below(array - 1) as usize);
            let noise = match rng.below(3) {
                0 => rng.bits(),
                1 => rng.bits() & 0xffff_ffff,
                _ => file.u64(slot) ^ rng.bits() & 0x1f_ffff,
            };
            file.set_u64(slot, noise);
            file.seal();
            survive(&file.0);
        }
    }
}

#[test]
fn other_kinds_of_file_are_named() {
    let rule = |bytes: &[u8]| match Octree::from_bytes(bytes) {
        Err(FormatError::Broken(broken)) => broken,
        _ => panic!("opened"),
    };
    assert_eq!(rule(b"").rule, ids::IDENTIFIER);
    assert_eq!(rule(&[0; 4096]).rule, ids::IDENTIFIER);
    assert_eq!(
        rule(b"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nend_header\n").rule,
        ids::IDENTIFIER
    );
    // The two classic kinds of damage by a text-mode transfer.
    let bytes = bytes_of(&samples()[0].1);
    let mut unix = bytes.clone();
    unix.remove(8);
    let mut dos = bytes.clone();
    dos.insert(11, b'\r');
    let mut seven_bit = bytes;
    seven_bit[0] &= 0x7f;
    for (bytes, what) in [(unix, "text-mode"), (dos, "text-mode"), (seven_bit, "not an esvo file")] {
        let broken = rule(&bytes);
        assert_eq!(broken.rule, ids::IDENTIFIER);
        assert!(broken.what.contains(what), "{broken}");
    }
}
