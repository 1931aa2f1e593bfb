//! The vectors of class streaming: which blocks of a valid vector show a region, and the octree that these blocks make.
//! Written from section 11.3 of the specification, on bytes, without the library.

use std::collections::BTreeMap;

use serde_json::{Value, json};

/// What a case asks for: an object in a box down to a level, or a set of blocks.
pub(crate) enum Wanted {
    Region { object: u32, low: [f64; 3], high: [f64; 3], level: u32 },
    Blocks(&'static [u32]),
}

/// A streaming vector.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) vector: &'static str,
    pub(crate) about: &'static str,
    pub(crate) wanted: Wanted,
    /// The blocks that are taken.
    pub(crate) blocks: Vec<u32>,
    /// The part as a file, and its image.
    pub(crate) bytes: Vec<u8>,
    pub(crate) image: Vec<u8>,
}

const ALL: ([f64; 3], [f64; 3]) = ([0.0; 3], [1.0; 3]);

fn region(object: u32, (low, high): ([f64; 3], [f64; 3]), level: u32) -> Wanted {
    Wanted::Region { object, low, high, level }
}

/// Vector, what is asked of it, a sentence.
fn wanted() -> Vec<(&'static str, Wanted, &'static str)> {
    let cube = |low: f64, high: f64| ([low; 3], [high; 3]);
    vec![
        ("single_voxel", region(0, ALL, 23), "the only block"),
        ("two_blocks", region(0, ALL, 2), "the root block alone: the voxel below becomes a leaf"),
        ("two_blocks", region(0, ALL, 3), "everything, so the image is that of the file"),
        ("three_blocks", region(0, cube(0.0, 0.25), 23), "one of two blocks below the root"),
        ("three_blocks", region(0, cube(0.5, 0.5), 23), "a point that the cubes of both have as a corner"),
        ("three_blocks", region(0, cube(0.75, 0.875), 3), "the other one, which moves in the image"),
        ("three_blocks", region(0, cube(1.5, 2.0), 23), "a box outside of the root cube: the root block"),
        ("levels_23_blocks", region(0, ALL, 16), "two of three blocks one below the other"),
        ("levels_23_blocks", Wanted::Blocks(&[0]), "the first of them"),
        ("two_objects_three_blocks", region(0, ALL, 23), "one object of two: it becomes object 0"),
        ("two_objects_three_blocks", region(1, ALL, 23), "the other one"),
        ("two_objects_three_blocks", Wanted::Blocks(&[0, 1]), "both objects, one of them in part"),
        ("compressed_mixed", region(0, ALL, 23), "a compressed block and one that is not"),
        ("compressed_reversed", region(0, ALL, 1), "the block that is stored last"),
        ("compressed_entropy", region(0, ALL, 23), "a frame with entropy coding"),
        ("written_blocks", Wanted::Blocks(&[0, 2]), "contours and colours, of blocks not next to each other"),
        ("written_corners", Wanted::Blocks(&[0, 1]), "values at corners, in a part"),
        ("sections_reversed", region(0, ALL, 23), "directory and tables at the end of the file"),
    ]
}

/// All cases; `vectors` are the valid vectors with their images.
pub(crate) fn cases(vectors: &BTreeMap<String, (Vec<u8>, Vec<u8>)>) -> Vec<Case> {
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    let mut list = Vec::new();
    for (vector, wanted, about) in wanted() {
        let count = counts.entry(vector).or_default();
        *count += 1;
        let (file, image) = &vectors[vector];
        let file = File { file, image };
        let blocks = match &wanted {
            Wanted::Blocks(blocks) => blocks.to_vec(),
            Wanted::Region { object, low, high, level } => file.blocks_for(*object, *low, *high, *level),
        };
        let (bytes, image) = file.part(&blocks);
        list.push(Case { name: format!("{vector}_{count}"), vector, about, wanted, blocks, bytes, image });
    }
    list
}

