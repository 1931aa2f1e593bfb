//! Decoders of all instruction sets give the same: the encoder's input, or the same error.

use glam::DMat4;

use super::block::{StoredPart, decode_fields, encode_block};
use super::instructions::InstructionSet;
use super::layout::{Block, write};
use super::stored::Decoder;
use crate::block::BlockParts;
use crate::file::{BlockEntry, CODEC_FIELDS, PART_HEADER_BYTES, PartEntry};
use crate::{AssembleOptions, Contour, Octree, RawNormal, Tree, Voxel, assemble};

/// SplitMix64.
struct Rng(u64);

impl Rng {
    fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % n
    }
}

/// What voxels of a random tree have.
#[derive(Clone, Copy)]
struct With {
    /// Of 8 child slots.
    children: u64,
    contours: bool,
    /// Different values of colours, normals and contours; 0 for no colours and normals.
    values: u64,
}

fn grow(tree: &mut Tree, rng: &mut Rng, with: With, level: u32) {
    let first = rng.below(8);
    let children: [Option<Voxel>; 8] = std::array::from_fn(|slot| {
        let there = slot as u64 == first || rng.below(8) < with.children;
        there.then(|| Voxel {
            color: (with.values > 0).then(|| [rng.below(with.values) as u8, 80, rng.below(with.values) as u8]),
            normal: (with.values > 0).then(|| RawNormal(rng.below(with.values) as u32 * 0x1003)),
            contour: (with.contours && rng.below(4) > 0)
                .then(|| Contour((rng.below(7 + with.values) as u32 * 0x2_0401) | 1)),
            leaf: level == 1 || rng.below(5) == 0,
        })
    });
    let node = tree.open(&children);
    for _ in children.iter().flatten().filter(|voxel| !voxel.leaf) {
        grow(tree, rng, with, level - 1);
    }
    tree.close(node);
}

fn octrees() -> Vec<Octree> {
    let mut rng = Rng(17);
    let mut all = Vec::new();
    for (children, contours, values, plain, levels, block_slots, near_limit) in [
        (4, true, 3, false, 6, 1 << 20, 32767),
        (3, true, 250, false, 7, 1000, 50),
        (8, true, 9, false, 4, 1 << 20, 1),
        (2, false, 0, false, 9, 64, 32767),
        (3, false, 5, false, 7, 1 << 20, 32767),
        (4, true, 40, true, 6, 3000, 200),
        (0, true, 1, false, 20, 64, 2),
    ] {
        let mut tree = Tree::default();
        tree.plain = plain;
        grow(&mut tree, &mut rng, With { children, contours, values }, levels);
        let options = AssembleOptions { block_slots, near_limit };
        all.push(assemble(&tree, DMat4::IDENTITY, &options).expect("a tree"));
    }
    all
}

/// Parts without their headers.
type Bodies = Vec<(PartEntry, Vec<u8>)>;

/// The image of a block of its parts, by one instruction set.
fn image_of(
    set: InstructionSet,
    parts: &[(PartEntry, Vec<u8>)],
    table: &[BlockEntry],
    index: u32,
) -> Result<Vec<u64>, String> {
    let entry = &table[index as usize];
    let mut decoder = Decoder::with(set)?;
    let bodies = parts.iter().map(|(entry, body)| (*entry, &body[..]));
    let fields = decode_fields(bodies, entry.image_size, &mut decoder)?;
    let mut image = vec![0; (entry.image_size / 8) as usize];
    let block = Block { fields: &fields, array_slots: fields.array_slots, index, start: entry.image_offset / 8 };
    write(set, &block, &mut image, &mut |block| table.get(block as usize).map(|b| b.image_offset / 8))?;
    Ok(image)
}

/// Every block of these octrees: the octree, its index, its image and its parts.
fn blocks(octrees: &[Octree]) -> Vec<(&Octree, u32, &[u64], Bodies)> {
    let mut all = Vec::new();
    for octree in octrees {
        for index in 0..octree.blocks().len() as u32 {
            let entry = &octree.blocks()[index as usize];
            let start = (entry.image_offset / 8) as usize;
            let image = &octree.slots()[start..start + (entry.image_size / 8) as usize];
            let places: BlockParts = octree.parts[index as usize].within();
            let (codec, stored) = encode_block(octree.blocks(), index, image, &places, 3).expect("no limit");
            assert_eq!(codec, CODEC_FIELDS);
            let body = |part: StoredPart| (part.entry, part.bytes[PART_HEADER_BYTES as usize..].to_vec());
            all.push((octree, index, image, stored.into_iter().map(body).collect()));
        }
    }
    all
}

#[test]
fn all_instruction_sets_decode_to_the_input() {
    let octrees = octrees();
    let blocks = blocks(&octrees);
    assert!(blocks.len() > 20, "{} blocks", blocks.len());
    for (octree, index, image, parts) in &blocks {
        for set in InstructionSet::all() {
            let decoded = image_of(set, parts, octree.blocks(), *index).expect("our own parts");
            assert!(decoded == *image, "block {index} with {set:?}");
        }
    }
}

#[test]
fn all_instruction_sets_find_the_same_in_damaged_parts() {
    let octrees = octrees();
    let (mut rng, mut refused, mut others, mut same) = (Rng(5), 0, 0, 0);
    for (octree, index, image, parts) in blocks(&octrees) {
        for _ in 0..60 {
            let mut damaged = parts.clone();
            for _ in 0..=rng.below(2) {
                let part = rng.below(damaged.len() as u64) as usize;
                let body = &mut damaged[part].1;
                // Mostly where the part says what follows.
                let range = 16 << rng.below(12);
                let at = rng.below((body.len() as u64).min(range)) as usize;
                match rng.below(8) {
                    0 => body.truncate(at),
                    1 => body[at] = rng.below(256) as u8,
                    _ => body[at] ^= 1 << rng.below(8),
                }
                if body.is_empty() {
                    body.push(0);
                }
            }
            let results: Vec<_> = (InstructionSet::all().into_iter())
                .map(|set| image_of(set, &damaged, octree.blocks(), index))
                .collect();
            assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "block {index}");
            match &results[0] {
                Err(_) => refused += 1,
                // The comparison tells images apart.
                Ok(other) if *other != image => others += 1,
                Ok(_) => same += 1,
            }
        }
    }
    assert!(refused > 500 && others > 50, "{refused} refused, {others} other images, {same} the same");
}
