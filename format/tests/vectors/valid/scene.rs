//! What a file says beside its octrees: registered metadata, instances, SHA-256 and id.

use super::super::writer::{Extra, IDENTITY, Plan};
use super::topology::{branching, smallest};
use super::{Add, extra, one};

/// Objects, instances and the rest in words.
const NAMES: &str = r#"{"unit":0.01,"up":"+z","handedness":"right","objects":[{"name":"a voxel","bounds":{"low":[0.5,0,0.5],"high":[1,0.5,1]}},{"name":"a branch","metadata":{"author":"of the branch","own":[1,2]}}],"instances":[{},{"name":"mirrored","metadata":{"season":"winter"}}]}"#;

pub(super) fn all(add: &mut Add<'_>) {
    let text = r#"{"title":"All that is registered","author":"the esvo contributors","license":"CC0-1.0","source":"nowhere","generator":"a test 1.0","created":"2026-11-28T12:00:00Z","unit":1,"up":"-y","handedness":"left","triangles":12,"cells":0,"model_voxels":9007199254740991,"settings":{"levels":1,"own":{"deep":[true]}},"displacement":{},"objects":[{"name":"a voxel","bounds":{"low":[-1,0,0.5],"high":[-1,1e300,0.5],"own":0},"metadata":{"title":"its own"},"own":null}],"instances":[],"own":"not registered"}"#;
    let plan = Plan { extra: vec![extra(b"META", 0, text.as_bytes())], ..one(1, smallest(4)) };
    add("meta_registered", "every registered member of the metadata, and others", plan);
    let two = |extras: Vec<Extra>| {
        let mut second = branching(8);
        second.object = 1;
        let mut plan = Plan::new(1, vec![smallest(4), second]);
        plan.objects = vec![(1, IDENTITY), (3, IDENTITY)];
        Plan { extra: extras, ..plan }
    };
    let turned = [0., 2., 0., 0., 0., 2., 2., 0., 0., 4., 5., 6.];
    let mirrored = [-1., 0., 0., 0., 1., 0., 0., 0., 1., 0.1, 1e-30, -1e30];
    let table = instances(&[(0, PLAIN), (1, turned), (1, mirrored), (0, turned)]);
    let names = extra(b"META", 0, NAMES.as_bytes());
    add("instances", "both objects placed twice, with names", two(vec![names, extra(b"INST", 0, &table)]));
    let table = instances(&[(1, mirrored)]);
    add(
        "instances_of_one",
        "one object is placed, the other is not in the scene",
        two(vec![extra(b"INST", 0, &table)]),
    );
    let sheared = [1., 0., 0., 0.5, 1., 0., 0., -0.5, 1e-9, 0., 0., 0.];
    let table = instances(&[(0, sheared)]);
    add(
        "instances_required",
        "a shear; the section is flagged as required",
        Plan { extra: vec![extra(b"INST", 1, &table)], ..one(1, smallest(4)) },
    );
    let id: Vec<u8> = (1..=16).collect();
    let hash = |id: &[u8]| extra(b"HASH", 2, &[&[0; 32][..], id].concat());
    add("hash", "a SHA-256, and an id", Plan { extra: vec![hash(&id)], ..one(1, smallest(4)) });
    let own = extra(b"crcs", 2, &[0xff; 33]);
    add(
        "hash_without_id",
        "a SHA-256 without an id, the first of several sections",
        Plan { extra: vec![hash(&[0; 16]), own, extra(b"META", 0, b"{}")], ..one(1, smallest(4)) },
    );
}

/// Where its own transform puts an object.
const PLAIN: [f64; 12] = [1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.];

fn instances(entries: &[(u32, [f64; 12])]) -> Vec<u8> {
    let entry = |(object, matrix): &(u32, [f64; 12])| {
        let mut bytes = [object.to_le_bytes(), [0; 4]].concat();
        bytes.extend(matrix.iter().flat_map(|x| x.to_le_bytes()));
        bytes
    };
    entries.iter().flat_map(entry).collect()
}
