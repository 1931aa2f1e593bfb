//! Bounds of a texture's channels over a polygon of texture coordinates, exact to the texel.
//!
//! Filtering blends the four texels around a place. So the unit here is a *cell*: the square between the centres of four
//! texels, with the least and greatest value of the four. A polygon shows the texels of the cells that it overlaps.
//!
//! Small polygons are drawn row by row. For large ones there is a pyramid over the cells: parts of it inside the polygon count
//! whole, parts outside not at all, and parts that would not widen the bounds are left out.

use std::sync::Arc;

use glam::{IVec2, UVec2, Vec2, Vec3};

use super::range::{Bounds, Level, pyramid};
use super::srgb::{encode_srgb, linear_of_srgb};
use crate::clip::MAX_VERTICES;
use crate::{LinearTexture, Texture, Wrap};

/// A texture with bounds.
pub(crate) struct TexelMap {
    cells: Vec<CellLevel>,
    size: UVec2,
    wrap: [Wrap; 2],
    /// The texture if it is opaque and its texels are colours: what is filtered from few texels is then known exactly.
    colors: Option<Arc<Texture>>,
}

/// One level of the pyramid, in rows.
struct CellLevel {
    width: u32,
    height: u32,
    cells: Vec<Packed>,
}

/// Bounds as they are widened fastest: 255 minus the least values in the first four bytes, the greatest values in the others.
/// Both only grow.
#[derive(Clone, Copy)]
struct Packed([u8; 8]);

/// Repeats of a texture along an axis above which all of it counts.
const MOST_TILES: i32 = 4;
/// Rows of cells up to which a polygon is drawn row by row.
const MOST_ROWS: usize = 16;
/// How far outside a polygon a cell may be, in texels, and still count: coordinates are rounded.
const TOLERANCE: f32 = 1e-3;

impl Packed {
    const NONE: Self = Self([0; 8]);

    fn of(bounds: &Bounds<3>) -> Self {
        let ([a, b, c], [d, e, f]) = (bounds.min, bounds.max);
        Self([255 - a, 255 - b, 255 - c, 0, d, e, f, 0])
    }

    fn extend(&mut self, other: &Self) {
        for k in 0..8 {
            self.0[k] = self.0[k].max(other.0[k]);
        }
    }

    fn contains(&self, other: &Self) -> bool {
        let mut wider = *self;
        wider.extend(other);
        wider.0 == self.0
    }

    /// Whether some channel spans more than `enough`.
    fn spans(&self, enough: u8) -> bool {
        (0..3).any(|k| u16::from(self.0[k]) + u16::from(self.0[k + 4]) > 255 + u16::from(enough))
    }

    fn bounds(&self) -> Bounds<3> {
        let [a, b, c, _, d, e, f, _] = self.0;
        Bounds { min: [255 - a, 255 - b, 255 - c], max: [d, e, f] }
    }
}

/// The next lower integer, for magnitudes below 2^31. `f32::floor` is a library call on processors without an instruction.
fn floor(x: f32) -> i32 {
    let towards_zero = x as i32;
    towards_zero - i32::from(x < towards_zero as f32)
}

fn floors(at: Vec2) -> IVec2 {
    IVec2::new(floor(at.x), floor(at.y))
}

impl TexelMap {
    /// Of sRGB-encoded colours.
    pub(crate) fn of_colors(texture: &Arc<Texture>) -> Self {
        let mip = &texture.mips[0];
        let bounds = |&[r, g, b, _]: &[u8; 4]| Bounds { min: [r, g, b], max: [r, g, b] };
        let texels = mip.texels.iter().map(bounds).collect();
        let opaque = texture.alpha_range().0 == u8::MAX;
        let colors = opaque.then(|| texture.clone());
        Self { colors, ..Self::new(Level { width: mip.width, height: mip.height, texels }, texture.wrap) }
    }

    /// Of linear channels, rounded outwards to 8 bits.
    pub(crate) fn of_channels(texture: &LinearTexture<3>) -> Self {
        let mip = &texture.mips[0];
        let bounds = |t: &[u16; 3]| Bounds { min: t.map(|c| (c / 257) as u8), max: t.map(|c| c.div_ceil(257) as u8) };
        let texels = mip.texels.iter().map(bounds).collect();
        Self::new(Level { width: mip.width, height: mip.height, texels }, texture.wrap)
    }

