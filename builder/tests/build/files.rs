//! Building directly into a file.

use super::*;
use esvo_builder::{
    DisplaceOptions, FileOptions, HeightMap, LinearTexture, Progress, UvTransform, build_displaced,
    build_displaced_file, build_file,
};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

fn bumpy(triangles: usize) -> Mesh {
    let mut random = Random(77);
    let soup: Vec<[DVec3; 3]> = (0..triangles)
        .map(|_| {
            let at = random.point();
            std::array::from_fn(|_| at + (random.point() - 0.5) * 0.2)
        })
        .collect();
    mesh_of(&soup)
}

/// Settings with small blocks, so that there are many.
fn settings(levels: u32) -> BuildSettings {
    let assemble = AssembleOptions { block_slots: 1 << 10, ..AssembleOptions::default() };
    BuildSettings { levels, assemble, ..BuildSettings::default() }
}

fn written(octree: &Octree) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree.write_to(&mut bytes).unwrap();
    bytes
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn a_file_has_the_bytes_of_the_octree_in_memory() {
    let (mesh, settings) = (bumpy(60), settings(7));
    let built = run(&mesh, settings);
    assert!(built.octree.blocks().len() > 20, "{} blocks", built.octree.blocks().len());
    let report = esvo_format::validate(&built.octree);
    assert!(report.findings.is_empty(), "{:?}", report.findings);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let build = || build_file(&mesh, &settings, &path, &FileOptions::default(), &|_| ()).unwrap();
        let file = pool.install(build);
        assert_eq!(file.object, built.octree.objects()[0]);
        assert!(std::fs::read(&path).unwrap() == written(&built.octree), "{threads} threads");
    }
    assert_eq!(names(folder.path()), ["a.esvo"]);
}

/// Starts a build that ends before it is finished.
fn interrupt(mesh: &Mesh, settings: &BuildSettings, path: &Path, options: &FileOptions) {
    // A panic in the progress callback is the only way for a caller to stop a build, as if its process were killed.
    let stop = |progress: Progress| assert!(progress.done < 0.9, "stopped here");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        one.install(|| build_file(mesh, settings, path, options, &stop).map(|_| ()))
    }));
    assert!(stopped.is_err(), "it was over too soon");
}

#[test]
fn an_interrupted_build_goes_on() {
    let (mesh, settings) = (bumpy(60), settings(7));
    let whole = written(&run(&mesh, settings).octree);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let options = FileOptions { resume: true, ..FileOptions::default() };
    interrupt(&mesh, &settings, &path, &options);
    assert_eq!(names(folder.path()), ["a.esvo.part"]);
    // A record that was truncated, for example by a full disk.
    let journal = folder.path().join("a.esvo.part/journal");
    let bytes = std::fs::read(&journal).unwrap();
    std::fs::write(&journal, &bytes[..bytes.len() - 5]).unwrap();

    let (first, again) = (AtomicU32::new(0), AtomicU32::new(0));
    let count = |calls: &AtomicU32| {
        calls.fetch_add(1, Ordering::Relaxed);
    };
    let file = build_file(&mesh, &settings, &path, &options, &|_| count(&again)).unwrap();
    assert!(file.resumed && file.resumed_voxels > 0);
    assert!(std::fs::read(&path).unwrap() == whole);
    assert_eq!(names(folder.path()), ["a.esvo"]);
    build_file(&mesh, &settings, &path, &FileOptions::default(), &|_| count(&first)).unwrap();
    let (first, again) = (first.into_inner(), again.into_inner());
    assert!(again < first / 2, "{again} of {first} reports: nothing was taken over");
}

#[test]
fn a_build_does_not_go_on_from_damaged_blocks() {
    let (mesh, settings) = (bumpy(60), settings(7));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let options = FileOptions { resume: true, ..FileOptions::default() };
    interrupt(&mesh, &settings, &path, &options);
    let blocks = folder.path().join("a.esvo.part/blocks");
    let whole = std::fs::read(&blocks).unwrap();
    for place in [0, 9, whole.len() / 3] {
        let mut bytes = whole.clone();
        bytes[place] ^= 4;
        std::fs::write(&blocks, &bytes).unwrap();
        let error = build_file(&mesh, &settings, &path, &options, &|_| ()).err().expect("damaged").to_string();
        for part in ["a.esvo.part: block ", "is damaged", "rule B006", "remove this folder"] {
            assert!(error.contains(part), "{error}");
        }
        assert!(!path.exists() && std::fs::read(&blocks).unwrap() == bytes, "something was written");
    }
    std::fs::write(&blocks, &whole).unwrap();
    assert!(build_file(&mesh, &settings, &path, &options, &|_| ()).unwrap().resumed);
    assert!(std::fs::read(&path).unwrap() == written(&run(&mesh, settings).octree));
}

