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

/// Weights of a row of five, and of five rows.
const ROW: [f32; 3] = [6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// Averages each pixel's value with those of near pixels that show the same surface. Values of pixels without a surface are not touched.
pub fn smooth<const N: usize>(frame: &Frame, values: &[[f32; N]], edges: &Edges) -> Vec<[f32; N]> {
    let belongs = |at: usize, other: usize| match (&frame.surfaces[at], &frame.surfaces[other]) {
        (Some(surface), Some(there)) => same(surface, there, edges),
        (None, _) => at == other,
        (Some(_), None) => false,
    };
    filter(frame, values, edges.passes, &belongs)
}

/// Averages each pixel's value with those of near pixels, whatever they show: for fog, which knows no surfaces. `passes` as in [`Edges`].
pub fn blur<const N: usize>(frame: &Frame, values: &[[f32; N]], passes: u32) -> Vec<[f32; N]> {
    filter(frame, values, passes, &|_, _| true)
}

/// `belongs`: whether the value of another pixel counts for a pixel. Its own always does.
fn filter<const N: usize>(
    frame: &Frame,
    values: &[[f32; N]],
    passes: u32,
    belongs: &(impl Fn(usize, usize) -> bool + Sync),
) -> Vec<[f32; N]> {
    let mut values = values.to_vec();
    for pass in 0..passes {
        values = filter_once(frame, &values, 1 << pass, belongs);
    }
    values
}

fn filter_once<const N: usize>(
    frame: &Frame,
    values: &[[f32; N]],
    apart: i64,
    belongs: &(impl Fn(usize, usize) -> bool + Sync),
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
            if !belongs(at, other) {
                continue;
            }
            let weight = ROW[i.unsigned_abs() as usize] * ROW[j.unsigned_abs() as usize];
            (0..N).for_each(|channel| sum[channel] += weight * values[other][channel]);
            weights += weight;
        }
        sum.map(|sum| sum / weights)
    };
    (0..values.len()).into_par_iter().map(pixel).collect()
}

fn same(surface: &Surface, other: &Surface, edges: &Edges) -> bool {
    let off = (other.position - surface.position).dot(surface.normal).abs();
    std::ptr::eq(surface, other) || (off <= edges.distance && other.normal.dot(surface.normal) >= edges.cosine)
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
