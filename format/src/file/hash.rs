//! SHA-256 of a file, and the id of its octrees: the section HASH (spec 2.5).
//!
//! The section is the last one of files that are written here, so that one pass over the bytes suffices.

use std::fs::File;
use std::io::{Read, Result, Seek, SeekFrom, Write};

use sha2::{Digest, Sha256};

use crate::file::{FileHash, HASH_BYTES, SECTION_OWN_CHECKSUMS, SectionEntry, from_bytes, to_bytes};
use crate::{Broken, ids};

/// Bytes of the field that counts as zeros.
const DIGEST_BYTES: usize = 32;

/// The bytes of HASH, for a file whose other bytes all come before it and have been hashed. Without an id, the octrees are named
/// by the first half of the digest of the file with zeros for the whole section.
fn seal(before: Sha256, id: Option<[u8; 16]>) -> Vec<u8> {
    let id = id.unwrap_or_else(|| {
        let digest = before.clone().chain_update([0; HASH_BYTES as usize]).finalize();
        std::array::from_fn(|k| digest[k])
    });
    let sha256 = before.chain_update([0; DIGEST_BYTES]).chain_update(id).finalize().into();
    to_bytes(&FileHash { sha256, id })
}

/// Hashes what it writes.
pub(crate) struct Hashing<'a> {
    out: &'a mut dyn Write,
    /// `None`: nothing is hashed.
    digest: Option<Sha256>,
}

impl<'a> Hashing<'a> {
    /// Writes to `out`, and hashes if `hash` says so.
    pub(crate) fn new(out: &'a mut dyn Write, hash: bool) -> Self {
        Self { out, digest: hash.then(Sha256::new) }
    }

    /// Writes HASH, if bytes were hashed.
    pub(crate) fn finish(self, id: Option<[u8; 16]>) -> Result<()> {
        match self.digest {
            Some(digest) => self.out.write_all(&seal(digest, id)),
            None => Ok(()),
        }
    }
}

impl Write for Hashing<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let written = self.out.write(bytes)?;
        if let Some(digest) = &mut self.digest {
            digest.update(&bytes[..written]);
        }
        Ok(written)
    }

    fn flush(&mut self) -> Result<()> {
        self.out.flush()
    }
}

/// Reads a file that is complete but for HASH, and appends that.
pub(crate) fn append(mut file: &File) -> Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let mut digest = Sha256::new();
    let mut bytes = vec![0; 1 << 20];
    loop {
        match file.read(&mut bytes)? {
            0 => return file.write_all(&seal(digest, None)),
            read => digest.update(&bytes[..read]),
        }
    }
}

/// Reads the section (F001).
pub(crate) fn read(section: &SectionEntry, bytes: &[u8]) -> std::result::Result<FileHash, Broken> {
    let whole = bytes.len() as u64 == HASH_BYTES && section.flags & SECTION_OWN_CHECKSUMS != 0;
    match from_bytes(bytes).filter(|_| whole) {
        Some(found) => Ok(found),
        None => {
            let what = format!(
                "section HASH has {} bytes and flags {}, expected 48 and flag bit 1",
                bytes.len(),
                section.flags
            );
            Err(Broken::new(ids::HASH_SIZE, section.offset, what))
        }
    }
}

/// Compares the SHA-256 of a file with that in its section HASH, which begins at `at` and has been read (F002).
pub(crate) fn check(file: &[u8], at: u64) -> std::result::Result<(), Broken> {
    let at = at as usize;
    let (before, rest) = file.split_at(at);
    let (stored, after) = rest.split_at(DIGEST_BYTES);
    let found = Sha256::new().chain_update(before).chain_update([0; DIGEST_BYTES]).chain_update(after).finalize();
    if found[..] == *stored {
        return Ok(());
    }
    let what = "the SHA-256 of the file differs from that in section HASH".to_owned();
    Err(Broken::new(ids::HASH_DIGEST, at as u64, what))
}
