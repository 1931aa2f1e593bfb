//! MagicaVoxel's models, and files of other programs that are named in the refusal.

use std::collections::BTreeMap;

use dot_vox::{Color, Dict, DotVoxData, Frame, Layer, Model, SceneNode, ShapeModel, Size, Voxel};
use esvo_builder::import::{load_mesh, load_voxels, load_voxels_from};
use esvo_builder::{BuildSettings, VoxelModel, build_voxels};
use esvo_format::{AssembleOptions, Octree};

use crate::support::{Files, octree_voxels};

fn dict(pairs: &[(&str, &str)]) -> Dict {
    pairs.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
}

fn model(size: [u32; 3], voxels: &[[u8; 4]]) -> Model {
    let [x, y, z] = size;
    let voxels = voxels.iter().map(|&[x, y, z, i]| Voxel { x, y, z, i }).collect();
    Model { size: Size { x, y, z }, voxels }
}

fn data(models: Vec<Model>, scenes: Vec<SceneNode>) -> DotVoxData {
    let mut palette: Vec<Color> = (0..=255u8).map(|i| Color { r: i, g: 255 - i, b: i / 2, a: 255 }).collect();
    palette[7] = Color { r: 255, g: 0, b: 0, a: 255 };
    palette[9] = Color { r: 0, g: 0, b: 255, a: 255 };
    let layers = vec![Layer { attributes: dict(&[]) }, Layer { attributes: dict(&[("_hidden", "1")]) }];
    DotVoxData { version: 150, index_map: Vec::new(), models, palette, materials: Vec::new(), scenes, layers }
}

fn bytes(data: &DotVoxData) -> Vec<u8> {
    let mut bytes = Vec::new();
    data.write_vox(&mut bytes).unwrap();
    bytes
}

fn read(data: &DotVoxData) -> VoxelModel {
    let files = Files::new();
    files.write("a.vox", bytes(data));
    load_voxels(&files.path("a.vox")).unwrap_or_else(|e| panic!("{e}"))
}

fn transform(child: u32, frame: &[(&str, &str)]) -> SceneNode {
    let frames = vec![Frame::new(dict(frame))];
    SceneNode::Transform { attributes: dict(&[]), frames, child, layer_id: 0 }
}

fn shape(model_id: u32) -> SceneNode {
    SceneNode::Shape { attributes: dict(&[]), models: vec![ShapeModel { model_id, attributes: dict(&[]) }] }
}

/// The places of the voxels and their colours.
fn places(model: &VoxelModel) -> BTreeMap<[i32; 3], [u8; 3]> {
    model.voxels.iter().map(|voxel| (voxel.at, voxel.color)).collect()
}

/// The leaves of an octree in mesh space, with their colours.
fn leaves(octree: &Octree, levels: u32) -> BTreeMap<[i32; 3], [u8; 3]> {
    let to_mesh = octree.octree_to_mesh(0);
    let edge = to_mesh.x_axis.x / f64::from(levels).exp2();
    assert_eq!(edge, 1.0, "a voxel is a unit");
    let origin = to_mesh.w_axis.truncate().to_array();
    let place = |at: [u32; 3]| std::array::from_fn(|k| at[k] as i32 + origin[k] as i32);
    octree_voxels(octree, levels).into_iter().map(|(at, color)| (place(at), color)).collect()
}

const RED: [u8; 3] = [255, 0, 0];
const BLUE: [u8; 3] = [0, 0, 255];

#[test]
fn each_voxel_is_a_leaf_with_its_colour() {
    let one = read(&data(vec![model([5, 3, 2], &[[0, 0, 0, 7], [4, 2, 1, 9], [1, 1, 1, 7]])], Vec::new()));
    assert_eq!(one.warnings, [""; 0]);
    let expected = BTreeMap::from([([0, 0, 0], RED), ([4, 2, 1], BLUE), ([1, 1, 1], RED)]);
    assert_eq!(places(&one), expected);
    assert_eq!(one.levels().unwrap(), 3);
    let settings = BuildSettings { plain_attributes: true, ..BuildSettings::default() };
    let octree = build_voxels(&one, &settings).unwrap().octree;
    let object = &octree.objects()[0];
    assert_eq!((object.leaf_voxels, object.contours), (3, 0));
    assert_eq!(leaves(&octree, 3), expected);
    assert!(esvo_format::validate(&octree).findings.is_empty());
}

