//! Blocks as they are stored: as they are in memory, or as one Zstandard frame (spec section 4.1).

use std::borrow::Cow;
use std::io::{Error, ErrorKind};

use crate::file::{BlockEntry, CODEC_RAW, CODEC_ZSTD, PAGE_BYTES};
use crate::{Broken, ids};

/// Most image bytes that a stored byte can stand for: Zstandard says 128 KiB of one byte in 4 bytes. Whatever claims
/// more is refused before memory is taken for it.
pub(crate) const MAX_RATIO: u64 = (128 << 10) / 4;

/// Compression levels that [`WriteOptions`](crate::WriteOptions) takes.
pub const COMPRESSION_LEVELS: std::ops::RangeInclusive<i32> = 1..=22;

/// The stored form of a block: codec and bytes. A block that would not take fewer pages of the file stays as it is.
pub(crate) fn encode(image: &[u8], level: Option<i32>) -> std::io::Result<(u32, Cow<'_, [u8]>)> {
    let raw = (CODEC_RAW, Cow::Borrowed(image));
    let Some(level) = level else { return Ok(raw) };
    if !COMPRESSION_LEVELS.contains(&level) {
        let what = format!("compression level {level}: Zstandard has 1 to 22");
        return Err(Error::new(ErrorKind::InvalidInput, what));
    }
    let frame = pack(image, level)?;
    let fewer = (frame.len() as u64).next_multiple_of(PAGE_BYTES) < image.len() as u64;
    Ok(if fewer { (CODEC_ZSTD, Cow::Owned(frame)) } else { raw })
}

#[cfg(feature = "zstd")]
fn pack(image: &[u8], level: i32) -> std::io::Result<Vec<u8>> {
    zstd::bulk::compress(image, level)
}

#[cfg(not(feature = "zstd"))]
fn pack(_: &[u8], _: i32) -> std::io::Result<Vec<u8>> {
    Err(Error::new(ErrorKind::Unsupported, "compressing takes a build of esvo-format with the feature `zstd`"))
}

/// Checks the stored bytes of block `index` against their checksum, and only then makes the image of the block of them.
/// `image` has the length that the block table says, and is filled to the last byte or refused.
pub(crate) fn decode(index: usize, block: &BlockEntry, stored: &[u8], image: &mut [u8]) -> Result<(), Broken> {
    check_crc(index, block, stored)?;
    let fail = |what: String| Err(Broken::new(ids::BLOCK_CODEC, block.file_offset, format!("block {index}: {what}")));
    match block.codec {
        // The table has been checked; sizes that differ would be an error of this library.
        CODEC_RAW if stored.len() == image.len() => {
            image.copy_from_slice(stored);
            Ok(())
        }
        CODEC_ZSTD => match unpack(stored, image) {
            Ok(()) => Ok(()),
            Err(what) => fail(what),
        },
        codec => fail(format!("codec {codec} with {} bytes for {}", stored.len(), image.len())),
    }
}

/// Checks the stored bytes of a block against its checksum.
pub(crate) fn check_crc(index: usize, block: &BlockEntry, stored: &[u8]) -> Result<(), Broken> {
    if crc32fast::hash(stored) == block.crc {
        return Ok(());
    }
    Err(Broken::new(ids::BLOCK_CHECKSUM, block.file_offset, format!("block {index} is damaged")))
}

#[cfg(feature = "zstd")]
fn unpack(stored: &[u8], image: &mut [u8]) -> Result<(), String> {
    use zstd::zstd_safe;
    const MAGIC: [u8; 4] = 0xFD2F_B528u32.to_le_bytes();
    // The decoder takes several frames, and passes over those that are to be skipped.
    let whole = stored.starts_with(&MAGIC) && zstd_safe::find_frame_compressed_size(stored) == Ok(stored.len());
    if !whole {
        return Err("the stored bytes are not one Zstandard frame".into());
    }
    let expected = image.len();
    let size = zstd::bulk::decompress_to_buffer(stored, image)
        .map_err(|error| format!("cannot be decompressed to {expected} bytes: {error}"))?;
    if size != expected {
        return Err(format!("decompresses to {size} bytes, not {expected}"));
    }
    Ok(())
}

#[cfg(not(feature = "zstd"))]
fn unpack(_: &[u8], _: &mut [u8]) -> Result<(), String> {
    Err("to decompress takes a build of esvo-format with the feature `zstd`".into())
}
