//! The stored form of a block: its image, or the image as one Zstandard frame (spec section 4.1).

use std::borrow::Cow;
use std::io::{Error, ErrorKind};

use crate::file::{BlockEntry, CODEC_RAW, CODEC_ZSTD, PAGE_BYTES};
use crate::{Broken, ids};

/// Largest compression ratio of Zstandard: 128 KiB of one repeated byte take 4 bytes. A block that claims a larger
/// ratio is refused before memory is allocated for it.
pub(crate) const MAX_RATIO: u64 = (128 << 10) / 4;

/// The compression levels that [`WriteOptions`](crate::WriteOptions) accepts.
pub const COMPRESSION_LEVELS: std::ops::RangeInclusive<i32> = 1..=22;

/// The stored form of a block: codec and bytes. A block stays uncompressed if compression would not save a page.
pub(crate) fn encode(image: &[u8], level: Option<i32>) -> std::io::Result<(u32, Cow<'_, [u8]>)> {
    let raw = (CODEC_RAW, Cow::Borrowed(image));
    let Some(level) = level else { return Ok(raw) };
    check_level(level)?;
    let frame = compress(image, level)?;
    let fewer = (frame.len() as u64).next_multiple_of(PAGE_BYTES) < image.len() as u64;
    Ok(if fewer { (CODEC_ZSTD, Cow::Owned(frame)) } else { raw })
}

/// Refuses a compression level that there is not.
pub(crate) fn check_level(level: i32) -> std::io::Result<()> {
    if COMPRESSION_LEVELS.contains(&level) {
        return Ok(());
    }
    Err(Error::new(ErrorKind::InvalidInput, format!("the compression level is {level}, expected 1 to 22")))
}

#[cfg(feature = "zstd")]
fn compress(image: &[u8], level: i32) -> std::io::Result<Vec<u8>> {
    zstd::bulk::compress(image, level)
}

#[cfg(not(feature = "zstd"))]
fn compress(_: &[u8], _: i32) -> std::io::Result<Vec<u8>> {
    Err(Error::new(ErrorKind::Unsupported, "compression needs a build of esvo-format with the feature `zstd`"))
}

/// Checks the stored bytes of block `index` against their checksum, then decodes them into `image`, whose length is
/// that of the block table. Stored bytes that do not fill `image` exactly are refused.
pub(crate) fn decode(index: usize, block: &BlockEntry, stored: &[u8], image: &mut [u8]) -> Result<(), Broken> {
    check_crc(index, block, stored)?;
    decode_body(index, block, stored, image)
}

/// Like [`decode`], of bytes whose checksum has been compared.
pub(crate) fn decode_body(index: usize, block: &BlockEntry, stored: &[u8], image: &mut [u8]) -> Result<(), Broken> {
    let fail = |what: String| Err(Broken::new(ids::BLOCK_CODEC, block.file_offset, format!("block {index}: {what}")));
    match block.codec {
        // The table has been checked, so different sizes would be a bug of this library.
        CODEC_RAW if stored.len() == image.len() => {
            image.copy_from_slice(stored);
            Ok(())
        }
        CODEC_ZSTD => match decompress(stored, image) {
            Ok(()) => Ok(()),
            Err(what) => fail(what),
        },
        codec => fail(format!("codec {codec} cannot decode {} stored bytes to {} bytes", stored.len(), image.len())),
    }
}

/// Checks the stored bytes of a block against its checksum.
pub(crate) fn check_crc(index: usize, block: &BlockEntry, stored: &[u8]) -> Result<(), Broken> {
    if crc32fast::hash(stored) == block.crc {
        return Ok(());
    }
    Err(Broken::new(ids::BLOCK_CHECKSUM, block.file_offset, format!("block {index} is damaged: its checksum differs")))
}

