//! Files made by the authors' builder, with the counts that their loader reports. The files are not in the repository.
//! The tests look for them in `$ESVO_REFERENCE`, then in `../shared/reference` (relative to the repository).

mod common;

use std::collections::BTreeMap;
use std::path::PathBuf;

use common::oct::{contents, damage, same};
use esvo_format::{Octree, diff, oct, stats, validate};

/// Name, levels, descriptors, leaf voxels, contours.
const FILES: [(&str, u32, u64, u64, u64); 5] = [
    ("sibenik_L7_contours_dxt", 7, 22_506, 76_478, 98_983),
    ("sibenik_L7_cubical_dxt", 7, 22_506, 76_478, 0),
    ("sibenik_L6_contours_palette", 6, 4_842, 17_664, 22_505),
    ("sibenik_L6_contours_corner", 6, 4_842, 17_664, 22_505),
    ("sibenik_L6_contours_palette_unoptimized", 6, 4_842, 17_664, 22_505),
];

fn file(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("ESVO_REFERENCE")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/reference"), PathBuf::from);
    let path = folder.join("oct").join(name).with_extension("oct");
    if !path.is_file() {
        println!("skipped: {} is not there; set ESVO_REFERENCE", path.display());
        return None;
    }
    Some(path)
}

#[test]
fn the_counts_are_those_of_the_authors_loader() {
    for (name, levels, descriptors, leaves, contours) in FILES {
        let Some(path) = file(name) else { continue };
        let imported = oct::open(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
        let stats = stats(&imported.octree);
        println!("{name}: lost {:#?}", imported.lost);
        assert_eq!(
            (stats.levels, stats.descriptors, stats.leaf_voxels, stats.contours),
            (levels, descriptors, leaves, contours),
            "{name}"
        );
        assert!(validate(&imported.octree).is_ok(), "{name}: {:?}", validate(&imported.octree).findings);
        assert!(imported.octree.needs().colors && imported.octree.needs().normals);
        let expected: &[&str] = if name.ends_with("unoptimized") { &["have not been built", "meshes"] } else { &[] };
        assert_eq!(imported.lost.len(), expected.len(), "{:?}", imported.lost);
        for (lost, expected) in imported.lost.iter().zip(expected) {
            assert!(lost.contains(expected), "{lost}");
        }
    }
}

#[test]
fn what_is_exported_is_what_was_imported() {
    for (name, ..) in FILES {
        let Some(path) = file(name) else { continue };
        let octree = oct::open(&path).unwrap().octree;
        let mut bytes = Vec::new();
        let lost = oct::write_to(&octree, &mut bytes).unwrap();
        assert!(lost.is_empty(), "{name}: {lost:?}");
        let back = oct::from_bytes(&bytes).unwrap();
        assert!(back.lost.is_empty(), "{:?}", back.lost);
        assert_eq!(back.octree.octree_to_mesh(0), octree.octree_to_mesh(0));
        same(&contents(&octree, 0), &contents(&back.octree, 0));
        assert!(diff::diff(&octree, &back.octree, 3).unwrap().is_empty(), "{name}");
        // Also through our own format. Nothing has changed, so the bytes are equal.
        let mut own = Vec::new();
        octree.write_to(&mut own).unwrap();
        let mut again = Vec::new();
        oct::write_to(&Octree::from_bytes(&own).unwrap(), &mut again).unwrap();
        assert!(again == bytes, "{name}");
        assert!(bytes.len() as u64 <= std::fs::metadata(&path).unwrap().len(), "{name}: {} bytes", bytes.len());
    }
}

/// The contents of a slice in a file, without the gaps between its parts.
#[derive(Debug, PartialEq)]
struct Parts {
    place: Vec<u32>,
    entries: Vec<u32>,
    split: Vec<bool>,
    masks: Vec<u8>,
    /// By type.
    attachments: BTreeMap<u32, Vec<u32>>,
}

/// A second reader, independent of that of the library.
fn slices(bytes: &[u8]) -> BTreeMap<u32, Parts> {
    let words = |bytes: &[u8]| -> Vec<u32> { bytes.as_chunks().0.iter().map(|w| u32::from_le_bytes(*w)).collect() };
    let file = words(bytes);
    let (clusters, cluster_bytes, chunks) = (file[3] as usize, file[4] as usize, file[5] as usize);
    let next = &file[7 + 6 * chunks..][..clusters];
    let mut slices = BTreeMap::new();
    for entry in file[7..].chunks(6).take(chunks).filter(|entry| entry[0] == 2) {
        let mut chunk = Vec::new();
        let mut cluster = entry[2] as usize;
        while cluster != 0x7fff_ffff {
            chunk.extend_from_slice(&bytes[cluster * cluster_bytes..][..cluster_bytes]);
            cluster = next[cluster] as usize;
        }
        let w = words(&chunk);
        let part = |count: usize, offset: usize| &w[w[offset] as usize..][..count];
        let (voxels, nodes) = (w[11] as usize, w[13] as usize);
        let split = part(voxels.div_ceil(32), 12);
        let attachments = part(3 * w[9] as usize, 10).chunks(3);
        let slice = Parts {
            place: w[..7].to_vec(),
            entries: part(w[7] as usize, 8).to_vec(),
            split: (0..voxels).map(|voxel| split[voxel / 32] >> (voxel % 32) & 1 != 0).collect(),
            masks: chunk[4 * w[14] as usize..][..nodes].to_vec(),
            attachments: attachments.map(|a| (a[0], w[a[1] as usize..][..a[2] as usize].to_vec())).collect(),
        };
        slices.insert(entry[1], slice);
    }
    slices
}

/// Our writer reproduces every slice of the authors' builder word by word. Slices that have not been built, and their
/// mesh, are listed as lost.
#[test]
fn files_come_back_slice_by_slice() {
    for (name, ..) in &FILES {
        let Some(path) = file(name) else { continue };
        // Also through our own bytes.
        let mut own = Vec::new();
        oct::open(&path).unwrap().octree.write_to(&mut own).unwrap();
        let mut bytes = Vec::new();
        oct::write_to(&Octree::from_bytes(&own).unwrap(), &mut bytes).unwrap();
        let (mut theirs, mut ours) = (slices(&std::fs::read(path).unwrap()), slices(&bytes));
        if name.ends_with("unoptimized") {
            theirs.retain(|_, slice| slice.place[1] == 2);
            // Unbuilt slices have numbers too, so the numbers differ; compare the other slices by place.
            for slices in [&mut theirs, &mut ours] {
                *slices = std::mem::take(slices).into_values().map(unnumbered).zip(0..).map(|(s, k)| (k, s)).collect();
            }
        }
        assert_eq!(theirs.len(), ours.len(), "{name}");
        for (id, slice) in &theirs {
            assert_eq!(Some(slice), ours.get(id), "{name}, slice {id}");
        }
    }
}

/// The contents of a slice, without the numbers of slices.
fn unnumbered(mut slice: Parts) -> Parts {
    slice.place[0] = 0;
    slice.entries.clear();
    slice
}

#[test]
fn blocks_and_contours_are_carried_over_bit_by_bit() {
    let Some(path) = file("sibenik_L7_contours_dxt") else { return };
    let octree = oct::open(&path).unwrap().octree;
    let slice = slices(&std::fs::read(&path).unwrap());
    let root = octree.objects()[0].root_slot as u32;
    let parts = &octree.parts()[0];
    let attachment = |kind: u32| (parts.attachments.iter().find(|a| a.0 == kind).unwrap().1 / 4) as usize;
    let block = |slot: u32| {
        let pair = (slot / 2) as usize;
        let color = &octree.words()[attachment(1) + 2 * pair..][..2];
        [color, &octree.words()[attachment(2) + 4 * pair..][..4]].concat()
    };
    // Slice 0 is the root, slice 1 its eight children. None of them is a leaf.
    assert_eq!(slice[&0].attachments[&1], block(root));
    let pairs: Vec<u32> = (0..8).step_by(2).flat_map(|k| block(octree.child(root, k).unwrap())).collect();
    assert_eq!(slice[&1].attachments[&1], pairs);
    let contours: Vec<u32> = (0..8).map(|k| octree.contour(root, k).unwrap().0).collect();
    assert_eq!(slice[&0].attachments[&6][1..], contours);
    let second = octree.child(root, 1).unwrap();
    let table = &slice[&1].attachments[&6];
    let first = octree.contour(second, octree.descriptor(second).contour_mask().trailing_zeros() as u8).unwrap();
    assert_eq!(table[(table[1] >> 8) as usize], first.0);
}

/// The same mesh with three kinds of attachments: the attributes of each voxel must be similar. Interpolated corners
/// are smoother than the values of voxels. Unrelated normals would be 90 degrees apart on average.
#[test]
fn blocks_palettes_and_corners_mean_the_same() {
    let open = |name: &str| Some(oct::open(&file(name)?).unwrap().octree);
    let Some(blocks) = open("sibenik_L7_contours_dxt") else { return };
    for (name, allowed) in [("sibenik_L6_contours_palette", 12.0), ("sibenik_L6_contours_corner", 40.0)] {
        let Some(other) = open(name) else { return };
        let (mut angles, mut count, mut contours) = (0.0, 0, 0);
        let root = |octree: &Octree| octree.objects()[0].root_slot as u32;
        let mut stack = vec![(root(&blocks), root(&other))];
        while let Some((a, b)) = stack.pop() {
            for child in (0..8).filter(|child| blocks.descriptor(a).valid_mask() >> child & 1 != 0) {
                assert!(other.descriptor(b).valid_mask() >> child & 1 != 0, "the same voxels");
                let (na, nb) = (blocks.normal(a, child).unwrap(), other.normal(b, child).unwrap());
                angles += na.angle_between(nb).to_degrees();
                let off = |(a, b): (f32, f32)| (a - b).abs();
                let (ca, cb) = (blocks.color(a, child).unwrap(), other.color(b, child).unwrap());
                assert!(ca.into_iter().zip(cb).map(off).fold(0.0, f32::max) < 0.05, "{ca:?} {cb:?}");
                contours += usize::from(blocks.contour(a, child) == other.contour(b, child));
                count += 1;
                stack.extend(blocks.child(a, child).zip(other.child(b, child)));
            }
        }
        let mean = angles / count as f32;
        println!("{name}: {count} voxels, normals {mean:.2} degrees apart, {contours} contours equal");
        assert!(mean < allowed, "{mean} degrees");
    }
}

#[test]
fn damaged_files_are_refused_or_read_and_nothing_else() {
    for (name, ..) in &FILES[2..4] {
        let Some(path) = file(name) else { continue };
        let refused = damage(&std::fs::read(path).unwrap(), 7, 80);
        assert!(refused > 20, "{refused} of 100");
    }
}