#[test]
fn a_model_of_many_blocks_keeps_every_voxel() {
    let mut voxels = Vec::new();
    for i in 0..40 * 40 * 40u32 {
        let at = [i % 40, i / 40 % 40, i / 1600].map(|x| x as u8);
        if (at[0] ^ at[1] ^ at[2]) % 3 == 0 {
            voxels.push([at[0], at[1], at[2], (i % 255) as u8]);
        }
    }
    let model = read(&data(vec![model([40; 3], &voxels)], Vec::new()));
    assert_eq!(model.levels().unwrap(), 6);
    for plain_attributes in [true, false] {
        let assemble = AssembleOptions { block_slots: 1 << 10, ..AssembleOptions::default() };
        let settings = BuildSettings { plain_attributes, assemble, ..BuildSettings::default() };
        let octree = build_voxels(&model, &settings).unwrap().octree;
        assert!(octree.blocks().len() > 3, "{}", octree.blocks().len());
        assert!(esvo_format::validate(&octree).findings.is_empty());
        let found = leaves(&octree, 6);
        if plain_attributes {
            assert_eq!(found, places(&model));
        } else {
            assert!(found.keys().eq(places(&model).keys()));
        }
    }
}

#[test]
fn the_scene_places_models_with_rotations() {
    // A bar of 4 x 1 x 1 along x, red at its low end, and one blue voxel.
    let bar = model([4, 1, 1], &[[0, 0, 0, 7], [1, 0, 0, 9], [2, 0, 0, 9], [3, 0, 0, 9]]);
    // A quarter turn about z: x from -y, y from x.
    let turn = (1u8 | 1 << 4).to_string();
    let scenes = vec![
        transform(1, &[]),
        SceneNode::Group { attributes: dict(&[]), children: vec![2, 4] },
        transform(3, &[("_t", "10 0 0")]),
        shape(0),
        transform(5, &[("_r", &turn), ("_t", "20 5 -7")]),
        shape(0),
    ];
    let found = read(&data(vec![bar], scenes));
    // The pivot of the bar is at 2, 0, 0.
    let mut expected = BTreeMap::from([([8, 0, 0], RED), ([9, 0, 0], BLUE), ([10, 0, 0], BLUE), ([11, 0, 0], BLUE)]);
    expected.extend([([19, 3, -7], RED), ([19, 4, -7], BLUE), ([19, 5, -7], BLUE), ([19, 6, -7], BLUE)]);
    assert_eq!(places(&found), expected);
    assert_eq!(found.warnings, [""; 0]);
}

#[test]
fn hidden_parts_are_left_out_and_named() {
    let cube = || model([1, 1, 1], &[[0, 0, 0, 7]]);
    let in_layer = |child, layer_id| SceneNode::Transform {
        attributes: dict(&[("_name", "lid")]),
        frames: vec![Frame::default()],
        child,
        layer_id,
    };
    let hidden = SceneNode::Transform {
        attributes: dict(&[("_hidden", "1")]),
        frames: vec![Frame::default()],
        child: 3,
        layer_id: 0,
    };
    let scenes = vec![
        transform(1, &[]),
        SceneNode::Group { attributes: dict(&[]), children: vec![2, 4, 5] },
        in_layer(3, 1),
        shape(0),
        hidden,
        transform(3, &[("_t", "5 5 5")]),
    ];
    let found = read(&data(vec![cube()], scenes));
    assert_eq!(places(&found), BTreeMap::from([([5, 5, 5], RED)]));
    assert_eq!(
        found.warnings,
        ["node 2 (lid) is in layer 1, which is hidden; it is left out", "node 4 is hidden; it is left out"]
    );
    // Of two voxels at a place, the later one counts.
    let scenes =
        vec![transform(1, &[]), SceneNode::Group { attributes: dict(&[]), children: vec![2, 3] }, shape(0), shape(1)];
    let both = read(&data(vec![cube(), model([1, 1, 1], &[[0, 0, 0, 9]])], scenes));
    let settings = BuildSettings { plain_attributes: true, ..BuildSettings::default() };
    let octree = build_voxels(&both, &settings).unwrap().octree;
    assert_eq!(leaves(&octree, 1), BTreeMap::from([([0, 0, 0], BLUE)]));
}

