//! Filters against the noise of few rays: within a picture, and over the pictures of a film.

use glam::Vec3;
use rayon::prelude::*;

use super::frame::{Frame, Surface};

/// How a filter within a picture tells surfaces apart.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Edges {
    /// How many times the filter runs, each time over pixels twice as far apart: with `n`, values come from up to 2^(n+1) - 2 pixels away.
    pub passes: u32,
    /// Values of a place farther off the surface's plane do not count, in the world's unit.
    pub distance: f32,
    /// Values of a normal whose cosine to the surface's is smaller do not count; from -1, all count, to 1.
    pub cosine: f32,
}

/// Averages each pixel's value with those of near pixels that show the same surface. Values of pixels without a surface are not touched.
pub fn smooth<const N: usize>(frame: &Frame, values: &[[f32; N]], edges: &Edges) -> Vec<[f32; N]> {
    if edges.passes == 0 {
        return values.to_vec();
    }
    filter(frame, values, edges.passes, &SameSurface::new(frame, edges))
}

/// Averages each pixel's value with those of near pixels, whatever they show: for fog, which knows no surfaces. `passes` as in [`Edges`].
pub fn blur<const N: usize>(frame: &Frame, values: &[[f32; N]], passes: u32) -> Vec<[f32; N]> {
    filter(frame, values, passes, &Everything)
}

/// As [`smooth`] for shares of rays that got through, from 0 to 1, of `rays` rays each: edges of shadows stay. Of `n` rays, each of which gets through with
/// chance `p`, the share is off by the root of `p (1 - p) / n`. A pixel counts less, the more times that its share differs, and that the mean of the 25 shares
/// around it does.
pub fn smooth_shares<const N: usize>(frame: &Frame, values: &[[f32; N]], rays: u32, edges: &Edges) -> Vec<[f32; N]> {
    if edges.passes == 0 {
        return values.to_vec();
    }
    let surfaces = SameSurface::new(frame, edges);
    let own: Planes<1> = [values.par_iter().map(|value| value.iter().sum::<f32>() / N.max(1) as f32).collect()];
    let [mean] = filter_once(frame, &own, 1, &EVEN, &surfaces);
    let [own] = own;
    let strictness = mean.par_iter().map(|mean| strictness(*mean, rays)).collect();
    filter(frame, values, edges.passes, &SameShare { surfaces, own, mean, strictness })
}

/// Pixels along each axis that a mean is taken over.
const ACROSS: f32 = 5.0;
/// How many times its noise a mean of many rays may differ to count by 1 / e.
const MANY: f32 = 1.0;
/// How many times more, of one ray: then noise is seen more than what it hides. It falls as the number of rays grows.
const FEW: f32 = 1.5;
/// How many times more of its noise than a mean a pixel's own share may differ.
const OWN: f32 = 3.0;

/// One over what a mean of shares may differ by.
fn strictness(mean: f32, rays: u32) -> f32 {
    // One ray more that gets through and one that does not: that few rays all do is no proof that others would.
    let all = ACROSS * ACROSS * rays.max(1) as f32;
    let chance = (mean * all + 1.0) / (all + 2.0);
    (all / (chance * (1.0 - chance))).sqrt() / (MANY + FEW / rays.max(1) as f32)
}

