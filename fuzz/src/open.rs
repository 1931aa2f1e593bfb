//! Arbitrary bytes: open, validate, count, walk.

use super::survive::survive;

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    survive(data);
}
