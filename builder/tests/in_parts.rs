//! Builds in parts: joined, they are the bytes of a whole build; what does not fit together is named.

use std::path::{Path, PathBuf};

use esvo_builder::{
    BuildPlan, BuildSettings, FileOptions, Material, Mesh, build_file, build_part, is_part, join_parts,
};
use esvo_format::{AssembleOptions, WriteOptions};

/// A ball of many triangles whose colours differ, a large floor, and a small triangle far away.
fn mesh() -> Mesh {
    let mut mesh = Mesh { materials: vec![Material::default()], ..Mesh::default() };
    let mut triangle = |corners: [[f64; 3]; 3]| {
        let first = mesh.positions.len() as u32;
        for p in corners {
            mesh.colors.push(p.map(|x| (x as f32 * 3.0).fract().abs()));
            mesh.positions.push(p);
        }
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangle_materials.push(0);
    };
    let at = |i: u32, k: u32| {
        let (a, b) = (f64::from(i) * 0.2618, f64::from(k) * 0.2618 - std::f64::consts::FRAC_PI_2);
        [0.4 + 0.3 * a.cos() * b.cos(), 0.45 + 0.3 * b.sin(), 0.5 + 0.3 * a.sin() * b.cos()]
    };
    for i in 0..24 {
        for k in 0..12 {
            triangle([at(i, k), at(i + 1, k), at(i, k + 1)]);
            triangle([at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]);
        }
    }
    triangle([[0.0, 0.1, 0.0], [1.0, 0.1, 0.0], [0.0, 0.12, 1.0]]);
    triangle([[0.95, 0.9, 0.9], [0.97, 0.9, 0.93], [0.96, 0.92, 0.91]]);
    mesh
}

fn settings() -> BuildSettings {
    // Blocks of few slots, so that blocks are cut on many levels.
    let assemble = AssembleOptions { block_slots: 4096, ..AssembleOptions::default() };
    BuildSettings { levels: 8, assemble, ..BuildSettings::default() }
}

fn whole(settings: &BuildSettings, write: WriteOptions, folder: &Path) -> Vec<u8> {
    let path = folder.join("whole.esvo");
    build_file(&mesh(), settings, &path, &FileOptions { write, ..FileOptions::default() }, &|_| {}).unwrap();
    std::fs::read(path).unwrap()
}

fn parts(settings: &BuildSettings, count: u32, folder: &Path) -> Vec<PathBuf> {
    let part = |k| {
        let path = folder.join(format!("{k}-of-{count}.esvopart"));
        let built = build_part(&mesh(), settings, (k, count), &path, &FileOptions::default(), &|_| {}).unwrap();
        assert_eq!((built.part, built.parts), (k, count));
        assert!(is_part(&path).unwrap());
        path
    };
    (1..=count).map(part).collect()
}

