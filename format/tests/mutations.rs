//! Damaged test vectors: nothing panics, hangs or takes unbounded memory, and every flipped bit is detected.
//!
//! Takes a few seconds by default. `ESVO_MUTATIONS=10000000 cargo test --release -p esvo-format --test mutations` flips
//! every bit of every vector and makes that number of random mutations; `ulimit -v` bounds the memory. With
//! `ESVO_MUTATIONS_OF=parts` only of the vectors whose blocks are stored in parts.

mod common;

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use common::Rng;
use common::patch::File;
use common::survive::survive;
use esvo_format::file::FEATURE_PARTS;
use rayon::prelude::*;

/// Longest time for one input, also in a debug build on a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

/// Number of random mutations.
fn wanted() -> u64 {
    std::env::var("ESVO_MUTATIONS").map_or(20_000, |text| text.parse().expect("ESVO_MUTATIONS is a number"))
}

/// Whether to flip every bit, or only some.
fn thorough() -> bool {
    wanted() >= 1_000_000
}

/// Name and bytes of every vector of a kind.
fn vectors(kind: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../spec/v1/vectors").join(kind);
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "esvo"));
    paths.sort();
    let name = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_owned();
    let mut files: Vec<_> = paths.iter().map(|path| (name(path), fs::read(path).unwrap())).collect();
    if std::env::var("ESVO_MUTATIONS_OF").is_ok_and(|of| of == "parts") {
        files.retain(|(_, bytes)| bytes.get(16).is_some_and(|features| u64::from(*features) & FEATURE_PARTS != 0));
    }
    files
}

/// Runs [`survive`] and checks the time that it takes. What took too long may do so once more: the machine may have slept.
fn survive_in_time(bytes: &[u8], what: &dyn Fn() -> String) -> bool {
    let timed = || {
        let start = Instant::now();
        (survive(bytes), start.elapsed())
    };
    let (found, took) = timed();
    let took = if took < PATIENCE { took } else { timed().1 };
    assert!(took < PATIENCE, "{}: {took:?}", what());
    found
}

/// Bytes that no checksum of version 1 covers and that need not be zero: unknown sections with their own checksums.
fn uncovered(file: &File, byte: usize) -> bool {
    let directory = file.u64(40) as usize;
    (0..file.sections()).map(|i| directory + 32 * i).any(|at| {
        let (offset, length) = (file.u64(at + 8) as usize, file.u64(at + 16) as usize);
        file.u32(at + 4) & 2 != 0 && &file.0[at..at + 4] != b"BLKS" && (offset..offset + length).contains(&byte)
    })
}

#[test]
fn every_flipped_bit_is_noticed() {
    let flips: u64 = vectors("valid").into_par_iter().map(|(name, bytes)| flip_bits(&name, &bytes)).sum();
    println!("{flips} bits flipped");
    assert!(flips > 40_000);
}

fn flip_bits(name: &str, bytes: &[u8]) -> u64 {
    let file = File(bytes.to_vec());
    let mut damaged = bytes.to_vec();
    let mut flips = 0;
    for byte in 0..bytes.len() {
        // By default every byte near a byte that is not zero, and some of the zeros between.
        let near = &bytes[byte.saturating_sub(8)..(byte + 9).min(bytes.len())];
        let bits = match (thorough(), near.iter().any(|b| *b != 0) || byte % 509 == 0) {
            (true, _) => 0..8,
            (_, true) => byte % 8..byte % 8 + 1,
            _ => continue,
        };
        for bit in bits {
            damaged[byte] ^= 1 << bit;
            let noticed = survive_in_time(&damaged, &|| format!("{name}: bit {bit} of byte {byte}"));
            assert!(noticed || uncovered(&file, byte), "{name}: bit {bit} of byte {byte} is not noticed");
            damaged[byte] ^= 1 << bit;
            flips += 1;
        }
    }
    flips
}

