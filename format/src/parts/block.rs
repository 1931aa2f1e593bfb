//! All parts of a block: encoding with a check, decoding.

use std::borrow::Cow;

use crate::block::BlockParts;
use crate::file::compression::{self, Packer};
use crate::file::*;
use crate::parts::encode::{fields, runs};
use crate::parts::fields::Fields;
use crate::parts::layout::{Block, write};
use crate::parts::stored::{Decoder, decode, encode};
use crate::parts::table::{PartTable, block_crc};
use crate::{Broken, ids};

/// A part as it is stored.
pub(crate) struct StoredPart {
    pub(crate) entry: PartEntry,
    /// With the header.
    pub(crate) bytes: Vec<u8>,
}

impl StoredPart {
    fn new(block: u32, codec: u32, (first_level, last_level): (u8, u8), body: &[u8]) -> std::io::Result<Self> {
        let size = u32::try_from(body.len() as u64 + PART_HEADER_BYTES)
            .map_err(|_| std::io::Error::other("a part has 4 GiB or more: use smaller blocks"))?;
        let header = PartHeader { crc: 0, size, block, first_level, last_level, codec: codec as u8, reserved: 0 };
        let mut bytes = to_bytes(&header);
        bytes.extend_from_slice(body);
        let crc = crc32fast::hash(&bytes[4..]);
        bytes[..4].copy_from_slice(&crc.to_le_bytes());
        Ok(Self { entry: PartEntry { block, size, first_level, last_level, reserved: 0 }, bytes })
    }

    /// The checksum in the header.
    pub(crate) fn crc(&self) -> [u8; 4] {
        self.bytes.first_chunk().copied().unwrap_or_default()
    }
}

/// The level of the first descriptors of a block.
pub(crate) fn first_level(block: &BlockEntry) -> u8 {
    if block.parent == NO_PARENT { 0 } else { 24u32.saturating_sub(block.cube_scale) as u8 }
}

/// The codec of a block and its parts. A block that cannot be made of its fields again, to the last bit, has one part with codec
/// 1 or 0.
///
/// `image` are the bytes of block `index`, `parts` is relative to their start. `table` has all blocks.
pub(crate) fn encode_block(
    table: &[BlockEntry],
    index: u32,
    image: &[u64],
    parts: &BlockParts,
    level: i32,
) -> std::io::Result<(u32, Vec<StoredPart>)> {
    compression::check_level(level)?;
    let first = first_level(&table[index as usize]);
    if let Some(stored) = encode_fields(table, index, image, parts, level)? {
        return Ok((CODEC_FIELDS, stored));
    }
    let (codec, bytes): (u32, Cow<[u8]>) = compression::encode(bytemuck::cast_slice(image), Some(level))?;
    Ok((codec, vec![StoredPart::new(index, codec, (first, LAST_LEVEL), &bytes)?]))
}

fn encode_fields(
    table: &[BlockEntry],
    index: u32,
    image: &[u64],
    parts: &BlockParts,
    level: i32,
) -> std::io::Result<Option<Vec<StoredPart>>> {
    let start = table[index as usize].image_offset / 8;
    let at = |distance: u64| {
        let at = (start + distance) * 8;
        table.binary_search_by_key(&at, |block| block.image_offset).ok().map(|found| found as u32)
    };
    let Some(fields) = fields(image, parts, &at) else { return Ok(None) };
    let mut packer = Packer::new(level)?;
    let mut stored = Vec::new();
    let base = usize::from(first_level(&table[index as usize]));
    for (first, last) in runs(&fields) {
        if base + last > usize::from(LAST_LEVEL) {
            return Ok(None);
        }
        let body = encode(&fields, first, last, &mut packer)?;
        let levels = ((base + first) as u8, (base + last) as u8);
        stored.push(StoredPart::new(index, CODEC_FIELDS, levels, &body)?);
    }
    // The proof that nothing is lost.
    let mut again = vec![0; image.len()];
    let bodies = stored.iter().map(|part| (part.entry, &part.bytes[PART_HEADER_BYTES as usize..]));
    let decoded = Decoder::take().and_then(|mut decoder| {
        let fields = decode_fields(bodies, image.len() as u64 * 8, &mut decoder)?;
        let mut outer = |block: u32| table.get(block as usize).map(|b| b.image_offset / 8);
        let block = Block { fields: &fields, array_slots: fields.array_slots, index, start };
        write(decoder.set, &block, &mut again, &mut outer)?;
        decoder.reuse(fields);
        decoder.keep();
        Ok(())
    });
    Ok((decoded.is_ok() && again == image).then_some(stored))
}

