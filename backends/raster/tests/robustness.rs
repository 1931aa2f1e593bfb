//! Hard input, errors, attributes, and structs that two languages share.

mod common;

use std::collections::BTreeSet;

use common::{exact, found, voxelizer};
use esvo_raster::{
    Looks, Material, Method, Options, RasterError, Surface, Texture, TriangleLook, Voxelizer, Wanted, Wrap, morton,
    morton_place,
};
use glam::DVec3;

fn surface(corners: &[[DVec3; 3]]) -> Surface<'_> {
    Surface { corners, looks: None }
}

#[test]
fn sheets_between_voxels_belong_to_both_sides() {
    let Some(voxelizer) = voxelizer() else { return };
    for axis in 0..3 {
        let mut corners = [[0.25, 0.25], [0.75, 0.25], [0.5, 0.75]].map(|[u, v]| {
            let mut p = [0.0; 3];
            (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (0.5, u, v);
            DVec3::from(p)
        });
        for mirrored in [false, true] {
            if mirrored {
                corners.swap(0, 1);
            }
            let exact = exact(&[corners], 4);
            let layers: BTreeSet<u32> = exact.iter().map(|&code| morton_place(code)[axis]).collect();
            assert_eq!(layers, BTreeSet::from([7, 8]));
            for method in [Method::ExpandedTested, Method::Compute] {
                let codes = found(voxelizer, &[corners], 4, method).unwrap().codes;
                assert!(codes.iter().eq(exact.iter()), "{method}, axis {axis}");
            }
        }
    }
}

#[test]
fn borders_of_the_grid_and_what_is_beyond_them() {
    let Some(voxelizer) = voxelizer() else { return };
    let p = DVec3::new;
    // In the faces of the grid at both ends, through the grid from far outside, outside of it.
    let corners = [
        [p(0.0, 0.0, 0.0), p(1.0, 0.0, 0.0), p(0.0, 1.0, 0.0)],
        [p(1.0, 1.0, 1.0), p(0.0, 1.0, 1.0), p(1.0, 0.0, 1.0)],
        [p(-30.0, -20.0, 0.3), p(40.0, -20.0, 0.4), p(0.5, 60.0, 0.7)],
        [p(1.5, 0.2, 0.2), p(1.9, 0.2, 0.2), p(1.5, 0.9, 0.2)],
    ];
    let exact = exact(&corners, 4);
    for method in [Method::ExpandedTested, Method::Compute] {
        let codes: BTreeSet<u64> = found(voxelizer, &corners, 4, method).unwrap().codes.into_iter().collect();
        let missing = exact.difference(&codes).count();
        assert!(missing == 0, "{method}: {missing} missing");
        let extra: Vec<_> = codes.difference(&exact).collect();
        assert!(method != Method::Compute || extra.is_empty(), "{extra:?}");
        assert!(extra.iter().all(|&&code| common::is_within_bound(&corners, 4, code)), "{method}: {extra:?}");
    }
    for method in Method::ALL {
        let Some(voxels) = found(voxelizer, &corners, 4, method) else { continue };
        assert!(!voxels.codes.is_empty() && voxels.codes.iter().all(|&code| code < 1 << 12), "{method}");
    }
}

#[test]
fn triangles_without_an_area_are_no_error() {
    let Some(voxelizer) = voxelizer() else { return };
    let p = DVec3::new;
    let corners = [[p(0.3, 0.3, 0.3); 3], [p(0.1, 0.1, 0.1), p(0.4, 0.4, 0.4), p(0.7, 0.7, 0.7)]];
    for method in Method::ALL {
        let Some(voxels) = found(voxelizer, &corners, 4, method) else { continue };
        if method.is_tested() {
            // What a point or a line touches, and what single precision cannot tell from it.
            let exact = exact(&corners, 4);
            assert!(exact.iter().all(|code| voxels.codes.contains(code)), "{method}");
        }
    }
    assert!(found(voxelizer, &[], 4, Method::Compute).unwrap().codes.is_empty());
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let Some(voxelizer) = voxelizer() else { return };
    let p = DVec3::new;
    let good = [[p(0.1, 0.1, 0.1), p(0.9, 0.1, 0.1), p(0.1, 0.9, 0.1)]];
    let refused =
        |corners: &[[DVec3; 3]], options: Options<'_>| voxelizer.voxelize(&surface(corners), &options).unwrap_err();
    assert_eq!(refused(&good, Options::new(0, Method::Compute)), RasterError::Level(0));
    assert!(refused(&good, Options::new(13, Method::DominantAxis)).to_string().contains("levels 1 to 12"));
    for bad in [f64::NAN, f64::INFINITY, -1e9] {
        let corners = [good[0], [p(0.1, bad, 0.1), p(0.9, 0.1, 0.1), p(0.1, 0.9, 0.1)]];
        let text = refused(&corners, Options::new(4, Method::Compute)).to_string();
        assert!(text.starts_with("triangle 1 has a corner at"), "{text}");
    }
    let long = [[p(-100.0, 0.1, 0.1), p(100.0, 0.1, 0.1), p(0.1, 0.9, 0.1)]];
    let text = refused(&long, Options::new(8, Method::ExpandedTested)).to_string();
    assert!(text.contains("51200 voxels long") && text.contains("compute"), "{text}");
    let codes: BTreeSet<u64> = found(voxelizer, &long, 8, Method::Compute).unwrap().codes.into_iter().collect();
    assert_eq!(codes, exact(&long, 8));
    // As far as corners may be: single precision then knows next to nothing, and the processor decides.
    let far = [[p(-200.0, -150.0, 0.3), p(250.0, -180.0, 0.9), p(10.0, 256.0, -0.2)]];
    let codes: BTreeSet<u64> = found(voxelizer, &far, 6, Method::Compute).unwrap().codes.into_iter().collect();
    assert_eq!(codes, exact(&far, 6));
    let wanted = Options { wanted: Wanted { colors: true, normals: false }, ..Options::new(4, Method::Compute) };
    assert!(refused(&good, wanted).to_string().contains("has no colours and normals"));
    let looks = Looks::default();
    let with = Surface { corners: &good, looks: Some(&looks) };
    assert!(voxelizer.voxelize(&with, &wanted).unwrap_err().to_string().contains("0 looks were given for 1 triangles"));
    assert!("dominant-axis".parse() == Ok(Method::DominantAxis) && "c'".parse() == Ok(Method::ExpandedClipped));
    assert!("z".parse::<Method>().unwrap_err().contains("there is no method z"));
}

/// Two sheets above each other, one red and one with a texture of four colours, and a thin one whose sides face each other.
fn painted() -> (Vec<[DVec3; 3]>, Looks) {
    let p = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let sheet =
        |z: f64| [[p(0.0, 0.0, z), p(1.0, 0.0, z), p(1.0, 1.0, z)], [p(0.0, 0.0, z), p(1.0, 1.0, z), p(0.0, 1.0, z)]];
    let corners = [sheet(0.21), sheet(0.61), sheet(0.90), sheet(0.91)].concat();
    let uvs = [[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]];
    let texels = vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]];
    let texture =
        Texture { width: 2, height: 2, mips: vec![texels, vec![[188, 188, 188, 255]]], wrap: [Wrap::Clamp; 2] };
    let look = |index: usize| {
        let up = if index < 6 { 1.0 } else { -1.0 };
        TriangleLook {
            normals: [[0.0, 0.0, up]; 3],
            uvs: uvs[index % 2],
            colors: [[1.0; 3]; 3],
            material: u32::from(index / 2 == 1),
        }
    };
    let materials =
        vec![Material { color: [1.0, 0.0, 0.0], texture: None }, Material { color: [1.0; 3], texture: Some(0) }];
    (corners, Looks { triangles: (0..8).map(look).collect(), materials, textures: vec![texture] })
}

