//! The image of a block from its fields (spec section 4.2 and 4.3: the layout of codec 2).

use crate::file::{ATTACHMENT_BYTES, FIRST_SLOT, INFO_BYTES, PAGE_BYTES, PAGE_SLOTS};
use crate::parts::fields::{Fields, MAX_KINDS, Start, Values};
use crate::parts::instructions::{InstructionSet, Work};
use crate::parts::stored::corner_count;
use crate::values::plain::plain_count;
use crate::{MAX_CONTOUR_POINTER, MAX_NEAR_POINTER};

/// Most levels of a block: those of the voxels with descriptors, 0 to 22.
const MAX_LEVELS: usize = 23;

/// Sizes of a block with some of its levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size {
    /// Length of the descriptor array in slots.
    pub(crate) array_slots: u32,
    /// Size of the image in bytes, a multiple of the page.
    pub(crate) bytes: u64,
}

/// Where the parts of a block are, in bytes.
struct Places {
    info: usize,
    pool: usize,
    attachments: Vec<usize>,
    end: u64,
}

impl Places {
    fn new(fields: &Fields, array_slots: u32) -> Self {
        let info = u64::from(array_slots) * 8;
        let pool = info + INFO_BYTES + ATTACHMENT_BYTES * fields.attachments.len() as u64;
        let mut end = pool + fields.contours.len() as u64 * 4;
        let mut attachments = Vec::with_capacity(fields.attachments.len());
        for (_, values) in &fields.attachments {
            let at = end.next_multiple_of(8);
            attachments.push(at as usize);
            end = at + values.bytes(array_slots.into());
        }
        Self { info: info as usize, pool: pool as usize, attachments, end: end.next_multiple_of(PAGE_BYTES) }
    }
}

/// The sizes of a block. The fields must be those of whole levels; see [`Fields::cut`].
pub(crate) fn measure(fields: &Fields) -> Size {
    let mut walk = Walk::new(fields);
    // Without targets nothing can fail.
    let _ = walk.run(&mut Nothing);
    let array_slots = walk.cursor;
    Size { array_slots, bytes: Places::new(fields, array_slots).end }
}

/// A block whose image is to be written.
pub(crate) struct Block<'a> {
    pub(crate) fields: &'a Fields,
    /// Length of the descriptor array: that of the fields, or less if only some of the levels are there.
    pub(crate) array_slots: u32,
    pub(crate) index: u32,
    /// Slot of the image that is slot 0 of the block.
    pub(crate) start: u64,
}

/// Writes the image of a block. `image` has the size that [`measure`] found (or the block table says) and is zero. `outer`
/// returns the slot of the image that is slot 0 of another block. All instruction sets write the same.
///
/// # Errors
/// The fields do not have this size, or a pointer would not fit.
pub(crate) fn write(
    set: InstructionSet,
    block: &Block,
    image: &mut [u64],
    outer: &mut dyn FnMut(u32) -> Option<u64>,
) -> Result<(), String> {
    set.run(Write { block, image, outer })
}

struct Write<'a> {
    block: &'a Block<'a>,
    image: &'a mut [u64],
    outer: &'a mut dyn FnMut(u32) -> Option<u64>,
}

impl Work for Write<'_> {
    type Output = Result<(), String>;

    #[inline(always)]
    fn run(self) -> Result<(), String> {
        let &Block { fields, array_slots, index, start } = self.block;
        let places = Places::new(fields, array_slots);
        if places.end != self.image.len() as u64 * 8 {
            return Err(format!("the parts make {} bytes, expected {}", places.end, self.image.len() * 8));
        }
        let (array, rest) = self.image.split_at_mut(array_slots as usize);
        write_info(fields, array_slots, index, &places, rest);
        let mut columns: [&mut [u64]; MAX_KINDS] = Default::default();
        let mut tail = rest;
        let mut at = places.info;
        let mut take = |to: usize| {
            let (head, next) = std::mem::take(&mut tail).split_at_mut((to - at) / 8);
            tail = next;
            at = to;
            head
        };
        take(places.pool);
        let first = places.attachments.first().map_or(places.end as usize, |at| *at);
        let pool = take(first);
        for (number, column) in columns.iter_mut().enumerate().take(places.attachments.len()) {
            let to = places.attachments.get(number + 1).map_or(places.end as usize, |at| *at);
            *column = take(to);
        }
        for ((_, values), column) in fields.attachments.iter().zip(&mut columns) {
            if let Values::Constant(value) = values {
                column[0] = *value;
            }
        }
        let pool_word = (places.pool / 4) as u32;
        let mut next = [Start::default(); MAX_LEVELS + 1];
        let levels = fields.levels().min(MAX_LEVELS);
        next[..levels].copy_from_slice(&fields.starts[..levels]);
        let mut writer = Writer {
            fields,
            array,
            // Without the word after an odd number of contours, which stays zero.
            pool: &mut bytemuck::cast_slice_mut(pool)[..fields.contours.len()],
            pool_word,
            pool_is_near: fields.contours.len() as u64 + u64::from(pool_word) <= u64::from(MAX_CONTOUR_POINTER),
            contour: 0,
            columns,
            values: [0; MAX_KINDS],
            next,
            start,
            outer: self.outer,
            array_slots,
        };
        let mut walk = Walk::new(fields);
        walk.run(&mut writer)?;
        writer.clear_pairs(walk.cursor);
        if walk.cursor == array_slots {
            Ok(())
        } else {
            Err(format!("the array has {} slots, not {array_slots}", walk.cursor))
        }
    }
}

