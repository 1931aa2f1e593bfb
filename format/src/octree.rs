//! An octree in memory: the image that casters walk, and its tables.

use std::sync::OnceLock;

use glam::{DMat4, Vec3};
use memmap2::Mmap;

use crate::block::BlockParts;
use crate::file::{BlockEntry, CODEC_RAW, FileHash, InstanceEntry, ObjectEntry, PAGE_SLOTS, attachment};
use crate::values::plain::{plain_entry, plain_rank};
use crate::{
    AmbientBlock, Broken, ChildDescriptor, ColorBlock, Contour, CornerCell, CornerValue, FormatError, Metadata, Needs,
    NodeCorners, NormalBlock, RawNormal,
};

/// The image: all blocks, uncompressed and contiguous, in slots of 8 bytes.
pub(crate) enum Image {
    Owned(Vec<u64>),
    Mapped { map: Mmap, offset: usize, bytes: usize },
}

impl Image {
    fn slots(&self) -> &[u64] {
        match self {
            Self::Owned(slots) => slots,
            Self::Mapped { map, offset, bytes } => bytemuck::cast_slice(&map[*offset..*offset + *bytes]),
        }
    }
}

/// Offsets in a file, in bytes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Origin {
    pub(crate) image: u64,
    pub(crate) objects: u64,
    pub(crate) meta: u64,
    pub(crate) instances: u64,
    /// Whether any block is compressed. The block data is not the image then, and all checksums were checked on
    /// reading.
    pub(crate) compressed: bool,
}

impl Origin {
    /// Offset of a block in the file, or in the image if the block is compressed.
    fn of_block(&self, block: &BlockEntry) -> u64 {
        match block.codec {
            _ if !self.compressed => self.image + block.image_offset,
            CODEC_RAW => block.file_offset,
            _ => block.image_offset,
        }
    }
}

/// Where the blocks of an octree come from. Decides what is verified before they are used or written again.
///
/// Everything that makes an [`Octree`] must name it, and everything that writes one calls [`Octree::verified`]: a writer
/// gives blocks new checksums, so it would hide damage.
pub(crate) enum Stored {
    /// This program made the blocks.
    Made,
    /// Blocks of a file whose checksums were compared when they were read, with other tables. Their contents are
    /// checked before they are written.
    Taken,
    /// A file.
    File {
        /// The bytes outside its sections and blocks.
        gaps: Gaps,
        /// See [`OpenOptions::verify`](crate::OpenOptions::verify).
        verify: bool,
    },
}

/// The bytes of a file outside its sections and blocks, which must be zero (D009).
pub(crate) enum Gaps {
    /// They were read: the first that is not zero.
    Read(Option<Broken>),
    /// They are in the mapped file, outside these ranges. Ranges are in order: start and end.
    Unread(Vec<(u64, u64)>),
}

/// A section that this library does not know. Kept when a file is rewritten.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownSection {
    /// Four ASCII characters.
    pub tag: [u8; 4],
    /// The flags in the directory.
    pub flags: u32,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// An octree: the image, mapped from a file or held in memory, with its object and block tables.
///
/// Opening checks the header, the tables and the info sections. The descriptors are checked by
/// [`validate`](crate::validate()), or faster by [`sound`](Self::sound), which every caster calls before it walks. The
/// checksums of the blocks are compared by [`intact`](Self::intact), which every caster calls too. Before an octree is
/// written, [`verified`](Self::verified) checks everything that came from a file.
pub struct Octree {
    pub(crate) objects: Vec<ObjectEntry>,
    pub(crate) blocks: Vec<BlockEntry>,
    pub(crate) parts: Vec<BlockParts>,
    pub(crate) meta: String,
    pub(crate) instances: Vec<InstanceEntry>,
    pub(crate) hash: Option<FileHash>,
    pub(crate) unknown: Vec<UnknownSection>,
    pub(crate) image: Image,
    /// Offsets in the file that the octree was read from.
    pub(crate) origin: Option<Origin>,
    pub(crate) sound: OnceLock<Result<(), Broken>>,
    pub(crate) stored: Stored,
    /// Where the table of parts is not in order, and what is wrong (S009).
    pub(crate) part_order: Option<(u64, String)>,
    /// Result of comparing the checksums.
    pub(crate) compared: OnceLock<Result<(), Broken>>,
    /// Result of [`verified`](Self::verified).
    pub(crate) verified: OnceLock<Result<(), Broken>>,
}

