//! A writer that lays out any block and any file, byte by byte from the specification. It shares no code with the library,
//! so that each tests the other, and it makes files that the library never writes.

/// How the bytes of a block are stored.
#[derive(Clone, PartialEq)]
pub(crate) enum Codec {
    Raw,
    /// A Zstandard frame of raw blocks and RLE blocks, made by [`zstd_frame`].
    Zstd,
    /// Codec 1 with these bytes. They need not be a frame.
    Frame(Vec<u8>),
}

/// One block, made slot by slot.
#[derive(Clone)]
pub(crate) struct Block {
    pub(crate) object: u32,
    pub(crate) parent: u32,
    /// Lower corner and scale.
    pub(crate) cube: ([u32; 3], u32),
    array: Vec<u64>,
    /// Far pointers into other blocks: slot of the descriptor, slot of the far pointer, block.
    links: Vec<(usize, usize, usize)>,
    /// Slot of the descriptor and contour values of its children.
    contours: Vec<(usize, Vec<u32>)>,
    /// Zero words before the contour pool.
    pub(crate) pool_gap: usize,
    /// The last descriptor's contours come first.
    pub(crate) pool_reversed: bool,
    /// Zero bytes before every attachment.
    pub(crate) attachment_gap: usize,
    /// Type and bytes, in the order of the directory.
    pub(crate) attachments: Vec<(u32, Vec<u8>)>,
    pub(crate) codec: Codec,
    descriptors: u64,
    leaf_voxels: u64,
    far_pointers: u64,
}

impl Block {
    /// A root block of object 0 with an array of `slots` slots.
    pub(crate) fn new(slots: usize) -> Self {
        let mut array = vec![0; slots];
        for page in (0..slots).step_by(1024) {
            array[page] = (slots - page) as u64;
        }
        Self {
            object: 0,
            parent: u32::MAX,
            cube: ([0; 3], 23),
            array,
            links: Vec::new(),
            contours: Vec::new(),
            pool_gap: 0,
            pool_reversed: false,
            attachment_gap: 0,
            attachments: Vec::new(),
            codec: Codec::Raw,
            descriptors: 0,
            leaf_voxels: 0,
            far_pointers: 0,
        }
    }

    /// A block below `parent` that holds what is in this cube.
    pub(crate) fn below(slots: usize, parent: u32, cube: ([u32; 3], u32)) -> Self {
        Self { parent, cube, ..Self::new(slots) }
    }

    pub(crate) fn slots(&self) -> usize {
        self.array.len()
    }

    /// A descriptor.
    pub(crate) fn node(&mut self, slot: usize, valid: u8, leaf: u8) -> &mut Self {
        assert_eq!(self.array[slot], 0, "slot {slot} is free");
        self.array[slot] = u64::from(valid) << 8 | u64::from(leaf);
        self.descriptors += 1;
        self.leaf_voxels += u64::from(leaf.count_ones());
        self
    }

    /// The same block, stored as these bytes with codec 1.
    pub(crate) fn framed(&self, frame: Vec<u8>) -> Self {
        Self { codec: Codec::Frame(frame), ..self.clone() }
    }

    /// Valid mask of the descriptor at `slot`.
    pub(crate) fn valid(&self, slot: usize) -> u8 {
        (self.array[slot] >> 8) as u8
    }

    /// A descriptor all of whose voxels are leaves.
    pub(crate) fn leaves(&mut self, slot: usize, valid: u8) -> &mut Self {
        self.node(slot, valid, valid)
    }

    /// The children of the descriptor at `slot` are at `first`.
    pub(crate) fn near(&mut self, slot: usize, first: usize) -> &mut Self {
        let distance = first - slot;
        assert!((1..1 << 15).contains(&distance));
        self.array[slot] |= (distance as u64) << 17;
        self
    }

    /// The same through a far pointer at slot `far`.
    pub(crate) fn far(&mut self, slot: usize, far: usize, first: usize) -> &mut Self {
        self.near(slot, far);
        self.array[slot] |= 1 << 16;
        self.array[far] = (first - slot) as u64;
        self.far_pointers += 1;
        self
    }

