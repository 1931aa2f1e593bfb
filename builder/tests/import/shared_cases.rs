//! The folder `../shared/cases`, where it is at hand: what people met, with the right number of voxels of each colour.
//!
//! The folder is no part of the repository. The same situations are tested with small files made here:
//!
//! | Case | Test |
//! | --- | --- |
//! | 01-obj-concave | `cases::concave_polygons_leave_their_notches_open`, `polygon` |
//! | 02-mtl-scale-offset, 03-mtl-clamp | `cases::texture_statements_scale_move_and_clamp` |
//! | 04-obj-mixed-vertex-colours | `obj::vertex_colours_are_display_values` |
//! | 05-obj-material-hash | `cases::materials_are_found_by_any_spelling` |
//! | 06-obj-mixed-corners | `obj::bad_attributes_are_dropped_with_their_place` |
//! | 07-mtl-keyword-case | `cases::masks_cut_holes_whatever_their_size_and_without_a_texture`, `mtl::keywords_may_be_in_any_case_and_lines_may_continue` |
//! | 09-mtl-backslash-bmp, 10-mtl-filename-case | `cases::texture_statements_scale_move_and_clamp`, `names::files_are_found_in_another_case_if_only_one_fits` |
//! | 11-mtl-options-after-name | `cases::texture_statements_scale_move_and_clamp`, `map_statement::names_are_found_between_options` |
//! | 12-obj-index-without-list | `obj::bad_attributes_are_dropped_with_their_place` |
//! | 13-cr-only | `cases::lines_end_and_continue_in_every_way`, `cases::stl_text_may_be_broken_into_lines_anyhow`, `ply_file::headers_of_all_line_ends_are_read` |
//! | 14-obj-continuation, 16-bom | `cases::lines_end_and_continue_in_every_way` |
//! | 19-mtl-opacity | `cases::what_is_invisible_leaves_no_voxels` |
//! | 20-obj-weights-freeform | `obj::vertex_colours_are_display_values`, `obj::free_form_surfaces_are_named` |
//! | 22-ply-wedge-texcoord, 23-ply-face-colour, 28-ply-two-textures | `cases::ply_faces_have_colours_textures_and_coordinates_of_their_own` |
//! | 25-ply-binary-variants | `ply::all_encodings_give_the_same_mesh`, `ply_file::headers_of_all_line_ends_are_read`, `ply_file::text_may_be_broken_into_lines_anyhow` |
//! | 26-nan-vertices, 58-nan-normals | `cases::ply_values_that_are_not_finite_are_dropped_where_nothing_needs_them`, `obj::bad_attributes_are_dropped_with_their_place` |
//! | 29-stl-colours | `cases::stl_colours_follow_both_conventions` |
//! | 30-stl-count | `cases::stl_counts_that_were_never_written_follow_from_the_length` |
//! | 31-stl-ascii-variants | `cases::stl_text_may_be_broken_into_lines_anyhow` |
//! | 32-gltf-skin | `gltf_cases::the_joints_place_a_skinned_mesh_and_its_node_does_not` |
//! | 33-gltf-wrap | `gltf_colors::samplers_repeat_mirror_or_clamp` |
//! | 34-gltf-gpu-instancing | `gltf_cases::instances_of_a_node_are_all_drawn` |
//! | 35-gltf-emissive-texture | `gltf_colors::emission_is_the_colour_where_the_base_colour_is_black` |
//! | 36-gltf-compressed | `gltf_colors::images_of_extensions_are_preferred_and_the_others_replace_them`, `gltf_cases::compressed_geometry_is_refused_by_name_unless_there_is_a_copy` |
//! | 37-gltf-vertex-alpha | `gltf_colors::the_opacity_of_vertices_cuts_masked_and_blended_materials` |
//! | 38-gltf-morph | `gltf_cases::morph_targets_have_their_default_weights` |
//! | 41-gltf-geometry | `gltf_cases::hidden_nodes_are_left_out_but_keep_their_place`, `gltf_colors::opacity_0_is_invisible`, `gltf` |
//! | 50-outlier | `build::triangles_without_area_do_not_count_for_the_bounds` |
//! | 53-quoted-names, 55-mtllib-escaped-blanks | `cases::materials_are_found_by_any_spelling`, `names::lists_of_names_are_split_at_blanks_that_separate` |
//! | 54-mtl-option-one-number | `cases::texture_statements_scale_move_and_clamp`, `map_statement::options_have_one_to_three_numbers` |
//! | 56-glb-unpadded-chunk | `gltf_cases::chunks_of_a_glb_may_be_unpadded` |
//! | 57-undecodable-images | `obj::textures_that_cannot_be_decoded_are_treated_as_missing`, `cases::ply_faces_have_colours_textures_and_coordinates_of_their_own`, `gltf_colors::an_image_that_cannot_be_decoded_is_like_one_that_is_missing` |
//! | 59-dangling-attribute-index | `obj::bad_attributes_are_dropped_with_their_place` |

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use esvo_builder::import::load_mesh;
use esvo_builder::{BuildSettings, build};

