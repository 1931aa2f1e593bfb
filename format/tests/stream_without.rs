//! A build without Zstandard refuses compressed files and names the missing feature.
#![cfg(not(feature = "zstd"))]

mod common;

use common::bytes_of;
use common::patch::File;
use common::samples::samples;
use esvo_format::{FormatError, Octree, StreamReader, WriteOptions, ids};

#[test]
fn compressed_files_are_refused_by_name() {
    let mut file = File(bytes_of(&samples()[0].1));
    file.set_u64(16, 1);
    file.seal();
    let check = |error: FormatError| {
        let FormatError::Broken(broken) = error else { panic!("{error}") };
        assert_eq!(broken.rule, ids::REQUIRED_FEATURES);
        assert!(broken.what.contains("feature bit 0") && broken.what.contains("zstd"), "{broken}");
    };
    check(Octree::from_bytes(&file.0).err().expect("refused"));
    check(StreamReader::open(&file.0).err().expect("refused"));
    let error = samples()[0]
        .1
        .write_to_with(&mut Vec::new(), &WriteOptions { compress: Some(3), ..WriteOptions::default() })
        .unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::Unsupported);
}
