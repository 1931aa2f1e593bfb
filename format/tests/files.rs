//! Files on disk: refused files, and the state after failed writes.

mod common;

use std::fs;
use std::path::Path;

use common::bytes_of;
use common::samples::samples;
use esvo_format::{FormatError, Octree, ids, validate_file, write_atomically};

fn sample() -> Octree {
    samples().pop().expect("a sample").1
}

fn names(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

/// The error of an operation on `path`, which must name it.
fn io_error<T>(result: Result<T, FormatError>, path: &Path) -> String {
    match result {
        Err(error @ FormatError::Io { .. }) => {
            let text = error.to_string();
            assert!(text.starts_with(&path.display().to_string()), "{text}");
            assert!(!text.contains('\n'), "{text}");
            text
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("{} was accepted", path.display()),
    }
}

#[test]
fn a_written_file_opens_and_can_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    let octree = sample();
    octree.write(&path).unwrap();
    let opened = Octree::open(&path).unwrap();
    assert_eq!(opened.slots(), octree.slots());
    assert_eq!(opened.objects(), octree.objects());
    assert_eq!(opened.parts(), octree.parts());
    assert_eq!(opened.meta(), octree.meta());
    assert!(validate_file(&path).unwrap().findings.is_empty());
    assert_eq!(bytes_of(&opened), fs::read(&path).unwrap());
    // A mapped file can be replaced, the map keeps the old one.
    samples().remove(0).1.write(&path).unwrap();
    assert_eq!(opened.slots(), octree.slots());
    assert_eq!(Octree::open(&path).unwrap().objects()[0].levels, 1);
    assert_eq!(names(folder.path()), ["a.esvo"]);
}

#[test]
fn what_is_not_a_whole_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.esvo");
    io_error(Octree::open(&missing), &missing);
    io_error(validate_file(&missing), &missing);
    assert!(io_error(Octree::open(folder.path()), folder.path()).contains("not a regular file"));
    io_error(validate_file(folder.path()), folder.path());

    let path = folder.path().join("broken.esvo");
    let bytes = bytes_of(&sample());
    for (length, rule) in
        [(0, ids::IDENTIFIER), (63, ids::IDENTIFIER), (64, ids::FILE_LENGTH), (8192, ids::FILE_LENGTH)]
    {
        fs::write(&path, &bytes[..length]).unwrap();
        let Err(FormatError::Broken(broken)) = Octree::open(&path) else { panic!("{length} bytes were opened") };
        assert_eq!(broken.rule, rule);
        let report = validate_file(&path).unwrap();
        assert_eq!(report.findings.len(), 1);
        assert_eq!(report.findings[0].broken, broken);
    }
    // The right length, but the end is a hole.
    fs::write(&path, &bytes[..8192]).unwrap();
    fs::File::options().write(true).open(&path).unwrap().set_len(bytes.len() as u64).unwrap();
    let Err(FormatError::Broken(broken)) = Octree::open(&path) else { panic!("a hole was opened") };
    assert_eq!(broken.rule, ids::PAGE_HEADER);
}

#[cfg(target_os = "linux")]
#[test]
fn devices_are_neither_read_nor_replaced() {
    let full = Path::new("/dev/full");
    assert!(io_error(Octree::open(full), full).contains("not a regular file"));
    assert!(io_error(sample().write(full), full).contains("not a regular file"));
    // A full disk is an error, not a short file.
    let mut device = fs::File::options().write(true).open(full).unwrap();
    let error = sample().write_to(&mut device).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::StorageFull);
}

#[test]
fn writing_where_it_cannot_be_is_one_error_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let octree = sample();
    let missing = folder.path().join("no/such/folder.esvo");
    io_error(octree.write(&missing), &missing);
    assert!(io_error(octree.write(folder.path()), folder.path()).contains("not a regular file"));
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn a_failed_write_keeps_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    fs::write(&path, "old").unwrap();
    let failed = write_atomically(&path, |out| {
        out.write_all(&[7; 100_000])?;
        Err(std::io::Error::from(std::io::ErrorKind::StorageFull))
    });
    assert_eq!(failed.unwrap_err().kind(), std::io::ErrorKind::StorageFull);
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["a.esvo"]);
}

#[test]
fn unknown_sections_survive_rewriting() {
    use common::patch::File;
    // META with another tag is an unknown section.
    for flags in [0, 2] {
        let mut file = File(bytes_of(&sample()));
        let entry = file.entry(b"META");
        file.0[entry..entry + 4].copy_from_slice(b"xyz1");
        file.set_u32(entry + 4, flags);
        file.seal();
        let octree = Octree::from_bytes(&file.0).unwrap();
        assert_eq!(octree.meta(), "");
        assert_eq!(octree.unknown_sections()[0].tag, *b"xyz1");
        assert_eq!(octree.unknown_sections()[0].bytes, sample().meta().as_bytes());
        assert!(is_valid(&file.0));
        assert_eq!(bytes_of(&octree), file.0);
    }
}

fn is_valid(bytes: &[u8]) -> bool {
    esvo_format::validate_bytes(bytes).unwrap().is_ok()
}

#[test]
fn a_great_many_sections_are_refused_at_once() {
    use common::patch::File;
    // A directory of a million entries. Checking every pair would take hours.
    let count = 1_000_000u32;
    let mut file = File(bytes_of(&sample()));
    file.0.resize(64 + 32 * count as usize, 0);
    let length = file.0.len() as u64;
    file.set_u64(32, length);
    file.set_u32(48, count);
    file.seal_header();
    let Err(FormatError::Broken(broken)) = Octree::from_bytes(&file.0) else { panic!("opened") };
    assert_eq!(broken.rule, ids::DIRECTORY_LIMIT);
}

#[test]
fn later_minor_versions_and_optional_features_are_accepted() {
    let mut file = common::patch::File(bytes_of(&sample()));
    file.0[14] = 9;
    file.set_u64(24, u64::MAX);
    // An attachment type that a later minor version may have registered.
    let normals = file.attachment(0, 1);
    assert_eq!(file.u32(normals), 2);
    file.set_u32(normals, 99);
    file.seal();
    let octree = Octree::from_bytes(&file.0).unwrap();
    octree.sound().unwrap();
    assert!(!octree.needs().normals && octree.needs().colors);
    assert_eq!(octree.normal(2, 0), None);
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_read_only_files_are_kept() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let write = |path: &std::path::Path| esvo_format::write_atomically(path, |out| out.write_all(b"new"));
    std::fs::write(at("target"), "old").unwrap();
    symlink(at("target"), at("link")).unwrap();
    write(&at("link")).unwrap();
    assert!(std::fs::symlink_metadata(at("link")).unwrap().is_symlink());
    assert_eq!(std::fs::read(at("target")).unwrap(), b"new");

    symlink(at("loop"), at("loop")).unwrap();
    write(&at("loop")).unwrap_err();
    symlink("/dev/null", at("null")).unwrap();
    write(&at("null")).unwrap_err();

    std::fs::write(at("kept"), "old").unwrap();
    std::fs::set_permissions(at("kept"), PermissionsExt::from_mode(0o444)).unwrap();
    assert_eq!(write(&at("kept")).unwrap_err().to_string(), "exists and is read-only");
    assert_eq!(std::fs::read(at("kept")).unwrap(), b"old");
}