#[test]
fn bad_models_are_errors() {
    let path = std::path::Path::new("a.vox");
    let error = |data: &DotVoxData| load_voxels_from(path, &bytes(data)).unwrap_err().to_string();
    let cube = || model([1, 1, 1], &[[0, 0, 0, 7]]);
    assert_eq!(error(&data(vec![model([1, 1, 1], &[])], Vec::new())), "a.vox: the file has no voxels");
    let scene = |nodes: Vec<SceneNode>| error(&data(vec![cube()], nodes));
    assert_eq!(scene(vec![transform(9, &[])]), "a.vox: node 9 does not exist: there are only 1");
    assert_eq!(scene(vec![shape(4)]), "a.vox: model 4 does not exist: there are only 1");
    assert_eq!(scene(vec![transform(1, &[("_r", "15")]), shape(0)]), "a.vox: node 0: the rotation '15' is not valid");
    assert!(scene(vec![transform(0, &[])]).contains("contains itself"));
    let doubling = |i| SceneNode::Group { attributes: dict(&[]), children: vec![i, i] };
    assert!(scene((1..64).map(doubling).chain([shape(0)]).collect()).contains("more than"));
    assert!(scene(vec![transform(1, &[("_t", "2000000000 0 0")]), shape(0)]).contains("coordinate"));
    // Damage is an error or another model, and never a panic.
    let good = bytes(&data(
        vec![cube(), model([2, 2, 2], &[[0, 1, 0, 3], [1, 1, 1, 4]])],
        vec![transform(1, &[("_t", "1 2 3")]), shape(1)],
    ));
    for i in 0..good.len() {
        for value in [0, 1, 0x7f, 0xff] {
            let mut bad = good.clone();
            bad[i] = value;
            let _ = load_voxels_from(path, &bad);
        }
        let _ = load_voxels_from(path, &good[..i]);
    }
}

#[test]
fn files_of_other_programs_are_named() {
    let files = Files::new();
    let mut laz = b"LASF".to_vec();
    laz.resize(104, 1);
    let las = [&laz[..], &[3]].concat();
    laz.push(0x83);
    let pcd = "# .PCD v.7\nVERSION .7\nFIELDS x y z\n";
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    for (name, bytes, what) in [
        ("a.las", &las[..], "is a LAS point cloud; "),
        ("a.laz", &laz, "is a LAZ point cloud; "),
        // By content, whatever the extension.
        ("a.obj", &laz, "is a LAZ point cloud; "),
        ("a.e57", b"ASTM-E57\0\0\0\0", "is an E57 point cloud; "),
        ("a.pcd", pcd.as_bytes(), "is a PCD point cloud; "),
        ("a.ply", points.as_bytes(), "is a PLY point cloud (its header declares no element 'face'); "),
        ("a.xyz", b"0 0 0\n", "is a text file of points by its extension; "),
        ("a.binvox", b"#binvox 1\ndim 2 2 2\n", "is a binvox volume; "),
        ("a.nvdb", b"NanoVDB0\0\0", "is a NanoVDB volume; "),
        ("a.vdb", b" BDV\0\0\0\0\xe0", "is an OpenVDB volume; "),
        ("a.schem", b"\x1f\x8b\x08", "is a schematic of Minecraft by its extension; "),
    ] {
        let error = files.refuse(name, bytes);
        assert!(error.starts_with(&format!("{name}: {what}")), "{error}");
    }
    assert_eq!(
        files.refuse("a.zip", "x"),
        "a.zip: unknown kind of mesh; the extension must be .obj, .gltf, .glb, .ply, .stl or .vox"
    );
    assert_eq!(
        files.refuse("a.vox", bytes(&data(vec![model([1, 1, 1], &[[0, 0, 0, 1]])], Vec::new()))),
        "a.vox: is a voxel model, not a mesh; esvo build makes an octree from it"
    );
    files.write("b.vox", "v 0 0 0\n");
    let error = load_voxels(&files.path("b.vox")).unwrap_err().to_string();
    assert!(
        error.ends_with("b.vox: is a text file, not a voxel model of MagicaVoxel as its extension says"),
        "{error}"
    );
    assert!(load_mesh(&files.path("none.las")).is_err());
}