use crate::support::{colors, lines, voxels};

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
    ("02-mtl-scale-offset/q.obj", 4, &[(BLUE, 128), (RED, 128)]),
    ("02-mtl-scale-offset/o.obj", 3, HALVES),
    ("02-mtl-scale-offset/n.obj", 3, HALVES),
    ("03-mtl-clamp/a.obj", 4, DOT),
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
    ("26-nan-vertices/nanstl.stl", 3, &[(GREY, 43)]),
    ("28-ply-two-textures/a.ply", 3, &[(BLUE, 9), (RED, 9)]),
    ("29-stl-colours/magics.stl", 3, &[(BLUE, 9), (RED, 9)]),
    ("29-stl-colours/viscam.stl", 3, &[(BLUE, 9), (RED, 9)]),
    ("30-stl-count/zero.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/spaces.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/minus1.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid_spaces.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/solid_spaces_trailing.stl", 3, &[(GREY, 18)]),
    ("30-stl-count/more.stl", 3, &[(GREY, 43)]),
    ("31-stl-ascii-variants/bom.stl", 3, &[(GREY, 43)]),
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
    ("32-gltf-skin/node_scaled.gltf", 4, &[(BLUE, 36), (RED, 36)]),
    ("32-gltf-skin/mixamo.gltf", 4, &[(BLUE, 36), (RED, 36)]),
    ("34-gltf-gpu-instancing/optional.gltf", 4, &[(RED, 48)]),
    ("34-gltf-gpu-instancing/required.gltf", 4, &[(RED, 48)]),
    ("35-gltf-emissive-texture/black_base.gltf", 4, &[([0, 200, 0], 256)]),
    ("35-gltf-emissive-texture/black_base_texture.gltf", 4, &[([0, 200, 0], 256)]),
    ("36-gltf-compressed/basisu_required0.gltf", 4, &[(WHITE, 256)]),
    ("36-gltf-compressed/basisu_required1.gltf", 4, &[(WHITE, 256)]),
    ("36-gltf-compressed/draco_with_fallback.gltf", 4, &[(RED, 256)]),
    // It requires the extension, but nothing in it is compressed.
    ("36-gltf-compressed/meshopt.gltf", 4, &[(RED, 256)]),
    ("36-gltf-compressed/webp_fallback0.gltf", 4, &[(RED, 256)]),
    ("36-gltf-compressed/webp_fallback1.gltf", 4, &[(RED, 256)]),
    // The image is lossy: red is brightness 82 and colour differences 90 and 240, which stand for 255, 1, 0.
    ("36-gltf-compressed/webp_plain_source.gltf", 4, &[([255, 1, 0], 256)]),
    ("36-gltf-compressed/webp_required.gltf", 4, &[(RED, 256)]),
    ("37-gltf-vertex-alpha/mask.gltf", 4, &[(BLUE, 36)]),
    ("38-gltf-morph/weight0.gltf", 4, &[(RED, 256)]),
    ("38-gltf-morph/weight1.gltf", 4, &[(RED, 96)]),
    ("41-gltf-geometry/alpha02_mask.gltf", 4, &[(BLUE, 36)]),
    ("41-gltf-geometry/alpha0_blend.gltf", 4, &[(BLUE, 36)]),
    ("41-gltf-geometry/back_blue_front_red.gltf", 4, &[([188, 0, 188], 256)]),
    ("41-gltf-geometry/color_f32.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/color_u16.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/color_u8.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/fan.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/hidden_node.gltf", 4, &[(BLUE, 36)]),
    ("41-gltf-geometry/longer_than_said.glb", 4, &[(RED, 256)]),
    ("41-gltf-geometry/mirrored.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/nonindexed.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/ok.glb", 4, &[(RED, 256)]),
    ("41-gltf-geometry/quantized.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/second_scene_blue.gltf", 4, &[(BLUE, 256)]),
    ("41-gltf-geometry/sparse.gltf", 4, &[(RED, 256)]),
    ("41-gltf-geometry/strip.gltf", 4, &[(RED, 256)]),
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
    ("56-glb-unpadded-chunk/a.glb", 3, &[(RED, 64)]),
    ("57-undecodable-images/kd.obj", 3, &[(RED, 64)]),
    ("57-undecodable-images/bump.obj", 3, &[(RED, 64)]),
    ("57-undecodable-images/colour_ktx2.gltf", 3, &[(WHITE, 64)]),
    ("57-undecodable-images/normal_map_ktx2.gltf", 3, &[(RED, 64)]),
    ("57-undecodable-images/occlusion_ktx2.gltf", 3, &[(RED, 64)]),
    ("58-nan-normals/a.ply", 3, &[(GREY, 64)]),
    ("58-nan-normals/ind.ply", 3, &[(GREY, 64)]),
    ("58-nan-normals/ind.obj", 3, &[(GREY, 43)]),
    ("58-nan-normals/nanind.obj", 3, &[(GREY, 43)]),
    ("58-nan-normals/numbers.ply", 3, &[(GREY, 32)]),
    ("58-nan-normals/tabs.ply", 3, &[(GREY, 43)]),
    ("59-dangling-attribute-index/vt_vn.obj", 3, &[(GREY, 43)]),
    ("59-dangling-attribute-index/vt_two_of_three.obj", 3, &[(GREY, 43)]),
];

