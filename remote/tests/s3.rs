//! An object store: `remote/tests/s3.sh` starts an emulator of S3 and runs this.

mod common;

use common::{bytes, octree, options};
use esvo_format::{IndexReader, RangeRead, Region};
use esvo_remote::{RemoteError, RemoteFile};

/// `ESVO_S3_BUCKET` has the file `octree.esvo`, whose bytes are those of `ESVO_S3_FILE`, and `replace.esvo`. Commands of
/// `ESVO_S3_REPLACE` replace the second one.
#[test]
#[ignore = "needs an emulator of S3: remote/tests/s3.sh"]
fn objects_are_read_by_ranges() {
    let variable = |name: &str| std::env::var(name).unwrap_or_else(|_| panic!("{name} is not set"));
    let bucket = variable("ESVO_S3_BUCKET");
    let local = std::fs::read(variable("ESVO_S3_FILE")).unwrap();
    let file = RemoteFile::open(&format!("s3://{bucket}/octree.esvo"), options()).unwrap();
    assert_eq!((file.len(), file.requests(), file.bytes()), (local.len() as u64, 1, 32 << 10));
    let part = IndexReader::open(&file).and_then(|mut reader| reader.octree(0, &Region::ALL, 4)).unwrap();
    let expected = IndexReader::open(&local).and_then(|mut reader| reader.octree(0, &Region::ALL, 4)).unwrap();
    assert!(part.slots() == expected.slots());
    assert!(file.bytes() < local.len() as u64 / 2, "{} of {}", file.bytes(), local.len());
    assert!(std::fs::read(file.download().unwrap().path()).unwrap() == local);

    let error = RemoteFile::open(&format!("s3://{bucket}/absent.esvo"), options()).unwrap_err();
    assert!(matches!(&error, RemoteError::Refused(what) if what.contains("no such object")), "{error}");

    let file = RemoteFile::open(&format!("s3://{bucket}/replace.esvo"), options()).unwrap();
    let mut end = [0; 8];
    file.read_at(file.len() - 8, &mut end).unwrap();
    let replaced = std::process::Command::new("sh").args(["-c", &variable("ESVO_S3_REPLACE")]).status().unwrap();
    assert!(replaced.success());
    let error = file.read_at(file.len() - 16, &mut end).unwrap_err().to_string();
    assert!(error.contains("was replaced on the server"), "{error}");
}

/// Writes the file that is put into the store.
#[test]
#[ignore = "for remote/tests/s3.sh"]
fn write_the_file() {
    let path = std::env::var("ESVO_S3_FILE").expect("ESVO_S3_FILE");
    std::fs::write(path, bytes(&octree(), true)).unwrap();
}
