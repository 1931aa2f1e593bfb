//! The stored bytes of a part (spec section 4.3).
//!
//! The decoder checks every length against what is there before it takes memory, and everything that [`layout`](super::layout)
//! relies on: each level has as many descriptors as the level above refers to.

use std::cell::Cell;

use crate::file::attachment;
use crate::file::compression::{MAX_RATIO, Packer, Unpacker};
use crate::parts::fields::{Fields, MAX_KINDS, Start, Values, link};
use crate::parts::instructions::{InstructionSet, Work};
use crate::parts::recent::{
    AHEAD, Row, count as count_tokens, join_rows, join_three, pack as pack_tokens, split_rows, split_three,
};
use crate::parts::split::{BYTES, COLOR_HEAD, CONTOUR_NORMAL, CONTOUR_REST, NORMAL_BITS, RAW_NORMAL, join, split};
use crate::values::plain::{OWN_CUBE, plain_count};

/// How the streams of a part are stored.
mod form {
    /// Each by itself, raw or as a frame.
    pub(super) const APART: u8 = 0;
    /// One after the other in one frame.
    pub(super) const JOINED: u8 = 1;
    /// One after the other as they are.
    pub(super) const RAW: u8 = 2;
}

/// Streams of at most this many bytes in all are also tried in one frame.
const JOIN_BELOW: usize = 1 << 16;

/// A frame, if it is shorter than the stream.
fn pack(packer: &mut Packer, stream: &[u8]) -> std::io::Result<Option<Vec<u8>>> {
    if stream.len() < 16 {
        return Ok(None);
    }
    let frame = packer.pack(stream)?;
    Ok((frame.len() < stream.len()).then_some(frame))
}

/// The bytes of the levels `first..=last` of a block, counted from its first level, without the part header.
pub(crate) fn encode(fields: &Fields, first: usize, last: usize, packer: &mut Packer) -> std::io::Result<Vec<u8>> {
    let mut out = Vec::new();
    if first == 0 {
        out.extend(fields.array_slots.to_le_bytes());
        out.push(fields.attachments.len() as u8);
        for (kind, values) in &fields.attachments {
            out.extend((*kind as u16).to_le_bytes());
            if let Values::Constant(value) = values {
                out.extend(value.to_le_bytes());
            }
        }
    }
    for level in first..=last {
        out.extend((fields.count(level) as u32).to_le_bytes());
    }
    let streams = streams(fields, first, last);
    let total: usize = streams.iter().map(Vec::len).sum();
    let mut table = Vec::new();
    let mut bodies = Vec::new();
    for stream in &streams {
        let packed = pack(packer, stream)?;
        put_number(&mut table, (packed.as_ref().unwrap_or(stream).len() as u64) << 1 | u64::from(packed.is_some()));
        bodies.extend_from_slice(packed.as_ref().unwrap_or(stream));
    }
    if total <= JOIN_BELOW {
        let joined = streams.concat();
        let packed = pack(packer, &joined)?;
        let (form, body) = packed.map_or((form::RAW, joined), |frame| (form::JOINED, frame));
        if 1 + body.len() < table.len() + bodies.len() {
            out.push(form);
            put_number(&mut out, total as u64);
            out.extend(body);
            return Ok(out);
        }
    }
    out.push(form::APART);
    out.extend(table);
    out.extend(bodies);
    Ok(out)
}