    fn new(texels: Level<3>, wrap: [Wrap; 2]) -> Self {
        let size = UVec2::new(texels.width, texels.height);
        let cell = |i: u32| {
            let (x, y) = (i % size.x, i / size.x);
            let mut bounds = texels.at(x, y);
            let next = |k: usize, at: u32, size: u32| wrap[k].texel(i64::from(at) + 1, size);
            let (right, below) = (next(0, x, size.x), next(1, y, size.y));
            for (x, y) in [(right, y), (x, below), (right, below)] {
                bounds.extend(&texels.at(x, y));
            }
            bounds
        };
        let cells = (0..size.x * size.y).map(cell).collect();
        let packed = |level: Level<3>| CellLevel {
            width: level.width,
            height: level.height,
            cells: level.texels.iter().map(Packed::of).collect(),
        };
        let cells = pyramid(Level { width: size.x, height: size.y, texels: cells }).into_iter().map(packed).collect();
        Self { cells, size, wrap, colors: None }
    }

    /// Bounds over a convex polygon of texture coordinates of at least one vertex, of any place and size. The bounds may be
    /// those of a part of it if this part alone spans more than `enough` in some channel.
    pub(crate) fn in_polygon(&self, polygon: &[Vec2], enough: u8) -> Bounds<3> {
        let size = self.size.as_vec2();
        let mut texels = [Vec2::ZERO; MAX_VERTICES];
        let (mut lo, mut hi) = (Vec2::MAX, Vec2::MIN);
        for (to, uv) in texels.iter_mut().zip(polygon) {
            *to = *uv * size - 0.5;
            (lo, hi) = (lo.min(*to), hi.max(*to));
        }
        let polygon = &texels[..polygon.len()];
        let folds = |k: usize| self.wrap[k] != Wrap::Repeat && (lo[k] < 0.0 || hi[k] > size[k] - 1.0);
        if folds(0) || folds(1) {
            return self.in_folded_box((lo + 0.5) / size, (hi + 0.5) / size);
        }
        // Also false for numbers that are not finite.
        let few = (0..2).all(|k| (hi[k] - lo[k]) < size[k] * MOST_TILES as f32 && lo[k].abs() < 1e6);
        if !few {
            return self.cells[self.cells.len() - 1].cells[0].bounds();
        }
        let (first, last) = (floors(lo), floors(hi));
        if let Some(texture) = &self.colors
            && (last - first).max_element() <= 1
        {
            return self.filtered(texture, first, lo - first.as_vec2(), hi - first.as_vec2());
        }
        let mut edges = Edges::new(polygon);
        let mut found = Packed::NONE;
        if self.has_contrast_inside(&edges, (lo + hi) * 0.5, (hi - lo).max_element(), enough, &mut found) {
            return found.bounds();
        }
        if last.y - first.y < MOST_ROWS as i32 {
            self.in_rows(polygon, first, last, &mut found);
            return found.bounds();
        }
        let (first, last) = (floors(lo / size), floors(hi / size));
        for y in first.y..=last.y {
            for x in first.x..=last.x {
                edges.tile = IVec2::new(x, y).as_vec2() * size;
                self.in_tile(&edges, lo - edges.tile, hi - edges.tile, enough, &mut found);
            }
        }
        found.bounds()
    }

    /// Adds the cells around the middle of a polygon that are inside it, if they are. Returns whether they alone span more than
    /// `enough`: most surface with detail is refused here, by one entry.
    fn has_contrast_inside(&self, edges: &Edges, middle: Vec2, extent: f32, enough: u8, found: &mut Packed) -> bool {
        let level = ((extent * 0.25).max(1.0).to_bits() >> 23) - 127;
        let level = level.min(self.cells.len() as u32 - 1);
        let size = self.size.as_vec2();
        let tile = floors(middle / size).as_vec2() * size;
        let at = (middle - tile).max(Vec2::ZERO).as_uvec2().min(self.size - 1) >> level;
        let corner = tile + (at << level).as_vec2();
        if !matches!(edges.meet(corner, (1u32 << level) as f32), Meets::Inside) {
            return false;
        }
        found.extend(self.cells[level as usize].at(at));
        found.spans(enough)
    }