#[test]
fn what_was_finished_for_other_settings_is_not_taken_over() {
    let mesh = bumpy(20);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let part = folder.path().join("a.esvo.part");
    let options = FileOptions { resume: true, ..FileOptions::default() };
    build_file(&mesh, &settings(5), &path, &options, &|_| ()).unwrap();
    std::fs::create_dir(&part).unwrap();
    std::fs::write(part.join("journal"), b"not a journal at all").unwrap();
    std::fs::write(part.join("notes.txt"), b"of somebody else").unwrap();
    let file = build_file(&mesh, &settings(6), &path, &options, &|_| ()).unwrap();
    assert!(!file.resumed);
    assert!(std::fs::read(&path).unwrap() == written(&run(&mesh, settings(6)).octree));
    assert_eq!(names(&part), ["notes.txt"], "what others put there stays, and nothing else");
}

#[test]
fn the_parts_of_another_build_are_kept() {
    let mesh = bumpy(20);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let part = folder.path().join("a.esvo.part");
    let options = FileOptions { resume: true, ..FileOptions::default() };
    // Stop a build of five levels after its first report.
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        build_file(&mesh, &settings(5), &path, &options, &|p| assert!(p.done < 0.01)).map(|_| ())
    }));
    assert!(stopped.is_err());
    let contents = || ["journal", "blocks"].map(|name| std::fs::read(part.join(name)).unwrap());
    let before = contents();
    for (mesh, settings) in [(&mesh, settings(6)), (&bumpy(21), settings(5))] {
        let error = build_file(mesh, &settings, &path, &options, &|_| ()).err().unwrap();
        assert!(matches!(error, BuildError::OtherWork(_)), "{error}");
        assert!(contents() == before && !path.exists());
    }
    std::fs::write(part.join("journal"), [7; 100]).unwrap();
    let error = build_file(&mesh, &settings(5), &path, &options, &|_| ()).err().unwrap();
    assert!(matches!(error, BuildError::OtherWork(_)), "a file of somebody else: {error}");
    assert_eq!(contents()[0], [7; 100]);
}

#[test]
fn too_little_memory_is_said_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let options = FileOptions { memory_limit: Some(1 << 20), ..FileOptions::default() };
    let error = build_file(&bumpy(20), &settings(5), &path, &options, &|_| ()).err().unwrap();
    assert!(error.to_string().contains("at least"), "{error}");
    assert!(names(folder.path()).is_empty());
    let options = FileOptions { memory_limit: Some(1 << 30), ..FileOptions::default() };
    build_file(&bumpy(20), &settings(5), &path, &options, &|_| ()).unwrap();
}

/// A square with bumps, and options under which it is displaced in several subtrees.
fn bumpy_square() -> (Mesh, DisplaceOptions) {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let texels = (0..64u32 * 64).map(|i| [(i.wrapping_mul(2_654_435_761) >> 16) as u16]).collect();
    let texture = Arc::new(LinearTexture::new(64, 64, texels).unwrap());
    let map = HeightMap { texture, amplitude: 0.05, bias: 0.0, uv_transform: UvTransform::IDENTITY };
    let mesh = Mesh {
        positions: corners.map(|[x, y]| [x, y, 0.2 * x]).to_vec(),
        uvs: corners.map(|[x, y]| [x as f32, y as f32]).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        triangle_materials: vec![0; 2],
        materials: vec![Material { height_map: Some(map), ..Material::default() }],
        ..Mesh::default()
    };
    let options = DisplaceOptions { max_triangles: 3000, ..DisplaceOptions::for_levels(&mesh, 8, 1.0) };
    (mesh, options)
}

#[test]
fn an_interrupted_build_of_a_displaced_mesh_goes_on() {
    let ((mesh, displacement), settings) = (bumpy_square(), settings(8));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let whole = written(&build_displaced(&mesh, &displacement, &settings, &|_| ()).unwrap().octree);
    let options = FileOptions { resume: true, ..FileOptions::default() };
    let build = |displacement: &DisplaceOptions, progress: &(dyn Fn(Progress) + Sync)| {
        build_displaced_file(&mesh, displacement, &settings, &path, &options, progress)
    };
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        build(&displacement, &|p| assert!(p.done < 0.5)).map(|_| ())
    }));
    assert!(stopped.is_err(), "it was over too soon");
    assert_eq!(names(folder.path()), ["a.esvo.part"]);
    let other = build(&DisplaceOptions { scale: 0.5, ..displacement }, &|_| ()).err().unwrap();
    assert!(matches!(other, BuildError::OtherWork(_)), "{other}");
    let file = build(&displacement, &|_| ()).unwrap();
    assert!(file.resumed && file.resumed_voxels > 1000, "{}", file.resumed_voxels);
    assert!(std::fs::read(&path).unwrap() == whole);
    assert_eq!(names(folder.path()), ["a.esvo"]);
    let little = FileOptions { memory_limit: Some(1 << 20), ..FileOptions::default() };
    let error = build_displaced_file(&mesh, &displacement, &settings, &path, &little, &|_| ()).err().unwrap();
    assert!(error.to_string().contains("at least"), "{error}");
}
