//! Each method against the exact set of voxels.

mod common;

use std::collections::BTreeSet;

use common::{exact, found, is_in_border, is_within_bound, voxelizer};
use esvo_builder::Mesh;
use esvo_builder::cells::PreparedMesh;
use esvo_raster::{Method, Options, Pair, Surface, Voxelizer, morton_place};
use glam::{DMat4, DVec3};
use proptest::prelude::*;

fn set(voxelizer: &Voxelizer, corners: &[[DVec3; 3]], level: u32, method: Method) -> Option<BTreeSet<u64>> {
    let voxels = found(voxelizer, corners, level, method)?;
    assert!(
        voxels.codes.is_sorted() && voxels.codes.windows(2).all(|pair| pair[0] < pair[1]),
        "{method}: not ascending"
    );
    Some(voxels.codes.into_iter().collect())
}

/// A wavy sheet of triangles, about three voxels large at level 5.
fn sheet() -> Vec<[DVec3; 3]> {
    let at = |i: u32, j: u32| {
        let (x, y) = (0.05 + 0.09 * f64::from(i), 0.05 + 0.09 * f64::from(j));
        DVec3::new(x, y, 0.5 + 0.3 * (5.0 * x).sin() * (4.0 * y).cos())
    };
    let mut corners = Vec::new();
    for (i, j) in (0..10).flat_map(|i| (0..10).map(move |j| (i, j))) {
        corners.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        corners.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    corners
}

/// A triangle of one of several kinds: free, in a plane between voxels, one with an edge almost along an axis, a needle, one of a point's size, one far larger than the grid.
fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
    let corner = || prop::array::uniform3(0.0..1.0f64).prop_map(DVec3::from);
    let grid = || prop::array::uniform3(0..=32u32).prop_map(|at| DVec3::from(at.map(|x| f64::from(x) / 32.0)));
    prop_oneof![
        4 => [corner(), corner(), corner()],
        3 => [grid(), grid(), grid()],
        2 => ([grid(), grid(), grid()], 0..3usize, 0..=32u32).prop_map(|(mut corners, axis, at)| {
            corners.iter_mut().for_each(|corner| corner[axis] = f64::from(at) / 32.0);
            corners
        }),
        // An edge that is almost along an axis, in or near a border of voxels.
        3 => ([grid(), grid(), grid()], 0..3usize, -50..-6i32, any::<bool>()).prop_map(|(mut corners, axis, e, up)| {
            corners[1][axis] = corners[0][axis] + if up { f64::from(e).exp2() } else { -f64::from(e).exp2() };
            corners
        }),
        2 => (corner(), corner(), corner(), -40..-3i32).prop_map(|(a, b, c, e)| [a, b, a + (b - a) * 0.4 + (c - a) * f64::from(e).exp2()]),
        2 => (corner(), corner(), corner(), -30..-3i32).prop_map(|(a, b, c, e)| [a, a + (b - a) * f64::from(e).exp2(), a + (c - a) * f64::from(e).exp2()]),
        1 => (corner(), corner(), corner()).prop_map(|(a, b, c)| [a * 40.0 - 20.0, b * 40.0 - 20.0, c * 40.0 - 20.0]),
    ]
}

#[test]
fn compute_is_exact_and_tested_methods_differ_within_their_bound() {
    let Some(voxelizer) = voxelizer() else { return };
    let config = ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() };
    let extra = std::cell::Cell::new(0);
    proptest!(config, |(corners in prop::collection::vec(triangle(), 1..6))| {
        let exact = exact(&corners, 5);
        let computed = set(voxelizer, &corners, 5, Method::Compute).unwrap();
        prop_assert!(computed.is_superset(&exact), "misses {:?}", exact.difference(&computed).collect::<Vec<_>>());
        for &code in computed.difference(&exact) {
            prop_assert!(is_in_border(&corners, 5, code), "has {:?}", morton_place(code));
        }
        for method in [Method::ExpandedTested, Method::HardwareTested] {
            let Some(found) = set(voxelizer, &corners, 5, method) else { continue };
            let missing: Vec<_> = exact.difference(&found).map(|&code| morton_place(code)).collect();
            prop_assert!(missing.is_empty(), "{} misses {:?}", method, missing);
            for &code in found.difference(&exact) {
                extra.set(extra.get() + 1);
                prop_assert!(is_within_bound(&corners, 5, code), "{} has {:?}", method, morton_place(code));
            }
        }
    });
    println!("{} extra voxels, all within the bound", extra.get());
}