impl Octree {
    /// An octree from tables and an image. File offsets, stored sizes and checksums of the blocks are ignored; writing
    /// the octree sets them.
    ///
    /// The octree counts as made by this program. A caller that copies slots of another octree must call
    /// [`verified`](Self::verified) on it first; damage would get right checksums otherwise.
    ///
    /// # Errors
    /// A broken rule of the object table, the block table or an info section, or blocks that do not fill the image.
    /// Offsets in errors count from the start of the image.
    pub fn from_parts(
        objects: Vec<ObjectEntry>,
        blocks: Vec<BlockEntry>,
        image: Vec<u64>,
    ) -> Result<Self, FormatError> {
        crate::check::tables::check_objects(&objects, 0)?;
        crate::check::tables::check_blocks(&blocks, 0, &objects, Some(image.len() as u64 * 8))?;
        Self::new(objects, blocks, String::new(), Vec::new(), Image::Owned(image), None, Stored::Made)
    }

    /// Reads the parts of the blocks. The tables must have been checked.
    pub(crate) fn new(
        objects: Vec<ObjectEntry>,
        blocks: Vec<BlockEntry>,
        meta: String,
        unknown: Vec<UnknownSection>,
        image: Image,
        origin: Option<Origin>,
        stored: Stored,
    ) -> Result<Self, FormatError> {
        let bytes: &[u8] = bytemuck::cast_slice(image.slots());
        let parts = (blocks.iter().enumerate())
            .map(|(index, block)| {
                let start = block.image_offset;
                let at = origin.map_or(start, |origin| origin.of_block(block));
                // In range, as the table has been checked.
                let bytes = &bytes[start as usize..(start + block.image_size) as usize];
                crate::check::tables::block_parts(bytes, start, at, index)
            })
            .collect::<Result<_, Broken>>()?;
        let (sound, compared, verified) = Default::default();
        let (part_order, hash, instances) = Default::default();
        Ok(Self {
            objects,
            blocks,
            parts,
            meta,
            instances,
            hash,
            unknown,
            image,
            origin,
            sound,
            stored,
            part_order,
            compared,
            verified,
        })
    }

    /// Offset of byte `at` of the image in the file that the octree was read from. `at` itself if there is no file, or
    /// in a compressed block.
    pub(crate) fn offset(&self, at: u64) -> u64 {
        let Some(origin) = self.origin else { return at };
        if !origin.compressed {
            return origin.image + at;
        }
        let index = self.blocks.partition_point(|b| b.image_offset <= at).saturating_sub(1);
        origin.of_block(&self.blocks[index]) + (at - self.blocks[index].image_offset)
    }

    /// The objects; at least one.
    pub fn objects(&self) -> &[ObjectEntry] {
        &self.objects
    }

    /// The block table.
    pub fn blocks(&self) -> &[BlockEntry] {
        &self.blocks
    }

    /// The parts of each block, in the order of the block table.
    pub fn parts(&self) -> &[BlockParts] {
        &self.parts
    }

    /// The metadata: a JSON object, or empty.
    pub fn meta(&self) -> &str {
        &self.meta
    }

    /// Replaces the metadata. `meta` should be a JSON object.
    pub fn set_meta(&mut self, meta: String) {
        self.meta = meta;
        self.verified = OnceLock::new();
    }

