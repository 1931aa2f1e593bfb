//! Numbers as programs write them.

/// A number: in the spelling of Rust (which includes `.5`, `5.`, `+1`, `nan` and `inf`), of Microsoft's C library (`1.#IND`,
/// `-nan(ind)`), or of Fortran (`1.5D+00`). `None` if the word is no number.
pub(super) fn number(word: &str) -> Option<f64> {
    if let Ok(x) = word.parse() {
        return Some(x);
    }
    let lower = word.to_ascii_lowercase();
    let (negative, bare) = match lower.strip_prefix('-') {
        Some(bare) => (true, bare),
        None => (false, lower.strip_prefix('+').unwrap_or(&lower)),
    };
    let value = if bare.starts_with("1.#inf") {
        f64::INFINITY
    } else if bare.starts_with("1.#") || bare.starts_with("nan(") {
        f64::NAN
    } else if bare.starts_with(|c: char| c.is_ascii_digit() || c == '.') && bare.contains('d') {
        bare.replacen('d', "e", 1).parse().ok()?
    } else {
        return None;
    };
    Some(if negative { -value } else { value })
}

/// A number that is neither infinite nor NaN.
pub(super) fn finite(word: &str) -> Option<f64> {
    number(word).filter(|x| x.is_finite())
}

/// The first `N` words of `text` as finite numbers.
pub(super) fn finite_array<const N: usize>(text: &str) -> Option<[f64; N]> {
    let mut words = text.split_whitespace();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = finite(words.next()?)?;
    }
    Some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_all_programs_are_read() {
        for (word, expected) in
            [(".5", 0.5), ("5.", 5.0), ("+1.5e+00", 1.5), ("-0", 0.0), ("1.5D+01", 15.0), ("-.5d1", -5.0), ("1E0", 1.0)]
        {
            assert_eq!(number(word), Some(expected), "{word}");
        }
        for word in ["nan", "NaN", "-nan", "-nan(ind)", "nan(0x8)", "1.#IND", "-1.#IND00", "1.#QNAN", "1.#SNAN"] {
            assert!(number(word).is_some_and(f64::is_nan), "{word}");
            assert_eq!(finite(word), None);
        }
        assert_eq!((number("-1.#INF"), number("inf")), (Some(f64::NEG_INFINITY), Some(f64::INFINITY)));
        for word in ["", "-", "x", "1,5", "1.5.5", "0x10", "d1", "--1", "1.5d", "1 2"] {
            assert_eq!(number(word), None, "{word}");
        }
    }
}
