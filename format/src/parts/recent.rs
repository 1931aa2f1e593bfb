//! Values that repeat recent ones: two bits each, and the new ones.
//!
//! Neighbouring voxels of a flat surface have the same normals. Six of seven are one of the last three.

/// Puts numbers of two bits into bytes, the first into the lowest bits.
pub(crate) fn pack(tokens: &[u8]) -> Vec<u8> {
    tokens.chunks(4).map(|four| four.iter().rev().fold(0, |byte, token| byte << 2 | token)).collect()
}

/// How many of the first `count` numbers are at least `least`, 2 or 3. `None` if the bits after them are not zero.
#[inline(always)]
pub(crate) fn count(bytes: &[u8], count: usize, least: u8) -> Option<usize> {
    let rest = count % 4;
    if rest != 0 && bytes.last().is_some_and(|last| last >> (rest * 2) != 0) {
        return None;
    }
    // The unused numbers are 0, and `least` is more.
    let of = |byte: u8| if least == 2 { byte & 0xaa } else { byte & byte << 1 & 0xaa };
    Some(bytes.iter().map(|byte| of(*byte).count_ones() as usize).sum())
}

/// What four numbers stand for: numbers of places in a window, which has the recent values and then the next new ones, four
/// of them. First those of the four values, then those of the recent values after them; last how many new ones were used.
type Four = [u8; 8];

/// [`Four`] for each byte, with `recent` recent values of which numbers up to that are the last ones.
const fn fours(recent: u8) -> [Four; 256] {
    let mut all = [[0; 8]; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut last = [0, 1, 2];
        let (mut k, mut new) = (0, 0);
        while k < 4 {
            let token = (byte >> (2 * k) & 3) as u8;
            let value = if token < recent { last[token as usize] } else { recent + new };
            if token >= recent {
                new += 1;
            }
            if token >= 2 {
                last[2] = last[1];
            }
            if token >= 1 {
                last[1] = last[0];
            }
            last[0] = value;
            all[byte][k] = value;
            k += 1;
        }
        [all[byte][4], all[byte][5], all[byte][6]] = last;
        all[byte][7] = new;
        byte += 1;
    }
    all
}

static FOURS_OF_THREE: [Four; 256] = fours(3);
static FOURS_OF_TWO: [Four; 256] = fours(2);

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

/// Adds the values to words in which their bits are zero. `new` must have one value for each number 3, and [`AHEAD`] more.
#[inline(always)]
pub(crate) fn join_three(tokens: &[u8], new: &[u32], words: &mut [u32]) {
    let mut recent = Window { places: [0; 8], next: 0 };
    let (fours, rest) = words.as_chunks_mut::<4>();
    for (words, byte) in fours.iter_mut().zip(tokens) {
        let found = recent.four(*byte, new);
        for k in 0..4 {
            words[k] |= found[k];
        }
    }
    if let Some(byte) = tokens.get(fours.len()) {
        rest.iter_mut().zip(recent.four(*byte, new)).for_each(|(word, found)| *word |= found);
    }
}

/// The last three values, and room for the next new ones.
struct Window {
    places: [u32; 8],
    /// Index of the next new one.
    next: usize,
}

impl Window {
    /// The values that a byte of tokens stands for.
    #[inline(always)]
    fn four(&mut self, byte: u8, new: &[u32]) -> [u32; 4] {
        let places = &FOURS_OF_THREE[usize::from(byte)];
        if let Some(new) = new.get(self.next..).and_then(<[u32]>::first_chunk::<AHEAD>) {
            self.places[3..7].copy_from_slice(new);
        }
        let at = |k: usize| self.places[usize::from(places[k] & 7)];
        let (found, recent) = ([at(0), at(1), at(2), at(3)], [at(4), at(5), at(6)]);
        self.places[..3].copy_from_slice(&recent);
        self.next += usize::from(places[7]);
        found
    }
}

/// How many values there must be after the last new one, so that four can be read at once.
pub(crate) const AHEAD: usize = 4;

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
#[inline(always)]
pub(crate) fn join_rows(tokens: &[u8], count: usize, base: &[u32], rest: [&[u32]; 3], rows: &mut Vec<u64>) {
    // The new rows, after the one that is last at first.
    let mut new = vec![[0; 2]; base.len() + 1];
    let (mut next, mut full) = (1, 0);
    for byte in tokens.iter().filter(|byte| **byte & 0xaa != 0) {
        for token in (0..4).map(|k| byte >> (2 * k) & 3).filter(|token| *token >= 2) {
            let base = u64::from(base.get(next - 1).copied().unwrap_or(0));
            let mut row = [base, 0];
            if token == 3 {
                let [u, axes, v] = rest.map(|words| u64::from(words.get(full).copied().unwrap_or(0)));
                row = [u << 32 | base, v << 32 | axes];
                full += 1;
            }
            if let Some(new) = new.get_mut(next) {
                *new = row;
            }
            next += 1;
        }
    }
    // Indices of rows: those of the two recent ones, then of the next new ones.
    let (mut window, mut next) = ([0u32; 8], 1);
    let from = rows.len() / 2;
    rows.resize(2 * (from + count), 0);
    for (rows, byte) in rows.as_chunks_mut::<2>().0[from..].chunks_mut(4).zip(tokens) {
        let places = &FOURS_OF_TWO[usize::from(*byte)];
        for k in 0..4 {
            window[2 + k] = next + k as u32;
        }
        let found: [u32; 6] = std::array::from_fn(|k| window[usize::from(places[k] & 7)]);
        window[..2].copy_from_slice(&found[4..]);
        next += u32::from(places[7]);
        for (row, index) in rows.iter_mut().zip(found) {
            *row = new.get(index as usize).copied().unwrap_or_default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recent_values_come_back() {
        let values: Vec<u32> = (0..1003u32).map(|k| k.wrapping_mul(k) % 11 % 5).collect();
        let (tokens, mut new) = split_three(values.iter().copied());
        assert!(new.len() < values.len() && tokens.contains(&2));
        let packed = pack(&tokens);
        assert_eq!(count(&packed, tokens.len(), 3), Some(new.len()));
        new.extend([0; AHEAD]);
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
