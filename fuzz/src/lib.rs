//! The bodies of the fuzz targets, one module each, which the tests of the format run on the committed inputs as well.

#[allow(dead_code, reason = "the tests take more of it")]
#[path = "../../format/tests/common/patch.rs"]
mod patch;
#[path = "../../format/tests/common/survive.rs"]
mod survive;

pub mod oct;
pub mod open;
pub mod sealed;
pub mod split;
pub mod values;

/// Takes an input and must neither panic nor hang.
pub type Target = fn(&[u8]);

/// Name and body of every target.
pub const TARGETS: [(&str, Target); 5] =
    [("open", open::run), ("sealed", sealed::run), ("values", values::run), ("oct", oct::run), ("split", split::run)];

/// The bytes with every checksum put right that can be found, so that what is behind the checksums is reached.
fn right_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut file = patch::File(bytes.to_vec());
    file.seal_whatever_is_there();
    file.0
}
