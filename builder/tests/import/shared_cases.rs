//! The folder `../shared/cases`, where it is at hand: what people met, with the right number of voxels of each colour.

use std::path::Path;

use esvo_builder::import::load_mesh;

use crate::support::{colors, voxels};

const RED: [u8; 3] = [255, 0, 0];
const GREEN: [u8; 3] = [0, 255, 0];
const BLUE: [u8; 3] = [0, 0, 255];
const WHITE: [u8; 3] = [255; 3];
/// The colour of meshes without any.
const GREY: [u8; 3] = [231; 3];

/// A texture with a red and a blue half. Its border is blurred at the seam of the image, too.
const HALVES: &[([u8; 3], usize)] = &[(BLUE, 30), ([81, 0, 245], 2), ([245, 0, 81], 2), (RED, 30)];

/// One red dot on white, blurred at its edge.
const DOT: &[([u8; 3], usize)] =
    &[(RED, 4), ([255, 207, 207], 8), ([255, 239, 239], 2), ([255, 240, 240], 2), (WHITE, 240)];

/// A file, the levels, and the voxels of each colour, the least colour first.
type Case = (&'static str, u32, &'static [([u8; 3], usize)]);

const CASES: &[Case] = &[
    ("01-obj-concave/u.obj", 4, &[(GREY, 216)]),
    ("01-obj-concave/u_reference.obj", 4, &[(GREY, 216)]),
    ("01-obj-concave/u.obj", 3, &[(GREY, 54)]),
    ("04-obj-mixed-vertex-colours/a.obj", 4, &[(GREEN, 26), (RED, 21)]),
    ("05-obj-material-hash/a.obj", 4, &[(BLUE, 26), (RED, 21)]),
    ("05-obj-material-hash/b.obj", 3, &[(RED, 43)]),
    ("06-obj-mixed-corners/a.obj", 4, &[(GREY, 256)]),
    ("07-mtl-keyword-case/a.obj", 3, &[(RED, 64)]),
    ("07-mtl-keyword-case/b.obj", 3, &[(BLUE, 64)]),
    ("07-mtl-keyword-case/c.obj", 3, &[(RED, 33)]),
    ("09-mtl-backslash-bmp/a.obj", 3, &[(RED, 64)]),
    ("09-mtl-backslash-bmp/b.obj", 3, &[(RED, 64)]),
    ("09-mtl-backslash-bmp/c.obj", 3, &[(WHITE, 64)]),
    ("10-mtl-filename-case/a.obj", 3, &[(RED, 64)]),
    ("10-mtl-filename-case/b.obj", 3, &[(RED, 64)]),
    ("11-mtl-options-after-name/a.obj", 3, &[(RED, 64)]),
    ("12-obj-index-without-list/a.obj", 4, &[(GREY, 151)]),
    ("13-cr-only/a.obj", 3, &[(GREY, 43)]),
    ("13-cr-only/a.stl", 3, &[(GREY, 43)]),
    ("13-cr-only/a.ply", 3, &[(GREY, 43)]),
    ("13-cr-only/b.obj", 3, &[(RED, 43)]),
    ("14-obj-continuation/a.obj", 3, &[(GREY, 64)]),
    ("14-obj-continuation/b.obj", 3, &[(GREY, 64)]),
    ("14-obj-continuation/c.obj", 3, &[(RED, 43)]),
    ("16-bom/a.obj", 3, &[(RED, 43)]),
    ("31-stl-ascii-variants/bom.stl", 3, &[(GREY, 43)]),
    ("19-mtl-opacity/a.obj", 3, &[(BLUE, 9)]),
    ("20-obj-weights-freeform/w.obj", 3, &[(GREY, 43)]),
    ("20-obj-weights-freeform/w2.obj", 3, &[(GREY, 43)]),
    ("20-obj-weights-freeform/w7.obj", 3, &[(RED, 43)]),
    ("22-ply-wedge-texcoord/a.ply", 3, HALVES),
    ("23-ply-face-colour/a.ply", 3, &[(BLUE, 9), (RED, 9)]),
    ("25-ply-binary-variants/blank.ply", 3, &[(GREY, 43)]),
    ("25-ply-binary-variants/rgb.ply", 3, &[(RED, 43)]),
    ("25-ply-binary-variants/floatcol.ply", 3, &[(RED, 43)]),
    ("25-ply-binary-variants/floatcol255.ply", 3, &[([128, 64, 0], 43)]),
    ("25-ply-binary-variants/sized.ply", 3, &[(RED, 43)]),
    ("25-ply-binary-variants/be.ply", 3, &[(RED, 64)]),
    ("25-ply-binary-variants/le.ply", 3, &[(RED, 64)]),
    ("25-ply-binary-variants/crlf.ply", 3, &[(RED, 64)]),
    ("26-nan-vertices/unused.ply", 3, &[(GREY, 43)]),
    ("26-nan-vertices/unused.obj", 3, &[(GREY, 43)]),
    ("26-nan-vertices/nannormal.obj", 3, &[(GREY, 43)]),
    ("26-nan-vertices/nanuv.obj", 3, &[(GREY, 43)]),
    ("26-nan-vertices/nanuv-ind.obj", 3, &[(GREY, 43)]),
    ("28-ply-two-textures/a.ply", 3, &[(BLUE, 9), (RED, 9)]),
    ("29-stl-colours/magics.stl", 3, &[(BLUE, 9), (RED, 9)]),
    ("29-stl-colours/viscam.stl", 3, &[(BLUE, 9), (RED, 9)]),
    ("30-stl-count/zero.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/spaces.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/minus1.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid_spaces.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid_spaces_trailing.stl", 3, &[(GREY, 18)]),
    ("31-stl-ascii-variants/all_space.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/oneline.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/caps.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/color.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/crlf.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/endloop_space.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/endsolidname.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/leadingblank.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/nosolid.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/utf16.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/twosolids.stl", 3, &[(GREY, 18)]),
    ("50-outlier/degenerate_far.obj", 3, &[(GREY, 296)]),
    ("50-outlier/stray_vertex.obj", 3, &[(GREY, 296)]),
    ("53-quoted-names/model.obj", 3, &[(RED, 64)]),
    ("53-quoted-names/unquoted_lib.obj", 3, &[(RED, 64)]),
    ("54-mtl-option-one-number/o1.obj", 3, &[(RED, 64)]),
    ("54-mtl-option-one-number/s1clamp.obj", 3, &[(RED, 64)]),
    ("54-mtl-option-one-number/s3.obj", 3, &[(RED, 64)]),
    ("54-mtl-option-one-number/mixed.obj", 3, &[(RED, 64)]),
    ("55-mtllib-escaped-blanks/a.obj", 3, &[(RED, 64)]),
    ("55-mtllib-escaped-blanks/mtl filename with whitespace issue46.obj", 3, &[(GREEN, 296)]),
    ("57-undecodable-images/kd.obj", 3, &[(RED, 64)]),
    ("57-undecodable-images/bump.obj", 3, &[(RED, 64)]),
    ("58-nan-normals/a.ply", 3, &[(GREY, 64)]),
    ("58-nan-normals/ind.ply", 3, &[(GREY, 64)]),
    ("58-nan-normals/ind.obj", 3, &[(GREY, 43)]),
    ("58-nan-normals/nanind.obj", 3, &[(GREY, 43)]),
    ("58-nan-normals/numbers.ply", 3, &[(GREY, 32)]),
    ("58-nan-normals/tabs.ply", 3, &[(GREY, 43)]),
    ("59-dangling-attribute-index/vt_vn.obj", 3, &[(GREY, 43)]),
    ("59-dangling-attribute-index/vt_two_of_three.obj", 3, &[(GREY, 43)]),
    ("02-mtl-scale-offset/q.obj", 4, &[(BLUE, 128), (RED, 128)]),
    ("02-mtl-scale-offset/o.obj", 3, HALVES),
    ("02-mtl-scale-offset/n.obj", 3, HALVES),
    ("03-mtl-clamp/a.obj", 4, DOT),
];

#[test]
fn every_case_gives_its_right_voxels() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/cases");
    if !folder.is_dir() {
        eprintln!("skipped: the folder ../shared/cases is not at hand");
        return;
    }
    let mut wrong = Vec::new();
    for (name, levels, expected) in CASES {
        match load_mesh(&folder.join(name)) {
            Ok(mesh) => {
                let found = colors(&voxels(&mesh, *levels));
                if found != *expected {
                    wrong.push(format!("{name}: {found:?} instead of {expected:?}; {:?}", mesh.warnings));
                }
            }
            Err(error) => wrong.push(error.to_string()),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