#[test]
fn compute_finds_the_builders_voxels() {
    let Some(voxelizer) = voxelizer() else { return };
    let config = ProptestConfig { cases: 150, failure_persistence: None, ..ProptestConfig::default() };
    let unit = |corner: &DVec3| corner.cmpge(DVec3::ZERO).all() && corner.cmple(DVec3::ONE).all();
    let undecided = std::cell::Cell::new(0);
    proptest!(config, |(triangles in prop::collection::vec(triangle(), 1..6))| {
        let mut positions = Vec::new();
        // The first spans the unit cube, so that it is the root cube.
        positions.extend([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]]);
        positions.extend(triangles.iter().filter(|triangle| triangle.iter().all(unit)).flatten().map(DVec3::to_array));
        let indices = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = Mesh::from_triangles(positions, indices).unwrap();
        let prepared = PreparedMesh::new(&mesh, 5).unwrap();
        prop_assert_eq!(prepared.octree_to_mesh(), DMat4::IDENTITY);
        let decide = |pairs: &[Pair]| -> Vec<bool> {
            pairs.iter().map(|pair| prepared.meets(pair.triangle as usize, pair.cell, 5)).collect()
        };
        let surface = Surface { corners: prepared.corners(), looks: None };
        let options = Options { decide: Some(&decide), ..Options::new(5, Method::Compute) };
        let found = voxelizer.voxelize(&surface, &options).unwrap();
        undecided.set(undecided.get() + found.stats.undecided);
        let exact = prepared.cells(5).unwrap();
        let cells = |codes: &[u64], of: &[u64]| -> Vec<[u32; 3]> {
            codes.iter().filter(|code| of.binary_search(code).is_err()).map(|&code| morton_place(code)).collect()
        };
        prop_assert!(found.codes == exact, "missing {:?}, extra {:?}", cells(&exact, &found.codes), cells(&found.codes, &exact));
    });
    assert!(undecided.get() > 1000, "{} pairs were left to the builder", undecided.get());
}

#[test]
fn a_sheet_by_every_method() {
    let Some(voxelizer) = voxelizer() else { return };
    let corners = sheet();
    let exact = exact(&corners, 5);
    let text: Vec<String> = Method::ALL
        .into_iter()
        .filter_map(|method| {
            let found = set(voxelizer, &corners, 5, method)?;
            let (missing, extra) = (exact.difference(&found).count(), found.difference(&exact).count());
            Some(format!("{}: {missing} missing, {extra} extra", method.letter()))
        })
        .collect();
    let of = |letter: &str| -> Vec<usize> {
        let line = text.iter().find(|line| line.starts_with(&format!("{letter}:"))).unwrap();
        line.split(' ').filter_map(|word| word.parse().ok()).collect()
    };
    println!("{} voxels\n{}", exact.len(), text.join("\n"));
    // What the document says of each.
    assert!(of("a")[0] > of("b")[0] && of("b")[0] > of("c")[0], "{text:?}");
    assert!(of("c")[1] > of("d")[1] && of("d") == [0, 0] && of("g") == [0, 0], "{text:?}");
    assert!(of("e4")[0] < of("b")[0], "{text:?}");
}

/// Whether the missing voxels of a method are all cracks, all holes, or both.
fn classes(voxelizer: &Voxelizer, corners: &[[DVec3; 3]], level: u32, method: Method) -> (usize, usize) {
    let found = set(voxelizer, corners, level, method).unwrap();
    let missing: Vec<u64> = exact(corners, level).difference(&found).copied().collect();
    let cracks = voxelizer.cracks(&Surface { corners, looks: None }, &Options::new(level, method), &missing).unwrap();
    assert!(cracks.iter().all(|code| missing.contains(code)));
    (cracks.len(), missing.len() - cracks.len())
}