/// A line of `index.json`.
pub(crate) fn line(case: &Case, file: &[u8]) -> Value {
    let entry = |block: &u32| {
        let table = section(file, b"BLKT");
        let at = table.0 + 72 * *block as usize;
        json!([u64_at(file, at + 40), u64_at(file, at + 48)])
    };
    let mut line = json!({
        "part": format!("{}.esvo", case.name), "file": format!("{}.esvo", case.vector), "about": case.about,
        "blocks": case.blocks, "ranges": case.blocks.iter().map(entry).collect::<Vec<_>>(),
    });
    if let Wanted::Region { object, low, high, level } = &case.wanted {
        line["object"] = json!(object);
        line["low"] = json!(low);
        line["high"] = json!(high);
        line["level"] = json!(level);
    }
    line
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

fn set_u32(bytes: &mut [u8], at: usize, value: u32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

fn set_u64(bytes: &mut [u8], at: usize, value: u64) {
    bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
}

/// First byte and length of a section.
fn section(file: &[u8], tag: &[u8; 4]) -> (usize, usize) {
    let directory = u64_at(file, 40) as usize;
    let entries = (0..u32_at(file, 48) as usize).map(|i| directory + 32 * i);
    let at = entries.into_iter().find(|at| &file[*at..at + 4] == tag).expect("the section");
    (u64_at(file, at + 8) as usize, u64_at(file, at + 16) as usize)
}

/// A valid vector.
struct File<'a> {
    file: &'a [u8],
    image: &'a [u8],
}

impl File<'_> {
    fn table(&self, tag: &[u8; 4]) -> &[u8] {
        let (at, length) = section(self.file, tag);
        &self.file[at..at + length]
    }

    /// First byte in the image and size of a block.
    fn place(&self, block: u32) -> (usize, usize) {
        let table = self.table(b"BLKT");
        let at = 72 * block as usize;
        (u64_at(table, at + 24) as usize, u64_at(table, at + 32) as usize)
    }

    fn blocks_for(&self, object: u32, low: [f64; 3], high: [f64; 3], level: u32) -> Vec<u32> {
        let table = self.table(b"BLKT");
        let taken = |block: &u32| {
            let at = 72 * *block as usize;
            let scale = u32_at(table, at + 20);
            let meets = (0..3).all(|axis| {
                let face = f64::from(u32_at(table, at + 8 + 4 * axis)) / f64::from(1 << 23);
                let edge = f64::from(1u32 << scale) / f64::from(1 << 23);
                low[axis] <= face + edge && face <= high[axis]
            });
            let is_root = u32_at(table, at + 4) == u32::MAX;
            u32_at(table, at) == object && (is_root || 23 - scale + 2 <= level && meets)
        };
        (0..table.len() as u32 / 72).filter(taken).collect()
    }

    /// The octree of these blocks as a file, and its image.
    fn part(&self, set: &[u32]) -> (Vec<u8>, Vec<u8>) {
        let (objects, blocks) = (self.table(b"OBJT"), self.table(b"BLKT"));
        let new_index = |block: u32| set.iter().position(|b| *b == block);
        // New first byte of each block of the set.
        let mut starts = vec![0];
        for block in set {
            starts.push(starts.last().unwrap() + self.place(*block).1);
        }
        let mut image: Vec<u8> = Vec::new();
        for (index, block) in set.iter().enumerate() {
            let (start, size) = self.place(*block);
            image.extend(&self.image[start..start + size]);
            let info = starts[index] + 8 * u32_at(&self.image[start..], 0) as usize;
            set_u32(&mut image, info, index as u32);
        }
        let of_set = |object: u32| new_index(u32_at(objects, 192 * object as usize + 128));
        let kept: Vec<u32> = (0..objects.len() as u32 / 192).filter(|object| of_set(*object).is_some()).collect();
        let mut object_table = Vec::new();
        for object in &kept {
            let at = 192 * *object as usize;
            let root = of_set(*object).unwrap();
            let mut counts = Counts::default();
            self.descend(set, &starts, &mut image, (root, 2, 1), &mut counts);
            let mut entry = objects[at..at + 192].to_vec();
            set_u32(&mut entry, 128, root as u32);
            set_u32(&mut entry, 132, counts.levels);
            set_u64(&mut entry, 136, starts[root] as u64 / 8 + 2);
            for (k, count) in [counts.descriptors, counts.leaves, counts.contours, counts.fars].into_iter().enumerate()
            {
                set_u64(&mut entry, 144 + 8 * k, count);
            }
            object_table.extend(entry);
        }
        let mut block_table = Vec::new();
        for (index, block) in set.iter().enumerate() {
            let at = 72 * *block as usize;
            let mut entry = blocks[at..at + 72].to_vec();
            let object = kept.iter().position(|o| *o == u32_at(&entry, 0)).expect("an object of the set");
            set_u32(&mut entry, 0, object as u32);
            let parent = u32_at(&entry, 4);
            if parent != u32::MAX {
                set_u32(&mut entry, 4, new_index(parent).expect("a parent in the set") as u32);
            }
            set_u64(&mut entry, 24, starts[index] as u64);
            let size = u64_at(&entry, 32);
            set_u64(&mut entry, 48, size);
            set_u32(&mut entry, 56, 0);
            set_u32(&mut entry, 60, crc32fast::hash(&image[starts[index]..starts[index + 1]]));
            block_table.extend(entry);
        }
        (container(&object_table, block_table, &image), image)
    }

    /// Mends the far pointers of one descriptor and of all below it, and counts. `slot` counts from the start of the
    /// block; `level` is that of the descriptor's children.
    fn descend(
        &self,
        set: &[u32],
        starts: &[usize],
        image: &mut [u8],
        (block, slot, level): (usize, usize, u32),
        counts: &mut Counts,
    ) {
        let (old_start, old_size) = self.place(set[block]);
        let at = starts[block] + 8 * slot;
        let (low, high) = (u32_at(image, at), u32_at(image, at + 4));
        let (mut leaf, valid, pointer) = (low & 0xff, low >> 8 & 0xff, (low >> 17) as usize);
        counts.levels = counts.levels.max(level);
        counts.descriptors += 1;
        counts.contours += u64::from((high & 0xff).count_ones());
        let mut first = (block, slot + pointer);
        if valid & !leaf != 0 && low >> 16 & 1 != 0 {
            let far = at + 8 * pointer;
            let target = slot + u32_at(image, far) as usize;
            first = (block, target);
            counts.fars += 1;
            if 8 * target >= old_size {
                // In another block: the target is slot 2 of it, 16 bytes after its first byte in the file's image.
                let start = old_start + 8 * target - 16;
                match set.iter().position(|b| self.place(*b).0 == start) {
                    Some(below) => {
                        first = (below, 2);
                        set_u32(image, far, ((starts[below] + 16 - at) / 8) as u32);
                    }
                    None => {
                        leaf = valid;
                        set_u32(image, at, valid << 8 | valid);
                        set_u64(image, far, 0);
                        counts.fars -= 1;
                    }
                }
            }
        }
        counts.leaves += u64::from(leaf.count_ones());
        for k in 0..(valid & !leaf).count_ones() as usize {
            self.descend(set, starts, image, (first.0, first.1 + k, level + 1), counts);
        }
    }
}

