//! The image of a block from its fields (spec section 4.2 and 4.3: the layout of codec 2).

use crate::file::{ATTACHMENT_BYTES, FIRST_SLOT, INFO_BYTES, PAGE_BYTES, PAGE_SLOTS};
use crate::parts::fields::{Fields, Start, Values, link};
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
    let mut nothing = Nothing;
    // Without targets nothing can fail.
    let _ = walk.run(&mut nothing);
    let array_slots = walk.cursor;
    Size { array_slots, bytes: Places::new(fields, array_slots).end }
}

/// Writes the image of a block. `image` has the size that [`measure`] found (or the block table says) and is zero. `outer`
/// returns the slot of the image that is slot 0 of another block; `start` is that of this block.
///
/// # Errors
/// The fields do not have this size, or a pointer would not fit.
pub(crate) fn write(
    fields: &Fields,
    array_slots: u32,
    block: u32,
    start: u64,
    image: &mut [u64],
    outer: &mut dyn FnMut(u32) -> Option<u64>,
) -> Result<(), String> {
    let places = Places::new(fields, array_slots);
    if places.end != image.len() as u64 * 8 {
        return Err(format!("the parts make {} bytes, expected {}", places.end, image.len() * 8));
    }
    let (array, rest) = image.split_at_mut(array_slots as usize);
    for page in (0..array_slots).step_by(PAGE_SLOTS as usize) {
        array[page as usize] = u64::from(array_slots - page);
    }
    write_info(fields, array_slots, block, &places, rest);
    let mut columns: [&mut [u64]; 3] = Default::default();
    let mut tail = rest;
    let mut at = places.info;
    let mut take = |to: usize| {
        let (head, next) = std::mem::take(&mut tail).split_at_mut((to - at) / 8);
        tail = next;
        at = to;
        head
    };
    // The pool may start or end in the middle of a slot only at its end: it starts at a multiple of 8.
    let pool_start = places.pool;
    take(pool_start);
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
    let mut writer = Writer {
        fields,
        array,
        pool: bytemuck::cast_slice_mut(pool),
        pool_word: (places.pool / 4) as u32,
        contour: 0,
        columns,
        values: [0; 3],
        start,
        outer,
        array_slots,
    };
    let mut walk = Walk::new(fields);
    walk.run(&mut writer)?;
    if walk.cursor == array_slots {
        Ok(())
    } else {
        Err(format!("the array has {} slots, not {array_slots}", walk.cursor))
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

/// Copies a few values of the same number. A call of `memcpy` for each descriptor costs more than the values.
#[inline(always)]
fn copy_few<T: Copy>(to: &mut [T], from: &[T]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// What is done at each step of the walk over the slots.
trait Sink {
    /// A group of siblings is at slots from `slot` on. `nodes` are its descriptors, `from` where the columns of its level are.
    fn group(&mut self, slot: u32, from: &Start, count: usize) -> Result<Start, String>;
    /// The children of the descriptor at `slot` are at slot `target`.
    fn near(&mut self, slot: u32, target: u32) -> Result<(), String>;
    /// As `near`, by the far pointer at `pointer`.
    fn far(&mut self, slot: u32, pointer: u32, target: u32) -> Result<(), String>;
    /// The children of the descriptor at `slot` are in another block.
    fn block(&mut self, slot: u32, pointer: u32, block: u32) -> Result<(), String>;
}

struct Nothing;

impl Sink for Nothing {
    fn group(&mut self, _: u32, from: &Start, count: usize) -> Result<Start, String> {
        Ok(Start { node: from.node + count, ..*from })
    }
    fn near(&mut self, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
    fn far(&mut self, _: u32, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
    fn block(&mut self, _: u32, _: u32, _: u32) -> Result<(), String> {
        Ok(())
    }
}

/// A group whose members' children are being placed.
#[derive(Clone, Copy, Default)]
struct Frame {
    /// The next member, and the end of the group.
    node: usize,
    end: usize,
    /// Slot of the next member.
    slot: u32,
    /// Next far pointer of the group.
    pointer: u32,
    /// Next block that a member refers to.
    child: usize,
}

/// The walk that gives slots to all descriptors: a group and its far pointers, then what is below each member.
struct Walk<'a> {
    fields: &'a Fields,
    cursor: u32,
    /// Where the next group of each level is in the columns.
    next: [Start; MAX_LEVELS + 1],
}

impl<'a> Walk<'a> {
    fn new(fields: &'a Fields) -> Self {
        let mut next = [Start::default(); MAX_LEVELS + 1];
        let levels = fields.levels().min(MAX_LEVELS);
        next[..levels].copy_from_slice(&fields.starts[..levels]);
        Self { fields, cursor: FIRST_SLOT, next }
    }

    /// Places a group of siblings of a level. Returns its first slot.
    #[inline(always)]
    fn place(&mut self, level: usize, count: usize, sink: &mut impl Sink) -> Result<Frame, String> {
        let from = self.next[level];
        let nodes = from.node..from.node + count;
        let links = self.fields.links.get(nodes.clone()).ok_or("a level has too few descriptors")?;
        let far = links.iter().filter(|l| **l >= link::FAR).count() as u32;
        let needed = count as u32 + far;
        let in_page = self.cursor % PAGE_SLOTS;
        if in_page == 0 || in_page + needed > PAGE_SLOTS {
            self.cursor = self.cursor.next_multiple_of(PAGE_SLOTS) + FIRST_SLOT;
        }
        let slot = self.cursor;
        self.cursor = (slot + needed).next_multiple_of(2);
        let mut end = sink.group(slot, &from, count)?;
        end.node = nodes.end;
        self.next[level] = end;
        Ok(Frame { node: nodes.start, end: nodes.end, slot, pointer: slot + count as u32, child: from.child })
    }

    fn run(&mut self, sink: &mut impl Sink) -> Result<(), String> {
        let mut stack = [Frame::default(); MAX_LEVELS + 1];
        let mut level = 0;
        stack[0] = self.place(0, self.fields.count(0), sink)?;
        loop {
            let frame = &mut stack[level];
            if frame.node == frame.end {
                if level == 0 {
                    return Ok(());
                }
                level -= 1;
                continue;
            }
            let (node, slot) = (frame.node, frame.slot);
            frame.node += 1;
            frame.slot += 1;
            match self.fields.links[node] {
                link::NONE => {}
                link::BLOCK => {
                    let (pointer, child) = (frame.pointer, frame.child);
                    frame.pointer += 1;
                    frame.child += 1;
                    self.next[level].child = child + 1;
                    let block = *self.fields.children.get(child).ok_or("a block is missing")?;
                    sink.block(slot, pointer, block)?;
                }
                kind => {
                    let pointer = frame.pointer;
                    frame.pointer += u32::from(kind == link::FAR);
                    let count = self.fields.nonleaf[node].count_ones() as usize;
                    level += 1;
                    if level >= self.fields.levels().min(MAX_LEVELS) {
                        return Err("the last level has children".into());
                    }
                    stack[level] = self.place(level, count, sink)?;
                    let target = stack[level].slot;
                    if kind == link::NEAR { sink.near(slot, target)? } else { sink.far(slot, pointer, target)? }
                }
            }
        }
    }
}

/// Writes what the walk finds.
struct Writer<'a> {
    fields: &'a Fields,
    array: &'a mut [u64],
    pool: &'a mut [u32],
    /// Word of the block that is the first of the pool.
    pool_word: u32,
    /// Contours that have been written.
    contour: usize,
    columns: [&'a mut [u64]; 3],
    /// Values that have been written of each attachment.
    values: [usize; 3],
    start: u64,
    outer: &'a mut dyn FnMut(u32) -> Option<u64>,
    array_slots: u32,
}

impl Writer<'_> {
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

    /// Contours of a descriptor. Returns the high word of the descriptor.
    #[inline(always)]
    fn contours(&mut self, slot: u32, mask: u8, at: &mut usize) -> Result<u64, String> {
        if mask == 0 {
            return Ok(0);
        }
        let count = mask.count_ones() as usize;
        let pointer = self.pool_word + self.contour as u32 - 2 * slot;
        if pointer > MAX_CONTOUR_POINTER {
            return Err(format!("the contours of slot {slot} are too far away"));
        }
        let from = self.fields.contours.get(*at..*at + count).ok_or("a level has too few contours")?;
        let to = self.pool.get_mut(self.contour..self.contour + count).ok_or("the pool is too short")?;
        copy_few(to, from);
        *at += count;
        self.contour += count;
        Ok(u64::from(pointer << 8 | u32::from(mask)))
    }
}

impl Sink for Writer<'_> {
    #[inline(always)]
    fn group(&mut self, slot: u32, from: &Start, count: usize) -> Result<Start, String> {
        let fields = self.fields;
        let mut end = *from;
        if slot as usize + count > self.array.len() {
            return Err("a group leaves the array".into());
        }
        let nodes = from.node..from.node + count;
        let (valid, nonleaf) = (&fields.valid[nodes.clone()], &fields.nonleaf[nodes.clone()]);
        let masks = &fields.contour_masks[nodes.clone()];
        for k in 0..count {
            let high = self.contours(slot + k as u32, masks[k], &mut end.contour)?;
            let low = u32::from(valid[k]) << 8 | u32::from(valid[k] & !nonleaf[k]);
            self.array[slot as usize + k] = high << 32 | u64::from(low);
        }
        for (number, (_, values)) in fields.attachments.iter().enumerate() {
            let column = &mut *self.columns[number];
            match values {
                Values::Constant(_) => {}
                Values::Pairs(unit, data) => {
                    let pairs = count.div_ceil(2);
                    let from = data.get(end.values[number] * unit..(end.values[number] + pairs) * unit);
                    let to = slot as usize / 2 * unit;
                    let to = column.get_mut(to..to + pairs * unit).ok_or("an attachment is too short")?;
                    copy_few(to, from.ok_or("a level has too few pairs")?);
                    end.values[number] += pairs;
                }
                Values::Plain(masks, data) => {
                    let words: &mut [u32] = bytemuck::cast_slice_mut(column);
                    for (k, node) in nodes.clone().enumerate() {
                        let own = plain_count(masks[node], valid[k]);
                        let next = self.array_slots as usize + self.values[number];
                        words[slot as usize + k] = (next as u32) << 8 | u32::from(masks[node]);
                        if next >= 1 << 24 {
                            return Err("a plain value is too far away".into());
                        }
                        let from = data.get(end.values[number]..end.values[number] + own);
                        let to = words.get_mut(next..next + own).ok_or("an attachment is too short")?;
                        to.copy_from_slice(from.ok_or("a level has too few values")?);
                        end.values[number] += own;
                        self.values[number] += own;
                    }
                }
                Values::Corners(masks, data) => {
                    for (k, node) in nodes.clone().enumerate() {
                        let own = corner_count(masks[node]);
                        let next = self.array_slots as usize + self.values[number];
                        let first = if own > 0 { 2 * next as u64 } else { 0 };
                        column[slot as usize + k] = first << 32 | u64::from(masks[node]);
                        let from = data.get(end.values[number]..end.values[number] + own);
                        let to = column.get_mut(next..next + own).ok_or("an attachment is too short")?;
                        to.copy_from_slice(from.ok_or("a level has too few values")?);
                        end.values[number] += own;
                        self.values[number] += own;
                    }
                }
            }
        }
        Ok(end)
    }

    fn near(&mut self, slot: u32, target: u32) -> Result<(), String> {
        self.point(slot, target, false)
    }

    fn far(&mut self, slot: u32, pointer: u32, target: u32) -> Result<(), String> {
        self.set(pointer, u64::from(target - slot))?;
        self.point(slot, pointer, true)
    }

    fn block(&mut self, slot: u32, pointer: u32, block: u32) -> Result<(), String> {
        let target = (self.outer)(block).ok_or_else(|| format!("there is no block {block}"))? + u64::from(FIRST_SLOT);
        let from = self.start + u64::from(slot);
        let distance = target.checked_sub(from).filter(|d| (1..1 << 32).contains(d));
        self.set(pointer, distance.ok_or_else(|| format!("block {block} cannot be reached"))?)?;
        self.point(slot, pointer, true)
    }
}