/// The fields of the first parts of a block of codec 2. `limit` is the size of its image in bytes.
pub(crate) fn decode_fields<'a>(
    parts: impl IntoIterator<Item = (PartEntry, &'a [u8])>,
    limit: u64,
    decoder: &mut Decoder,
) -> Result<Fields, String> {
    let mut fields = decoder.fields();
    for (entry, body) in parts {
        let levels = usize::from(entry.last_level.saturating_sub(entry.first_level)) + 1;
        decode(&mut fields, levels, body, limit, decoder)?;
    }
    Ok(fields)
}

/// Checks the header of a part that was read from byte `at` of the file. Returns what follows the header.
pub(crate) fn check_part<'a>(entry: &PartEntry, codec: u32, bytes: &'a [u8], at: u64) -> Result<&'a [u8], Broken> {
    let block = entry.block;
    let Some(header) = from_bytes::<PartHeader>(bytes).filter(|_| bytes.len() == entry.size as usize) else {
        return Err(Broken::new(ids::PART_PLACE, at, format!("a part of block {block} has {} bytes", bytes.len())));
    };
    let levels = (entry.first_level, entry.last_level);
    if crc32fast::hash(&bytes[4..]) != header.crc {
        let what = format!("the part of block {block} from level {} on is damaged: its checksum differs", levels.0);
        return Err(Broken::new(ids::PART_CHECKSUM, at, what));
    }
    let same = (header.size, header.block) == (entry.size, block)
        && (header.first_level, header.last_level) == levels
        && u32::from(header.codec) == codec
        && header.reserved == 0;
    if !same {
        let what = format!("the header of the part of block {block} from level {} on differs from the table", levels.0);
        return Err(Broken::new(ids::PART_HEADER, at, what));
    }
    Ok(&bytes[PART_HEADER_BYTES as usize..])
}

/// Decodes all parts of block `index` to its image. `bytes` are those of the file.
pub(crate) fn decode_parts(
    table: &[BlockEntry],
    parts: &PartTable,
    index: usize,
    bytes: &[u8],
    image: &mut [u8],
    decoder: &mut Decoder,
) -> Result<(), Broken> {
    let stored = parts.of_block(index).iter().map(|&part| {
        let (at, end) = parts.range(part);
        (part, &bytes[at as usize..end as usize])
    });
    let stored: Vec<(u32, &[u8])> = stored.collect();
    let slots = bytemuck::try_cast_slice_mut::<u8, u64>(image);
    let Ok(slots) = slots else { return Err(broken(table, index, "the image is not aligned".into())) };
    decode_stored(table, parts, index, &stored, slots, decoder)
}

/// Decodes all parts of block `index` to its image. `stored` are the parts by level, each with its number.
pub(crate) fn decode_stored(
    table: &[BlockEntry],
    parts: &PartTable,
    index: usize,
    stored: &[(u32, &[u8])],
    image: &mut [u64],
    decoder: &mut Decoder,
) -> Result<(), Broken> {
    let block = &table[index];
    let mut bodies = Vec::with_capacity(stored.len());
    for &(part, bytes) in stored {
        let entry = &parts.entries[part as usize];
        bodies.push((*entry, check_part(entry, block.codec, bytes, parts.offsets[part as usize])?));
    }
    let crc = block_crc(stored.iter().map(|(_, bytes)| bytes.first_chunk().copied().unwrap_or_default()));
    if crc != block.crc {
        let what = format!("block {index}: its checksum is not that of its parts");
        return Err(Broken::new(ids::BLOCK_CHECKSUM, block.file_offset, what));
    }
    if block.codec != CODEC_FIELDS {
        let body = bodies.first().map_or(&[][..], |(_, body)| body);
        return compression::decode_body(index, block, body, bytemuck::cast_slice_mut(image));
    }
    let mut outer = |block: u32| table.get(block as usize).map(|b| b.image_offset / 8);
    let start = block.image_offset / 8;
    decode_fields(bodies, block.image_size, decoder)
        .and_then(|fields| {
            let block = Block { fields: &fields, array_slots: fields.array_slots, index: index as u32, start };
            let written = write(decoder.set, &block, image, &mut outer);
            decoder.reuse(fields);
            written
        })
        .map_err(|what| broken(table, index, what))
}

fn broken(table: &[BlockEntry], index: usize, what: String) -> Broken {
    Broken::new(ids::PART_FIELDS, table[index].file_offset, format!("block {index}: {what}"))
}
