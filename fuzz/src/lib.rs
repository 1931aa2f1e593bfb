//! The bodies of the fuzz targets, one module each. The tests of esvo-format run them on the committed inputs too.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../../format/tests/common/patch.rs"]
mod patch;
#[path = "../../format/tests/common/survive.rs"]
mod survive;

pub mod oct;
pub mod open;
pub mod sealed;
pub mod split;
pub mod values;

/// A function that must neither panic nor hang on any input.
pub type Target = fn(&[u8]);

/// Name and body of every target.
pub const TARGETS: [(&str, Target); 5] =
    [("open", open::run), ("sealed", sealed::run), ("values", values::run), ("oct", oct::run), ("split", split::run)];

/// The bytes with all checksums corrected that can be found, so that the code after the checks of checksums is reached.
fn right_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut file = patch::File(bytes.to_vec());
    file.seal_whatever_is_there();
    file.0
}
