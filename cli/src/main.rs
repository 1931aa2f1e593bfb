//! The esvo command line.
fn main() {}