    /// Replaces the metadata, e.g. what [`Metadata::parse`] of [`meta`](Self::meta) has, changed.
    ///
    /// # Errors
    /// Metadata that break a rule: arrays and objects nested more than 64 deep (M001).
    pub fn set_metadata(&mut self, metadata: &Metadata) -> Result<(), Broken> {
        let text = if metadata.is_empty() { String::new() } else { metadata.to_string() };
        if !text.is_empty() {
            let broken = |(at, what)| Broken::new(crate::ids::META_JSON, at as u64, format!("the metadata: {what}"));
            crate::check::metadata::parse(text.as_bytes()).map_err(broken)?;
        }
        self.meta = text;
        Ok(())
    }

    /// The scene: objects at their places. Empty if the file does not say; then each object is there once, where its own
    /// transform puts it. Otherwise the scene has these instances and nothing else (spec 3.1).
    pub fn instances(&self) -> &[InstanceEntry] {
        &self.instances
    }

    /// The scene, spelt out: the [instances](Self::instances), or one for each object at its own place.
    pub fn placed(&self) -> Vec<InstanceEntry> {
        match &self.instances[..] {
            [] => (0..self.objects.len() as u32).map(|object| InstanceEntry::new(object, DMat4::IDENTITY)).collect(),
            some => some.to_vec(),
        }
    }

    /// Replaces the instances; none: each object is there once.
    ///
    /// # Errors
    /// An object that does not exist (N002), a matrix without an inverse (N003), a reserved field that is not zero (N004), or more
    /// than [`MAX_INSTANCES`](crate::file::MAX_INSTANCES) (N001). Offsets count from the first instance.
    pub fn set_instances(&mut self, instances: Vec<InstanceEntry>) -> Result<(), Broken> {
        crate::check::instances::check(&instances, self.objects.len(), 0)?;
        self.instances = instances;
        Ok(())
    }

    /// The id of the octrees in the file, if it has one (spec 2.5): files with the same id hold the same octrees, however they are
    /// stored. Where an octree of a file with a SHA-256 is written, the file gets the id and a new SHA-256.
    pub fn file_id(&self) -> Option<[u8; 16]> {
        self.hash.map(|hash| hash.id).filter(|id| *id != [0; 16])
    }

    /// SHA-256 and id of the file that the octree was read from, if it has them. Only [`validate_file`](crate::validate_file()) and
    /// its like compare the SHA-256.
    pub fn file_hash(&self) -> Option<FileHash> {
        self.hash
    }

    /// The sections of the file that this library does not know.
    pub fn unknown_sections(&self) -> &[UnknownSection] {
        &self.unknown
    }

    /// The image in slots of 8 bytes. Pointers in descriptors are distances in this array.
    pub fn slots(&self) -> &[u64] {
        self.image.slots()
    }

    /// The image in 32-bit words: the low word of slot `s` is word `2 s`.
    pub fn words(&self) -> &[u32] {
        bytemuck::cast_slice(self.slots())
    }

    /// The transform of object `object` from octree space (root cube `[0, 1]³`) to mesh space.
    pub fn octree_to_mesh(&self, object: usize) -> DMat4 {
        DMat4::from_cols_array(&self.objects[object].octree_to_mesh)
    }

    /// The features that this octree uses.
    pub fn needs(&self) -> Needs {
        let kind = |kinds: &[u32]| self.parts.iter().any(|p| p.attachments.iter().any(|a| kinds.contains(&a.0)));
        Needs {
            contours: self.parts.iter().any(|p| p.contour_count > 0),
            far_pointers: self.objects.iter().any(|o| o.far_pointers > 0),
            levels: self.objects.iter().map(|o| o.levels).max().unwrap_or(0),
            colors: kind(&attachment::COLORS),
            normals: kind(&attachment::NORMALS),
            ambient: kind(&[attachment::AMBIENT_BLOCKS]),
        }
    }

