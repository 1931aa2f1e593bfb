//! Values that repeat recent ones: two bits each, and the new ones.
//!
//! Neighbouring voxels of a flat surface have the same normals. Six of seven are one of the last three.

/// Puts numbers of two bits into bytes, the first into the lowest bits.
pub(crate) fn pack(tokens: &[u8]) -> Vec<u8> {
    tokens.chunks(4).map(|four| four.iter().rev().fold(0, |byte, token| byte << 2 | token)).collect()
}

/// The `k`-th of the numbers in these bytes.
#[inline(always)]
pub(crate) fn token(bytes: &[u8], k: usize) -> u8 {
    bytes[k / 4] >> (k % 4 * 2) & 3
}

/// How many of the first `count` numbers are at least `least`. `None` if the bits after them are not zero.
pub(crate) fn count(bytes: &[u8], count: usize, least: u8) -> Option<usize> {
    let rest = count % 4;
    if rest != 0 && bytes.last().is_some_and(|last| last >> (rest * 2) != 0) {
        return None;
    }
    let of = |byte: u8| (0..4).filter(|k| byte >> (k * 2) & 3 >= least).count() as u8;
    let table: [u8; 256] = std::array::from_fn(|byte| of(byte as u8));
    // The unused numbers are 0, and `least` is more.
    Some(bytes.iter().map(|byte| usize::from(table[usize::from(*byte)])).sum())
}

/// The last three different values; all 0 at first.
#[derive(Default, Clone, Copy)]
struct Three([u32; 3]);

impl Three {
    /// The value moves to the front.
    #[inline(always)]
    fn take(&mut self, token: u8, new: u32) -> u32 {
        let [a, b, c] = self.0;
        // Selections, not branches: what comes next cannot be predicted.
        let value = if token == 0 {
            a
        } else if token == 1 {
            b
        } else if token == 2 {
            c
        } else {
            new
        };
        self.0 = [value, if token >= 1 { a } else { b }, if token >= 2 { b } else { c }];
        value
    }
}

/// The numbers of values, 0 to 2 for one of the last three, the latest first, and 3 for others; and these others.
pub(crate) fn split_three(values: impl Iterator<Item = u32>) -> (Vec<u8>, Vec<u32>) {
    let (mut recent, mut tokens, mut new) = (Three::default(), Vec::new(), Vec::new());
    for value in values {
        let token = recent.0.iter().position(|other| *other == value).unwrap_or(3) as u8;
        if token == 3 {
            new.push(value);
        }
        recent.take(token, value);
        tokens.push(token);
    }
    (tokens, new)
}

/// Adds the values to words in which their bits are zero. `new` must have one value for each number 3, or more.
pub(crate) fn join_three(tokens: &[u8], new: &[u32], words: &mut [u32]) {
    let (mut recent, mut next) = (Three::default(), 0);
    // One more, so that it can be read before it is known whether it is needed.
    let last = new.len().saturating_sub(1);
    for (four, byte) in words.chunks_mut(4).zip(tokens) {
        let mut byte = *byte;
        for word in four {
            let token = byte & 3;
            byte >>= 2;
            let fresh = if new.is_empty() { 0 } else { new[next.min(last)] };
            *word |= recent.take(token, fresh);
            next += usize::from(token == 3);
        }
    }
}

/// A normal block as two slots.
pub(crate) type Row = [u64; 2];

/// Whether a normal block has nothing but a base: one normal.
fn is_flat(row: &Row) -> bool {
    row[0] >> 32 == 0 && row[1] == 0
}

/// The numbers of normal blocks: 0 for the last one, 1 for the last that differs from it, 2 for a new one with only a base, 3 for
/// another new one. And the new ones.
pub(crate) fn split_rows(rows: &[Row]) -> (Vec<u8>, Vec<Row>) {
    let (mut recent, mut tokens, mut new) = ([[0; 2]; 2], Vec::new(), Vec::new());
    for row in rows {
        let token = if *row == recent[0] {
            0
        } else if *row == recent[1] {
            1
        } else {
            new.push(*row);
            if is_flat(row) { 2 } else { 3 }
        };
        if token != 0 {
            recent = [*row, recent[0]];
        }
        tokens.push(token);
    }
    (tokens, new)
}

/// The rows, of `count` numbers. `base` are the bases of new rows, `rest` the other three words of those of number 3.
pub(crate) fn join_rows(tokens: &[u8], count: usize, base: &[u32], rest: [&[u32]; 3], rows: &mut Vec<u64>) {
    let (mut recent, mut bases, mut others) = ([[0; 2]; 2], base.iter(), 0);
    rows.reserve(2 * count);
    for k in 0..count {
        match token(tokens, k) {
            0 => {}
            1 => recent.swap(0, 1),
            kind => {
                let base = u64::from(bases.next().copied().unwrap_or(0));
                let mut row = [base, 0];
                if kind == 3 {
                    let [u, axes, v] = rest.map(|words| u64::from(words.get(others).copied().unwrap_or(0)));
                    others += 1;
                    row = [u << 32 | base, v << 32 | axes];
                }
                recent = [row, recent[0]];
            }
        }
        rows.extend(recent[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recent_values_come_back() {
        let values: Vec<u32> = (0..1003u32).map(|k| k.wrapping_mul(k) % 11 % 5).collect();
        let (tokens, new) = split_three(values.iter().copied());
        assert!(new.len() < values.len() && tokens.contains(&2));
        let packed = pack(&tokens);
        assert_eq!(count(&packed, tokens.len(), 3), Some(new.len()));
        let mut words = vec![0; values.len()];
        join_three(&packed, &new, &mut words);
        assert_eq!(words, values);
        let mut damaged = packed;
        *damaged.last_mut().expect("some") |= 0x80;
        assert_eq!(count(&damaged, tokens.len(), 3), None, "bits after the last number");
    }

    #[test]
    fn recent_rows_come_back() {
        let row = |k: u64| match k * k % 7 {
            0 => [5, 0],
            1 => [k << 32 | 9, 7],
            2 => [0, 0],
            _ => [6, 1 << 40],
        };
        let rows: Vec<Row> = (0..99).map(row).collect();
        let (tokens, new) = split_rows(&rows);
        assert!((0..4).all(|token| tokens.contains(&token)), "{tokens:?}");
        let base: Vec<u32> = new.iter().map(|row| row[0] as u32).collect();
        let full: Vec<&Row> = new.iter().filter(|row| !is_flat(row)).collect();
        let rest: [Vec<u32>; 3] = [
            full.iter().map(|row| (row[0] >> 32) as u32).collect(),
            full.iter().map(|row| row[1] as u32).collect(),
            full.iter().map(|row| (row[1] >> 32) as u32).collect(),
        ];
        let mut back = Vec::new();
        join_rows(&pack(&tokens), rows.len(), &base, [&rest[0], &rest[1], &rest[2]], &mut back);
        assert_eq!(back, rows.concat());
    }
}
