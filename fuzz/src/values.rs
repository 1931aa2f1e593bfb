//! Contours, colour blocks and normal blocks: decoded values are in range, and encoders keep their bounds.

use esvo_format::{ColorBlock, Contour, NormalBlock, RawNormal};
use glam::Vec3;

fn word(data: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|k| data.get(4 * at + k).copied().unwrap_or(0)))
}

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    let words: [u32; 20] = std::array::from_fn(|at| word(data, at));
    contours(words[0], words[1], words[2]);
    colors(words[0], words[1], &words);
    normals(&words);
}

fn contours(any: u32, lo: u32, hi: u32) {
    let slab = Contour(any).decode();
    assert!(slab.normal.iter().all(|n| (-32.0..32.0).contains(n)) && slab.position.abs() <= 48.0);
    assert!((0.0..=96.0).contains(&slab.thickness));
    let (lo, hi) = (f64::from(lo as i32) * 2f64.powi(-25), f64::from(hi as i32) * 2f64.powi(-25));
    let (lo, hi) = (lo.min(hi), lo.max(hi));
    let Some(bits) = Contour::encode_normal(slab.normal) else {
        assert_eq!(slab.normal, [0.0; 3]);
        return;
    };
    assert_ne!(bits, 0);
    if let Some(contour) = Contour::encode_bounds(bits, lo, hi) {
        let slab = contour.decode();
        assert!(slab.lo() <= lo.max(-48.0) && hi.min(48.0) <= slab.hi(), "{lo} {hi} became {slab:?}");
        assert_ne!(contour.0 << 14, 0);
    }
}

fn colors(head: u32, indices: u32, words: &[u32; 20]) {
    let block = ColorBlock { head, indices };
    assert!((0..16).flat_map(|i| block.decode(i)).all(|c| (0.0..=1.0).contains(&c)));
    let colors: [Option<[u8; 3]>; 16] = std::array::from_fn(|i| {
        let [r, g, b, used] = words[4 + i].to_le_bytes();
        (used & 3 != 0).then_some([r, g, b])
    });
    let block = ColorBlock::encode(&colors);
    let used: Vec<(usize, [f32; 3])> = (colors.iter().enumerate())
        .filter_map(|(i, color)| color.map(|c| (i, c.map(|c| f32::from(c) / 255.0))))
        .collect();
    let distance = |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>().sqrt();
    let furthest = used.iter().flat_map(|a| used.iter().map(move |b| distance(a.1, b.1))).fold(0.0, f32::max);
    // The root mean square error is at most the largest distance between colours plus two steps of five bits. A single
    // colour may exceed that, as references may lie outside the colours if that improves the others.
    let total: f32 = used.iter().map(|(i, color)| distance(block.decode(*i), *color).powi(2)).sum();
    let step = 2.0 / 32.0 * 3f32.sqrt();
    assert!(total <= used.len() as f32 * (furthest + step).powi(2), "{colors:?} became {block:?}");
}

fn normals(words: &[u32; 20]) {
    let block = NormalBlock { base: RawNormal(words[0]), u_indices: words[1], axes: words[2], v_indices: words[3] };
    let unit = |n: Vec3| (n.length() - 1.0).abs() < 1e-3;
    assert!((0..16).all(|i| unit(block.decode(i))));
    assert!(unit(RawNormal(words[0]).decode()));
    let normals: [Option<Vec3>; 16] =
        std::array::from_fn(|i| (words[4 + i] & 3 != 0).then(|| RawNormal(words[4 + i]).decode()));
    let encoded = NormalBlock::encode(&normals);
    let count = normals.iter().flatten().count();
    for (i, normal) in normals.iter().enumerate() {
        let found = encoded.decode(i);
        assert!(unit(found));
        if let (Some(normal), 1) = (normal, count) {
            assert!(found.dot(*normal) > 0.9999, "{normal} became {found}");
        }
    }
}