    /// Adds the cells that a polygon overlaps, row by row. `first` and `last` are the cells of its box.
    fn in_rows(&self, polygon: &[Vec2], first: IVec2, last: IVec2, found: &mut Packed) {
        let mut rows = [(f32::MAX, f32::MIN); MOST_ROWS];
        let top = first.y as f32;
        let mut previous = polygon[polygon.len() - 1];
        for &current in polygon {
            let (a, b) = if previous.y < current.y { (previous, current) } else { (current, previous) };
            let slope = if b.y > a.y { (b.x - a.x) / (b.y - a.y) } else { 0.0 };
            let ends = [a.y - top - TOLERANCE, b.y - top + TOLERANCE];
            let of = |y: f32| (y.max(0.0) as usize).min(MOST_ROWS - 1);
            for row in of(ends[0])..=of(ends[1]) {
                let y = top + row as f32;
                // A row that the edge only comes near to gets the end of it.
                let within = |y: f32| (y - a.y).clamp(0.0, b.y - a.y);
                let (from, to) =
                    if b.y > a.y { (a.x + slope * within(y), a.x + slope * within(y + 1.0)) } else { (a.x, b.x) };
                let entry = &mut rows[row];
                *entry = (entry.0.min(from.min(to)), entry.1.max(from.max(to)));
            }
            previous = current;
        }
        let level = &self.cells[0];
        let width = level.width as i32;
        for (row, (least, most)) in rows.iter().enumerate().take((last.y - first.y) as usize + 1) {
            if least > most {
                continue;
            }
            let y = (first.y + row as i32).rem_euclid(level.height as i32) as usize;
            let cells = &level.cells[y * width as usize..][..width as usize];
            let (from, to) = (floor(least - TOLERANCE).max(first.x), floor(most + TOLERANCE).min(last.x));
            let mut x = from.rem_euclid(width);
            for _ in from..=to {
                found.extend(&cells[x as usize]);
                x = if x + 1 == width { 0 } else { x + 1 };
            }
        }
    }

    /// Adds what a polygon shows of one repeat of the texture. The box is that of the polygon, in texels of this repeat.
    fn in_tile(&self, edges: &Edges, lo: Vec2, hi: Vec2, enough: u8, found: &mut Packed) {
        let lo = lo.max(Vec2::ZERO).as_uvec2();
        let hi = hi.as_ivec2().max(IVec2::ZERO).as_uvec2().min(self.size - 1);
        // On this level the box spans at most two entries along each axis.
        let extent = (hi - lo.min(hi)).max_element();
        let level = (u32::BITS - extent.leading_zeros()).min(self.cells.len() as u32 - 1);
        let (from, to) = (lo >> level, hi >> level);
        let mut stack = [(0u32, UVec2::ZERO); 64];
        let mut open = 0;
        for y in from.y..=to.y {
            for x in from.x..=to.x {
                (stack[open], open) = ((level, UVec2::new(x, y)), open + 1);
            }
        }
        while open > 0 {
            open -= 1;
            let (level, at) = stack[open];
            let bounds = self.cells[level as usize].at(at);
            if found.contains(bounds) {
                continue;
            }
            let corner = at << level;
            if (corner.cmpgt(hi) | (corner + ((1 << level) - 1)).cmplt(lo)).any() {
                continue;
            }
            match edges.meet(corner.as_vec2(), (1u32 << level) as f32) {
                Meets::Outside => {}
                Meets::Partly if level > 0 => {
                    let finer = &self.cells[level as usize - 1];
                    for child in [UVec2::ZERO, UVec2::X, UVec2::Y, UVec2::ONE] {
                        let child = at * 2 + child;
                        if child.x < finer.width && child.y < finer.height {
                            (stack[open], open) = ((level - 1, child), open + 1);
                        }
                    }
                }
                _ => {
                    found.extend(bounds);
                    if found.spans(enough) {
                        return;
                    }
                }
            }
        }
    }

    /// Bounds of the filtered colours in a box of at most two cells along each axis, the first of which is given; `lo` and `hi`
    /// are from its corner. In a cell filtered colours are bilinear, so the extremes over a box are at its corners and those
    /// of the cells.
    fn filtered(&self, texture: &Texture, first: IVec2, lo: Vec2, hi: Vec2) -> Bounds<3> {
        let (mip, table) = (&texture.mips[0], linear_of_srgb());
        let place = |k: usize, size: u32| [0, 1, 2].map(|d| self.wrap[k].texel(i64::from(first[k]) + d, size));
        let (columns, lines) = (place(0, mip.width), place(1, mip.height));
        let texel = |x: usize, y: usize| {
            let [r, g, b, _] = mip.texels[(lines[y] * mip.width + columns[x]) as usize];
            Vec3::new(table[r as usize], table[g as usize], table[b as usize])
        };
        // The middle place is the border of the two cells if the box spans it.
        let places = |k: usize| [lo[k], if hi[k] > 1.0 { 1.0 } else { lo[k] }, hi[k]];
        let (xs, ys) = (places(0), places(1));
        let blend = |[a, b, c]: [Vec3; 3], t: f32| if t <= 1.0 { a + (b - a) * t } else { b + (c - b) * (t - 1.0) };
        let texels: [[Vec3; 3]; 3] = std::array::from_fn(|x| std::array::from_fn(|y| texel(x, y)));
        let (mut least, mut most) = (Vec3::MAX, Vec3::MIN);
        for y in ys {
            let row = texels.map(|column| blend(column, y));
            for x in xs {
                let color = blend(row, x);
                (least, most) = (least.min(color), most.max(color));
            }
        }
        Bounds { min: encode_srgb(least), max: encode_srgb(most) }
    }