/// Checks that bytes are one Zstandard frame. The decoder would accept several frames and skippable frames, which the format
/// does not allow.
#[cfg(feature = "zstd")]
fn one_frame(stored: &[u8]) -> Result<(), String> {
    const MAGIC: [u8; 4] = 0xFD2F_B528u32.to_le_bytes();
    let whole = stored.starts_with(&MAGIC) && zstd::zstd_safe::find_frame_compressed_size(stored) == Ok(stored.len());
    if whole { Ok(()) } else { Err("the stored bytes are not one Zstandard frame".into()) }
}

/// Decoders of frames that keep their memory from one frame to the next.
#[cfg(feature = "zstd")]
pub(crate) struct Unpacker(zstd::bulk::Decompressor<'static>);

#[cfg(feature = "zstd")]
impl Unpacker {
    pub(crate) fn new() -> Result<Self, String> {
        zstd::bulk::Decompressor::new().map(Self).map_err(|error| error.to_string())
    }

    /// Decodes one frame, whole and alone, to as many bytes as `out` has.
    pub(crate) fn unpack(&mut self, stored: &[u8], out: &mut [u8]) -> Result<(), String> {
        one_frame(stored)?;
        let expected = out.len();
        let size = (self.0.decompress_to_buffer(stored, out))
            .map_err(|error| format!("the stored bytes cannot be decompressed to {expected} bytes: {error}"))?;
        if size != expected {
            return Err(format!("the stored bytes decompress to {size} bytes, expected {expected}"));
        }
        Ok(())
    }
}

/// An encoder of frames that keeps its memory from one frame to the next.
#[cfg(feature = "zstd")]
pub(crate) struct Packer(zstd::bulk::Compressor<'static>);

#[cfg(feature = "zstd")]
impl Packer {
    /// Shortest match at levels up to [`Self::FAST`]. Streams of fields are close to random: a match of fewer bytes takes about as
    /// many bits as the bytes themselves, and much more time to decode.
    const SHORTEST_MATCH: u32 = 6;
    /// Levels above this one find out by themselves whether a match pays.
    const FAST: i32 = 9;

    pub(crate) fn new(level: i32) -> std::io::Result<Self> {
        let mut packer = zstd::bulk::Compressor::new(level)?;
        if level <= Self::FAST {
            packer.set_parameter(zstd::zstd_safe::CParameter::MinMatch(Self::SHORTEST_MATCH))?;
        }
        Ok(Self(packer))
    }

    pub(crate) fn pack(&mut self, bytes: &[u8]) -> std::io::Result<Vec<u8>> {
        self.0.compress(bytes)
    }
}

#[cfg(feature = "zstd")]
fn decompress(stored: &[u8], image: &mut [u8]) -> Result<(), String> {
    Unpacker::new()?.unpack(stored, image)
}

#[cfg(not(feature = "zstd"))]
const WITHOUT: &str = "it needs a build of esvo-format with the feature `zstd`";

#[cfg(not(feature = "zstd"))]
pub(crate) struct Unpacker;

#[cfg(not(feature = "zstd"))]
impl Unpacker {
    pub(crate) fn new() -> Result<Self, String> {
        Err(WITHOUT.into())
    }

    pub(crate) fn unpack(&mut self, _: &[u8], _: &mut [u8]) -> Result<(), String> {
        Err(WITHOUT.into())
    }
}

#[cfg(not(feature = "zstd"))]
pub(crate) struct Packer;

#[cfg(not(feature = "zstd"))]
impl Packer {
    pub(crate) fn new(_: i32) -> std::io::Result<Self> {
        Err(Error::new(ErrorKind::Unsupported, WITHOUT))
    }

    pub(crate) fn pack(&mut self, _: &[u8]) -> std::io::Result<Vec<u8>> {
        Err(Error::new(ErrorKind::Unsupported, WITHOUT))
    }
}

#[cfg(not(feature = "zstd"))]
fn decompress(_: &[u8], _: &mut [u8]) -> Result<(), String> {
    Err("decompression needs a build of esvo-format with the feature `zstd`".into())
}