    /// The children are those of block `block`, through a far pointer at slot `far`.
    pub(crate) fn link(&mut self, slot: usize, far: usize, block: usize) -> &mut Self {
        self.far(slot, far, slot + 1);
        self.links.push((slot, far, block));
        self
    }

    /// Gives voxels of the descriptor at `slot` contours, one value for each bit of `mask`.
    pub(crate) fn contour(&mut self, slot: usize, mask: u8, words: &[u32]) -> &mut Self {
        assert_eq!(mask.count_ones() as usize, words.len());
        self.array[slot] |= u64::from(mask) << 32;
        self.contours.push((slot, words.to_vec()));
        self
    }

    /// Adds an attachment after the others.
    pub(crate) fn attachment(&mut self, kind: u32, bytes: Vec<u8>) -> &mut Self {
        self.attachments.push((kind, bytes));
        self
    }

    /// The bytes in memory; `starts` are the first slots of all blocks.
    pub(crate) fn image(&self, index: usize, starts: &[u64]) -> Vec<u8> {
        let mut array = self.array.clone();
        for &(slot, far, block) in &self.links {
            array[far] = starts[block] + 2 - (starts[index] + slot as u64);
        }
        let info = array.len() * 8;
        let count: usize = self.contours.iter().map(|(_, words)| words.len()).sum();
        let pool = info + 32 + 16 * self.attachments.len() + 4 * self.pool_gap;
        let mut values = Vec::new();
        let mut contours = self.contours.clone();
        contours.sort_by_key(|(slot, _)| *slot);
        if self.pool_reversed {
            contours.reverse();
        }
        for (slot, words) in &contours {
            let pointer = pool / 4 + values.len() - slot * 2;
            array[*slot] |= (pointer as u64) << 40;
            values.extend_from_slice(words);
        }
        let mut bytes: Vec<u8> = array.iter().flat_map(|slot| slot.to_le_bytes()).collect();
        let head = [index, array.len(), array.len() - 2, (pool - info) / 4, count, self.attachments.len(), 0, 0];
        bytes.extend(head.iter().flat_map(|word| (*word as u32).to_le_bytes()));
        let mut at = pool + 4 * count;
        let mut placed = Vec::new();
        for (kind, data) in &self.attachments {
            at = (at + self.attachment_gap).next_multiple_of(8);
            bytes.extend(kind.to_le_bytes());
            bytes.extend(((at - info) as u32).to_le_bytes());
            bytes.extend((data.len() as u64).to_le_bytes());
            placed.push((at, data));
            at += data.len();
        }
        bytes.resize(pool, 0);
        bytes.extend(values.iter().flat_map(|word| word.to_le_bytes()));
        for (at, data) in placed {
            bytes.resize(at, 0);
            bytes.extend(data);
        }
        bytes.resize(bytes.len().next_multiple_of(8192), 0);
        bytes
    }
}

/// A section that version 1 does not know, or META.
pub(crate) struct Extra {
    pub(crate) tag: [u8; 4],
    pub(crate) flags: u32,
    pub(crate) bytes: Vec<u8>,
}

/// Order of the parts of a file.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Order {
    /// As the specification shows it.
    Usual,
    /// Block data first, then the sections from last to first, the directory at the end of the file.
    DataFirst,
}

/// A file.
pub(crate) struct Plan {
    pub(crate) minor: u16,
    pub(crate) optional_features: u64,
    /// Levels and transform (by columns) of each object.
    pub(crate) objects: Vec<(u32, [f64; 16])>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) extra: Vec<Extra>,
    pub(crate) order: Order,
    /// Flags of OBJT and BLKT; BLKS has bit 1 set in addition.
    pub(crate) flags: u32,
    /// Compressed blocks are stored last first.
    pub(crate) stored_reversed: bool,
    /// Zero bytes of BLKS before the first block and after the last one; the former a multiple of 8192.
    pub(crate) spare: (usize, usize),
}

pub(crate) const IDENTITY: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

impl Plan {
    /// A file with one object of this number of levels.
    pub(crate) fn new(levels: u32, blocks: Vec<Block>) -> Self {
        Self {
            minor: 0,
            optional_features: 0,
            objects: vec![(levels, IDENTITY)],
            blocks,
            extra: Vec::new(),
            order: Order::Usual,
            flags: 1,
            stored_reversed: false,
            spare: (0, 0),
        }
    }

