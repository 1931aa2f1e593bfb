//! Checks of the object table, the block table and the info sections (spec sections 3, 4 and 6).

use crate::block::BlockParts;
use crate::file::compression::MAX_RATIO;
use crate::file::*;
use crate::values::components::{Form, HEAD_WORDS};
use crate::{Broken, ComponentFormat, ids};

/// A broken rule: its id, the offset in bytes from the start of the entry or block, and a description.
type Fault = (&'static str, u64, String);

/// Checks the entries of an object table that starts at byte `at`.
pub(crate) fn check_objects(objects: &[ObjectEntry], at: u64) -> Result<(), Broken> {
    if objects.is_empty() {
        return Err(Broken::new(ids::OBJECT_SIZE, at, "the object table is empty"));
    }
    for (i, object) in objects.iter().enumerate() {
        check_object(object).map_err(|(rule, field, what)| {
            Broken::new(rule, at + i as u64 * OBJECT_BYTES + field, format!("object {i}: {what}"))
        })?;
    }
    Ok(())
}

fn check_object(object: &ObjectEntry) -> Result<(), Fault> {
    if !is_usable(&object.octree_to_mesh) {
        let what = format!("transform {:?} is not finite, affine and invertible", object.octree_to_mesh);
        return Err((ids::OBJECT_TRANSFORM, 0, what));
    }
    if !(1..=23).contains(&object.levels) {
        return Err((ids::OBJECT_LEVELS, 132, format!("it has {} levels, expected 1 to 23", object.levels)));
    }
    if object.reserved != [0; 4] {
        return Err((ids::OBJECT_RESERVED, 176, "reserved fields are not zero".into()));
    }
    Ok(())
}

/// Whether a transform, stored by columns, is finite, affine and invertible (O004). Evaluates in the order of the
/// specification, as with huge elements another order may overflow.
pub(crate) fn is_usable(m: &[f64; 16]) -> bool {
    let affine = [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0];
    let determinant =
        m[0] * (m[5] * m[10] - m[9] * m[6]) - m[4] * (m[1] * m[10] - m[9] * m[2]) + m[8] * (m[1] * m[6] - m[5] * m[2]);
    m.iter().all(|x| x.is_finite()) && affine && determinant.is_normal()
}

/// Checks the entries of a block table that starts at byte `at`. `image` is the size in bytes of the image that the
/// blocks must fill, if known. [`check_stored`] checks where and how the blocks are stored.
pub(crate) fn check_blocks(
    blocks: &[BlockEntry],
    at: u64,
    objects: &[ObjectEntry],
    image: Option<u64>,
) -> Result<(), Broken> {
    if blocks.is_empty() {
        return Err(Broken::new(ids::BLOCK_SIZE, at, "the block table is empty"));
    }
    let mut end = 0u64;
    for (i, block) in blocks.iter().enumerate() {
        check_block(block, i, end, blocks, objects).map_err(|fault| block_fault(fault, at, i))?;
        end = end.saturating_add(block.image_size);
    }
    if let Some(image) = image.filter(|image| *image != end) {
        return Err(Broken::new(
            ids::BLOCK_IMAGE,
            at,
            format!("the blocks have {end} bytes in total, the image {image}"),
        ));
    }
    if end / 8 > MAX_IMAGE_SLOTS {
        return Err(Broken::new(
            ids::BLOCK_LIMIT,
            at,
            format!("the image has {end} bytes, expected at most 2^32 slots of 8 bytes"),
        ));
    }
    Ok(())
}

fn block_fault((rule, field, what): Fault, table: u64, index: usize) -> Broken {
    Broken::new(rule, table + index as u64 * BLOCK_BYTES + field, format!("block {index}: {what}"))
}

/// Checks one entry. `end` is the end of the previous block in the image.
fn check_block(
    block: &BlockEntry,
    index: usize,
    end: u64,
    blocks: &[BlockEntry],
    objects: &[ObjectEntry],
) -> Result<(), Fault> {
    if !block.image_offset.is_multiple_of(PAGE_BYTES) {
        return Err((
            ids::BLOCK_ALIGNMENT,
            24,
            format!("image offset {} is no multiple of {PAGE_BYTES}", block.image_offset),
        ));
    }
    if block.image_size == 0 || !block.image_size.is_multiple_of(PAGE_BYTES) {
        return Err((
            ids::BLOCK_ALIGNMENT,
            32,
            format!("image size {} is zero or no multiple of {PAGE_BYTES}", block.image_size),
        ));
    }
    if block.image_offset != end {
        return Err((
            ids::BLOCK_IMAGE,
            24,
            format!("image offset {}, expected {end}, the end of the previous block", block.image_offset),
        ));
    }
    let parent_fits = match block.parent {
        NO_PARENT => objects.get(block.object as usize).is_some_and(|o| o.root_block as usize == index),
        parent => (parent as usize) < index && blocks[parent as usize].object == block.object,
    };
    if !parent_fits {
        return Err((ids::BLOCK_PARENT, 4, wrong_parent(block)));
    }
    if !cube_fits(block, blocks) {
        return Err((ids::BLOCK_CUBE, 8, wrong_cube(block)));
    }
    if block.reserved != 0 {
        return Err((ids::BLOCK_RESERVED, 64, "reserved fields are not zero".into()));
    }
    Ok(())
}

fn wrong_parent(block: &BlockEntry) -> String {
    let object = block.object;
    match block.parent {
        NO_PARENT => format!("it has no parent, but is not the root block of object {object}"),
        parent => format!("parent {parent} is not an earlier block of object {object}"),
    }
}

fn wrong_cube(block: &BlockEntry) -> String {
    let (position, scale) = (block.cube_position, block.cube_scale);
    format!(
        "the cube at {position:?} of scale {scale} is not aligned to its size, or not within the cube of its parent"
    )
}

/// Whether any block is compressed, so that the block data is not the image.
pub(crate) fn compressed(blocks: &[BlockEntry]) -> bool {
    blocks.iter().any(|block| block.codec != CODEC_RAW)
}

/// Checks the codecs of the blocks. `features` are the required feature bits of the file.
pub(crate) fn check_codecs(blocks: &[BlockEntry], at: u64, features: u64) -> Result<(), Broken> {
    let check = |(i, block)| check_codec(block, features).map_err(|fault| block_fault(fault, at, i));
    blocks.iter().enumerate().try_for_each(check)
}

/// Checks where the blocks are stored, if not in parts. `data` is the section of the block data.
pub(crate) fn check_stored(blocks: &[BlockEntry], at: u64, data: &SectionEntry) -> Result<(), Broken> {
    let in_place = !compressed(blocks);
    for (i, block) in blocks.iter().enumerate() {
        let fail = |what| Err(block_fault((ids::BLOCK_RANGE, 40, what), at, i));
        // A stored block occupies whole pages.
        let end = (block.stored_size.checked_next_multiple_of(PAGE_BYTES))
            .and_then(|size| block.file_offset.checked_add(size))
            .filter(|end| *end <= data.offset.saturating_add(data.length) && block.file_offset >= data.offset);
        if end.is_none() || block.file_offset % PAGE_BYTES != 0 {
            return fail(format!(
                "the {} bytes at file offset {} are not whole pages of the block data",
                block.stored_size, block.file_offset
            ));
        }
        let expected = data.offset.saturating_add(block.image_offset);
        if in_place && block.file_offset != expected {
            return fail(format!("file offset {}, expected {expected} as no block is compressed", block.file_offset));
        }
    }
    let ranges = stored_ranges(blocks);
    if let Some(pair) = ranges.windows(2).find(|pair| pair[0].1 > pair[1].0) {
        return Err(Broken::new(
            ids::BLOCK_RANGE,
            at,
            format!("two stored blocks overlap at file offset {}", pair[1].0),
        ));
    }
    Ok(())
}

fn check_codec(block: &BlockEntry, features: u64) -> Result<(), Fault> {
    let in_parts = features & FEATURE_PARTS != 0;
    let header = if in_parts && block.codec != CODEC_FIELDS { PART_HEADER_BYTES } else { 0 };
    let (stored, image) = (block.stored_size.saturating_sub(header), block.image_size);
    match block.codec {
        CODEC_RAW if stored == image => Ok(()),
        CODEC_RAW => {
            Err((ids::BLOCK_CODEC, 48, format!("the stored size is {stored} bytes, expected {image} with codec 0")))
        }
        CODEC_ZSTD if features & FEATURE_COMPRESSED == 0 => {
            Err((ids::BLOCK_CODEC, 56, "codec 1 is used, but required feature bit 0 is clear".into()))
        }
        // Refused before memory is allocated for it.
        CODEC_ZSTD if image / MAX_RATIO > stored => {
            Err((ids::BLOCK_CODEC, 48, format!("{stored} compressed bytes cannot decompress to {image} bytes")))
        }
        CODEC_ZSTD => Ok(()),
        CODEC_FIELDS if features & FEATURE_COMPRESSED == 0 || !in_parts => {
            Err((ids::BLOCK_CODEC, 56, "codec 2 is used, but required feature bit 0 or 1 is clear".into()))
        }
        // A byte of a stream stands for less than eight bytes of the image.
        CODEC_FIELDS if image / (8 * MAX_RATIO) > stored => {
            Err((ids::BLOCK_CODEC, 48, format!("{stored} bytes of parts cannot decode to {image} bytes")))
        }
        CODEC_FIELDS => Ok(()),
        codec => Err((ids::BLOCK_CODEC, 56, format!("this reader does not know codec {codec}"))),
    }
}

/// Start and end in the file of the stored blocks, in order. The file ranges in the table must have been checked.
pub(crate) fn stored_ranges(blocks: &[BlockEntry]) -> Vec<(u64, u64)> {
    let mut ranges: Vec<_> = blocks.iter().map(|b| (b.file_offset, b.file_offset + b.stored_size)).collect();
    ranges.sort_unstable();
    ranges
}

fn cube_fits(block: &BlockEntry, blocks: &[BlockEntry]) -> bool {
    cube_within(block, blocks.get(block.parent as usize))
}

/// Whether the cube of a block is aligned and within that of its parent; without a parent, whether it is the root cube.
pub(crate) fn cube_within(block: &BlockEntry, parent: Option<&BlockEntry>) -> bool {
    if !(1..=23).contains(&block.cube_scale) {
        return false;
    }
    let size = 1u32 << block.cube_scale;
    let inside = |low: u32, outer_low: u32, outer: u32| low >= outer_low && low - outer_low <= outer - size.min(outer);
    let Some(parent) = parent else {
        // A root block has the root cube.
        return (block.cube_position, block.cube_scale) == ([0; 3], 23);
    };
    let (outer_position, outer) = (parent.cube_position, 1u32 << parent.cube_scale.min(23));
    (0..3).all(|axis| {
        block.cube_position[axis].is_multiple_of(size) && inside(block.cube_position[axis], outer_position[axis], outer)
    }) && size <= outer
}

/// Reads and checks the info section of block `index`. `bytes` are those of the block, which starts at byte `start` of
/// the image. Offsets in errors count from `at`.
pub(crate) fn block_parts(bytes: &[u8], start: u64, at: u64, index: usize) -> Result<BlockParts, Broken> {
    let fault = |(rule, within, what): Fault| Broken::new(rule, at + within, format!("block {index}: {what}"));
    let (info_at, info) = info_section(bytes, index as u32).map_err(fault)?;
    let pool = info_at + u64::from(info.contour_offset) * 4;
    let attachments = attachments(bytes, info_at, &info).map_err(fault)?;
    Ok(BlockParts {
        start: (start / 8) as u32,
        array_slots: info.array_slots,
        contour_words: ((start + pool) / 4) as usize,
        contour_count: info.contour_count,
        attachments: attachments.into_iter().map(|(kind, at, size)| (kind, start + at, size)).collect(),
    })
}

/// The offset of the info section in a block, and the info section. Checks everything except the attachments.
fn info_section(bytes: &[u8], index: u32) -> Result<(u64, InfoSection), Fault> {
    let size = bytes.len() as u64;
    let array_slots = bytes.first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
    if array_slots > size / 8 || array_slots < 4 {
        return Err((
            ids::PAGE_HEADER,
            0,
            format!("its first page header is {array_slots:#x}, not the distance to an info section in the block"),
        ));
    }
    let at = array_slots * 8;
    let Some(info) = from_bytes::<InfoSection>(&bytes[at as usize..]) else {
        return Err((ids::INFO_RANGE, at, "the info section does not fit into the block".into()));
    };
    if info.block != index {
        return Err((ids::INFO_BLOCK, at, format!("its info section names block {}", info.block)));
    }
    if u64::from(info.array_slots) != array_slots {
        let what = format!(
            "the descriptor array has {} slots, but the info section is at slot {array_slots}",
            info.array_slots
        );
        return Err((ids::INFO_RANGE, at + 4, what));
    }
    if u64::from(info.first_descriptor) + u64::from(FIRST_SLOT) != array_slots {
        return Err((
            ids::INFO_FIRST,
            at + 8,
            format!(
                "the first descriptor is {} slots back from the info section, expected {}",
                info.first_descriptor,
                array_slots - u64::from(FIRST_SLOT)
            ),
        ));
    }
    if info.attachment_count > MAX_ATTACHMENTS {
        return Err((
            ids::ATTACHMENT_LIMIT,
            at + 20,
            format!("it has {} attachments, expected at most {MAX_ATTACHMENTS}", info.attachment_count),
        ));
    }
    if info.reserved != 0 {
        return Err((ids::INFO_RESERVED, at + 24, "reserved fields of the info section are not zero".into()));
    }
    let directory_end = at + INFO_BYTES + u64::from(info.attachment_count) * ATTACHMENT_BYTES;
    if directory_end > size {
        return Err((
            ids::INFO_RANGE,
            at + 20,
            format!("the directory of {} attachments does not fit into the block", info.attachment_count),
        ));
    }
    let pool = at + u64::from(info.contour_offset) * 4;
    if pool < directory_end || pool + u64::from(info.contour_count) * 4 > size {
        let what = format!(
            "the pool of {} contours at byte {pool} overlaps the attachment directory or leaves the block",
            info.contour_count
        );
        return Err((ids::INFO_CONTOURS, at + 12, what));
    }
    Ok((at, info))
}

/// Type, offset in the block, and size in bytes of each attachment.
fn attachments(bytes: &[u8], info_at: u64, info: &InfoSection) -> Result<Vec<(u32, u64, u64)>, Fault> {
    let pool_end = info_at + u64::from(info.contour_offset) * 4 + u64::from(info.contour_count) * 4;
    let (slots, pairs) = (u64::from(info.array_slots), u64::from(info.array_slots.div_ceil(2)));
    let mut found: Vec<(u32, u64, u64)> = Vec::new();
    for k in 0..u64::from(info.attachment_count) {
        let at = info_at + INFO_BYTES + k * ATTACHMENT_BYTES;
        let Some(AttachmentEntry { kind, offset, size }) = from_bytes(&bytes[at as usize..]) else {
            return Err((ids::INFO_RANGE, at, "the attachment directory does not fit into the block".into()));
        };
        let expected = match kind {
            attachment::COLOR_BLOCKS | attachment::AMBIENT_BLOCKS => pairs * 8,
            attachment::NORMAL_BLOCKS => pairs * 16,
            attachment::COLOR_CONSTANT => 8,
            // One entry per slot, then any number of values.
            attachment::COLORS_PLAIN | attachment::NORMALS_PLAIN => slots * 4 + size.saturating_sub(slots * 4) / 4 * 4,
            attachment::CORNERS => slots * 8 + size.saturating_sub(slots * 8) / 8 * 8,
            // Types of vendors and of later versions may have any size.
            _ => size,
        };
        if size != expected {
            return Err((
                ids::ATTACHMENT_SIZE,
                at + 8,
                format!("attachment type {kind} has {size} bytes, expected {expected}"),
            ));
        }
        let start = info_at + u64::from(offset);
        let end = start.checked_add(size).filter(|end| *end <= bytes.len() as u64);
        let Some(end) = end.filter(|_| start.is_multiple_of(8) && start >= pool_end) else {
            return Err((
                ids::ATTACHMENT_RANGE,
                at + 4,
                format!(
                    "attachment type {kind} is not between the contour pool and the end of the block, \
                     or not aligned to 8 bytes"
                ),
            ));
        };
        if found.iter().any(|&(_, other, size)| start < other + size && other < end) {
            return Err((ids::ATTACHMENT_RANGE, at + 4, format!("attachment type {kind} overlaps another attachment")));
        }
        let excludes = |a: u32| {
            let both = |kinds: &[u32]| kinds.contains(&a) && kinds.contains(&kind);
            a == kind || both(&attachment::COLORS) || both(&attachment::NORMALS)
        };
        if let Some((other, ..)) = found.iter().find(|a| excludes(a.0)) {
            let what = if *other == kind {
                format!("attachment type {kind} occurs twice")
            } else {
                format!("attachment types {other} and {kind} exclude each other")
            };
            return Err((ids::ATTACHMENT_TYPE, at, what));
        }
        if attachment::has_components(kind) {
            check_head(kind, &bytes[start as usize..end as usize], slots).map_err(|(rule, within, what)| {
                (rule, if rule == ids::ATTACHMENT_SIZE { at + 8 } else { start + within }, what)
            })?;
        }
        found.push((kind, start, size));
    }
    Ok(found)
}

/// Checks head and size of a component attachment. `slots` is the length of the descriptor array.
fn check_head(kind: u32, bytes: &[u8], slots: u64) -> Result<(), Fault> {
    let size = bytes.len() as u64;
    let wrong_size = |expected: u64| {
        let what = format!("attachment type {kind} has {size} bytes, expected {expected}");
        Err((ids::ATTACHMENT_SIZE, 0, what))
    };
    let least = HEAD_WORDS as u64 * 4;
    let Some(head) = bytes.first_chunk::<8>() else { return wrong_size(least) };
    let words = [0, 4].map(|at| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]));
    let found = ComponentFormat::from_head(&words).filter(|(format, _)| format.fits(kind));
    let Some((format, form)) = found else {
        let what = format!("the head {head:02x?} of attachment type {kind} is none of this type");
        return Err((ids::COMPONENT_HEAD, 0, what));
    };
    let value = format.words() as u64 * 4;
    let expected = match form {
        Form::Constant => least + value,
        // One entry per slot, then any number of values.
        Form::Entries => least + slots * 4 + size.saturating_sub(least + slots * 4) / value * value,
    };
    if size == expected { Ok(()) } else { wrong_size(expected) }
}
