//! The sections of a file beside its octrees, as they are written: metadata, instances, unknown sections, hash.

use std::borrow::Cow;

use crate::file::*;
use crate::{Octree, UnknownSection};

/// Contents of the optional sections.
#[derive(Clone, Copy, Default)]
pub(crate) struct Extras<'a> {
    pub(crate) meta: &'a str,
    pub(crate) instances: &'a [InstanceEntry],
    pub(crate) unknown: &'a [UnknownSection],
    /// Whether the section HASH follows everything else. It is written by [`Hashing`](crate::file::hash::Hashing) or
    /// [`append`](crate::file::hash::append).
    pub(crate) hash: bool,
}

impl<'a> Extras<'a> {
    pub(crate) fn of(octree: &'a Octree, hash: bool) -> Self {
        Self { meta: &octree.meta, instances: &octree.instances, unknown: &octree.unknown, hash }
    }

    /// Tag, flags and bytes of each section but HASH, in the order of the specification.
    pub(crate) fn sections(&self) -> Vec<([u8; 4], u32, Cow<'a, [u8]>)> {
        let mut sections = Vec::new();
        if !self.meta.is_empty() {
            sections.push((TAG_META, 0, Cow::Borrowed(self.meta.as_bytes())));
        }
        if !self.instances.is_empty() {
            sections.push((TAG_INSTANCES, 0, Cow::Owned(self.instances.iter().flat_map(to_bytes).collect())));
        }
        sections.extend(self.unknown.iter().map(|s| (s.tag, s.flags, Cow::Borrowed(&s.bytes[..]))));
        sections
    }

    /// The directory entry of HASH, which begins at `offset`, and the length of the file. Without HASH, `offset` is the latter.
    pub(crate) fn hash_at(&self, offset: u64) -> (Option<SectionEntry>, u64) {
        if !self.hash {
            return (None, offset);
        }
        let (tag, flags, length) = (TAG_HASH, SECTION_OWN_CHECKSUMS, HASH_BYTES);
        (Some(SectionEntry { tag, flags, offset, length, crc: 0, reserved: 0 }), offset + length)
    }
}
