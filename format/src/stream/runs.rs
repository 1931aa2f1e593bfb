//! What lies close together is read at once.

/// Pieces with at most this many bytes between them are read at once: a request costs more than that.
pub(super) const MERGE_GAP: u64 = 64 << 10;

/// Longest run of several pieces, in bytes.
const LONGEST: u64 = 16 << 20;

/// Most bytes of runs that are read at the same time, unless one run alone has more.
const AT_ONCE: u64 = 64 << 20;

/// Pieces that are read by one range, with its start and end.
pub(super) struct Run<'a, T> {
    pub(super) pieces: &'a [T],
    pub(super) start: u64,
    pub(super) end: u64,
}

/// Divides pieces, which are in the order of their offsets, into runs. `range` gives start and end of a piece.
pub(super) fn runs<T>(pieces: &[T], range: impl Fn(&T) -> (u64, u64)) -> Vec<Run<'_, T>> {
    let mut found = Vec::new();
    let mut first = 0;
    while let Some(piece) = pieces.get(first) {
        let (start, mut end) = range(piece);
        let mut last = first + 1;
        while let Some((from, to)) = pieces.get(last).map(&range) {
            if from.saturating_sub(end) > MERGE_GAP || to.saturating_sub(start) > LONGEST {
                break;
            }
            end = end.max(to);
            last += 1;
        }
        found.push(Run { pieces: &pieces[first..last], start, end });
        first = last;
    }
    found
}

/// Divides runs into those that are read at the same time.
pub(super) fn batches<'a, 'b, T>(runs: &'b [Run<'a, T>]) -> Vec<&'b [Run<'a, T>]> {
    let mut found = Vec::new();
    let (mut first, mut bytes) = (0, 0);
    for (index, run) in runs.iter().enumerate() {
        let length = run.end - run.start;
        if index > first && bytes + length > AT_ONCE {
            found.push(&runs[first..index]);
            (first, bytes) = (index, 0);
        }
        bytes += length;
    }
    if first < runs.len() {
        found.push(&runs[first..]);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_gaps_are_read_along() {
        let pieces = [(0, 100), (100 + MERGE_GAP, 1 << 18), ((1 << 18) + MERGE_GAP + 1, 1 << 19)];
        let runs = runs(&pieces, |piece| *piece);
        let found: Vec<_> = runs.iter().map(|run| (run.start, run.end, run.pieces.len())).collect();
        assert_eq!(found, [(0, 1 << 18, 2), (pieces[2].0, 1 << 19, 1)]);
        assert!(super::runs(&[] as &[(u64, u64)], |piece| *piece).is_empty());
    }

    #[test]
    fn runs_and_batches_have_bounds() {
        let size = 3 << 20;
        let pieces: Vec<u64> = (0..60).map(|index| index * size).collect();
        let runs = runs(&pieces, |at| (*at, at + size));
        assert!(runs.iter().all(|run| run.end - run.start <= LONGEST && run.pieces.len() == 5));
        let batches = batches(&runs);
        assert_eq!(batches.iter().map(|batch| batch.len()).collect::<Vec<_>>(), [4, 4, 4]);
        // A piece that is longer than a run is one, and a run that is longer than a batch too.
        let long = super::runs(&[0u64, 1 << 30], |at| (*at, at + (1 << 30)));
        assert_eq!((long.len(), super::batches(&long).len()), (2, 2));
    }
}