/// Weights of a row of five, and of five rows.
const ROW: [f32; 3] = [6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
const EVEN: [f32; 3] = [1.0; 3];

/// How much the values of some pixels in a row count for others.
trait Weights: Sync {
    /// `weights[i]` becomes the weight that pixel `other + i` has for pixel `at + i`, at most 1.
    fn weigh(&self, at: usize, other: usize, weights: &mut [f32]);
}

struct Everything;

impl Weights for Everything {
    fn weigh(&self, _: usize, _: usize, weights: &mut [f32]) {
        weights.fill(1.0);
    }
}

/// Pixels of the same surface count by 1, others not at all. Numbers of one kind lie side by side, so that the processor takes several pixels at once.
struct SameSurface {
    places: [Vec<f32>; 3],
    /// Not a number where there is no surface: whatever is compared with it is false.
    normals: [Vec<f32>; 3],
    distance: f32,
    cosine: f32,
}

impl SameSurface {
    fn new(frame: &Frame, edges: &Edges) -> Self {
        let of = |value: fn(&Surface) -> Vec3, axis: usize| {
            let number = |surface: &Option<Surface>| surface.as_ref().map_or(f32::NAN, |surface| value(surface)[axis]);
            frame.surfaces.par_iter().map(number).collect()
        };
        Self {
            places: std::array::from_fn(|axis| of(|surface| surface.position, axis)),
            normals: std::array::from_fn(|axis| of(|surface| surface.normal, axis)),
            distance: edges.distance,
            cosine: edges.cosine,
        }
    }
}

impl Weights for SameSurface {
    fn weigh(&self, at: usize, other: usize, weights: &mut [f32]) {
        let count = weights.len();
        let [x, y, z] = self.places.each_ref().map(|all| (&all[at..at + count], &all[other..other + count]));
        let [u, v, w] = self.normals.each_ref().map(|all| (&all[at..at + count], &all[other..other + count]));
        for (i, weight) in weights.iter_mut().enumerate() {
            let off = (x.1[i] - x.0[i]) * u.0[i] + (y.1[i] - y.0[i]) * v.0[i] + (z.1[i] - z.0[i]) * w.0[i];
            let cosine = u.0[i] * u.1[i] + v.0[i] * v.1[i] + w.0[i] * w.1[i];
            *weight = if (off.abs() <= self.distance) & (cosine >= self.cosine) { 1.0 } else { 0.0 };
        }
    }
}

/// Pixels of the same surface count the less, the farther their share of rays is off.
struct SameShare {
    surfaces: SameSurface,
    own: Vec<f32>,
    mean: Vec<f32>,
    strictness: Vec<f32>,
}

impl Weights for SameShare {
    fn weigh(&self, at: usize, other: usize, weights: &mut [f32]) {
        self.surfaces.weigh(at, other, weights);
        let count = weights.len();
        let strictness = &self.strictness[at..at + count];
        let [own, mean] =
            [&self.own, &self.mean].map(|shares| (&shares[at..at + count], &shares[other..other + count]));
        for (i, weight) in weights.iter_mut().enumerate() {
            let mean = (mean.0[i] - mean.1[i]) * strictness[i];
            // The share of one pixel has more noise than that of all, by the root of their number.
            let own = (own.0[i] - own.1[i]) * strictness[i] * (1.0 / (OWN * ACROSS));
            // Nearly the exponential of its negative, and 0 where that is small.
            let left = (1.0 - (mean * mean + own * own) * 0.125).max(0.0);
            let fourth = (left * left) * (left * left);
            *weight *= fourth * fourth;
        }
    }
}

/// A number of each pixel, kind by kind.
type Planes<const N: usize> = [Vec<f32>; N];

fn filter<const N: usize>(frame: &Frame, values: &[[f32; N]], passes: u32, weights: &impl Weights) -> Vec<[f32; N]> {
    let mut planes: Planes<N> = std::array::from_fn(|n| values.par_iter().map(|value| value[n]).collect());
    for pass in 0..passes {
        planes = filter_once(frame, &planes, 1 << pass, &ROW, weights);
    }
    (0..values.len()).into_par_iter().map(|at| std::array::from_fn(|n| planes[n][at])).collect()
}

/// Each pixel's mean of 5 x 5 pixels, `apart` from one to the next. Its own value counts in any case.
fn filter_once<const N: usize>(
    frame: &Frame,
    planes: &Planes<N>,
    apart: usize,
    row: &[f32; 3],
    weights: &impl Weights,
) -> Planes<N> {
    let (width, height) = (frame.eye.size.0 as usize, frame.eye.size.1 as usize);
    let filtered = |y: usize| {
        let mut sums: Planes<N> = std::array::from_fn(|_| vec![0.0; width]);
        let (mut all, mut some) = (vec![0.0f32; width], vec![0.0f32; width]);
        for (j, i) in (-2..=2isize).flat_map(|j| (-2..=2isize).map(move |i| (j, i))) {
            let (dx, dy) = (i * apart as isize, j * apart as isize);
            let Some(other_y) = y.checked_add_signed(dy).filter(|y| *y < height) else { continue };
            // Pixels that have one there.
            let (first, last) = (dx.min(0).unsigned_abs(), width.saturating_sub(dx.max(0).unsigned_abs()));
            if first >= last {
                continue;
            }
            let other = (other_y * width + first).wrapping_add_signed(dx);
            let some = &mut some[first..last];
            match (j, i) {
                (0, 0) => some.fill(1.0),
                _ => weights.weigh(y * width + first, other, some),
            }
            let share = row[i.unsigned_abs()] * row[j.unsigned_abs()];
            all[first..last].iter_mut().zip(&*some).for_each(|(all, weight)| *all += share * weight);
            for (sums, values) in sums.iter_mut().zip(planes) {
                let values = &values[other..other + some.len()];
                for ((sum, weight), value) in sums[first..last].iter_mut().zip(&*some).zip(values) {
                    *sum += share * weight * value;
                }
            }
        }
        for sums in &mut sums {
            sums.iter_mut().zip(&all).for_each(|(sum, all)| *sum /= all);
        }
        sums
    };
    let rows: Vec<Planes<N>> = (0..height).into_par_iter().map(filtered).collect();
    std::array::from_fn(|n| rows.iter().flat_map(|row| row[n].iter().copied()).collect())
}

fn same(surface: &Surface, other: &Surface, edges: &Edges) -> bool {
    let off = (other.position - surface.position).dot(surface.normal).abs();
    off <= edges.distance && other.normal.dot(surface.normal) >= edges.cosine
}

/// Values of the pictures before, to average with.
#[derive(Clone, Debug, Default)]
pub struct History<const N: usize> {
    before: Option<Past<N>>,
}

/// The picture before.
#[derive(Clone, Debug)]
struct Past<const N: usize> {
    frame: Frame,
    values: Vec<[f32; N]>,
    /// How many pictures each value is of.
    counts: Vec<u16>,
}

impl<const N: usize> History<N> {
    /// None yet.
    pub fn new() -> Self {
        Self { before: None }
    }

    /// Averages values with those that the same places had in the pictures before. A place is found by where it was then: [`Surface::moved`] tells. It counts if it
    /// was seen, within `edges.distance` and `edges.cosine`. A value is the mean of up to `most` pictures; of more, the latest weigh most.
    pub fn add(&mut self, frame: &Frame, values: &[[f32; N]], edges: &Edges, most: u16) -> Vec<[f32; N]> {
        let found = |(surface, value): (&Option<Surface>, &[f32; N])| {
            let (Some(past), Some(surface)) = (&self.before, surface) else { return (*value, 1) };
            let was = Surface { position: surface.position - surface.moved, ..*surface };
            let Some((at, _)) = past.frame.eye.project(was.position) else { return (*value, 1) };
            let Some((pixel, there)) = past.frame.at(at) else { return (*value, 1) };
            // A pixel's middle may lie as far away as the pixel is large.
            let near =
                was.position.distance(there.position) <= edges.distance + 2.0 * there.depth * past.frame.eye.pixel();
            if !near || !same(&was, there, edges) {
                return (*value, 1);
            }
            let count = past.counts[pixel].saturating_add(1).min(most.max(1));
            let share = 1.0 / f32::from(count);
            let old = past.values[pixel];
            (std::array::from_fn(|channel| old[channel] + (value[channel] - old[channel]) * share), count)
        };
        let (values, counts): (Vec<_>, Vec<_>) = frame.surfaces.par_iter().zip(values).map(found).unzip();
        self.before = Some(Past { frame: frame.clone(), values: values.clone(), counts });
        values
    }
}