/// What the object table counts.
#[derive(Default)]
struct Counts {
    levels: u32,
    descriptors: u64,
    leaves: u64,
    contours: u64,
    fars: u64,
}

/// A file of codec 0 with nothing but these tables and this image.
fn container(objects: &[u8], mut blocks: Vec<u8>, image: &[u8]) -> Vec<u8> {
    let places = [160, 160 + objects.len(), (160 + objects.len() + blocks.len()).next_multiple_of(8192)];
    for at in (0..blocks.len()).step_by(72) {
        let image_offset = u64_at(&blocks, at + 24);
        set_u64(&mut blocks, at + 40, places[2] as u64 + image_offset);
    }
    let mut directory = Vec::new();
    for ((tag, flags, bytes), place) in
        [(b"OBJT", 1u32, objects), (b"BLKT", 1, &blocks), (b"BLKS", 3, image)].into_iter().zip(places)
    {
        directory.extend(tag);
        directory.extend(flags.to_le_bytes());
        directory.extend((place as u64).to_le_bytes());
        directory.extend((bytes.len() as u64).to_le_bytes());
        directory.extend(if flags == 3 { 0 } else { crc32fast::hash(bytes) }.to_le_bytes());
        directory.extend([0; 4]);
    }
    let mut file = b"\xABESVO 1\xBB\r\n\x1A\n\x01\0\0\0".to_vec();
    file.extend([0; 16]);
    file.extend(((places[2] + image.len()) as u64).to_le_bytes());
    file.extend(64u64.to_le_bytes());
    file.extend(3u32.to_le_bytes());
    file.extend(crc32fast::hash(&directory).to_le_bytes());
    file.extend([0; 4]);
    file.extend(crc32fast::hash(&file).to_le_bytes());
    file.extend(&directory);
    file.extend(objects);
    file.extend(&blocks);
    file.resize(places[2], 0);
    file.extend(image);
    file
}