#[test]
fn colours_and_normals_are_those_of_the_triangles() {
    let Some(voxelizer) = voxelizer() else { return };
    let (corners, looks) = painted();
    let wanted = Wanted { colors: true, normals: true };
    for method in [Method::DominantAxis, Method::ExpandedTested, Method::Compute] {
        let run = || {
            let surface = Surface { corners: &corners, looks: Some(&looks) };
            voxelizer.voxelize(&surface, &Options { wanted, ..Options::new(4, method) }).unwrap()
        };
        let (first, second) = (run(), run());
        assert_eq!(first.codes, second.codes);
        assert_eq!(first.attributes, second.attributes, "two runs of {method} differ");
        assert_eq!(first.codes.len(), first.attributes.len());
        let at = |x: u32, y: u32, z: u32| {
            let index = first.codes.binary_search(&morton([x, y, z])).unwrap();
            first.attributes[index]
        };
        assert_eq!(at(3, 5, 3).color, [255, 0, 0]);
        assert_eq!(at(3, 5, 3).normal, [0.0, 0.0, 1.0]);
        // The first row of a texture is its top, where v is 0: y is 1 there.
        assert_eq!([at(1, 14, 9).color, at(14, 14, 9).color], [[255, 0, 0], [0, 255, 0]], "{method}");
        assert_eq!([at(1, 1, 9).color, at(14, 1, 9).color], [[0, 0, 255], [255, 255, 255]], "{method}");
        let middle = at(7, 8, 9).color;
        assert!(middle.iter().all(|&c| (150..=225).contains(&c)), "{middle:?}");
        // Both sides of a thin sheet: one of them, not what is left of their sum.
        assert_eq!(at(3, 5, 14).normal.map(f32::abs), [0.0, 0.0, 1.0]);
    }
}

#[test]
fn broken_bounds_are_caught() {
    let Some(voxelizer) = voxelizer() else { return };
    // The negative control of the property test: a decision that is wrong for one pair is a difference.
    let p = DVec3::new;
    let corners = [[p(0.25, 0.25, 0.5), p(0.75, 0.25, 0.5), p(0.5, 0.75, 0.5)]];
    let nobody = |pairs: &[esvo_raster::Pair]| vec![false; pairs.len()];
    let options = Options { decide: Some(&nobody), ..Options::new(4, Method::Compute) };
    let wrong = voxelizer.voxelize(&surface(&corners), &options).unwrap();
    assert!(wrong.stats.undecided > 0 && wrong.codes.len() < exact(&corners, 4).len());
}

#[test]
fn a_list_is_made_of_any_grid() {
    if voxelizer().is_none() {
        return;
    }
    // Grids smaller than a word and than a block, and a device that is used by two voxelizers in turn.
    let voxelizer = Voxelizer::open(None).unwrap();
    let p = DVec3::new;
    let corners = [[p(0.1, 0.1, 0.1), p(0.9, 0.2, 0.4), p(0.2, 0.9, 0.9)]];
    for level in 1..=7 {
        let codes: Vec<u64> = exact(&corners, level).into_iter().collect();
        assert_eq!(found(&voxelizer, &corners, level, Method::Compute).unwrap().codes, codes, "level {level}");
    }
}