fn joined(paths: &[PathBuf], write: WriteOptions, folder: &Path) -> Vec<u8> {
    let path = folder.join("joined.esvo");
    join_parts(paths, &path, &write).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn parts_in_any_order_join_to_the_bytes_of_a_whole_build() {
    let folder = tempfile::tempdir().unwrap();
    let expected = whole(&settings(), WriteOptions::default(), folder.path());
    for count in [1, 2, 7, 64] {
        let mut paths = parts(&settings(), count, folder.path());
        paths.rotate_left(count as usize / 2);
        paths.swap(0, count as usize - 1);
        assert!(joined(&paths, WriteOptions::default(), folder.path()) == expected, "{count} parts");
    }
    // Nothing else is left in the folder.
    let left = std::fs::read_dir(folder.path()).unwrap().filter(|file| {
        let name = file.as_ref().unwrap().file_name().into_string().unwrap();
        !name.ends_with(".esvopart") && !name.ends_with(".esvo")
    });
    assert_eq!(left.count(), 0);
}

#[test]
fn every_kind_of_octree_joins() {
    let folder = tempfile::tempdir().unwrap();
    let base = settings();
    let kinds = [
        BuildSettings { contours: false, ..base },
        BuildSettings { contours: false, colors: false, normals: false, ..base },
        BuildSettings { plain_attributes: true, ..base },
        BuildSettings { normals: false, ..base },
        // Nothing below the cubes that are shared out.
        BuildSettings { levels: 4, ..base },
        BuildSettings { levels: 5, ..base },
        BuildSettings { levels: 1, ..base },
    ];
    for settings in kinds {
        let expected = whole(&settings, WriteOptions::default(), folder.path());
        let found = joined(&parts(&settings, 3, folder.path()), WriteOptions::default(), folder.path());
        assert!(found == expected, "{settings:?}");
    }
    for write in [
        WriteOptions { compress: Some(3), ..WriteOptions::default() },
        WriteOptions { parts: true, ..WriteOptions::default() },
    ] {
        let expected = whole(&settings(), write, folder.path());
        assert!(joined(&parts(&settings(), 3, folder.path()), write, folder.path()) == expected, "{write:?}");
    }
}

#[test]
fn a_join_names_what_is_missing_double_or_foreign() {
    let folder = tempfile::tempdir().unwrap();
    let paths = parts(&settings(), 3, folder.path());
    let others = folder.path().join("others");
    std::fs::create_dir(&others).unwrap();
    let coarse = parts(&BuildSettings { levels: 7, ..settings() }, 3, &others);
    let of_two = parts(&settings(), 2, folder.path());
    let output = folder.path().join("out.esvo");
    let error = |paths: &[&PathBuf]| {
        let paths: Vec<PathBuf> = paths.iter().map(|path| (*path).clone()).collect();
        let error = join_parts(&paths, &output, &WriteOptions::default()).expect_err("these do not fit together");
        assert!(!output.exists());
        error.to_string()
    };
    let [a, b, c] = &paths[..] else { panic!("three") };
    let missing = error(&[a, c]);
    assert!(missing.contains("parts 2/3 are missing"), "{missing}");
    let double = error(&[a, b, c, b]);
    assert!(double.contains("is part 2 of 3, and so is"), "{double}");
    let foreign = error(&[a, &coarse[1], c]);
    assert!(foreign.contains("is of another build than") && foreign.contains("others"), "{foreign}");
    let divided = error(&[a, &of_two[1], c]);
    assert!(divided.contains("is one of 2 parts"), "{divided}");
    let mesh = folder.path().join("mesh.obj");
    std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let no_part = error(&[a, &mesh, c]);
    assert!(no_part.contains("is no part of a build"), "{no_part}");
}

#[test]
fn a_damaged_part_is_named_wherever_it_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let mut paths = parts(&settings(), 2, folder.path());
    let good = std::fs::read(&paths[1]).unwrap();
    let output = folder.path().join("out.esvo");
    let damaged = folder.path().join("damaged.esvopart");
    paths[1].clone_from(&damaged);
    let refused = |bytes: &[u8], what: &str| {
        std::fs::write(&damaged, bytes).unwrap();
        let error = join_parts(&paths, &output, &WriteOptions::default()).err().unwrap_or_else(|| panic!("{what}"));
        assert!(error.to_string().contains("damaged.esvopart"), "{what}: {error}");
        assert!(!output.exists(), "{what}");
    };
    for at in (0..good.len()).step_by(good.len() / 97 + 1) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        refused(&bytes, &format!("a bit of byte {at} of {}", good.len()));
        refused(&good[..at], &format!("cut at byte {at} of {}", good.len()));
    }
    refused(&[good.clone(), vec![0]].concat(), "a byte more");
    // And the part as it was is taken.
    std::fs::write(&damaged, &good).unwrap();
    join_parts(&paths, &output, &WriteOptions::default()).unwrap();
}

#[test]
fn a_part_that_was_stopped_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part.esvopart");
    let options = FileOptions { resume: true, ..FileOptions::default() };
    // A build that is stopped leaves its journal; here a panic in the report of progress stops it.
    let stopped = std::panic::catch_unwind(|| {
        build_part(&mesh(), &settings(), (1, 2), &path, &options, &|progress| {
            assert!(progress.done < 0.2, "stop here");
        })
    });
    assert!(stopped.is_err());
    assert!(folder.path().join("part.esvopart.part").exists() && !path.exists());
    let resumed = std::sync::atomic::AtomicU64::new(0);
    build_part(&mesh(), &settings(), (1, 2), &path, &options, &|progress| {
        resumed.fetch_max(progress.resumed, std::sync::atomic::Ordering::Relaxed);
    })
    .unwrap();
    assert!(resumed.into_inner() > 0);
    let fresh = parts(&settings(), 2, folder.path());
    let expected = joined(&fresh, WriteOptions::default(), folder.path());
    assert!(joined(&[path, fresh[1].clone()], WriteOptions::default(), folder.path()) == expected);
}

#[test]
fn a_plan_is_even_and_has_everything_once() {
    let plan = |count| BuildPlan::new(&mesh(), &settings(), count).unwrap();
    let one = plan(1).parts()[0];
    let largest = plan(4096).parts().iter().map(|part| part.voxels).fold(0.0, f64::max);
    for count in [2, 7, 64] {
        let plan = plan(count);
        let parts = plan.parts();
        assert_eq!(parts.iter().map(|part| part.cubes).sum::<u32>(), one.cubes);
        assert_eq!(parts.iter().map(|part| part.pieces).sum::<u64>(), one.pieces);
        let even = one.voxels / f64::from(count);
        assert!(parts.iter().all(|part| (part.voxels - even).abs() <= largest), "{parts:?}");
    }
    let error = |count| BuildPlan::new(&mesh(), &settings(), count).err().expect("out of range").to_string();
    assert!(error(0).contains("1 to 4096") && error(5000).contains("1 to 4096"));
}