#[test]
fn random_mutations_are_survived() {
    let mut seeds = vectors("valid");
    seeds.extend(vectors("invalid"));
    let batches = wanted().div_ceil(1000);
    let noticed: u64 = (0..batches)
        .into_par_iter()
        .map(|batch| {
            let mut rng = Rng(batch << 20 ^ 0x5eed);
            (0..1000).filter(|_| mutate_once(&seeds, &mut rng)).count() as u64
        })
        .sum();
    println!("{} mutations, {noticed} noticed", batches * 1000);
    // Some changes are harmless: another colour, a matching checksum.
    assert!(noticed > batches * 500, "only {noticed} of {batches} thousand were noticed");
}

/// Values at the limits of arithmetic and of the format.
const EDGES: [u64; 16] = [
    0,
    1,
    2,
    7,
    8,
    0x1f,
    0xff,
    0x3ff,
    0x400,
    0x7fff,
    0x8000,
    0xffff_ffff,
    0x8000_0000,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    0xffff_ffff_ffff_ffff,
];

fn mutate_once(seeds: &[(String, Vec<u8>)], rng: &mut Rng) -> bool {
    let (name, seed) = &seeds[rng.below(seeds.len() as u64) as usize];
    let state = rng.0;
    let mut bytes = seed.clone();
    for _ in 0..=rng.below(6) {
        mutate(&mut bytes, seeds, rng);
    }
    // Correct the checksums of most mutations, so that they reach the code after the checks of checksums.
    if rng.chance(200) {
        let mut file = File(bytes);
        file.seal_whatever_is_there();
        bytes = file.0;
    }
    survive_in_time(&bytes, &|| format!("{name} from state {state:#x}"))
}

fn mutate(bytes: &mut Vec<u8>, seeds: &[(String, Vec<u8>)], rng: &mut Rng) {
    let length = bytes.len() as u64;
    if length < 16 {
        bytes.push(rng.bits() as u8);
        return;
    }
    // Mostly at the beginning of the file and of pages.
    let at = match rng.below(4) {
        0 => rng.below(length.min(640)),
        1 => rng.below(length),
        _ => (rng.below(length) / 8192 * 8192 + rng.below(320)).min(length - 1),
    } as usize;
    match rng.below(16) {
        0..=5 => bytes[at] ^= 1 << rng.below(8),
        6..=7 => bytes[at] = rng.bits() as u8,
        8..=9 => put(bytes, at & !3, &(EDGES[rng.below(16) as usize] as u32).to_le_bytes()),
        10 => put(bytes, at & !7, &EDGES[rng.below(16) as usize].to_le_bytes()),
        11 => {
            let nearby = u32::from_le_bytes(*bytes[at & !3..].first_chunk().unwrap_or(&[0; 4]));
            put(bytes, at & !3, &nearby.wrapping_add(rng.below(9) as u32).wrapping_sub(4).to_le_bytes());
        }
        12 => {
            // A slot or a range from elsewhere in the file.
            let (from, count) = (rng.below(length) as usize & !7, 8 << rng.below(5));
            let stretch = bytes[from..(from + count).min(bytes.len())].to_vec();
            put(bytes, at & !7, &stretch);
        }
        13 => {
            let (_, other) = &seeds[rng.below(seeds.len() as u64) as usize];
            let from = (rng.below(other.len() as u64 + 1) as usize) & !7;
            let stretch = other[from..(from + (64 << rng.below(8))).min(other.len())].to_vec();
            put(bytes, at & !7, &stretch);
        }
        14 => bytes.truncate(at),
        _ => {
            let count = rng.below(24) as usize;
            bytes.splice(at..at, std::iter::repeat_n(rng.bits() as u8, count));
        }
    }
}

/// Overwrites the bytes at an offset, up to the end of the file.
fn put(bytes: &mut [u8], at: usize, new: &[u8]) {
    let end = (at + new.len()).min(bytes.len());
    bytes[at..end].copy_from_slice(&new[..end - at]);
}