/// The streams of some levels, in the order of the specification.
fn streams(fields: &Fields, first: usize, last: usize) -> Vec<Vec<u8>> {
    let (from, to) = (fields.starts[first], fields.starts[last + 1]);
    let nodes = from.node..to.node;
    let mut streams = vec![fields.valid[nodes.clone()].to_vec(), fields.nonleaf[nodes.clone()].to_vec()];
    streams.push(fields.links[nodes.clone()].iter().filter(|l| **l != link::NONE).map(|l| l - 1).collect());
    let mut before = 0u32;
    let steps = fields.children[from.child..to.child].iter().map(|child| {
        let step = child.wrapping_sub(before);
        before = *child;
        step
    });
    split(&steps.collect::<Vec<_>>(), BYTES, &mut streams);
    streams.push(fields.contour_masks[nodes.clone()].to_vec());
    let contours = &fields.contours[from.contour..to.contour];
    let (tokens, new) = split_three(contours.iter().map(|word| word & NORMAL_BITS));
    streams.push(pack_tokens(&tokens));
    split(&new, CONTOUR_NORMAL, &mut streams);
    split(contours, CONTOUR_REST, &mut streams);
    for (number, (kind, values)) in fields.attachments.iter().enumerate() {
        let range = from.values[number]..to.values[number];
        match values {
            Values::Constant(_) => {}
            Values::Pairs(unit, slots) => {
                let slots = &slots[range.start * unit..range.end * unit];
                let word = |k: usize, high: bool| -> Vec<u32> {
                    let slots = slots.iter().skip(k).step_by(*unit);
                    slots.map(|slot| if high { (slot >> 32) as u32 } else { *slot as u32 }).collect()
                };
                match *kind {
                    attachment::COLOR_BLOCKS => {
                        split(&word(0, false), COLOR_HEAD, &mut streams);
                        split(&word(0, true), BYTES, &mut streams);
                    }
                    attachment::NORMAL_BLOCKS => {
                        let rows: Vec<Row> = slots.chunks_exact(2).map(|row| [row[0], row[1]]).collect();
                        let (tokens, new) = split_rows(&rows);
                        streams.push(pack_tokens(&tokens));
                        let base = |row: &Row| row[0] as u32;
                        split(&new.iter().map(base).collect::<Vec<_>>(), RAW_NORMAL, &mut streams);
                        let new = new.iter().filter(|row| row[0] >> 32 != 0 || row[1] != 0);
                        for word in 1..4 {
                            let part = |row: &Row| (row[word / 2] >> (word % 2 * 32)) as u32;
                            split(&new.clone().map(part).collect::<Vec<_>>(), BYTES, &mut streams);
                        }
                    }
                    _ => {
                        split(&word(0, false), BYTES, &mut streams);
                        split(&word(0, true), BYTES, &mut streams);
                    }
                }
            }
            Values::Plain(masks, words) => {
                streams.push(masks[nodes.clone()].to_vec());
                if *kind == attachment::NORMALS_PLAIN {
                    split(&words[range], RAW_NORMAL, &mut streams);
                } else {
                    split(&words[range], BYTES, &mut streams);
                }
            }
            Values::Corners(masks, slots) => {
                split(&masks[nodes.clone()], BYTES, &mut streams);
                let slots = &slots[range];
                split(&slots.iter().map(|slot| *slot as u32).collect::<Vec<_>>(), BYTES, &mut streams);
                split(&slots.iter().map(|slot| (slot >> 32) as u32).collect::<Vec<_>>(), RAW_NORMAL, &mut streams);
            }
        }
    }
    streams
}

/// A number in groups of seven bits, the lowest first; the top bit of a byte says that another follows.
fn put_number(out: &mut Vec<u8>, mut number: u64) {
    while number > 127 {
        out.push(number as u8 | 128);
        number >>= 7;
    }
    out.push(number as u8);
}

/// A decoder of parts that keeps its memory from one part to the next.
pub(crate) struct Decoder {
    unpacker: Unpacker,
    room: Vec<u8>,
    /// Fields that are no longer in use: their memory is taken for the next block.
    spare: Fields,
    /// The attachments of these fields.
    spare_values: Vec<(u32, Values)>,
    /// What it may use.
    pub(crate) set: InstructionSet,
}

impl Decoder {
    /// With the fastest instructions that there are.
    pub(crate) fn new() -> Result<Self, String> {
        Self::with(InstructionSet::best())
    }

    /// With these instructions.
    pub(crate) fn with(set: InstructionSet) -> Result<Self, String> {
        Ok(Self {
            unpacker: Unpacker::new()?,
            room: Vec::new(),
            spare: Fields::default(),
            spare_values: Vec::new(),
            set,
        })
    }

    /// A decoder that this thread no longer needs, or a new one: making one costs as much as decoding 100 KB.
    pub(crate) fn take() -> Result<Self, String> {
        UNUSED.take().map_or_else(Self::new, Ok)
    }

    /// Keeps the decoder for the next [`take`](Self::take) of this thread.
    pub(crate) fn keep(self) {
        let bytes = self.room.capacity() + self.spare.capacity();
        if bytes <= MOST_KEPT {
            UNUSED.set(Some(self));
        }
    }

    /// Empty fields.
    pub(crate) fn fields(&mut self) -> Fields {
        let mut fields = std::mem::take(&mut self.spare);
        self.spare_values = fields.clear();
        fields
    }

