//! Octrees of lists of cells.

use esvo_builder::cells::{Cells, MAX_LEVELS, morton};
use esvo_builder::{BuildError, BuildSettings, FileOptions, PreparedMesh, build, build_cells, build_cells_file};
use esvo_format::{AssembleOptions, Octree};
use glam::{DMat4, DVec3};

use crate::random::Random;
use crate::triangles::mesh_of;
use crate::{soups, topology};

/// Cells with colours and normals at random.
fn with_attributes(levels: u32, codes: Vec<u64>) -> Cells {
    let mut random = Random(31);
    let colors = codes.iter().map(|_| [0; 3].map(|_| random.next() as u8)).collect();
    let normals = codes.iter().map(|_| (random.point(20) - 0.5).normalize().as_vec3().to_array()).collect();
    Cells { levels, codes, colors, normals }
}

fn octree_of(cells: &Cells, settings: &BuildSettings) -> Octree {
    let octree = build_cells(cells, DMat4::IDENTITY, settings).unwrap().octree;
    let report = esvo_format::validate(&octree);
    assert!(report.findings.is_empty(), "{:?}", report.findings);
    octree
}

/// Many small blocks.
fn small_blocks() -> AssembleOptions {
    AssembleOptions { block_slots: 1 << 10, ..AssembleOptions::default() }
}

/// A surface of more cells than one thread takes alone.
fn many(levels: u32) -> Cells {
    let slope = |x: u32, y: u32| (x * 3 + y * 5) / 8;
    let side = 1u32 << levels;
    let mut codes: Vec<u64> =
        (0..side * side).map(|i| morton([i % side, i / side, slope(i % side, i / side)])).collect();
    codes.sort_unstable();
    with_attributes(levels, codes)
}

#[test]
fn cells_of_a_mesh_have_the_topology_of_its_build() {
    for (name, triangles) in soups().into_iter().filter(|(name, _)| !name.starts_with("almost")) {
        for levels in [1, 2, 6] {
            let mesh = mesh_of(&triangles);
            let settings =
                BuildSettings { levels, contours: false, assemble: small_blocks(), ..BuildSettings::default() };
            let built = build(&mesh, &settings, &|_| ()).unwrap().octree;
            let prepared = PreparedMesh::new(&mesh, levels).unwrap();
            let mut cells = Cells { levels, codes: prepared.cells(levels).unwrap(), ..Cells::default() };
            let of_cells = build_cells(&cells, prepared.octree_to_mesh(), &settings).unwrap().octree;
            assert_eq!(topology(&of_cells), topology(&built), "{name}");
            assert_eq!(of_cells.octree_to_mesh(0), built.octree_to_mesh(0));
            assert_eq!(of_cells.objects()[0].descriptors, built.objects()[0].descriptors);
            assert!(esvo_format::validate(&of_cells).findings.is_empty());
            if cells.codes.len() > 1 {
                cells.codes.remove(cells.codes.len() / 2);
                assert_ne!(topology(&octree_of(&cells, &settings)), topology(&built), "one less would be noticed");
            }
        }
    }
}

#[test]
fn leaves_keep_their_attributes() {
    let cells = many(8);
    let settings = BuildSettings { plain_attributes: true, assemble: small_blocks(), ..BuildSettings::default() };
    let octree = octree_of(&cells, &settings);
    assert_eq!((octree.objects()[0].levels, octree.objects()[0].leaf_voxels), (8, cells.codes.len() as u64));
    let mut waiting = vec![(octree.objects()[0].root_slot as u32, 0)];
    let mut leaves = 0;
    while let Some((slot, parent)) = waiting.pop() {
        let valid = octree.descriptor(slot).valid_mask();
        for child in (0..8u8).filter(|c| valid >> c & 1 != 0) {
            let code = parent << 3 | u64::from(child);
            if let Some(next) = octree.child(slot, child) {
                waiting.push((next, code));
                continue;
            }
            let i = cells.codes.binary_search(&code).unwrap();
            assert_eq!(octree.plain_color(slot, child).unwrap()[..3], cells.colors[i]);
            let normal = octree.normal(slot, child).unwrap();
            assert!((normal - glam::Vec3::from(cells.normals[i])).length() < 1e-3);
            leaves += 1;
        }
    }
    assert_eq!(leaves, cells.codes.len());
}

#[test]
fn inner_voxels_have_the_mean() {
    let cells = Cells {
        levels: 2,
        codes: vec![0, 1],
        colors: vec![[255, 0, 0], [0, 0, 255]],
        normals: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    };
    let octree = octree_of(&cells, &BuildSettings { plain_attributes: true, ..BuildSettings::default() });
    let root = octree.objects()[0].root_slot as u32;
    // The mean of linear light: half of it is 188 of 255.
    assert_eq!(octree.plain_color(root, 0).unwrap()[..3], [188, 0, 188]);
    let normal = octree.normal(root, 0).unwrap();
    assert!((normal - glam::Vec3::new(1.0, 1.0, 0.0).normalize()).length() < 1e-3, "{normal}");
}

