//! Errors of encoders over many blocks, and the comparison of two encoders.

use std::fmt::Write;
use std::hint::black_box;
use std::time::Instant;

use esvo_format::{ColorBlock, NormalBlock};
use glam::Vec3;

use super::authors;
use super::blocks::{Colors, Normals};

/// Errors of all used texels of a set of blocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors {
    /// Root mean square.
    pub(crate) rms: f64,
    /// The 99th percentile.
    pub(crate) p99: f64,
}

impl Errors {
    fn of(mut errors: Vec<f64>) -> Self {
        errors.sort_by(f64::total_cmp);
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        Self { rms: (squares / errors.len() as f64).sqrt(), p99: errors[(errors.len() - 1) * 99 / 100] }
    }

    /// Whether the root mean square is not above that of the others, up to rounding errors.
    pub(crate) fn as_good_as(self, other: Self) -> bool {
        self.rms <= other.rms * (1.0 + 1e-9)
    }
}

/// Colour errors in units of 1/255: the root mean square over the three channels.
pub(crate) fn color_errors(blocks: &[Colors], encode: impl Fn(&Colors) -> ColorBlock) -> Errors {
    let of = |colors: &Colors| {
        let block = encode(colors);
        let error = |(i, color): (usize, &Option<[u8; 3]>)| {
            let (color, found) = ((*color)?, block.decode(i));
            let square = |k: usize| (f64::from(found[k]) * 255.0 - f64::from(color[k])).powi(2);
            Some(((square(0) + square(1) + square(2)) / 3.0).sqrt())
        };
        colors.iter().enumerate().filter_map(error).collect::<Vec<_>>()
    };
    Errors::of(blocks.iter().flat_map(of).collect())
}

/// Angles between normals in degrees.
pub(crate) fn normal_errors(blocks: &[Normals], encode: impl Fn(&Normals) -> NormalBlock) -> Errors {
    let of = |normals: &Normals| {
        let block = encode(normals);
        let error = |(i, normal): (usize, &Option<Vec3>)| {
            let (normal, found) = ((*normal)?.as_dvec3().normalize(), block.decode(i).as_dvec3().normalize());
            // From the chord, as the arc cosine is inexact for small angles.
            Some((2.0 * (normal.distance(found) * 0.5).min(1.0).asin()).to_degrees())
        };
        normals.iter().enumerate().filter_map(error).collect::<Vec<_>>()
    };
    Errors::of(blocks.iter().flat_map(of).collect())
}

/// A broken encoder for the negative control: indices in order along the line of the palette instead of 0, 2, 3, 1.
pub(crate) fn with_colors_in_a_wrong_order(colors: &Colors) -> ColorBlock {
    let block = ColorBlock::encode(colors);
    let index = |i: usize| [0, 3, 1, 2][(block.indices >> (2 * i) & 3) as usize] << (2 * i);
    ColorBlock { indices: (0..16).map(index).sum(), ..block }
}

/// A broken encoder for the negative control: the indices of the two axes are exchanged.
pub(crate) fn with_axes_exchanged(normals: &Normals) -> NormalBlock {
    let block = NormalBlock::encode(normals);
    NormalBlock { u_indices: block.v_indices, v_indices: block.u_indices, ..block }
}

/// Nanoseconds per block: the minimum of several rounds over the blocks (over some of them, if there are many).
fn time<B, R>(blocks: &[B], encode: impl Fn(&B) -> R) -> f64 {
    let some: Vec<&B> = blocks.iter().step_by((blocks.len() / 4000).max(1)).collect();
    let round = || {
        let start = Instant::now();
        for block in &some {
            black_box(encode(black_box(block)));
        }
        start.elapsed().as_secs_f64() * 1e9 / some.len() as f64
    };
    (0..30).map(|_| round()).fold(f64::MAX, f64::min)
}

fn row(table: &mut String, name: &str, blocks: usize, [ours, theirs]: [Errors; 2], time: f64) {
    let (digits, [a, b, c, d]) = (3, [ours.rms, theirs.rms, ours.p99, theirs.p99]);
    let cells = format!("{a:.digits$} | {b:.digits$} | {c:.digits$} | {d:.digits$}");
    writeln!(table, "| {name} | {blocks} | {cells} | {time:.0} |").expect("a string takes what it is given");
}

/// Compares the two colour encoders on a set of blocks. Adds a row to the table, if there is one.
///
/// # Panics
/// If our encoder is less accurate, or if the comparison does not detect a broken encoder.
pub(crate) fn colors(name: &str, blocks: &[Colors], table: Option<&mut String>) {
    let [ours, theirs] = [color_errors(blocks, ColorBlock::encode), color_errors(blocks, authors::colors)];
    assert!(ours.as_good_as(theirs), "{name}: {ours:?} instead of {theirs:?}");
    let broken = color_errors(blocks, with_colors_in_a_wrong_order);
    assert!(!broken.as_good_as(theirs), "{name}: colours in a wrong order pass with {broken:?}");
    if let Some(table) = table {
        row(table, name, blocks.len(), [ours, theirs], time(blocks, ColorBlock::encode));
    }
}

/// Like [`colors`], for normals. No negative control if all normals of each block are equal, as the axes are zero then.
///
/// # Panics
/// If our encoder is less accurate, or if the comparison does not detect a broken encoder.
pub(crate) fn normals(name: &str, blocks: &[Normals], table: Option<&mut String>) {
    let [ours, theirs] = [normal_errors(blocks, NormalBlock::encode), normal_errors(blocks, authors::normals)];
    assert!(ours.as_good_as(theirs), "{name}: {ours:?} instead of {theirs:?}");
    let flat = |block: &Normals| block.iter().flatten().all(|n| Some(n) == block.iter().flatten().next());
    if !blocks.iter().all(flat) {
        let broken = normal_errors(blocks, with_axes_exchanged);
        assert!(!broken.as_good_as(theirs), "{name}: exchanged axes pass with {broken:?}");
    }
    if let Some(table) = table {
        row(table, name, blocks.len(), [ours, theirs], time(blocks, NormalBlock::encode));
    }
}