    /// The bytes of the file, and the image.
    pub(crate) fn write(&self) -> (Vec<u8>, Vec<u8>) {
        let nowhere = vec![u64::from(u32::MAX); self.blocks.len()];
        let mut starts = vec![0u64];
        for (index, block) in self.blocks.iter().enumerate() {
            // The length of a block does not depend on the places of the others.
            let block = Block { links: Vec::new(), ..block.clone() };
            starts.push(starts[index] + block.image(index, &nowhere).len() as u64 / 8);
        }
        let images: Vec<Vec<u8>> = self.blocks.iter().enumerate().map(|(i, b)| b.image(i, &starts)).collect();
        let compressed = self.blocks.iter().any(|b| b.codec != Codec::Raw);
        let stored: Vec<Vec<u8>> = (self.blocks.iter().zip(&images))
            .map(|(b, image)| match &b.codec {
                Codec::Raw => image.clone(),
                Codec::Zstd => zstd_frame(image, true),
                Codec::Frame(bytes) => bytes.clone(),
            })
            .collect();
        // Where each block lies in the section.
        let mut data = vec![0; self.spare.0];
        let mut places = vec![0; stored.len()];
        let mut order: Vec<usize> = (0..stored.len()).collect();
        if self.stored_reversed {
            order.reverse();
        }
        for block in order {
            places[block] = data.len() as u64;
            data.extend(&stored[block]);
            data.resize(data.len().next_multiple_of(8192), 0);
        }
        data.resize(data.len() + self.spare.1, 0);
        let objects = self.object_table();
        let table_bytes = 72 * self.blocks.len();
        let mut sections: Vec<([u8; 4], u32, Vec<u8>)> =
            vec![(*b"OBJT", self.flags, objects), (*b"BLKT", self.flags, vec![0; table_bytes])];
        sections.extend(self.extra.iter().map(|e| (e.tag, e.flags, e.bytes.clone())));
        sections.push((*b"BLKS", self.flags | 2, data));
        let directory_bytes = 32 * sections.len();
        let mut file = vec![0u8; 64];
        let mut order: Vec<usize> = (0..sections.len()).collect();
        let mut directory_at = 64;
        match self.order {
            Order::Usual => file.resize(64 + directory_bytes, 0),
            Order::DataFirst => order.reverse(),
        }
        let mut offsets = vec![0; sections.len()];
        for index in order {
            let align = if &sections[index].0 == b"BLKS" { 8192 } else { 8 };
            file.resize(file.len().next_multiple_of(align), 0);
            offsets[index] = file.len();
            if &sections[index].0 == b"BLKT" {
                // With the data first, its place is known; otherwise it will start at the next page.
                let base = match self.order {
                    Order::DataFirst => offsets[sections.len() - 1],
                    Order::Usual => {
                        let mut end = file.len() + table_bytes;
                        for (.., bytes) in &sections[2..sections.len() - 1] {
                            end = end.next_multiple_of(8) + bytes.len();
                        }
                        end.next_multiple_of(8192)
                    }
                };
                sections[index].2 = self.block_table(base as u64, &starts, &places, &stored);
            }
            file.extend(&sections[index].2);
        }
        let mut directory = Vec::new();
        for ((tag, flags, bytes), offset) in sections.iter().zip(&offsets) {
            directory.extend(tag);
            directory.extend(flags.to_le_bytes());
            directory.extend((*offset as u64).to_le_bytes());
            directory.extend((bytes.len() as u64).to_le_bytes());
            let crc = if flags & 2 != 0 { 0 } else { crc32fast::hash(bytes) };
            directory.extend(crc.to_le_bytes());
            directory.extend([0; 4]);
        }
        if self.order == Order::DataFirst {
            file.resize(file.len().next_multiple_of(8), 0);
            directory_at = file.len();
            file.resize(directory_at + directory_bytes, 0);
        }
        file[directory_at..directory_at + directory_bytes].copy_from_slice(&directory);
        let mut header = b"\xABESVO 1\xBB\r\n\x1A\n".to_vec();
        header.extend(1u16.to_le_bytes());
        header.extend(self.minor.to_le_bytes());
        header.extend(u64::from(compressed).to_le_bytes());
        header.extend(self.optional_features.to_le_bytes());
        header.extend((file.len() as u64).to_le_bytes());
        header.extend((directory_at as u64).to_le_bytes());
        header.extend((sections.len() as u32).to_le_bytes());
        header.extend(crc32fast::hash(&directory).to_le_bytes());
        header.extend([0; 4]);
        header.extend(crc32fast::hash(&header).to_le_bytes());
        file[..64].copy_from_slice(&header);
        (file, images.concat())
    }