/// Files whose texture is read outside 0..=1: the voxels along `u` and along `v`, see [`lines`].
const WRAPPED: &[(&str, &str)] = &[
    ("33-gltf-wrap/repeat.gltf", "rrrwwrrrwwwrrwww"),
    ("33-gltf-wrap/mirror.gltf", "wwwrrrrrwwwwwrrr"),
    ("33-gltf-wrap/clamp.gltf", "rrrrrrrrwwwwwwww"),
];

/// Files that are refused, and what the error says.
const REFUSED: &[(&str, &str)] = &[
    ("20-obj-weights-freeform/free.obj", "free-form"),
    ("26-nan-vertices/used.ply", "vertex 3 is not finite"),
    ("30-stl-count/truncated.stl", "the header declares 2 triangles, but the file ends after 1"),
    ("31-stl-ascii-variants/comma.stl", "line 5"),
    ("31-stl-ascii-variants/empty.stl", "the mesh has no triangles"),
    ("36-gltf-compressed/draco.gltf", "KHR_draco_mesh_compression"),
    ("41-gltf-geometry/json_nan.gltf", "line 3"),
    ("41-gltf-geometry/restart.gltf", "refers to vertex 65535 of 4"),
    ("41-gltf-geometry/shorter_than_said.glb", "the GLB container is truncated"),
    ("50-outlier/all_degenerate.obj", "none of its triangles has an area"),
];

/// The folder of the cases. Prints why a test is skipped if there is none.
fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/cases");
    if !folder.is_dir() {
        eprintln!("skipped: the folder ../shared/cases is not at hand");
        return None;
    }
    Some(folder)
}

#[test]
fn every_case_gives_its_right_voxels() {
    let Some(folder) = folder() else { return };
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

#[test]
fn every_wrap_mode_gives_its_right_voxels() {
    let Some(folder) = folder() else { return };
    for &(name, line) in WRAPPED {
        let mesh = load_mesh(&folder.join(name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(mesh.warnings, [""; 0]);
        assert_eq!(lines(&mesh), (line.to_owned(), line.to_owned()), "{name}");
    }
}

#[test]
fn what_cannot_be_read_is_refused_for_the_right_reason() {
    let Some(folder) = folder() else { return };
    let mut wrong = Vec::new();
    for &(name, reason) in REFUSED {
        let built = load_mesh(&folder.join(name)).map_err(|e| e.to_string()).and_then(|mesh| {
            let settings = BuildSettings { levels: 3, ..BuildSettings::default() };
            build(&mesh, &settings, &|_| ()).map_err(|e| e.to_string())
        });
        let error = built.map(|_| ()).err().unwrap_or_else(|| "it is an octree".to_owned());
        if !error.contains(reason) {
            wrong.push(format!("{name}: {error}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_file_of_every_case_is_tested() {
    let Some(folder) = folder() else { return };
    let tested: BTreeSet<&str> =
        (CASES.iter().map(|case| case.0)).chain(WRAPPED.iter().chain(REFUSED).map(|case| case.0)).collect();
    let mut missing = Vec::new();
    let names = |folder: &Path| -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        entries.map(|name| name.into_string().unwrap()).collect()
    };
    for case in names(&folder).iter().filter(|case| folder.join(case).is_dir()) {
        let mut files = 0;
        for file in names(&folder.join(case)) {
            if [".obj", ".ply", ".stl", ".gltf", ".glb", ".vox"].iter().any(|end| file.ends_with(end)) {
                files += 1;
                let name = format!("{case}/{file}");
                if !tested.contains(&*name) {
                    missing.push(name);
                }
            }
        }
        assert!(files > 0, "{case} has no mesh");
    }
    assert!(missing.is_empty(), "{missing:?}");
}
