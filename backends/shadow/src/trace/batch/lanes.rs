//! Sixteen rays at once, each with a cell and a time of its own: the walk of `walk.rs`, without jumps.
//!
//! A lane is in a cell that is one byte, of the base level or of a mip. A step looks at the byte. If it is zero, the lane goes to the next cell along the ray, and up
//! a level where that leaves the cell above. Else it finds the one of the byte's eight cells that the ray is in at the lane's time. If that is full, it goes down into
//! it, or has hit it if it is a voxel; if it is empty, the lane goes on from there: to another of the eight or, where the ray leaves them, to the next byte.
//! So lanes meet the same cells as the walk, at the same times and in the same order.
//!
//! Lanes that meet what is rare, planes of several axes at once, end there, and the walk traces their rays.

use fearless_simd::prelude::*;
use fearless_simd::{Bytes as _, i32x8, mask32x8, u32x8};

use super::gather::Gather;
use super::stage::{FIELDS, Field, LANES, Staged};
use super::{List, fault};
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

/// Where the bytes of the levels are. Tables have a number for each level of cells that have a byte, from 1 on.
struct Bytes<'a, S: Simd> {
    all: &'a [u8],
    /// Place of the first byte.
    starts: Ints<S>,
    /// From row to row, and from layer to layer.
    rows: Ints<S>,
    layers: Ints<S>,
}