    /// Bounds over a box that reaches outside of an image that does not repeat.
    fn in_folded_box(&self, lo: Vec2, hi: Vec2) -> Bounds<3> {
        let size = self.size.as_vec2();
        let (u, v) = (self.wrap[0].fold_range(lo.x, hi.x), self.wrap[1].fold_range(lo.y, hi.y));
        let lo = Vec2::new(u.0, v.0) * size - 0.5;
        let hi = Vec2::new(u.1, v.1) * size - 0.5;
        let mut found = Packed::NONE;
        // One axis may repeat: then the box can be anywhere along it, and all of the axis counts.
        let whole = |k: usize| self.wrap[k] == Wrap::Repeat;
        let lo = Vec2::new(if whole(0) { 0.0 } else { lo.x }, if whole(1) { 0.0 } else { lo.y });
        let hi = Vec2::new(if whole(0) { size.x } else { hi.x }, if whole(1) { size.y } else { hi.y });
        self.in_tile(&Edges::none(), lo, hi.max(Vec2::ZERO), u8::MAX, &mut found);
        found.bounds()
    }
}

impl CellLevel {
    fn at(&self, at: UVec2) -> &Packed {
        &self.cells[(at.y * self.width + at.x) as usize]
    }
}

enum Meets {
    Outside,
    Partly,
    Inside,
}

/// The edges of a convex polygon, in texels: it lies where `n·p >= d` for each.
struct Edges {
    list: [(Vec2, f32); MAX_VERTICES],
    count: usize,
    /// Where the repeat of the texture begins that cells are in.
    tile: Vec2,
}

impl Edges {
    fn none() -> Self {
        Self { list: [(Vec2::ZERO, 0.0); MAX_VERTICES], count: 0, tile: Vec2::ZERO }
    }

    /// `polygon` is in texels.
    fn new(polygon: &[Vec2]) -> Self {
        let mut edges = Self::none();
        let at = |i: usize| polygon[i % polygon.len()];
        let twice = (1..polygon.len().max(2) - 1).map(|i| (at(i) - at(0)).perp_dot(at(i + 1) - at(0))).sum::<f32>();
        for i in 0..polygon.len() {
            let (a, b) = (at(i), at(i + 1));
            let n = (b - a).perp() * 1f32.copysign(twice);
            edges.list[i] = (n, n.dot(a) - TOLERANCE * n.length());
        }
        edges.count = polygon.len();
        edges
    }

    /// How the square with this lower corner and edge lies to the polygon.
    fn meet(&self, corner: Vec2, edge: f32) -> Meets {
        let corner = corner + self.tile;
        let mut inside = true;
        for (n, d) in &self.list[..self.count] {
            let at = n.dot(corner);
            let (x, y) = (n.x * edge, n.y * edge);
            let (most, least) = (x.max(0.0) + y.max(0.0), x.min(0.0) + y.min(0.0));
            if at + most < *d {
                return Meets::Outside;
            }
            inside &= at + least >= *d;
        }
        if inside { Meets::Inside } else { Meets::Partly }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn noise(width: u32, height: u32) -> Arc<Texture> {
        let mut state = 9u32;
        let mut byte = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let texels: Vec<u8> = (0..width * height).flat_map(|_| [byte(), byte(), byte(), 255]).collect();
        Arc::new(Texture::from_rgba8(width, height, &texels).unwrap())
    }

    /// Points of a polygon, from its vertices to its middle.
    fn points(polygon: &[Vec2]) -> impl Iterator<Item = Vec2> + '_ {
        let [a, b, c] = [polygon[0], polygon[1], polygon[2]];
        (0..400).map(move |i| {
            let (u, v) = ((i % 20) as f32 / 19.0, (i / 20) as f32 / 19.0);
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            a + (b - a) * u + (c - a) * v
        })
    }

