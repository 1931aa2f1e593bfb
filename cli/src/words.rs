//! Numbers with units, for people to read.

use esvo_bench::text::short;

/// A number and its unit, with a plural `s` unless the number is 1: `1 level`, `2 levels`.
pub(crate) fn count(number: impl Into<u64>, unit: &str) -> String {
    let number = number.into();
    format!("{number} {unit}{}", if number == 1 { "" } else { "s" })
}

/// A size in KiB if it is below 1 MiB, otherwise in MiB.
pub(crate) fn size(bytes: u64) -> String {
    match bytes {
        0..0x10_0000 => format!("{} KiB", short(bytes as f64 / 1024.0)),
        _ => format!("{} MiB", short(bytes as f64 / f64::from(1 << 20))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_units() {
        assert_eq!(count(0u64, "block"), "0 blocks");
        assert_eq!(count(1u32, "block"), "1 block");
        assert_eq!(count(25u64, "block"), "25 blocks");
        assert_eq!(size(8192), "8.00 KiB");
        assert_eq!(size((1 << 20) - 1), "1024 KiB");
        assert_eq!(size(14 << 20), "14.0 MiB");
    }
}