impl<'a, S: Gather> Bytes<'a, S> {
    #[inline(always)]
    fn new(simd: S, volume: &'a Volume) -> Self {
        let [mut starts, mut rows, mut layers] = [[0; LANES]; 3];
        for mip in 0..=volume.mips().min(MAX_LEVEL - 1) {
            let [width, height, _] = volume.level(mip).0.map(|n| n as i32);
            let level = mip as usize + 1;
            (starts[level], rows[level], layers[level]) = (volume.start_of(mip) as i32, width, width * height);
        }
        let table = [Ints::simd_from(simd, starts), Ints::simd_from(simd, rows), Ints::simd_from(simd, layers)];
        Self { all: volume.all_bytes(), starts: table[0], rows: table[1], layers: table[2] }
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
    /// Lanes that have gone to another of the eight cells of their byte.
    moved: Mask<S>,
    byte: Ints<S>,
    fields: [Ints<S>; FIELDS],
}

/// Traces the rays of a list. `COARSE`: whether fidelity falls along the rays.
#[inline(always)]
pub(super) fn trace<S: Gather, L: Ends, const COARSE: bool>(simd: S, list: &mut List<'_, L>) {
    let List { volume, fidelity, .. } = *list;
    // The least cells that lanes have are those of a byte.
    let coarsest = fidelity.coarsest.min(volume.coarsest()).clamp(1, MAX_LEVEL);
    let top = (coarsest + FRACTION_BITS) as i32;
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
            // Of rays that are staged none may be left: all may end where they begin, or be for the walk.
            while more && staged.left() < LANES {
                list.stage(simd, &mut staged, coarsest);
                more = list.next < list.rays.len();
            }
            group.fill(running, &mut staged);
        }
        let [a, b] = &mut groups;
        if !(a.running | b.running).any_true() {
            return;
        }
        // Lanes that end wait for the others, since each look at who has ended costs as much as a step. Steps of two groups do not wait for one another.
        a.fetch(&bytes);
        for _ in 1..STEPS {
            b.fetch(&bytes);
            a.step::<COARSE>(top, fine_until);
            if !fault::made(fault::OLD_BYTE) {
                a.fetch(&bytes);
            }
            b.step::<COARSE>(top, fine_until);
        }
        b.fetch(&bytes);
        a.step::<COARSE>(top, fine_until);
        b.step::<COARSE>(top, fine_until);
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
        Self { simd, running: none, hit: none, rare: none, moved: none, byte: number(simd, 0), fields }
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
        let shift: [i32; LANES] = self.get(Field::Shift).into();
        let time: [[i32; LANES]; 2] = [self.get(Field::Numerator).into(), self.get(Field::Denominator).into()];
        let mut bits = ended & hit;
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            let corner = [corner[0][lane], corner[1][lane], corner[2][lane]];
            let met = Met { corner, level: shift[lane] as u32 - FRACTION_BITS, time: [time[0][lane], time[1][lane]] };
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
        self.moved &= !mask;
        staged.take(count);
    }

    /// Reads the bytes of the lanes' cells.
    #[inline(always)]
    fn fetch(&mut self, bytes: &Bytes<S>) {
        let (corner, flip) = (self.on_axes(Field::Corner), self.on_axes(Field::Flip));
        let shift = self.get(Field::Shift);
        let narrow = shift & 31;
        let simd = self.simd;
        let mut index = simd.pick(bytes.starts, shift);
        index += (corner[0] ^ flip[0]) >> narrow;
        index += ((corner[1] ^ flip[1]) >> narrow) * simd.pick(bytes.rows, shift);
        index += ((corner[2] ^ flip[2]) >> narrow) * simd.pick(bytes.layers, shift);
        // As the highest byte of each word.
        self.byte = simd.gather(bytes.all, index) << 24;
    }

    /// Goes on with the bytes that were read last.
    #[inline(always)]
    fn step<const COARSE: bool>(&mut self, top: i32, fine_until: i32) {
        let simd = self.simd;
        let zero = number(simd, 0);
        let (corner, origin) = (self.on_axes(Field::Corner), self.on_axes(Field::Origin));
        let (direction, flip) = (self.on_axes(Field::Direction), self.on_axes(Field::Flip));
        let (numerator, denominator) = (self.get(Field::Numerator), self.get(Field::Denominator));
        let (shift, half) = (self.get(Field::Shift), self.get(Field::Half));

        let byte = self.byte;
        let is_empty = byte.simd_eq(zero);

        let mut hit = Mask::splat(simd, false);
        if COARSE {
            let [x, y, z] = corner;
            let major = self.get(Field::Major);
            let on_major = major.simd_eq(zero).select(x, major.simd_eq(number(simd, 1)).select(y, z));
            let voxels = ((on_major >> FRACTION_BITS) - self.get(Field::Start)).max(zero);
            let fine = number(simd, fine_until);
            let level = (shift - FRACTION_BITS as i32) & 31;
            hit = self.running & !is_empty & voxels.simd_ge((fine << level) - fine);
        }

        // Which of the eight cells the lane is in: on which axes the plane between them is ahead.
        let middle = [corner[0] - origin[0] + half, corner[1] - origin[1] + half, corner[2] - origin[2] + half];
        let mut ahead = [zero; 3];
        let mut lower = [is_empty; 3];
        let mut others = zero;
        for axis in 0..3 {
            ahead[axis] = middle[axis] * denominator - numerator * direction[axis];
            lower[axis] = ahead[axis].simd_gt(zero);
            // Of bits in the order of octants, those that are not set.
            others |= (lower[axis].to_vector() ^ flip[axis]) & (1 << axis);
        }
        let is_full = (byte << others).simd_lt(zero);
        let descends = if COARSE { self.running & is_full & !hit } else { self.running & is_full };
        let goes = if COARSE { self.running & !is_full & !hit } else { self.running & !is_full };
        // Planes that are crossed on the way into a cell are crossed together with the one that leads to it.
        let [x, y, z] = [ahead[0].bitcast::<u32x8<S>>(), ahead[1].bitcast(), ahead[2].bitcast()];
        let on_plane = x.min(y).min(z).simd_eq(u32x8::splat(simd, 0)) & !(is_empty | self.moved);

        // The next cell along the ray: from that one, or from the cell of the byte if it has no voxel.
        let size = half + is_empty.select(half, zero);
        let mut upper = middle;
        for axis in 0..3 {
            upper[axis] += (lower[axis] & !is_empty).select(zero, half);
        }
        let xy = upper[0] * direction[1] - upper[1] * direction[0];
        let xz = upper[0] * direction[2] - upper[2] * direction[0];
        let yz = upper[1] * direction[2] - upper[2] * direction[1];
        // Where the least is in two of them, one of these is zero; signs choose one of the two.
        let x = (xy & xz).simd_lt(zero);
        let y = (!xy & yz).simd_lt(zero);
        let tie = goes & !x & y.select(xy, xz.min(yz)).simd_eq(zero);
        let reached = choose(x, y, upper);
        let miss = goes & reached.simd_gt(choose(x, y, self.on_axes(Field::Limit)));
        let first = [x & goes, y & goes, goes & !(x | y)];
        let mut next = upper;
        for axis in 0..3 {
            next[axis] += origin[axis] - first[axis].select(zero, size);
        }
        let leaves = (choose(x, y, next) & size).simd_eq(zero);
        let up = goes & is_empty & leaves & shift.simd_lt(number(simd, top));
        self.moved = goes & !(is_empty | leaves);
        let new_half = descends.select(half >> 1, half + up.select(half, zero));
        let mask = zero - (new_half + new_half);
        for axis in 0..3 {
            self.fields[Field::Corner as usize + axis] = next[axis] & mask;
        }
        self.fields[Field::Numerator as usize] = goes.select(reached, numerator);
        self.fields[Field::Denominator as usize] = goes.select(choose(x, y, direction), denominator);
        self.fields[Field::Half as usize] = new_half;
        self.fields[Field::Shift as usize] = shift + descends.to_vector() - up.to_vector();

        hit |= descends & shift.simd_eq(number(simd, FRACTION_BITS as i32 + 1));
        let tie = if fault::made(fault::TIES) { Mask::splat(simd, false) } else { tie };
        let on_plane = if fault::made(fault::ON_PLANE) { Mask::splat(simd, false) } else { on_plane };
        let rare = (tie | on_plane) & self.running;
        self.hit |= hit;
        self.rare |= rare;
        self.running &= !(hit | miss | rare);
    }
}