    /// The colours of points of the polygon that are outside of the bounds by more than `slack` steps.
    fn outside(texture: &Texture, polygon: &[Vec2], bounds: &Bounds<3>, slack: u8) -> usize {
        let beyond = |p: &Vec2| {
            let [r, g, b, _] = texture.sample(p.to_array(), 1.0);
            let color = encode_srgb(Vec3::new(r, g, b));
            (0..3).any(|k| {
                color[k] < bounds.min[k].saturating_sub(slack) || color[k] > bounds.max[k].saturating_add(slack)
            })
        };
        points(polygon).filter(beyond).count()
    }

    proptest! {
        /// All that is filtered from the texture lies within the bounds, and the bounds within those of the cells that the polygon
        /// overlaps.
        #[test]
        fn bounds_are_those_of_the_polygon(
            corners in prop::array::uniform3(prop::array::uniform2(-1.2f32..1.2)), scale in prop::sample::select(vec![0.02f32, 0.1, 0.4, 1.0]),
            at in prop::array::uniform2(-3.0f32..3.0), wide in prop::bool::ANY,
        ) {
            let texture = if wide { noise(61, 37) } else { noise(13, 6) };
            let map = TexelMap::of_colors(&texture);
            let polygon = corners.map(|c| Vec2::from(at) + Vec2::from(c) * scale);
            let found = map.in_polygon(&polygon, u8::MAX);
            prop_assert_eq!(outside(&texture, &polygon, &found, 1), 0);
            let size = map.size.as_vec2();
            let texels = polygon.map(|p| p * size - 0.5);
            let (lo, hi) = (texels[0].min(texels[1]).min(texels[2]), texels[0].max(texels[1]).max(texels[2]));
            let mut all = Packed::NONE;
            let edges = Edges::new(&texels);
            // What is filtered from few texels is that of the polygon's box, and rounded.
            let few = (floors(hi) - floors(lo)).max_element() <= 1;
            for y in floor(lo.y)..=floor(hi.y) {
                for x in floor(lo.x)..=floor(hi.x) {
                    let corner = IVec2::new(x, y).as_vec2();
                    // A cell that the polygon comes near to may count.
                    if few || !matches!(edges.meet(corner - 4.0 * TOLERANCE, 1.0 + 8.0 * TOLERANCE), Meets::Outside) {
                        let cell = IVec2::new(x, y).rem_euclid(map.size.as_ivec2()).as_uvec2();
                        all.extend(map.cells[0].at(cell));
                    }
                }
            }
            if few {
                all.0 = all.0.map(|byte| byte.saturating_add(1));
            }
            prop_assert!(all.contains(&Packed::of(&found)), "{:?} of {:?}", found, all.bounds());
        }
    }

    #[test]
    fn a_polygon_elsewhere_has_other_bounds() {
        let texture = noise(61, 37);
        let map = TexelMap::of_colors(&texture);
        let polygon = [[0.2, 0.2], [0.3, 0.22], [0.25, 0.33]].map(Vec2::from);
        let moved = polygon.map(|p| p + 0.1);
        assert!(outside(&texture, &polygon, &map.in_polygon(&moved, u8::MAX), 1) > 0);
    }

    #[test]
    fn images_that_do_not_repeat_end_at_their_edges() {
        let mut texture = (*noise(8, 8)).clone();
        texture.wrap = [Wrap::Clamp, Wrap::Repeat];
        let texture = Arc::new(texture);
        let map = TexelMap::of_colors(&texture);
        for polygon in [[[1.5, 0.5], [1.7, 0.5], [1.6, 0.9]], [[-0.5, 3.0], [0.3, 3.1], [0.1, 3.4]]] {
            let polygon = polygon.map(Vec2::from);
            assert_eq!(outside(&texture, &polygon, &map.in_polygon(&polygon, u8::MAX), 1), 0);
        }
    }

    #[test]
    fn odd_coordinates_have_bounds() {
        let map = TexelMap::of_colors(&noise(5, 3));
        for odd in [f32::NAN, f32::INFINITY, -1e30, 1e12] {
            let bounds = map.in_polygon(&[Vec2::splat(odd), Vec2::ZERO, Vec2::ONE], 3);
            assert!((0..3).all(|k| bounds.min[k] <= bounds.max[k]), "{odd}");
        }
    }
}
