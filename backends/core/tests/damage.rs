//! No damaged octree is loaded.

use std::collections::BTreeSet;
use std::sync::Arc;

use esvo_core::reference::ReferenceCaster;
use esvo_core::testing::sample::{Sample, two_objects};
use esvo_core::{CastError, Caster};
use esvo_format::{FormatError, Octree, OpenOptions, WriteOptions, ids};

/// SplitMix64: the same places in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % n
    }
}

/// Files of cubes and contours, of one and of several blocks, with ambient occlusion, compressed.
fn files() -> Result<Vec<Vec<u8>>, Box<dyn std::error::Error>> {
    let mut files = Vec::new();
    for octree in [Sample::plain(5, false).octree()?, Sample::scattered(5, true).octree()?, two_objects()?] {
        let lit = octree.with_ambient_occlusion(|slot, child| (slot * 31) as u8 ^ child)?;
        for (octree, compress) in [(&*octree, None), (&*octree, Some(3)), (&lit, None)] {
            let mut file = Vec::new();
            octree.write_to_with(&mut file, &WriteOptions { compress, ..WriteOptions::default() })?;
            files.push(file);
        }
    }
    Ok(files)
}

#[test]
fn no_damaged_octree_is_loaded() -> Result<(), Box<dyn std::error::Error>> {
    let files = files()?;
    let mut caster = ReferenceCaster::default();
    for file in &files {
        caster.load(&Arc::new(Octree::from_bytes(file)?))?;
    }
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("in.esvo");
    let trusting = OpenOptions { verify: false, ..OpenOptions::default() };
    let mut random = Random(5);
    let (mut rules, mut taken) = (BTreeSet::new(), 0);
    for flip in 0..500 {
        let whole = &files[flip % files.len()];
        let mut file = whole.clone();
        let first = random.below(file.len() as u64) as usize;
        let second = random.below(file.len() as u64) as usize;
        file[first] ^= 1 + random.below(255) as u8;
        if flip % 2 == 1 && second != first {
            file[second] ^= 1 + random.below(255) as u8;
        }
        std::fs::write(&path, &file)?;
        let octree = match Octree::open(&path) {
            Err(FormatError::Broken(broken)) => {
                rules.insert(broken.rule);
                continue;
            }
            other => Arc::new(other?),
        };
        match caster.load(&octree) {
            Err(CastError::Damaged(broken)) => rules.insert(broken.rule),
            other => panic!("flip {flip} at {first} and {second}: {other:?}"),
        };
        // Without the check, most of them are loaded: this test can fail.
        let octree = Arc::new(Octree::open_with(&path, &trusting)?);
        taken += usize::from(caster.load(&octree).is_ok());
        assert!(octree.write_to(&mut Vec::new()).is_err(), "flip {flip}: it is never written");
    }
    println!("{rules:?}, {taken} taken without the check");
    assert!(rules.contains(ids::BLOCK_CHECKSUM) && rules.contains(ids::FILE_GAPS), "{rules:?}");
    assert!(taken > 100, "only {taken}");
    Ok(())
}