    /// Takes back the memory of fields.
    pub(crate) fn reuse(&mut self, fields: Fields) {
        self.spare = fields;
    }
}

/// Bytes of memory that a thread keeps for the next block: several times what blocks of the usual size take.
const MOST_KEPT: usize = 32 << 20;

thread_local! {
    static UNUSED: Cell<Option<Decoder>> = const { Cell::new(None) };
}

/// Bytes that are read from the front.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (head, tail) = self.0.split_at_checked(count).ok_or("the part ends too early")?;
        self.0 = tail;
        Ok(head)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        Ok(self.take(N)?.try_into().unwrap_or([0; N]))
    }

    fn number(&mut self) -> Result<u64, String> {
        let mut number = 0;
        for k in 0..5 {
            let [byte] = self.array()?;
            number |= u64::from(byte & 127) << (7 * k);
            if byte & 128 == 0 {
                return Ok(number);
            }
        }
        Err("a number of a part has more than five bytes".into())
    }
}

/// Where the streams of a part come from.
enum Source<'a> {
    /// Sizes and kinds, and the bytes.
    Apart(std::vec::IntoIter<u64>, Rest<'a>),
    /// The bytes of all streams.
    Joined(Rest<'a>),
}

struct Streams<'a, 'b> {
    source: Source<'a>,
    unpacker: &'b mut Unpacker,
    /// Streams that were unpacked are here.
    room: &'b mut Vec<u8>,
}

impl Streams<'_, '_> {
    /// The next `N` streams, of `count` bytes each.
    #[inline(always)]
    fn next<const N: usize>(&mut self, count: usize) -> Result<[&[u8]; N], String> {
        match &mut self.source {
            Source::Joined(rest) => {
                let mut found = [&[][..]; N];
                for stream in &mut found {
                    *stream = rest.take(count)?;
                }
                Ok(found)
            }
            Source::Apart(sizes, rest) => {
                let mut stored = [(&[][..], false); N];
                for one in &mut stored {
                    let size = sizes.next().unwrap_or(0);
                    *one = (rest.take((size >> 1) as usize)?, size & 1 != 0);
                    let fits =
                        if one.1 { count as u64 / MAX_RATIO <= one.0.len() as u64 } else { one.0.len() == count };
                    if !fits {
                        return Err(format!("a stream has {} stored bytes, expected {count} bytes", one.0.len()));
                    }
                }
                let packed = stored.iter().filter(|one| one.1).count();
                if self.room.len() < packed * count {
                    self.room.resize(packed * count, 0);
                }
                let mut room = &mut self.room[..packed * count];
                let mut found = [&[][..]; N];
                for (stream, (bytes, packed)) in found.iter_mut().zip(stored) {
                    *stream = if packed {
                        let (head, tail) = room.split_at_mut(count);
                        room = tail;
                        self.unpacker.unpack(bytes, head)?;
                        head
                    } else {
                        bytes
                    };
                }
                Ok(found)
            }
        }
    }

    #[inline(always)]
    fn words<const N: usize>(&mut self, fields: [(u32, u32); N], words: &mut [u32]) -> Result<(), String> {
        let streams = self.next::<N>(words.len())?;
        join(streams, fields, words).ok_or_else(|| "a stream has a byte that is wider than its field".into())
    }
}

/// Number of streams of a part.
fn stream_count(fields: &Fields) -> usize {
    let of = |(kind, values): &(u32, Values)| match values {
        Values::Constant(_) => 0,
        Values::Pairs(..) if *kind == attachment::COLOR_BLOCKS => 10,
        Values::Pairs(..) if *kind == attachment::NORMAL_BLOCKS => 18,
        Values::Pairs(..) => 8,
        Values::Plain(..) if *kind == attachment::NORMALS_PLAIN => 6,
        Values::Plain(..) => 5,
        Values::Corners(..) => 13,
    };
    14 + fields.attachments.iter().map(of).sum::<usize>()
}

/// Appends the levels of a part to those of the parts before it. `levels` is how many the part has, `limit` how many bytes the
/// image of the block may have.
///
/// # Errors
/// What is wrong with the bytes.
pub(crate) fn decode(
    fields: &mut Fields,
    levels: usize,
    stored: &[u8],
    limit: u64,
    decoder: &mut Decoder,
) -> Result<(), String> {
    let mut rest = Rest(stored);
    if fields.starts.is_empty() {
        read_front(fields, &mut decoder.spare_values, &mut rest, limit)?;
        fields.starts.push(Default::default());
    }
    let mut counts = Vec::with_capacity(levels);
    for _ in 0..levels {
        counts.push(u32::from_le_bytes(rest.array()?) as usize);
    }
    let nodes: usize = counts.iter().sum();
    if counts.contains(&0) || (fields.valid.len() + nodes) as u64 > limit / 8 {
        return Err(format!(
            "the part has levels of {counts:?} descriptors, expected at least one each and no more than fit"
        ));
    }
    let Decoder { unpacker, room: scratch, set, .. } = decoder;
    let [form] = rest.array()?;
    let (joined, mut room);
    let source = match form {
        form::APART => {
            let sizes: Vec<u64> = (0..stream_count(fields)).map(|_| rest.number()).collect::<Result<_, _>>()?;
            if sizes.iter().map(|size| size >> 1).sum::<u64>() != rest.0.len() as u64 {
                return Err("the streams do not fill the part".into());
            }
            Source::Apart(sizes.into_iter(), Rest(rest.0))
        }
        form::JOINED => {
            let total = rest.number()?;
            // No stream is longer than what it stands for in the image, but for fields of less than a byte.
            if total > limit * 2 || total / MAX_RATIO > rest.0.len() as u64 {
                return Err(format!("the streams cannot have {total} bytes"));
            }
            room = vec![0; total as usize];
            unpacker.unpack(rest.0, &mut room)?;
            joined = room;
            Source::Joined(Rest(&joined))
        }
        form::RAW => {
            let total = rest.number()?;
            if total != rest.0.len() as u64 {
                return Err("the streams do not fill the part".into());
            }
            Source::Joined(Rest(rest.0))
        }
        other => return Err(format!("streams are stored in form {other}, this reader knows 0 to 2")),
    };
    let mut streams = Streams { source, unpacker, room: scratch };
    set.run(Read { fields, counts: &counts, nodes, streams: &mut streams, limit })?;
    match streams.source {
        Source::Joined(rest) if !rest.0.is_empty() => Err("the streams do not fill the part".into()),
        _ => Ok(()),
    }
}

/// What the first part of a block begins with.
fn read_front(fields: &mut Fields, spare: &mut Vec<(u32, Values)>, rest: &mut Rest, limit: u64) -> Result<(), String> {
    fields.array_slots = u32::from_le_bytes(rest.array()?);
    if fields.array_slots < 4 || u64::from(fields.array_slots) > limit / 8 {
        return Err(format!("the descriptor array has {} slots", fields.array_slots));
    }
    let [count] = rest.array()?;
    if usize::from(count) > MAX_KINDS {
        return Err(format!("the block has {count} attachments, expected at most {MAX_KINDS}"));
    }
    for _ in 0..count {
        let kind = u32::from(u16::from_le_bytes(rest.array()?));
        let spare = spare.iter().position(|(other, _)| *other == kind).map(|at| spare.swap_remove(at).1);
        let values = spare.or_else(|| Values::of_kind(kind));
        let mut values = values.ok_or_else(|| format!("attachment type {kind} cannot be in a part"))?;
        if let Values::Constant(value) = &mut values {
            *value = u64::from_le_bytes(rest.array()?);
        }
        fields.attachments.push((kind, values));
    }
    Ok(())
}

struct Read<'a, 'b, 'c> {
    fields: &'a mut Fields,
    counts: &'a [usize],
    nodes: usize,
    streams: &'a mut Streams<'b, 'c>,
    limit: u64,
}

