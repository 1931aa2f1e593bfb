//! Sixteen rays at once, each with a cell and a time of its own: the walk of `walk.rs`, without jumps.
//!
//! A step looks at the byte of each lane's cell, or at that which has its bit if the cell is a voxel. Where the cell is full, the lane goes down to
//! the cell of the level below that the ray is in, whose bit the same byte has. Where there is no voxel then, it goes to the next cell along the ray. These are two
//! steps of the walk, in its order, and so the cells at which rays end are the walk's.
//!
//! Lanes that meet what is rare, planes of several axes at once, end there, and the walk traces their rays.

use fearless_simd::prelude::*;
use fearless_simd::{Bytes as _, i32x8, mask32x8, u32x8};

use super::{List, fault};
use super::gather::Gather;
use super::stage::{FIELDS, Field, LANES, Staged};
use crate::trace::{FRACTION_BITS, MAX_LEVEL};
use crate::volume::{Occupancy, Volume};

type Ints<S> = i32x8<S>;
type Mask<S> = mask32x8<S>;

/// Steps between two looks at which lanes have ended. Measured with AVX2.
const STEPS: usize = 4;

/// Number of a lane that has no ray yet.
pub(super) const NOBODY: u32 = u32::MAX >> 1;

/// The first full cell on a ray.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Met {
    /// Its least corner, in 1/256 of a voxel, in mirrored space.
    pub(super) corner: [i32; 3],
    pub(super) level: u32,
    /// Numerator and denominator.
    pub(super) time: [i32; 2],
}

/// Where ends of rays are put.
pub(super) trait Ends {
    /// Whether it is asked where rays end.
    const PLACES: bool;

    /// Puts the end of a ray of a list: whether a cell is in its way, and which, if that is asked. Rays that nothing is in the way of may be left out.
    /// Ends of rays on their way may be put before, as if nothing was in their way, and [`NOBODY`]'s.
    fn put(&mut self, number: u32, is_hit: bool, met: Option<Met>);
}

/// Where the bytes of the levels are.
struct Bytes<'a, S: Gather> {
    all: &'a [u8],
    /// Place of the first byte of cells of each level from 1 on.
    starts: Ints<S>,
    /// Voxels along each axis, less one.
    last: [Ints<S>; 3],
}

impl<'a, S: Gather> Bytes<'a, S> {
    #[inline(always)]
    fn new(simd: S, volume: &'a Volume) -> Self {
        let mut starts = [0; LANES];
        for mip in 0..=volume.mips().min(MAX_LEVEL - 1) {
            starts[mip as usize + 1] = volume.start_of(mip) as i32;
        }
        let [x, y, z] = volume.voxels();
        let last = [number(simd, x as i32 - 1), number(simd, y as i32 - 1), number(simd, z as i32 - 1)];
        Self { all: volume.all_bytes(), starts: Ints::simd_from(simd, starts), last }
    }
}

/// Rays on their way, in mirrored space.
struct State<S: Gather> {
    simd: S,
    running: Mask<S>,
    /// Lanes whose rays have met a cell since they were filled.
    hit: Mask<S>,
    /// Lanes whose rays the walk must trace.
    rare: Mask<S>,
    fields: [Ints<S>; FIELDS],
}

/// Traces the rays of a list. `COARSE`: whether fidelity falls along the rays.
#[inline(always)]
pub(super) fn trace<S: Gather, L: Ends, const COARSE: bool>(simd: S, list: &mut List<'_, L>) {
    let List { volume, fidelity, .. } = *list;
    let coarsest = fidelity.coarsest.min(volume.coarsest()).min(MAX_LEVEL);
    // No ray is longer.
    let fine_until = fidelity.fine_until.min(1 << 20) as i32;
    let mut staged = Staged::new();
    let bytes = Bytes::new(simd, volume);
    let mut groups = [State::new(simd), State::new(simd)];
    let mut more = true;
    loop {
        for group in &mut groups {
            let running = group.running.to_bitmask() as u32;
            if running == (1 << LANES) - 1 {
                continue;
            }
            group.put(!running, list);
            if more && staged.left() < LANES {
                list.stage(simd, &mut staged, coarsest);
                more = staged.left() >= LANES;
            }
            group.fill(running, &mut staged);
        }
        let [a, b] = &mut groups;
        if !(a.running | b.running).any_true() {
            return;
        }
        // Lanes that end wait for the others, since each look at who has ended costs as much as a step. Steps of two groups do not wait for one another.
        for _ in 0..STEPS {
            a.step::<COARSE>(&bytes, coarsest, fine_until);
            b.step::<COARSE>(&bytes, coarsest, fine_until);
        }
    }
}

