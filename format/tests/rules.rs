//! A broken file for every rule; the report must contain that rule and no other.

mod common;

use std::collections::BTreeSet;

use common::break_parts::broken_parts;
use common::break_scene::broken_scenes;
use common::breaks::{Broken, broken_files, change_low, sample, set_slot};
use common::samples::samples;
use common::{Colors, Shape, bytes_of};
use esvo_format::{AssembleOptions, Octree, assemble, validate, validate_bytes};
use esvo_spec::{Level, RULES, rule};

/// The ids that validation of these bytes reports.
fn reported(bytes: &[u8]) -> BTreeSet<&'static str> {
    let report = validate_bytes(bytes).expect("no limit of the library is reached");
    let must = report.findings.iter().any(|f| rule(f.broken.rule).unwrap().level == Level::Must);
    assert_eq!(report.is_ok(), !must, "{report}");
    report.findings.iter().map(|f| f.broken.rule).collect()
}

#[test]
fn every_rule_is_reported_when_it_is_broken_and_no_other() {
    let mut tested = BTreeSet::new();
    for (name, octree) in samples() {
        assert_eq!(reported(&bytes_of(&octree)), BTreeSet::new(), "{name} is valid before");
    }
    // Builds without Zstandard cannot say what is wrong with files in parts.
    let parts = if cfg!(feature = "zstd") { broken_parts() } else { Vec::new() };
    for (number, broken) in broken_files().into_iter().chain(broken_scenes()).chain(parts).enumerate() {
        let Broken { rule, sample, bytes } = broken;
        assert_eq!(reported(&bytes), BTreeSet::from([rule]), "case {number} for {rule}, made from {sample}");
        tested.insert(rule);
    }
    for rule in RULES {
        if rule.id.starts_with(['S', 'I']) && cfg!(not(feature = "zstd")) {
            continue;
        }
        assert_eq!(tested.contains(rule.id), rule.no_vector.is_none(), "{}: a case or a reason for none", rule.id);
    }
}

#[test]
fn siblings_do_not_share_a_far_pointer() {
    // For one of them the pointer is wrong too, so this file breaks more than one rule.
    let mut file = sample("blocks");
    change_low(&mut file, 4, |low| low + (1 << 17));
    file.seal();
    assert!(reported(&file.0).contains("C005"));
}

#[test]
fn octrees_in_memory_are_validated_too() {
    for (name, octree) in samples() {
        let report = validate(&octree);
        assert!(report.findings.is_empty(), "{name}: {report}");
        assert!(validate(&Octree::from_bytes(&bytes_of(&octree)).unwrap()).is_ok());
    }
    let octree = samples().remove(0).1;
    let mut image = octree.slots().to_vec();
    image[1] = 1;
    let changed = Octree::from_parts(octree.objects().to_vec(), octree.blocks().to_vec(), image).unwrap();
    let report = validate(&changed);
    assert_eq!(report.findings.len(), 1);
    assert_eq!((report.findings[0].broken.rule, report.findings[0].broken.offset), ("P006", 8));
    let mut objects = octree.objects().to_vec();
    objects[0].levels = 99;
    assert!(Octree::from_parts(objects, octree.blocks().to_vec(), octree.slots().to_vec()).is_err());
}

#[test]
fn an_octree_that_denies_its_far_pointers_is_not_sound() {
    let (_, octree) = samples().into_iter().find(|(name, _)| *name == "far_pointers").expect("a sample");
    let changed = |far_pointers| {
        let mut objects = octree.objects().to_vec();
        objects[0].far_pointers = far_pointers;
        Octree::from_parts(objects, octree.blocks().to_vec(), octree.slots().to_vec()).expect("the tables are right")
    };
    let broken = changed(0).sound().expect_err("casters would leave out what follows far pointers");
    assert_eq!((broken.rule, broken.offset), ("O005", 168));
    assert_eq!(changed(u64::MAX).sound(), Ok(()), "casters follow them");
}

#[test]
fn a_report_is_capped_and_reads_well() {
    let mut file = sample("far_pointers");
    let array = file.u32(file.slot(0)) as usize;
    // Garbage after the parts of a block is one finding, whatever its length; each unused slot is one finding.
    set_slot(&mut file, array + 200, 1);
    set_slot(&mut file, array + 300, 1);
    set_slot(&mut file, 1, 1);
    file.seal();
    let report = validate_bytes(&file.0).unwrap();
    insta::assert_snapshot!(report.to_string());
    insta::assert_snapshot!(serde_json::to_string_pretty(&report).unwrap());

    let shape = Shape {
        seed: 5,
        levels: 6,
        valid: 128,
        leaf: 0,
        contour: 255,
        colors: Colors::None,
        normals: false,
        nodes: 3000,
    };
    let octree = assemble(&shape.tree(), glam::DMat4::IDENTITY, &AssembleOptions::default()).unwrap();
    let mut image = octree.slots().to_vec();
    let parts = &octree.parts()[0];
    let words: &mut [u32] = bytemuck::cast_slice_mut(&mut image);
    words[parts.contour_words..][..parts.contour_count as usize].fill(0xfffc_0000);
    let changed = Octree::from_parts(octree.objects().to_vec(), octree.blocks().to_vec(), image).unwrap();
    let report = validate(&changed);
    assert_eq!(report.findings.len(), 1000);
    assert_eq!(report.errors, u64::from(parts.contour_count));
    assert_eq!(report.left_out, report.errors - 1000);
    assert!(report.to_string().contains(&format!("{} more findings", report.left_out)));
}
