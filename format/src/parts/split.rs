//! Words as streams of bytes, one for each field, and back.
//!
//! A stream holds one field of all words of a part, a byte each: equal fields are next to each other, which is what an entropy
//! coder needs. The loops have no branches and fixed shifts, so that compilers vectorize them.

/// Lowest bits and widths of the fields of the normal of a contour: nz, ny, nx (spec 7).
pub(crate) const CONTOUR_NORMAL: [(u32, u32); 3] = [(0, 6), (6, 6), (12, 6)];
/// The bits of the normal of a contour.
pub(crate) const NORMAL_BITS: u32 = (1 << 18) - 1;
/// The other fields of a contour: position, thickness.
pub(crate) const CONTOUR_REST: [(u32, u32); 2] = [(18, 7), (25, 7)];
/// The six channels of the references of a colour block (spec 8.1).
pub(crate) const COLOR_HEAD: [(u32, u32); 6] = [(0, 5), (5, 6), (11, 5), (16, 5), (21, 6), (27, 5)];
/// A raw normal (spec 8.2): v and u in two bytes each, main axis with sign.
pub(crate) const RAW_NORMAL: [(u32, u32); 5] = [(0, 6), (6, 8), (14, 7), (21, 8), (29, 3)];
/// The four bytes of a word.
pub(crate) const BYTES: [(u32, u32); 4] = [(0, 8), (8, 8), (16, 8), (24, 8)];

/// Appends the streams of these words.
pub(crate) fn split<const N: usize>(words: &[u32], fields: [(u32, u32); N], streams: &mut Vec<Vec<u8>>) {
    streams.extend(fields.map(|(shift, width)| {
        let mask = (1u32 << width) - 1;
        words.iter().map(|word| (word >> shift & mask) as u8).collect::<Vec<u8>>()
    }));
}

/// Puts words together. All streams have the length of `words`. `None` if a field has bits above its width.
#[inline(always)]
pub(crate) fn join<const N: usize>(streams: [&[u8]; N], fields: [(u32, u32); N], words: &mut [u32]) -> Option<()> {
    let count = words.len();
    // One check for each stream instead of one for each byte.
    let streams = streams.map(|stream| &stream[..count]);
    let mut beyond = 0;
    for (i, word) in words.iter_mut().enumerate() {
        let mut sum = 0;
        for k in 0..N {
            let value = u32::from(streams[k][i]);
            sum |= value << fields[k].0;
            beyond |= value >> fields[k].1;
        }
        *word = sum;
    }
    (beyond == 0).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_fill_a_word_and_come_back() {
        let words: Vec<u32> = (0..1000u32).map(|k| k.wrapping_mul(0x9e37_79b9) ^ k << 20).collect();
        fn check<const N: usize>(words: &[u32], fields: [(u32, u32); N]) {
            let bits = fields.iter().fold(0, |bits, f| bits | ((1u64 << f.1) - 1) << f.0) as u32;
            let words: &[u32] = &words.iter().map(|word| word & bits).collect::<Vec<_>>();
            assert!(fields.windows(2).all(|pair| pair[0].0 + pair[0].1 == pair[1].0));
            let mut streams = Vec::new();
            split(words, fields, &mut streams);
            let mut back = vec![0; words.len()];
            let slices: [&[u8]; N] = std::array::from_fn(|k| &streams[k][..]);
            assert_eq!(join(slices, fields, &mut back), Some(()));
            assert_eq!(back, words);
            if fields[0].1 < 8 {
                streams[0][999] = 0xff;
                let slices: [&[u8]; N] = std::array::from_fn(|k| &streams[k][..]);
                assert_eq!(join(slices, fields, &mut back), None, "bits above the width");
            }
        }
        check(&words, CONTOUR_NORMAL);
        check(&words, CONTOUR_REST);
        check(&words, COLOR_HEAD);
        check(&words, RAW_NORMAL);
        check(&words, BYTES);
    }
}