#[inline(always)]
fn number<S: Gather>(simd: S, x: i32) -> Ints<S> {
    Ints::splat(simd, x)
}

/// What of three values is that of the axis whose mask is set; that of the third, if it is neither of the first two.
#[inline(always)]
fn choose<S: Gather>(first: Mask<S>, second: Mask<S>, [x, y, z]: [Ints<S>; 3]) -> Ints<S> {
    first.select(x, second.select(y, z))
}

impl<S: Gather> State<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let none = Mask::splat(simd, false);
        let mut fields = [number(simd, 0); FIELDS];
        fields[Field::Number as usize] = number(simd, NOBODY as i32);
        Self { simd, running: none, hit: none, rare: none, fields }
    }

    /// Puts the ends of lanes' rays where they belong.
    #[inline(always)]
    fn put<L: Ends>(&self, ended: u32, list: &mut List<'_, L>) {
        let (hit, rare) = (self.hit.to_bitmask() as u32, self.rare.to_bitmask() as u32);
        let numbers: [i32; LANES] = self.get(Field::Number).into();
        if rare & ended != 0 {
            let lanes = (0..LANES).filter(|lane| (rare & ended) >> lane & 1 == 1);
            list.rare.extend(lanes.map(|lane| numbers[lane] as u32));
        }
        if !L::PLACES {
            for lane in 0..LANES {
                list.ends.put(numbers[lane] as u32, hit >> lane & 1 == 1, None);
            }
            return;
        }
        let [x, y, z] = self.on_axes(Field::Corner);
        let corner: [[i32; LANES]; 3] = [x.into(), y.into(), z.into()];
        let level: [i32; LANES] = self.get(Field::Level).into();
        let time: [[i32; LANES]; 2] = [self.get(Field::Numerator).into(), self.get(Field::Denominator).into()];
        let mut bits = ended & hit;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let corner = [corner[0][lane], corner[1][lane], corner[2][lane]];
            let met = Met { corner, level: level[lane] as u32, time: [time[0][lane], time[1][lane]] };
            list.ends.put(numbers[lane] as u32, true, Some(met));
        }
    }

    #[inline(always)]
    fn get(&self, field: Field) -> Ints<S> {
        self.fields[field as usize]
    }

    #[inline(always)]
    fn on_axes(&self, field: Field) -> [Ints<S>; 3] {
        // `map` would call a function that is compiled without the vectors' instructions.
        let first = field as usize;
        [self.fields[first], self.fields[first + 1], self.fields[first + 2]]
    }

    /// Puts staged rays into the lanes that have none.
    #[inline(always)]
    fn fill(&mut self, running: u32, staged: &mut Staged) {
        let free = !running & ((1 << LANES) - 1);
        let count = (free.count_ones() as usize).min(staged.left());
        if count == 0 {
            return;
        }
        // Of the free lanes the first ones, if not enough rays are left for all.
        let mut fresh = free;
        while fresh.count_ones() as usize > count {
            fresh &= !(1 << (31 - fresh.leading_zeros()));
        }
        let mask = Mask::from_bitmask(self.simd, u64::from(fresh));
        for field in 0..FIELDS {
            if fault::made(fault::OLD_LIMIT) && field == Field::Limit as usize {
                continue;
            }
            let new = staged.next(self.simd, field).expand(mask);
            self.fields[field] = mask.select(new, self.fields[field]);
        }
        self.running |= mask;
        self.hit &= !mask;
        self.rare &= !mask;
        staged.take(count);
    }

    #[inline(always)]
    fn step<const COARSE: bool>(&mut self, bytes: &Bytes<S>, coarsest: u32, fine_until: i32) {
        let simd = self.simd;
        let zero = number(simd, 0);
        let (corner, origin) = (self.on_axes(Field::Corner), self.on_axes(Field::Origin));
        let direction = self.on_axes(Field::Direction);
        let (flip, limit) = (self.on_axes(Field::Flip), self.on_axes(Field::Limit));
        let (numerator, denominator, level) =
            (self.get(Field::Numerator), self.get(Field::Denominator), self.get(Field::Level));

        // The byte of the cell, or of the voxel's cell.
        let byte_level = level.max(number(simd, 1));
        let shift = byte_level + FRACTION_BITS as i32;
        let mut index = zero;
        let mut inside = Mask::splat(simd, true);
        for axis in [2, 1, 0] {
            let place = (corner[axis] ^ flip[axis]) >> shift;
            let last = bytes.last[axis] >> byte_level;
            inside &= place.bitcast::<u32x8<S>>().simd_le(last.bitcast::<u32x8<S>>());
            index = index * (last + 1) + place;
        }
        index += simd.pick(bytes.starts, byte_level);
        let byte = inside.select(simd.gather(bytes.all, index) & 0xff, zero);

        // Down one level where there are voxels.
        let is_full = byte.simd_gt(zero);
        let mut descends = self.running & is_full & level.simd_gt(zero);
        let mut hit_above = Mask::splat(simd, false);
        if COARSE {
            let [x, y, z] = corner;
            let major = self.get(Field::Major);
            let on_major = major.simd_eq(zero).select(x, major.simd_eq(number(simd, 1)).select(y, z));
            let voxels = ((on_major >> FRACTION_BITS) - self.get(Field::Start)).max(zero);
            let fine = number(simd, fine_until);
            let is_fine = voxels.simd_ge((fine << level) - fine);
            hit_above = descends & is_fine;
            descends &= !is_fine;
        }
        let half = number(simd, 128) << level;
        let mut child = corner;
        let mut on_plane = Mask::splat(simd, false);
        for axis in 0..3 {
            let middle = corner[axis] - origin[axis] + half;
            let ahead = middle * denominator - numerator * direction[axis];
            let upper = descends & !ahead.simd_gt(zero);
            child[axis] = corner[axis] + upper.select(half, zero);
            on_plane |= ahead.simd_eq(zero);
        }
        on_plane &= descends;
        let level = level - descends.select(number(simd, 1), zero);
        let bit_shift = shift - 1;
        let mut octant = zero;
        for axis in 0..3 {
            octant |= (((child[axis] ^ flip[axis]) >> bit_shift) & 1) << axis as u32;
        }
        let is_full = ((byte >> octant) & 1).simd_gt(zero);
        let hit = (is_full & level.simd_eq(zero)) | hit_above;

        // To the next cell where there is none.
        let size = number(simd, 256) << level;
        let goes = self.running & !(is_full | hit_above);
        let mut ahead = [zero; 3];
        for axis in 0..3 {
            ahead[axis] = child[axis] - origin[axis] + size;
        }
        let xy = ahead[0] * direction[1] - ahead[1] * direction[0];
        let xz = ahead[0] * direction[2] - ahead[2] * direction[0];
        let yz = ahead[1] * direction[2] - ahead[2] * direction[1];
        let x = zero.simd_gt(xy) & zero.simd_gt(xz);
        let y = xy.simd_gt(zero) & zero.simd_gt(yz);
        let z = xz.simd_gt(zero) & yz.simd_gt(zero);
        let tie = goes & !(x | y | z);
        let reached = choose(x, y, ahead);
        let miss = goes & (reached.simd_gt(choose(x, y, limit)));
        let mut stepped = child;
        for (axis, first) in [x, y, z].into_iter().enumerate() {
            stepped[axis] += (first & goes).select(size, zero);
        }
        let leaves = goes & (choose(x, y, stepped) & size).simd_eq(zero);
        let up = (leaves & level.simd_lt(number(simd, coarsest as i32))).select(number(simd, 1), zero);
        let mask = -(size << up);
        for axis in 0..3 {
            self.fields[Field::Corner as usize + axis] = stepped[axis] & mask;
        }
        self.fields[Field::Numerator as usize] = goes.select(reached, numerator);
        self.fields[Field::Denominator as usize] = goes.select(choose(x, y, direction), denominator);
        self.fields[Field::Level as usize] = level + up;

        let rare = if fault::made(fault::TIES) { tie & on_plane } else { tie | on_plane };
        self.hit |= hit & self.running;
        self.rare |= rare;
        self.running &= !(hit | miss | rare);
    }
}