    /// The descriptor at slot `slot` of the image. This and all other methods with a parameter `slot` expect the slot
    /// of a descriptor: the root slot of an object, or a result of [`child`](Self::child).
    ///
    /// # Panics
    /// Slots outside the image.
    pub fn descriptor(&self, slot: u32) -> ChildDescriptor {
        ChildDescriptor(self.slots()[slot as usize])
    }

    /// Slot of the first child descriptor of the descriptor at `slot`. Meaningless if it has no non-leaf child.
    pub fn first_child(&self, slot: u32) -> u32 {
        let descriptor = self.descriptor(slot);
        let near = slot + descriptor.child_ptr();
        if descriptor.far() { slot.wrapping_add(self.slots()[near as usize] as u32) } else { near }
    }

    /// Slot of the descriptor of child slot `child` (0..8). `None` for empty slots and leaf voxels.
    ///
    /// # Panics
    /// Slots outside the image. Invalid pointers, if the octree is not [sound](Self::sound).
    pub fn child(&self, slot: u32, child: u8) -> Option<u32> {
        let descriptor = self.descriptor(slot);
        (descriptor.nonleaf_mask() >> child & 1 != 0).then(|| self.first_child(slot) + descriptor.child_rank(child))
    }

    /// Contour of child `child` of the descriptor at `slot`. `None` if it has none.
    pub fn contour(&self, slot: u32, child: u8) -> Option<Contour> {
        let descriptor = self.descriptor(slot);
        (descriptor.contour_mask() >> child & 1 != 0).then(|| {
            let word = slot as usize * 2 + (descriptor.contour_ptr() + descriptor.contour_rank(child)) as usize;
            Contour(self.words()[word])
        })
    }

    /// Index of the block of the descriptor at `slot`, read through its page header.
    pub fn block_of(&self, slot: u32) -> u32 {
        let page = slot & !(PAGE_SLOTS - 1);
        let info = page + self.slots()[page as usize] as u32;
        self.words()[info as usize * 2]
    }

    /// Colour of child `child` of the descriptor at `slot`: sRGB-encoded, channels in `0.0..=1.0`. With values at
    /// corners: the colour at the centre of the voxel. `None` if the octree has no colours.
    pub fn color(&self, slot: u32, child: u8) -> Option<[f32; 3]> {
        self.color_at(slot, child, Vec3::splat(0.5))
    }

    /// Like [`color`](Self::color), at a point of the voxel. Coordinates are 0 to 1 within the voxel.
    pub fn color_at(&self, slot: u32, child: u8, point: Vec3) -> Option<[f32; 3]> {
        if let Some([r, g, b, _]) = self.plain_color(slot, child) {
            return Some([r, g, b].map(|c| f32::from(c) / 255.0));
        }
        let parts = &self.parts[self.block_of(slot) as usize];
        let (pair, texel) = pair_of(slot - parts.start, child);
        if let Some(first) = parts.words(attachment::COLOR_BLOCKS) {
            let words = self.words().get(first + pair * 2..)?;
            return Some(ColorBlock { head: words[0], indices: words[1] }.decode(texel));
        }
        let ([r, g, b, _], _) = self.corners(slot, child)?.at(point)?;
        Some([r, g, b])
    }

    /// Red, green, blue and alpha of child `child` of the descriptor at `slot`, sRGB-encoded. `None` unless the block
    /// has plain colours or a constant colour, which is opaque.
    pub fn plain_color(&self, slot: u32, child: u8) -> Option<[u8; 4]> {
        let parts = &self.parts[self.block_of(slot) as usize];
        if let Some(word) = parts.words(attachment::COLOR_CONSTANT) {
            let [r, g, b, _] = self.words()[word].to_le_bytes();
            return Some([r, g, b, u8::MAX]);
        }
        Some(self.plain(parts, attachment::COLORS_PLAIN, slot, child)?.to_le_bytes())
    }