fn write_info(fields: &Fields, array_slots: u32, block: u32, places: &Places, rest: &mut [u64]) {
    let words: &mut [u32] = bytemuck::cast_slice_mut(rest);
    let (pool, count) = ((places.pool - places.info) / 4, fields.contours.len());
    words[..6].copy_from_slice(&[
        block,
        array_slots,
        array_slots - FIRST_SLOT,
        pool as u32,
        count as u32,
        fields.attachments.len() as u32,
    ]);
    for (entry, ((kind, values), at)) in
        words[8..].chunks_exact_mut(4).zip(fields.attachments.iter().zip(&places.attachments))
    {
        let size = values.bytes(array_slots.into());
        entry.copy_from_slice(&[*kind, (at - places.info) as u32, size as u32, (size >> 32) as u32]);
    }
}

/// The bytes at `at`, as the lowest bytes of a number; zero after the end.
#[inline(always)]
fn eight(bytes: &[u8], at: usize) -> u64 {
    if let Some(eight) = bytes.get(at..at + 8) {
        return u64::from_le_bytes(eight.try_into().unwrap_or_default());
    }
    let rest = bytes.get(at..).unwrap_or_default();
    rest.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte))
}

/// The lowest bit of each byte.
const LOWEST: u64 = 0x0101_0101_0101_0101;

