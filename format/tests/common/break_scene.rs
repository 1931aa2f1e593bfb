//! Ways to break what a file says beside its octrees: registered metadata, instances, SHA-256.

use esvo_format::file::InstanceEntry;
use esvo_format::{Octree, UpAxis, WriteOptions, join};
use glam::{DMat4, DVec3};

use super::breaks::{Broken, sample, set_meta};
use super::patch::File;
use super::samples::{samples, single_voxel};

/// Two objects, the first placed twice, with metadata.
pub(crate) fn scene() -> Octree {
    let branch = samples().into_iter().find(|(name, _)| *name == "everything").expect("a sample").1;
    let mut octree = join(&[&branch, &single_voxel()]).expect("two small octrees");
    let places = [DMat4::IDENTITY, DMat4::from_scale(DVec3::new(1.0, -2.0, 3.0)), DMat4::from_rotation_z(0.5)];
    let place = |(k, place): (usize, &DMat4)| InstanceEntry::new(k as u32 % 2, *place);
    octree.set_instances(places.iter().enumerate().map(place).collect()).expect("two objects");
    let mut metadata = esvo_format::Metadata::parse(octree.meta()).expect("metadata");
    metadata.up = Some(UpAxis::Y);
    octree.set_meta(metadata.to_string());
    octree
}

/// [`scene`] as a file, with the section HASH if asked for.
fn scene_file(hash: bool) -> File {
    let mut bytes = Vec::new();
    scene().write_to_with(&mut bytes, &WriteOptions { hash, ..WriteOptions::default() }).expect("memory");
    File(bytes)
}

/// A change of the table of instances at a byte.
type Change = (&'static str, fn(&mut File, usize));

const INSTANCES: &[Change] = &[
    ("N001", |f, _| {
        let entry = f.entry(b"INST");
        f.set_u64(entry + 16, 3 * 104 + 8);
    }),
    ("N001", |f, at| {
        f.0[at..at + 3 * 104].fill(0);
        let entry = f.entry(b"INST");
        f.set_u64(entry + 16, 0);
    }),
    ("N002", |f, at| f.set_u32(at, 2)),
    ("N002", |f, at| f.set_u32(at + 208, u32::MAX)),
    ("N003", |f, at| f.set_u64(at + 8, f64::NAN.to_bits())),
    ("N003", |f, at| f.set_u64(at + 96, f64::INFINITY.to_bits())),
    // No extent along one axis; one too small for the inverse.
    ("N003", |f, at| f.set_u64(at + 104 + 8, 0)),
    ("N003", |f, at| [8, 40, 72].iter().for_each(|field| f.set_u64(at + field, 1e-120f64.to_bits()))),
    ("N004", |f, at| f.set_u32(at + 104 + 4, 1)),
];

/// Metadata that breaks a rule, for a file with one object and no instances.
const METADATA: &[(&str, &str)] = &[
    ("M003", r#"{"unit":0}"#),
    ("M003", r#"{"unit":"metre"}"#),
    ("M003", r#"{"up":"y"}"#),
    ("M003", r#"{"up":["+y"]}"#),
    ("M003", r#"{"handedness":"Right"}"#),
    ("M003", r#"{"triangles":-1}"#),
    ("M003", r#"{"cells":1.5}"#),
    ("M003", r#"{"model_voxels":9007199254740992}"#),
    ("M003", r#"{"settings":[]}"#),
    ("M003", r#"{"displacement":null}"#),
    ("M004", r#"{"objects":{}}"#),
    ("M004", r#"{"objects":[{},{}]}"#),
    ("M004", r#"{"objects":[7]}"#),
    ("M004", r#"{"objects":[{"name":7}]}"#),
    ("M004", r#"{"objects":[{"metadata":"none"}]}"#),
    ("M004", r#"{"objects":[{"bounds":[[0,0,0],[1,1,1]]}]}"#),
    ("M004", r#"{"objects":[{"bounds":{"low":[0,0],"high":[1,1]}}]}"#),
    ("M004", r#"{"objects":[{"bounds":{"low":[0,2,0],"high":[1,1,1]}}]}"#),
    ("M004", r#"{"objects":[{"bounds":{"low":[0,0,0]}}]}"#),
    ("M004", r#"{"instances":[{}]}"#),
];

/// All broken files.
pub(crate) fn broken_scenes() -> Vec<Broken> {
    let mut files = Vec::new();
    for (rule, text) in METADATA {
        let mut file = sample("everything");
        set_meta(&mut file, text.as_bytes());
        file.seal();
        files.push(Broken { rule, sample: "everything", bytes: file.0 });
    }
    let mut add = |rule, bytes| files.push(Broken { rule, sample: "scene", bytes });
    for (rule, change) in INSTANCES {
        let mut file = scene_file(false);
        let at = file.section(b"INST").0;
        change(&mut file, at);
        file.seal();
        add(rule, file.0);
    }
    // Half an id; a checksum in the directory.
    let mut file = scene_file(true);
    file.0.truncate(file.0.len() - 8);
    file.set_u64(32, file.0.len() as u64);
    let entry = file.entry(b"HASH");
    file.set_u64(entry + 16, 40);
    file.seal();
    add("F001", file.0);
    let mut file = scene_file(true);
    let entry = file.entry(b"HASH");
    file.set_u32(entry + 4, 0);
    file.seal();
    add("F001", file.0);
    // A bit of the SHA-256, one of the id, and one that no CRC-32 covers.
    for (tag, byte) in [(b"HASH", 31), (b"HASH", 47), (b"crcs", 32)] {
        let mut file = hashed_with_vendor();
        let at = file.section(tag).0 + byte;
        file.0[at] ^= 1;
        add("F002", file.0);
    }
    files
}

/// A file with a section of a vendor that has no CRC-32, and a SHA-256.
fn hashed_with_vendor() -> File {
    let mut file = sample("everything");
    let entry = file.entry(b"META");
    file.0[entry..entry + 4].copy_from_slice(b"crcs");
    file.set_u32(entry + 4, 2);
    file.seal();
    let octree = Octree::from_bytes(&file.0).expect("a sample with a section of a vendor");
    let mut bytes = Vec::new();
    octree.write_to_with(&mut bytes, &WriteOptions { hash: true, ..WriteOptions::default() }).expect("memory");
    File(bytes)
}
