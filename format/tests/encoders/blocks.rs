//! Blocks of up to sixteen colours or normals: synthetic, or those of an octree with plain values.

use esvo_format::Octree;
use glam::Vec3;

/// The colours of a block.
pub(crate) type Colors = [Option<[u8; 3]>; 16];
/// The unit normals of a block.
pub(crate) type Normals = [Option<Vec3>; 16];

/// SplitMix64: random numbers that are the same on every machine.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to 1.
    fn part(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// From -1 to 1.
    fn signed(&mut self) -> f32 {
        self.part() * 2.0 - 1.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vector();
            if (0.01..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    fn color(&mut self) -> Vec3 {
        Vec3::new(self.part(), self.part(), self.part())
    }
}

/// The centres of the voxels of a block, which belong to two adjacent nodes. Voxels have the edge 1.
fn place(texel: usize) -> Vec3 {
    let bit = |k: usize| (texel >> k & 1) as f32;
    Vec3::new(bit(0) + 2.0 * bit(3) - 1.5, bit(1) - 0.5, bit(2) - 0.5)
}

/// The texels that a surface through the block touches: about half of them, at least one.
fn surface(random: &mut Random) -> [bool; 16] {
    let (normal, offset) = (random.direction(), random.signed() * 0.5);
    let reach = normal.abs().element_sum() * 0.5;
    let mut used: [bool; 16] = std::array::from_fn(|i| (place(i).dot(normal) - offset).abs() <= reach);
    used[(random.bits() % 16) as usize] = true;
    used
}

fn blocks<T>(random: &mut Random, count: usize, mut block: impl FnMut(&mut Random) -> [T; 16]) -> Vec<[Option<T>; 16]> {
    let mut one = || {
        let used = surface(random);
        let mut at = 0..;
        block(random).map(|texel| used[at.next().unwrap_or(0)].then_some(texel))
    };
    (0..count).map(|_| one()).collect()
}

/// Kinds of colour blocks, `count` of each.
pub(crate) fn color_sets(count: usize) -> Vec<(&'static str, Vec<Colors>)> {
    let bytes = |c: Vec3| c.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
    let random = &mut Random(1);
    let mut set = |name, texels: &mut dyn FnMut(&mut Random) -> [Vec3; 16]| {
        (name, blocks(random, count, |random| texels(random).map(bytes)))
    };
    vec![
        set("one colour", &mut |r| [r.color(); 16]),
        set("two colours", &mut |r| {
            let pair = [r.color(), r.color()];
            std::array::from_fn(|_| pair[(r.bits() & 1) as usize])
        }),
        set("gradient", &mut |r| {
            let (middle, change, along) = (r.color(), r.vector() * 0.15, r.direction());
            std::array::from_fn(|i| middle + change * place(i).dot(along))
        }),
        set("gradient with noise", &mut |r| {
            let (middle, change, along, noise) = (r.color(), r.vector() * 0.1, r.direction(), r.part() * 0.1);
            std::array::from_fn(|i| middle + change * place(i).dot(along) + r.vector() * noise)
        }),
        set("one colour, lit differently", &mut |r| {
            let (color, least) = (r.color(), r.part());
            std::array::from_fn(|_| color * (least + (1.0 - least) * r.part()))
        }),
        set("any colours", &mut |r| std::array::from_fn(|_| r.color())),
    ]
}

/// Kinds of normal blocks, `count` of each.
pub(crate) fn normal_sets(count: usize) -> Vec<(&'static str, Vec<Normals>)> {
    let random = &mut Random(2);
    let mut set = |name, texels: &mut dyn FnMut(&mut Random) -> [Vec3; 16]| (name, blocks(random, count, texels));
    vec![
        set("flat", &mut |r| [r.direction(); 16]),
        set("edge of two planes", &mut |r| {
            let pair = [r.direction(), r.direction()];
            std::array::from_fn(|_| pair[(r.bits() & 1) as usize])
        }),
        set("corner of three planes", &mut |r| {
            let planes = [r.direction(), r.direction(), r.direction()];
            std::array::from_fn(|_| planes[(r.bits() % 3) as usize])
        }),
        set("curved", &mut |r| {
            // Spheres and cylinders from 4 to 128 voxels in radius.
            let normal = r.direction();
            let (right, up) = normal.any_orthonormal_pair();
            let bend = 2f32.powf(-2.0 - 5.0 * r.part());
            let (a, b) = (bend * r.signed(), bend);
            std::array::from_fn(|i| {
                (normal + right * (place(i).dot(right) * a) + up * (place(i).dot(up) * b)).normalize()
            })
        }),
        set("rough", &mut |r| {
            let (normal, noise) = (r.direction(), r.part() * 0.3);
            std::array::from_fn(|_| (normal + r.vector() * noise).normalize_or(normal))
        }),
        set("any directions", &mut |r| std::array::from_fn(|_| r.direction())),
    ]
}

/// The blocks of the colours and normals of an octree.
pub(crate) fn of_octree(octree: &Octree) -> (Vec<Colors>, Vec<Normals>) {
    let mut slots: Vec<u32> = octree.objects().iter().filter_map(|o| u32::try_from(o.root_slot).ok()).collect();
    let mut at = 0;
    while let Some(&slot) = slots.get(at) {
        slots.extend((0..8).filter_map(|child| octree.child(slot, child)));
        at += 1;
    }
    slots.sort_unstable();
    let pair = |slot: u32| {
        let block = octree.block_of(slot);
        (block, (slot - octree.parts()[block as usize].start) / 2)
    };
    let (mut colors, mut normals) = (Vec::new(), Vec::new());
    for pair in slots.chunk_by(|a, b| pair(*a) == pair(*b)) {
        let (mut color, mut normal) = ([None; 16], [None; 16]);
        for &slot in pair {
            let half = 8 * ((slot - octree.parts()[octree.block_of(slot) as usize].start) % 2) as usize;
            for child in (0..8u8).filter(|child| octree.descriptor(slot).valid_mask() >> child & 1 != 0) {
                color[half + child as usize] = octree.plain_color(slot, child).map(|[r, g, b, _]| [r, g, b]);
                normal[half + child as usize] = octree.normal(slot, child);
            }
        }
        colors.push(color);
        normals.push(normal);
    }
    (colors, normals)
}