/// The lowest bits of the bytes as bits next to each other.
#[inline(always)]
fn lowest_bits(bytes: u64) -> u32 {
    ((bytes & LOWEST).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32
}

/// Number of ones of each byte.
#[inline(always)]
fn ones_of_bytes(bytes: u64) -> u64 {
    let two = bytes - (bytes >> 1 & 0x5555_5555_5555_5555);
    let four = (two & 0x3333_3333_3333_3333) + (two >> 2 & 0x3333_3333_3333_3333);
    (four + (four >> 4)) & 0x0f0f_0f0f_0f0f_0f0f
}

/// Copies `count` values from the start of `from` to the start of `to`. May write more values of `from` after them, up to a
/// multiple of `N`: wide moves cost less than a call of `memcpy`. `None` if either is shorter than `count`.
#[inline(always)]
fn copy_ahead<const N: usize, T: Copy>(to: &mut [T], from: &[T], count: usize) -> Option<()> {
    let mut done = 0;
    while let (Some(to), Some(from)) = (to[done..].first_chunk_mut::<N>(), from[done..].first_chunk::<N>()) {
        *to = *from;
        done += N;
        if done >= count {
            return Some(());
        }
    }
    copy_exactly(to.get_mut(done..count)?, from.get(done..count)?)
}

/// Copies as much as there is. A function of its own, for the ends of columns: compilers would call `memcpy` for both ways.
#[cold]
#[inline(never)]
fn copy_exactly<T: Copy>(to: &mut [T], from: &[T]) -> Option<()> {
    to.copy_from_slice(from);
    Some(())
}

/// A group of at most eight siblings and its place.
#[derive(Clone, Copy)]
struct Group {
    level: usize,
    /// Its first slot.
    slot: u32,
    /// Its first descriptor in the columns.
    node: usize,
    /// Number of descriptors, 1 to 8.
    count: u32,
    /// Number of far pointers.
    far: u32,
}

impl Group {
    /// The bytes of a column that belong to the group.
    #[inline(always)]
    fn of(&self, column: &[u8]) -> u64 {
        eight(column, self.node) & u64::MAX >> (64 - 8 * self.count)
    }
}

/// What is done at each step of the walk over the slots.
trait Sink {
    /// The slots from `cursor` to the end of a page stay empty; the next group is after the header of page `page`, its first slot.
    fn page(&mut self, cursor: u32, page: u32);
    /// A group has its place.
    fn group(&mut self, group: &Group) -> Result<(), String>;
    /// The children of the descriptor at `slot` are at slot `target`.
    fn near(&mut self, slot: u32, target: u32) -> Result<(), String>;
    /// As `near`, by the far pointer at `pointer`.
    fn far(&mut self, slot: u32, pointer: u32, target: u32) -> Result<(), String>;
    /// The children of the descriptor at `slot`, of this level, are in the next other block.
    fn block(&mut self, level: usize, slot: u32, pointer: u32) -> Result<(), String>;
}

struct Nothing;

impl Sink for Nothing {
    fn page(&mut self, _: u32, _: u32) {}
    fn group(&mut self, _: &Group) -> Result<(), String> {
        Ok(())
    }
    fn near(&mut self, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
    fn far(&mut self, _: u32, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
    fn block(&mut self, _: usize, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
}

/// A group whose members' children are being placed.
#[derive(Clone, Copy, Default)]
struct Frame {
    /// Slot of the first member.
    slot: u32,
    /// Slot of the first far pointer.
    pointer: u32,
    /// Members whose children are still to be placed.
    left: u32,
    /// Members that have a far pointer.
    far: u32,
    /// The masks of the members.
    nonleaf: u64,
}

/// The walk that gives slots to all descriptors: a group and its far pointers, then what is below each member.
struct Walk<'a> {
    nonleaf: &'a [u8],
    links: &'a [u8],
    levels: usize,
    first_group: u32,
    cursor: u32,
    /// The next descriptor of each level.
    next: [usize; MAX_LEVELS + 1],
}

impl<'a> Walk<'a> {
    #[inline(always)]
    fn new(fields: &'a Fields) -> Self {
        let mut next = [0; MAX_LEVELS + 1];
        let levels = fields.levels().min(MAX_LEVELS);
        for (next, start) in next.iter_mut().zip(&fields.starts[..levels]) {
            *next = start.node;
        }
        let (nonleaf, links) = (&fields.nonleaf[..], &fields.links[..]);
        Self { nonleaf, links, levels, first_group: fields.count(0) as u32, cursor: FIRST_SLOT, next }
    }

    /// Places a group of siblings of a level.
    #[inline(always)]
    fn place(&mut self, level: usize, count: u32, sink: &mut impl Sink) -> Result<Frame, String> {
        let node = self.next[level];
        if !(1..=8).contains(&count) || node + count as usize > self.links.len() {
            return Err("a level has too few descriptors".into());
        }
        self.next[level] = node + count as usize;
        let mut group = Group { level, slot: self.cursor, node, count, far: 0 };
        let links = group.of(self.links);
        // Links far and block, 2 and 3, have bit 1; links near and far, 1 and 2, have one of the two bits.
        group.far = (links >> 1 & LOWEST).count_ones();
        let in_page = self.cursor % PAGE_SLOTS;
        if in_page == 0 || in_page + count + group.far > PAGE_SLOTS {
            let page = self.cursor.next_multiple_of(PAGE_SLOTS);
            sink.page(self.cursor, page);
            group.slot = page + FIRST_SLOT;
        }
        let pointer = group.slot + count;
        self.cursor = (pointer + group.far).next_multiple_of(2);
        sink.group(&group)?;
        let frame = Frame {
            slot: group.slot,
            pointer,
            left: lowest_bits(links ^ links >> 1),
            far: lowest_bits(links >> 1),
            nonleaf: group.of(self.nonleaf),
        };
        if group.far > 0 {
            let mut blocks = frame.far & !frame.left;
            while blocks != 0 {
                let member = blocks.trailing_zeros();
                blocks &= blocks - 1;
                sink.block(level, frame.slot + member, frame.pointer_of(member))?;
            }
        }
        Ok(frame)
    }

    #[inline(always)]
    fn run(&mut self, sink: &mut impl Sink) -> Result<(), String> {
        let mut stack = [Frame::default(); MAX_LEVELS + 1];
        let mut level = 0;
        sink.page(0, 0);
        let mut frame = self.place(0, self.first_group, sink)?;
        loop {
            if frame.left == 0 {
                if level == 0 {
                    return Ok(());
                }
                level -= 1;
                frame = stack[level];
                continue;
            }
            let member = frame.left.trailing_zeros();
            frame.left &= frame.left - 1;
            if level + 1 >= self.levels {
                return Err("the last level has children".into());
            }
            let count = ((frame.nonleaf >> (8 * member)) as u8).count_ones();
            let below = self.place(level + 1, count, sink)?;
            if frame.far >> member & 1 == 0 {
                sink.near(frame.slot + member, below.slot)?;
            } else {
                sink.far(frame.slot + member, frame.pointer_of(member), below.slot)?;
            }
            if below.left != 0 {
                stack[level] = frame;
                level += 1;
                frame = below;
            }
        }
    }
}

impl Frame {
    /// Slot of the far pointer of a member.
    #[inline(always)]
    fn pointer_of(&self, member: u32) -> u32 {
        self.pointer + (self.far & ((1 << member) - 1)).count_ones()
    }
}

/// Writes what the walk finds.
struct Writer<'a> {
    fields: &'a Fields,
    array: &'a mut [u64],
    pool: &'a mut [u32],
    /// Word of the block that is the first of the pool.
    pool_word: u32,
    /// Whether every contour pointer fits.
    pool_is_near: bool,
    /// Contours that have been written.
    contour: usize,
    columns: [&'a mut [u64]; MAX_KINDS],
    /// Values that have been written of each attachment.
    values: [usize; MAX_KINDS],
    /// Where the next group of each level is in the columns of contours, blocks and values.
    next: [Start; MAX_LEVELS + 1],
    start: u64,
    outer: &'a mut dyn FnMut(u32) -> Option<u64>,
    array_slots: u32,
}

impl Writer<'_> {
    #[inline(always)]
    fn point(&mut self, slot: u32, to: u32, far: bool) -> Result<(), String> {
        let distance = to - slot;
        if distance > MAX_NEAR_POINTER {
            return Err(format!("the children of slot {slot} are too far away for a child pointer"));
        }
        let descriptor = self.array.get_mut(slot as usize).ok_or("a descriptor leaves the array")?;
        *descriptor |= u64::from(distance << 17 | u32::from(far) << 16);
        Ok(())
    }

    fn set(&mut self, slot: u32, value: u64) -> Result<(), String> {
        *self.array.get_mut(slot as usize).ok_or("a far pointer leaves the array")? = value;
        Ok(())
    }

    /// The descriptors of a group, without child pointers, and its contours.
    #[inline(always)]
    fn descriptors(&mut self, group: &Group) -> Result<(), String> {
        let fields = self.fields;
        if (group.slot + group.count) as usize > self.array.len() {
            return Err("a group leaves the array".into());
        }
        let (valid, nonleaf) = (group.of(&fields.valid), group.of(&fields.nonleaf));
        let masks = group.of(&fields.contour_masks);
        // Sums of the bytes up to each: at most 64, so that no byte overflows.
        let sums = ones_of_bytes(masks).wrapping_mul(LOWEST);
        let (contours, before) = ((sums >> 56) as usize, sums << 8);
        let pool = u64::from(self.pool_word) + self.contour as u64 - 2 * u64::from(group.slot);
        let leaf = valid & !nonleaf;
        let mut descriptors = [0; 8];
        // Those after the last of the group are zero.
        for (descriptor, k) in descriptors.iter_mut().zip([0u64, 1, 2, 3, 4, 5, 6, 7]) {
            let of = |bytes: u64| bytes >> (8 * k) & 0xff;
            // Of those after the last the difference may be negative.
            let contours = (pool + of(before)).wrapping_sub(2 * k) << 40 | of(masks) << 32;
            let contours = if of(masks) == 0 { 0 } else { contours };
            *descriptor = contours | of(valid) << 8 | of(leaf);
        }
        let too_far = |k: u64| {
            masks >> (8 * k) & 0xff != 0 && pool + (before >> (8 * k) & 0xff) - 2 * k > MAX_CONTOUR_POINTER.into()
        };
        if !self.pool_is_near && (0..8).any(too_far) {
            return Err(format!("the contours of slot {} are too far away", group.slot));
        }
        let slots = &mut self.array[group.slot as usize..];
        match slots.first_chunk_mut() {
            Some(slots) => *slots = descriptors,
            None => {
                let count = group.count as usize;
                copy_exactly(&mut slots[..count], &descriptors[..count]);
            }
        }
        if contours > 0 {
            let next = &mut self.next[group.level].contour;
            let from = fields.contours.get(*next..).ok_or("a level has too few contours")?;
            let to = self.pool.get_mut(self.contour..).ok_or("the pool is too short")?;
            copy_ahead::<16, u32>(to, from, contours).ok_or("a level has too few contours")?;
            *next += contours;
            self.contour += contours;
        }
        Ok(())
    }

    /// Clears what was copied too much to the pairs of slots from `cursor` on.
    #[cold]
    fn clear_pairs(&mut self, cursor: u32) {
        for ((_, values), column) in self.fields.attachments.iter().zip(&mut self.columns) {
            if let Values::Pairs(unit, _) = values {
                let from = (cursor as usize / 2 * unit).min(column.len());
                let to = (from + 4 * unit).min(column.len());
                column[from..to].fill(0);
            }
        }
    }
}

impl Sink for Writer<'_> {
    #[inline(always)]
    fn page(&mut self, cursor: u32, page: u32) {
        self.clear_pairs(cursor);
        if let Some(header) = self.array.get_mut(page as usize) {
            *header = u64::from(self.array_slots - page);
        }
    }

    #[inline(always)]
    fn group(&mut self, group: &Group) -> Result<(), String> {
        self.descriptors(group)?;
        let (slot, count) = (group.slot as usize, group.count as usize);
        let next = &mut self.next[group.level].values;
        let nodes = group.node..group.node + count;
        for (number, (_, values)) in self.fields.attachments.iter().enumerate() {
            let column = &mut *self.columns[number];
            let from = next[number];
            match values {
                Values::Constant(_) => {}
                Values::Pairs(unit, data) => {
                    let pairs = count.div_ceil(2);
                    let from = data.get(from * unit..).ok_or("a level has too few pairs")?;
                    let column = column.get_mut(slot / 2 * unit..).ok_or("an attachment is too short")?;
                    let copied = match unit {
                        1 => copy_ahead::<4, u64>(column, from, pairs),
                        _ => copy_ahead::<8, u64>(column, from, pairs * unit),
                    };
                    copied.ok_or("a level has too few pairs")?;
                    if group.far > 0 {
                        // The pairs of the far pointers.
                        let end = (slot + count + group.far as usize).div_ceil(2) - slot / 2;
                        let rest = column.get_mut(pairs * unit..end * unit).ok_or("an attachment is too short")?;
                        rest.fill(0);
                    }
                    next[number] += pairs;
                }
                Values::Plain(masks, data) => {
                    let words: &mut [u32] = bytemuck::cast_slice_mut(column);
                    for (k, node) in nodes.clone().enumerate() {
                        let own = plain_count(masks[node], self.fields.valid[node]);
                        let to = self.array_slots as usize + self.values[number];
                        words[slot + k] = (to as u32) << 8 | u32::from(masks[node]);
                        if to >= 1 << 24 {
                            return Err("a plain value is too far away".into());
                        }
                        let from = data.get(next[number]..next[number] + own);
                        let to = words.get_mut(to..to + own).ok_or("an attachment is too short")?;
                        to.copy_from_slice(from.ok_or("a level has too few values")?);
                        next[number] += own;
                        self.values[number] += own;
                    }
                }
                Values::Corners(masks, data) => {
                    for (k, node) in nodes.clone().enumerate() {
                        let own = corner_count(masks[node]);
                        let to = self.array_slots as usize + self.values[number];
                        let first = if own > 0 { 2 * to as u64 } else { 0 };
                        column[slot + k] = first << 32 | u64::from(masks[node]);
                        let from = data.get(next[number]..next[number] + own);
                        let to = column.get_mut(to..to + own).ok_or("an attachment is too short")?;
                        to.copy_from_slice(from.ok_or("a level has too few values")?);
                        next[number] += own;
                        self.values[number] += own;
                    }
                }
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn near(&mut self, slot: u32, target: u32) -> Result<(), String> {
        self.point(slot, target, false)
    }

    #[inline(always)]
    fn far(&mut self, slot: u32, pointer: u32, target: u32) -> Result<(), String> {
        self.set(pointer, u64::from(target - slot))?;
        self.point(slot, pointer, true)
    }

    fn block(&mut self, level: usize, slot: u32, pointer: u32) -> Result<(), String> {
        let next = &mut self.next[level].child;
        let block = *self.fields.children.get(*next).ok_or("a block is missing")?;
        *next += 1;
        let target = (self.outer)(block).ok_or_else(|| format!("there is no block {block}"))? + u64::from(FIRST_SLOT);
        let from = self.start + u64::from(slot);
        let distance = target.checked_sub(from).filter(|d| (1..1 << 32).contains(d));
        self.set(pointer, distance.ok_or_else(|| format!("block {block} cannot be reached"))?)?;
        self.point(slot, pointer, true)
    }
}