#[test]
fn a_steep_plane_has_cracks_if_it_is_seen_from_above() {
    let Some(voxelizer) = voxelizer() else { return };
    // The document's Figure 4: three voxels up for each voxel along x.
    let (a, b) = (DVec3::new(0.3, 0.1, 0.05), DVec3::new(0.59, 0.1, 0.92));
    let up = DVec3::new(0.0, 0.8, 0.0);
    let corners = [[a, b, b + up], [a, b + up, a + up]];
    let (cracks, holes) = classes(voxelizer, &corners, 5, Method::FixedAxis);
    assert!(cracks > 300, "{cracks} cracks, {holes} holes");
    // Seen from its own side, only what touches the border of a pixel is missing: no row of the plane is without voxels.
    let found = set(voxelizer, &corners, 5, Method::DominantAxis).unwrap();
    let rows: BTreeSet<u32> =
        found.iter().map(|&code| morton_place(code)).filter(|cell| cell[1] == 10).map(|cell| cell[2]).collect();
    let all: BTreeSet<u32> = exact(&corners, 5)
        .iter()
        .map(|&code| morton_place(code))
        .filter(|cell| cell[1] == 10)
        .map(|cell| cell[2])
        .collect();
    assert!(all.len() - rows.len() <= 2, "{rows:?} of {all:?}");
    let fixed = set(voxelizer, &corners, 5, Method::FixedAxis).unwrap();
    let rows = fixed.iter().map(|&code| morton_place(code)).filter(|cell| cell[1] == 10).count();
    assert!(rows * 2 < all.len(), "{rows} of {} rows", all.len());
}

#[test]
fn triangles_projected_along_different_axes_have_holes_between_them() {
    let Some(voxelizer) = voxelizer() else { return };
    // The document's Figures 7 and 8: the strip in the middle is steep and lies between two centres of pixels.
    let at = |x: f64, z: f64| [DVec3::new(x / 16.0, 0.03, z / 16.0), DVec3::new(x / 16.0, 0.97, z / 16.0)];
    let profile = [at(1.2, 5.3), at(6.7, 4.7), at(6.9, 5.45), at(12.2, 5.2)];
    let mut corners = Vec::new();
    for pair in profile.windows(2) {
        corners.push([pair[0][0], pair[1][0], pair[1][1]]);
        corners.push([pair[0][0], pair[1][1], pair[0][1]]);
    }
    let (_, holes) = classes(voxelizer, &corners, 4, Method::DominantAxis);
    let (_, none) = classes(voxelizer, &corners, 4, Method::ExpandedTested);
    assert!(holes >= 14 && none == 0, "{holes} holes");
}

#[test]
fn needles_have_extra_voxels_where_edges_are_moved() {
    let Some(voxelizer) = voxelizer() else { return };
    // The document's Figures 9 and 10.
    let corners = [[DVec3::new(0.25, 0.30, 0.4), DVec3::new(0.70, 0.61, 0.5), DVec3::new(0.71, 0.625, 0.5)]];
    let exact = exact(&corners, 5);
    let extra = |method| set(voxelizer, &corners, 5, method).unwrap().difference(&exact).count();
    let (plain, clipped, tested) =
        (extra(Method::Expanded), extra(Method::ExpandedClipped), extra(Method::ExpandedTested));
    assert!(plain > clipped + 5 && clipped > tested && tested == 0, "{plain}, {clipped}, {tested}");
    // The tests, not the clip alone, remove them.
    let pixels = |method| {
        voxelizer.pixels(&Surface { corners: &corners, looks: None }, &Options::new(5, method)).unwrap().shaded
    };
    assert!(pixels(Method::Expanded) > pixels(Method::DominantAxis), "no further pixels");
}

#[test]
fn tiles_make_no_difference() {
    if voxelizer().is_none() {
        return;
    }
    let corners = sheet();
    let (whole, tiled) = (Voxelizer::open(None).unwrap(), Voxelizer::open(None).unwrap().with_tiles(8));
    for method in Method::ALL {
        let Some(found_whole) = found(&whole, &corners, 6, method) else { continue };
        let found_tiled = found(&tiled, &corners, 6, method).unwrap();
        if !matches!(method, Method::Expanded | Method::ExpandedClipped | Method::Multisampled(_)) {
            // The others may write voxels beyond a tile that shades none of the triangle's pixels.
            assert_eq!(found_whole.codes, found_tiled.codes, "{method}");
        }
        assert_eq!((found_whole.stats.tiles, found_whole.stats.tiles_of_grid), (1, 1));
        assert!(found_tiled.stats.tiles < found_tiled.stats.tiles_of_grid, "{:?}", found_tiled.stats);
    }
}
