//! The esvo file format specification: rules and test vectors.