#[test]
fn attributes_that_are_not_there_are_not_stored() {
    let both = many(3);
    let settings = BuildSettings { plain_attributes: true, ..BuildSettings::default() };
    for (colors, normals) in [(false, false), (true, false), (false, true), (true, true)] {
        let mut some = both.clone();
        if !colors {
            some.colors.clear();
        }
        if !normals {
            some.normals.clear();
        }
        let missing = octree_of(&some, &settings);
        let root = missing.objects()[0].root_slot as u32;
        assert_eq!(missing.color(root, 0).is_some(), colors);
        assert_eq!(missing.normal(root, 0).is_some(), normals);
        // As if the settings left them out.
        let left_out = octree_of(&both, &BuildSettings { colors, normals, ..settings });
        assert_eq!(missing.words(), left_out.words());
    }
}

#[test]
fn the_file_has_the_bytes_of_the_octree_in_memory_on_any_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let cells = many(9);
    let settings = BuildSettings { assemble: small_blocks(), ..BuildSettings::default() };
    let octree = octree_of(&cells, &settings);
    assert!(octree.blocks().len() > 20, "{}", octree.blocks().len());
    let mut expected = Vec::new();
    octree.write_to(&mut expected).unwrap();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let build = || build_cells_file(&cells, DMat4::IDENTITY, &settings, &path, &FileOptions::default()).unwrap();
        let file = pool.install(build);
        assert_eq!(file.object, octree.objects()[0]);
        assert!(std::fs::read(&path).unwrap() == expected, "{threads} threads");
    }
    let meta: serde_json::Value = serde_json::from_str(octree.meta()).unwrap();
    assert!(meta["generator"].as_str().unwrap().starts_with("esvo-builder "));
    assert_eq!(meta["cells"], cells.codes.len());
    let options = FileOptions { meta: r#"{"generator":"a test"}"#.into(), ..FileOptions::default() };
    build_cells_file(&cells, DMat4::IDENTITY, &settings, &path, &options).unwrap();
    assert_eq!(Octree::open(&path).unwrap().meta(), options.meta);
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["a.esvo"]);
}

#[test]
fn lists_that_break_a_rule_are_refused() {
    let good = with_attributes(2, vec![0, 9, 63]);
    good.check().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let error = |change: &dyn Fn(&mut Cells)| {
        let mut bad = good.clone();
        change(&mut bad);
        let settings = BuildSettings::default();
        let error = build_cells(&bad, DMat4::IDENTITY, &settings).err().unwrap().to_string();
        let of_file = build_cells_file(&bad, DMat4::IDENTITY, &settings, &path, &FileOptions::default());
        assert_eq!(of_file.err().unwrap().to_string(), error);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no file appears");
        error
    };
    assert_eq!(
        error(&|cells| *cells = Cells { levels: 2, ..Cells::default() }),
        "cells: there are none; an octree needs at least one"
    );
    for levels in [0, MAX_LEVELS + 1] {
        let expected = format!("levels is {levels}: it must be between 1 and 21 for cells");
        assert_eq!(error(&|cells| cells.levels = levels), expected);
    }
    let order = |codes: [u64; 3], found: &str| {
        let expected = format!("cells: {found} before it; sort the codes and remove those that occur twice");
        assert_eq!(error(&|cells| cells.codes = codes.to_vec()), expected);
    };
    order([0, 0, 63], "code 0 of cell 1 is not above code 0");
    order([0, 63, 9], "code 9 of cell 2 is not above code 63");
    assert_eq!(
        error(&|cells| cells.codes[2] = 64),
        "cells: code 64 of cell 2 is outside of the root cube; on level 2 codes must be below 8^2"
    );
    assert_eq!(
        error(&|cells| cells.colors.truncate(1)),
        "cells: there are 1 colours for 3 cells; give one for each cell or none"
    );
    assert_eq!(
        error(&|cells| cells.normals.truncate(2)),
        "cells: there are 2 normals for 3 cells; give one for each cell or none"
    );
    for bad in [[0.0; 3], [f32::NAN, 0.0, 0.0], [1.0, 1.0, 0.0]] {
        let expected = format!("cells: the normal of cell 1 is {bad:?}; it must have the length 1");
        assert_eq!(error(&|cells| cells.normals[1] = bad), expected);
    }
    let flat = DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0));
    let error = build_cells(&good, flat, &BuildSettings::default()).err().unwrap();
    assert!(matches!(error, BuildError::Format(_)), "{error}");
}

#[test]
fn the_deepest_cells_and_the_fewest() {
    let last = [(1 << MAX_LEVELS) - 1; 3];
    for (levels, codes) in [(MAX_LEVELS, vec![0, 1, morton(last)]), (MAX_LEVELS, vec![morton(last)]), (1, vec![7])] {
        let cells = with_attributes(levels, codes);
        let octree = octree_of(&cells, &BuildSettings::default());
        let leaves: Vec<u64> = topology(&octree)
            .into_iter()
            .filter(|voxel| voxel.2)
            .map(|(level, code, _)| {
                assert_eq!(level, levels);
                code
            })
            .collect();
        assert_eq!(leaves, cells.codes);
    }
}
