//! Filters against the noise of few rays: within a picture, and over the pictures of a film.

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
    filter(frame, values, edges.passes, &|at, other| belongs(frame, edges, at, other))
}

/// Averages each pixel's value with those of near pixels, whatever they show: for fog, which knows no surfaces. `passes` as in [`Edges`].
pub fn blur<const N: usize>(frame: &Frame, values: &[[f32; N]], passes: u32) -> Vec<[f32; N]> {
    filter(frame, values, passes, &|_, _| 1.0)
}

/// As [`smooth`] for shares of rays that got through, from 0 to 1, of `rays` rays each: edges of shadows stay. Of `n` rays, each of which gets through with
/// chance `p`, the share is off by the root of `p (1 - p) / n`. A pixel counts less, the more times that its share differs, and that the mean of the 25 shares
/// around it does.
pub fn smooth_shares<const N: usize>(frame: &Frame, values: &[[f32; N]], rays: u32, edges: &Edges) -> Vec<[f32; N]> {
    if edges.passes == 0 {
        return values.to_vec();
    }
    let belongs = |at: usize, other: usize| belongs(frame, edges, at, other);
    let share = |value: &[f32; N]| [value.iter().sum::<f32>() / N.max(1) as f32];
    let shares: Vec<[f32; 1]> = values.par_iter().map(share).collect();
    let means = filter_once(frame, &shares, 1, &EVEN, &belongs);
    let shares: Vec<Share> =
        shares.par_iter().zip(means).map(|([share], [mean])| Share::new(*share, mean, rays)).collect();
    filter(frame, values, edges.passes, &|at, other| match belongs(at, other) {
        0.0 => 0.0,
        weight => weight * shares[at].weight(&shares[other]),
    })
}

/// The share of a pixel's rays that get through.
#[derive(Clone, Copy)]
struct Share {
    own: f32,
    /// Of all pixels around it.
    mean: f32,
    /// One over the noise of a mean.
    strictness: f32,
}

/// Pixels that a mean is taken over.
const AROUND: f32 = 25.0;
/// How many times its noise a pixel's own share may differ to count by 1 / e. Means may by once their noise.
const OWN: f32 = 3.0;

impl Share {
    fn new(own: f32, mean: f32, rays: u32) -> Self {
        // One ray more that gets through and one that does not: that few rays all do is no proof that others would.
        let all = AROUND * rays.max(1) as f32;
        let chance = (mean * all + 1.0) / (all + 2.0);
        Self { own, mean, strictness: (all / (chance * (1.0 - chance))).sqrt() }
    }

    fn weight(&self, other: &Self) -> f32 {
        let mean = (self.mean - other.mean) * self.strictness;
        // A share of fewer rays has more noise by the root.
        let own = (self.own - other.own) * self.strictness / (OWN * AROUND.sqrt());
        (-mean * mean - own * own).exp()
    }
}

/// Weights of a row of five, and of five rows.
const ROW: [f32; 3] = [6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
const EVEN: [f32; 3] = [1.0; 3];

/// `weight`: how much the value of another pixel counts for a pixel. Its own must count.
fn filter<const N: usize>(
    frame: &Frame,
    values: &[[f32; N]],
    passes: u32,
    weight: &(impl Fn(usize, usize) -> f32 + Sync),
) -> Vec<[f32; N]> {
    let mut values = values.to_vec();
    for pass in 0..passes {
        values = filter_once(frame, &values, 1 << pass, &ROW, weight);
    }
    values
}

fn filter_once<const N: usize>(
    frame: &Frame,
    values: &[[f32; N]],
    apart: i64,
    row: &[f32; 3],
    weight: &(impl Fn(usize, usize) -> f32 + Sync),
) -> Vec<[f32; N]> {
    let (width, height) = (i64::from(frame.eye.size.0), i64::from(frame.eye.size.1));
    let pixel = |at: usize| {
        let (x, y) = (at as i64 % width, at as i64 / width);
        let (mut sum, mut weights) = ([0.0; N], 0.0);
        for (j, i) in (-2..=2i64).flat_map(|j| (-2..=2i64).map(move |i| (j, i))) {
            let (x, y) = (x + i * apart, y + j * apart);
            if x < 0 || y < 0 || x >= width || y >= height {
                continue;
            }
            let other = (y * width + x) as usize;
            let weight = weight(at, other) * row[i.unsigned_abs() as usize] * row[j.unsigned_abs() as usize];
            if weight > 0.0 {
                (0..N).for_each(|channel| sum[channel] += weight * values[other][channel]);
                weights += weight;
            }
        }
        sum.map(|sum| sum / weights)
    };
    (0..values.len()).into_par_iter().map(pixel).collect()
}

/// 1 if two pixels show the same surface, else 0.
fn belongs(frame: &Frame, edges: &Edges, at: usize, other: usize) -> f32 {
    let is_same = at == other
        || match (&frame.surfaces[at], &frame.surfaces[other]) {
            (Some(surface), Some(there)) => same(surface, there, edges),
            _ => false,
        };
    f32::from(u8::from(is_same))
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