    /// Normal of child `child` of the descriptor at `slot`. `None` unless the block has plain normals.
    pub fn plain_normal(&self, slot: u32, child: u8) -> Option<RawNormal> {
        let parts = &self.parts[self.block_of(slot) as usize];
        self.plain(parts, attachment::NORMALS_PLAIN, slot, child).map(RawNormal)
    }

    /// A value of a plain attachment.
    fn plain(&self, parts: &BlockParts, kind: u32, slot: u32, child: u8) -> Option<u32> {
        let words = self.attachment_words(parts, kind)?;
        let (mask, first) = plain_entry(*words.get((slot - parts.start) as usize)?);
        words.get(first + plain_rank(mask, child)).copied()
    }

    /// The cell that child `child` of the descriptor at `slot` lies in. `None` unless the block has values at corners.
    pub fn corners(&self, slot: u32, child: u8) -> Option<CornerCell> {
        let parts = &self.parts[self.block_of(slot) as usize];
        let (corners, values) = self.corner_values(parts, slot)?;
        corners.cell(child, values)
    }

    /// The corners of the children of the descriptor at `slot`, and the values from its first on.
    pub(crate) fn corner_values(&self, parts: &BlockParts, slot: u32) -> Option<(NodeCorners, &[CornerValue])> {
        let words = self.attachment_words(parts, attachment::CORNERS)?;
        let entry = words.get((slot - parts.start) as usize * 2..)?.first_chunk::<2>()?;
        let rest = words.get(entry[1] as usize..)?;
        let values = bytemuck::cast_slice(&rest[..rest.len() / 2 * 2]);
        Some((NodeCorners { mask: entry[0], first: 0 }, values))
    }

    /// The words of an attachment.
    pub(crate) fn attachment_words(&self, parts: &BlockParts, kind: u32) -> Option<&[u32]> {
        let (_, at, size) = parts.attachments.iter().find(|(k, ..)| *k == kind)?;
        self.words().get((at / 4) as usize..)?.get(..(size / 4) as usize)
    }

    /// The fraction of the ambient light that reaches child `child` of the descriptor at `slot`, 0 to 1.
    pub fn ambient(&self, slot: u32, child: u8) -> Option<f32> {
        let parts = &self.parts[self.block_of(slot) as usize];
        let (pair, texel) = pair_of(slot - parts.start, child);
        let words = self.words().get(parts.words(attachment::AMBIENT_BLOCKS)? + pair * 2..)?;
        Some(AmbientBlock(u64::from(words[1]) << 32 | u64::from(words[0])).decode(texel))
    }

    /// Unit normal of child `child` of the descriptor at `slot`, in mesh orientation. With values at corners: the
    /// normal at the centre of the voxel. `None` if the octree has no normals.
    pub fn normal(&self, slot: u32, child: u8) -> Option<Vec3> {
        self.normal_at(slot, child, Vec3::splat(0.5))
    }

    /// Like [`normal`](Self::normal), at a point of the voxel. Coordinates are 0 to 1 within the voxel.
    pub fn normal_at(&self, slot: u32, child: u8, point: Vec3) -> Option<Vec3> {
        let parts = &self.parts[self.block_of(slot) as usize];
        if let Some(first) = parts.words(attachment::NORMAL_BLOCKS) {
            let (pair, texel) = pair_of(slot - parts.start, child);
            let words = self.words().get(first + pair * 4..)?;
            return Some(bytemuck::pod_read_unaligned::<NormalBlock>(bytemuck::cast_slice(&words[..4])).decode(texel));
        }
        if let Some(normal) = self.plain_normal(slot, child) {
            return Some(normal.decode());
        }
        Some(self.corners(slot, child)?.at(point)?.1)
    }
}

/// Index of the compression block of child `child` of the descriptor at `slot` of its block, and the texel in it.
fn pair_of(slot: u32, child: u8) -> (usize, usize) {
    ((slot / 2) as usize, (child as u32 + 8 * (slot % 2)) as usize)
}
