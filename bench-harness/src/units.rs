//! Units of bytes.

/// Bytes of a gigabyte, the unit of limits.
pub(crate) const GB: f64 = 1e9;
/// Bytes of a mebibyte, the unit of sizes in tables.
pub(crate) const MIB: f64 = (1u64 << 20) as f64;