impl Work for Read<'_, '_, '_> {
    type Output = Result<(), String>;

    #[inline(always)]
    fn run(self) -> Result<(), String> {
        read_streams(self.fields, self.counts, self.nodes, self.streams, self.limit)
    }
}

#[inline(always)]
fn read_streams(
    fields: &mut Fields,
    counts: &[usize],
    nodes: usize,
    streams: &mut Streams,
    limit: u64,
) -> Result<(), String> {
    let from = fields.end();
    let Fields { starts, valid, nonleaf, links, children, contour_masks, contours, attachments, .. } = fields;
    valid.extend_from_slice(streams.next::<1>(nodes)?[0]);
    nonleaf.extend_from_slice(streams.next::<1>(nodes)?[0]);
    read_links(&nonleaf[from.node..], links, streams)?;
    let blocks = links[from.node..].iter().filter(|l| **l == link::BLOCK).count();
    let mut before = 0u32;
    children.resize(from.child + blocks, 0);
    streams.words(BYTES, &mut children[from.child..])?;
    for child in &mut children[from.child..] {
        before = before.wrapping_add(*child);
        *child = before;
    }
    contour_masks.extend_from_slice(streams.next::<1>(nodes)?[0]);
    // The columns of each level are counted here, once.
    let mut node = from.node;
    let mut contour = from.contour;
    let mut child = from.child;
    let mut expected = expected_count(starts, valid, nonleaf, links);
    let mut pairs = Vec::with_capacity(counts.len());
    for &count in counts {
        // Pairs need the groups that the level above makes; of the first level there is one.
        let level = node..node + count;
        let (groups, pair) = match expected {
            Some((nodes, pairs)) => (nodes, pairs),
            None => (count.min(8), count.div_ceil(2)),
        };
        if groups != count {
            return Err(format!("a level has {count} descriptors, expected {groups}"));
        }
        pairs.push(pair);
        contour += ones(&contour_masks[level.clone()]);
        child += links[level.clone()].iter().filter(|l| **l == link::BLOCK).count();
        node += count;
        expected = Some(below(&nonleaf[level.clone()], &links[level]));
        starts.push(Start { node, contour, child, values: from.values });
    }
    if contour as u64 * 4 > limit {
        return Err(format!("the part has {} contours, more than fit", contour - from.contour));
    }
    contours.resize(contour, 0);
    read_contours(&mut contours[from.contour..], streams)?;
    let first = starts.len() - counts.len();
    for (number, (kind, values)) in attachments.iter_mut().enumerate() {
        let start = from.values[number];
        let mut ends = Vec::with_capacity(counts.len());
        read_values(*kind, values, &valid[from.node..], counts, &pairs, streams, limit, &mut ends)?;
        for (place, end) in starts[first..].iter_mut().zip(ends) {
            place.values[number] = start + end;
        }
    }
    Ok(())
}