    fn object_table(&self) -> Vec<u8> {
        let mut table = Vec::new();
        for (index, (levels, transform)) in self.objects.iter().enumerate() {
            let own = || self.blocks.iter().filter(|b| b.object as usize == index);
            let root = self.blocks.iter().position(|b| b.object as usize == index && b.parent == u32::MAX).unwrap();
            let nowhere = vec![u64::from(u32::MAX); self.blocks.len()];
            let before: usize = (self.blocks[..root].iter().enumerate())
                .map(|(i, b)| Block { links: Vec::new(), ..b.clone() }.image(i, &nowhere).len() / 8)
                .sum();
            table.extend(transform.iter().flat_map(|x| x.to_le_bytes()));
            table.extend((root as u32).to_le_bytes());
            table.extend(levels.to_le_bytes());
            table.extend((before as u64 + 2).to_le_bytes());
            table.extend(own().map(|b| b.descriptors).sum::<u64>().to_le_bytes());
            table.extend(own().map(|b| b.leaf_voxels).sum::<u64>().to_le_bytes());
            let contours: usize = own().flat_map(|b| &b.contours).map(|(_, words)| words.len()).sum();
            table.extend((contours as u64).to_le_bytes());
            table.extend(own().map(|b| b.far_pointers).sum::<u64>().to_le_bytes());
            table.extend([0; 16]);
        }
        table
    }

    fn block_table(&self, base: u64, starts: &[u64], places: &[u64], stored: &[Vec<u8>]) -> Vec<u8> {
        let mut table = Vec::new();
        for (index, block) in self.blocks.iter().enumerate() {
            let ([x, y, z], scale) = block.cube;
            for word in [block.object, block.parent, x, y, z, scale] {
                table.extend(word.to_le_bytes());
            }
            let image = (starts[index] * 8, (starts[index + 1] - starts[index]) * 8);
            for long in [image.0, image.1, base + places[index], stored[index].len() as u64] {
                table.extend(long.to_le_bytes());
            }
            table.extend(u32::from(block.codec != Codec::Raw).to_le_bytes());
            table.extend(crc32fast::hash(&stored[index]).to_le_bytes());
            table.extend([0; 8]);
        }
        table
    }
}

/// A Zstandard frame (RFC 8878) without entropy coding: raw blocks, and runs of zeros as RLE blocks. The bytes do not depend
/// on the machine or on a library.
pub(crate) fn zstd_frame(content: &[u8], with_size: bool) -> Vec<u8> {
    // Magic number and descriptor: a single segment with the content size in four bytes, or a window of 64 KiB.
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd];
    if with_size {
        frame.push(0xa0);
        frame.extend((content.len() as u32).to_le_bytes());
    } else {
        assert!(content.len() <= 1 << 16);
        frame.extend([0x00, 6 << 3]);
    }
    let mut blocks: Vec<(bool, &[u8])> = Vec::new();
    for slot in content.chunks(8) {
        let zero = slot.iter().all(|b| *b == 0);
        let at = slot.as_ptr() as usize - content.as_ptr() as usize;
        match blocks.last_mut() {
            Some((run, bytes)) if *run == zero && bytes.len() < 1 << 17 => {
                let start = bytes.as_ptr() as usize - content.as_ptr() as usize;
                *bytes = &content[start..at + slot.len()];
            }
            _ => blocks.push((zero, slot)),
        }
    }
    if blocks.is_empty() {
        blocks.push((false, content));
    }
    let last = blocks.len() - 1;
    for (index, (run, bytes)) in blocks.into_iter().enumerate() {
        let head = u32::from(index == last) | u32::from(run) << 1 | (bytes.len() as u32) << 3;
        frame.extend(&head.to_le_bytes()[..3]);
        frame.extend(if run { &bytes[..1] } else { bytes });
    }
    frame
}