/// How many descriptors and pairs of slots the level after the last one has. `None` before the first level.
#[inline(always)]
fn expected_count(starts: &[Start], valid: &[u8], nonleaf: &[u8], links: &[u8]) -> Option<(usize, usize)> {
    let [.., above, end] = starts else { return None };
    debug_assert!(end.node <= valid.len());
    Some(below(&nonleaf[above.node..end.node], &links[above.node..end.node]))
}

/// How many descriptors, and pairs of slots, are below these descriptors in the same block.
#[inline(always)]
fn below(nonleaf: &[u8], links: &[u8]) -> (usize, usize) {
    let mut sum = (0, 0);
    for (mask, kind) in nonleaf.iter().zip(links) {
        let count = if *kind == link::BLOCK { 0 } else { mask.count_ones() as usize };
        sum = (sum.0 + count, sum.1 + count.div_ceil(2));
    }
    sum
}

#[inline(always)]
fn ones(masks: &[u8]) -> usize {
    masks.iter().map(|mask| mask.count_ones() as usize).sum()
}

/// The links of descriptors with these masks; those without children have none.
#[inline(always)]
fn read_links(nonleaf: &[u8], links: &mut Vec<u8>, streams: &mut Streams) -> Result<(), String> {
    let count = nonleaf.iter().filter(|mask| **mask != 0).count();
    let [stored] = streams.next::<1>(count)?;
    if stored.iter().any(|l| *l > 2) {
        return Err("a link is none of 0 to 2".into());
    }
    let from = links.len();
    links.resize(from + nonleaf.len(), link::NONE);
    let mut next = 0;
    // Most runs of descriptors all have children, or none has.
    for (masks, links) in nonleaf.chunks(8).zip(links[from..].chunks_mut(8)) {
        let some = masks.iter().filter(|mask| **mask != 0).count();
        let stored = stored.get(next..next + some).unwrap_or_default();
        next += some;
        if some == masks.len() {
            links.iter_mut().zip(stored).for_each(|(link, stored)| *link = stored + 1);
        } else if some > 0 {
            let with = links.iter_mut().zip(masks).filter(|(_, mask)| **mask != 0);
            with.zip(stored).for_each(|((link, _), stored)| *link = stored + 1);
        }
    }
    Ok(())
}

/// Contours, into words that are zero.
#[inline(always)]
fn read_contours(words: &mut [u32], streams: &mut Streams) -> Result<(), String> {
    let (tokens, fresh) = read_tokens(words.len(), [3], streams)?;
    let mut new = vec![0; fresh[0] + AHEAD];
    streams.words(CONTOUR_NORMAL, &mut new[..fresh[0]])?;
    streams.words(CONTOUR_REST, words)?;
    join_three(&tokens, &new, words);
    Ok(())
}

/// Packed numbers of two bits, and how many are at least each of these.
#[inline(always)]
fn read_tokens<const N: usize>(
    count: usize,
    least: [u8; N],
    streams: &mut Streams,
) -> Result<(Vec<u8>, [usize; N]), String> {
    let tokens = streams.next::<1>(count.div_ceil(4))?[0].to_vec();
    let mut counts = [0; N];
    for (found, least) in counts.iter_mut().zip(least) {
        *found = count_tokens(&tokens, count, least).ok_or("bits after the last of the numbers are not zero")?;
    }
    Ok((tokens, counts))
}

#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the columns of one attachment")]
fn read_values(
    kind: u32,
    values: &mut Values,
    valid: &[u8],
    counts: &[usize],
    pairs: &[usize],
    streams: &mut Streams,
    limit: u64,
    ends: &mut Vec<usize>,
) -> Result<(), String> {
    let fits = |count: usize, bytes: usize| {
        if (count * bytes) as u64 <= limit { Ok(()) } else { Err(format!("attachment type {kind} has {count} values")) }
    };
    // Sums of what the descriptors of each level have.
    let mut sum_levels = |count_of: &dyn Fn(usize) -> usize| {
        let (mut node, mut sum) = (0, 0);
        for &count in counts {
            sum += (node..node + count).map(count_of).sum::<usize>();
            node += count;
            ends.push(sum);
        }
        sum
    };
    match values {
        Values::Constant(_) => ends.resize(counts.len(), 0),
        Values::Pairs(_, slots) => {
            let mut sum = 0;
            for pair in pairs {
                sum += pair;
                ends.push(sum);
            }
            if kind == attachment::NORMAL_BLOCKS {
                let (tokens, [new, full]) = read_tokens(sum, [2, 3], streams)?;
                let mut base = vec![0; new];
                streams.words(RAW_NORMAL, &mut base)?;
                let mut rest = [vec![0; full], vec![0; full], vec![0; full]];
                for words in &mut rest {
                    streams.words(BYTES, words)?;
                }
                let [u, axes, v] = &rest;
                join_rows(&tokens, sum, &base, [u, axes, v], slots);
                return Ok(());
            }
            let (mut low, mut high) = (vec![0; sum], vec![0; sum]);
            if kind == attachment::COLOR_BLOCKS {
                streams.words(COLOR_HEAD, &mut low)?;
            } else {
                streams.words(BYTES, &mut low)?;
            }
            streams.words(BYTES, &mut high)?;
            slots.extend(low.iter().zip(&high).map(|(low, high)| u64::from(*high) << 32 | u64::from(*low)));
        }
        Values::Plain(masks, words) => {
            let from = masks.len();
            masks.extend_from_slice(streams.next::<1>(valid.len())?[0]);
            let own = &masks[from..];
            let count = sum_levels(&|node| plain_count(own[node], valid[node]));
            fits(count, 4)?;
            let start = words.len();
            words.resize(start + count, 0);
            if kind == attachment::NORMALS_PLAIN {
                streams.words(RAW_NORMAL, &mut words[start..])?;
            } else {
                streams.words(BYTES, &mut words[start..])?;
            }
        }
        Values::Corners(masks, slots) => {
            let from = masks.len();
            masks.resize(from + valid.len(), 0);
            streams.words(BYTES, &mut masks[from..])?;
            let own = &masks[from..];
            let count = sum_levels(&|node| corner_count(own[node]));
            fits(count, 8)?;
            let (mut low, mut high) = (vec![0; count], vec![0; count]);
            streams.words(BYTES, &mut low)?;
            streams.words(RAW_NORMAL, &mut high)?;
            slots.extend(low.iter().zip(&high).map(|(low, high)| u64::from(*high) << 32 | u64::from(*low)));
        }
    }
    Ok(())
}

/// Number of values of a descriptor with this corner mask.
pub(crate) fn corner_count(mask: u32) -> usize {
    (mask & (OWN_CUBE - 1)).count_ones() as usize + if mask & OWN_CUBE != 0 { 8 } else { 0 }
}
