//! Emission, roughness and metalness, opacity and material of voxels, from glTF files and OBJ materials.

use esvo_builder::import::{Format, load_mesh_from};
use esvo_builder::{
    BuildSettings, ComponentSettings, FileOptions, Mesh, Properties, build, build_file, build_part, join_parts,
};
use esvo_format::{Octree, WriteOptions, component_stats, validate};
use serde_json::json;

use crate::gltf_document::Document;
use crate::support::{Files, png};

const ALL: ComponentSettings =
    ComponentSettings { emission: true, roughness_metalness: true, opacity: true, material: true };

fn settings(levels: u32, components: ComponentSettings) -> BuildSettings {
    BuildSettings { levels, components, plain_attributes: true, ..BuildSettings::default() }
}

fn octree(mesh: &Mesh, settings: &BuildSettings) -> Octree {
    let octree = build(mesh, settings, &|_| ()).unwrap_or_else(|e| panic!("{e}")).octree;
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    octree
}

/// A glTF document with the textures of its properties.
fn mesh_of(document: &Document) -> Mesh {
    load_mesh_from("a.gltf".as_ref(), Format::Gltf, document.text().into_bytes(), true)
        .unwrap_or_else(|e| panic!("{e}"))
}

/// A voxel: its level, its lower corner and its edge in units of the root cube, and what it has.
struct Found {
    level: u32,
    at: [f64; 3],
    size: f64,
    leaf: bool,
    color: [f32; 3],
    emission: [f32; 3],
    surface: [f32; 2],
    opacity: f32,
    material: u32,
}

fn voxels(octree: &Octree) -> Vec<Found> {
    let mut found = Vec::new();
    let mut waiting = vec![(octree.objects()[0].root_slot as u32, 1, [0.0; 3])];
    while let Some((slot, level, corner)) = waiting.pop() {
        let size = 0.5f64.powi(level as i32);
        for child in (0..8u8).filter(|c| octree.descriptor(slot).valid_mask() >> c & 1 != 0) {
            let at: [f64; 3] = std::array::from_fn(|axis| corner[axis] + size * f64::from(child >> axis & 1));
            let below = octree.child(slot, child);
            found.push(Found {
                level,
                at,
                size,
                leaf: below.is_none(),
                color: octree.color(slot, child).unwrap_or_default(),
                emission: octree.emission(slot, child),
                surface: octree.roughness_metalness(slot, child),
                opacity: octree.opacity(slot, child),
                material: octree.material(slot, child),
            });
            waiting.extend(below.map(|slot| (slot, level + 1, at)));
        }
    }
    found
}

fn near(a: f32, b: f32) -> bool {
    (a - b).abs() < 0.003 * b.abs().max(1.0)
}

/// Two squares, the left one with everything, the right one with nothing.
fn lamp_and_wall() -> Document {
    let mut document = Document::two_squares();
    let material = document.material(0);
    *material = json!({
        "alphaMode": "BLEND", "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
        "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.4], "metallicFactor": 0.25, "roughnessFactor": 0.5},
    });
    document
}

#[test]
fn factors_reach_every_voxel() {
    let mesh = mesh_of(&lamp_and_wall());
    for contours in [true, false] {
        for threads_apart in [3, 7] {
            let settings = BuildSettings { contours, ..settings(threads_apart, ALL) };
            let octree = octree(&mesh, &settings);
            let kinds: Vec<u32> = component_stats(&octree).iter().map(|s| s.kind).collect();
            assert_eq!(kinds, [8, 9, 10, 11]);
            for voxel in voxels(&octree).iter().filter(|v| v.level > 1) {
                // The squares end at a third and begin at two thirds of the root cube.
                let lamp = voxel.at[0] < 0.5;
                let expected =
                    if lamp { ([4.0, 2.0, 0.0], [0.5, 0.25], 0.4, 1) } else { ([0.0; 3], [1.0, 1.0], 1.0, 2) };
                assert!((0..3).all(|k| near(voxel.emission[k], expected.0[k])), "{:?}", voxel.emission);
                assert!((0..2).all(|k| near(voxel.surface[k], expected.1[k])), "{:?}", voxel.surface);
                assert!(near(voxel.opacity, expected.2) && voxel.material == expected.3);
            }
        }
    }
}

#[test]
fn textures_are_averaged_and_split_voxels_where_the_emission_changes() {
    let mut document = Document::textured_square();
    // Left: bright, rough. Right: dark, smooth, metal.
    let emission = document.texture(&png(2, 1, &[[255; 4], [0, 0, 0, 255]]));
    let surface = document.texture(&png(2, 1, &[[0, 255, 0, 255], [0, 0, 255, 255]]));
    for texture in document.list("textures") {
        texture["sampler"] = 0.into();
    }
    document.push("samplers", json!({"wrapS": 33071, "wrapT": 33071}));
    let material = document.material(0);
    material["emissiveFactor"] = json!([1, 1, 0]);
    material["emissiveTexture"] = json!({"index": emission});
    material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": surface});
    let mesh = mesh_of(&document);
    let coarse = |components| BuildSettings { contour_error: 6.0, ..settings(6, components) };
    let built = octree(&mesh, &coarse(ALL));
    let plain = octree(&mesh, &coarse(ComponentSettings::NONE));
    let count = |octree: &Octree| voxels(octree).len();
    assert!(count(&built) > 4 * count(&plain), "{} and {}", count(&built), count(&plain));
    for voxel in voxels(&built).iter().filter(|voxel| voxel.leaf) {
        // Between the middles of the two texels the values change linearly.
        let middle = (voxel.at[0] + voxel.size / 2.0) as f32;
        let left = (1.5 - 2.0 * middle).clamp(0.0, 1.0);
        let reach = 2.0 * voxel.size as f32 + 0.01;
        assert!(
            (voxel.emission[0] - left).abs() <= reach && voxel.emission[2] == 0.0,
            "{middle}: {:?}",
            voxel.emission
        );
        assert!((voxel.surface[0] - left).abs() <= reach, "{middle}: {:?}", voxel.surface);
        assert!((voxel.surface[1] - (1.0 - left)).abs() <= reach);
    }
    // Above, the means of what is below.
    let top: Vec<Found> = voxels(&built).into_iter().filter(|voxel| voxel.level == 1).collect();
    let mean = |values: &mut dyn Iterator<Item = f32>| values.sum::<f32>() / top.len() as f32;
    assert!((mean(&mut top.iter().map(|v| v.emission[0])) - 0.5).abs() < 0.02);
    assert!((mean(&mut top.iter().map(|v| v.surface[1])) - 0.5).abs() < 0.02);
    // Read without the textures, they count as white.
    let white = load_mesh_from("a.gltf".as_ref(), Format::Gltf, document.text().into_bytes(), false).unwrap();
    assert!(
        voxels(&octree(&white, &settings(3, ALL)))
            .iter()
            .all(|v| v.emission == [1.0, 1.0, 0.0] && v.surface == [1.0; 2])
    );
}

#[test]
fn a_voxel_has_the_material_of_most_of_its_surface() {
    // A small square on a large one, in one voxel.
    let mut document = Document::two_squares();
    document.node(1)["scale"] = json!([0.25, 0.25, 1]);
    document.node(1)["translation"] = json!([-0.4, 0.1, 0]);
    let octree = octree(&mesh_of(&document), &settings(1, ALL));
    let found: Vec<_> = voxels(&octree).iter().map(|voxel| (voxel.at, voxel.material)).collect();
    assert!(found.iter().all(|(_, material)| *material == 1), "{found:?}");
    assert!(voxels(&octree).iter().all(|voxel| voxel.surface == [1.0, 1.0]));
}

#[test]
fn what_only_emits_is_black_beside_its_emission() {
    let mut document = Document::two_squares();
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([0, 0, 0, 1]);
    document.material(0)["emissiveFactor"] = json!([0, 1, 0]);
    let mesh = mesh_of(&document);
    let left = |components: ComponentSettings| {
        let found = voxels(&octree(&mesh, &settings(4, components)));
        let voxel = found.into_iter().find(|v| v.level == 4 && v.at[0] < 0.3).unwrap();
        (voxel.color, voxel.emission)
    };
    assert_eq!(left(ComponentSettings::NONE), ([0.0, 1.0, 0.0], [0.0; 3]));
    assert_eq!(left(ComponentSettings::LOOK), ([0.0; 3], [0.0, 1.0, 0.0]));
}

#[test]
fn nothing_is_stored_that_is_the_default_or_not_asked_for() {
    let full = mesh_of(&lamp_and_wall());
    let mut bare = full.clone();
    bare.materials.iter_mut().for_each(|material| material.properties = Properties::default());
    let plain = octree(&bare, &settings(6, ComponentSettings::NONE));
    assert!(octree(&bare, &settings(6, ALL)).slots() == plain.slots(), "everything is the default");
    assert!(octree(&full, &settings(6, ComponentSettings::NONE)).slots() == plain.slots(), "nothing is asked for");
    assert!(octree(&full, &settings(6, ALL)).slots() != plain.slots());
    for (k, kind) in [8, 9, 10, 11].into_iter().enumerate() {
        let one =
            ComponentSettings { emission: k == 0, roughness_metalness: k == 1, opacity: k == 2, material: k == 3 };
        assert_eq!(octree(&full, &settings(3, one)).component_kinds(), [kind]);
    }
}

#[test]
fn parts_of_a_build_have_them_too() {
    let (files, mesh) = (Files::new(), mesh_of(&lamp_and_wall()));
    for contours in [true, false] {
        let settings = BuildSettings { contours, ..settings(6, ALL) };
        let options = FileOptions { meta: "{}".into(), ..FileOptions::default() };
        build_file(&mesh, &settings, &files.path("whole.esvo"), &options, &|_| ()).unwrap();
        let parts = [1, 2].map(|k| {
            let path = files.path(&format!("{k}.esvopart"));
            build_part(&mesh, &settings, (k, 2), &path, &options, &|_| ()).unwrap();
            path
        });
        join_parts(&parts, &files.path("joined.esvo"), &WriteOptions::default()).unwrap();
        let [whole, joined] = ["whole.esvo", "joined.esvo"].map(|name| std::fs::read(files.path(name)).unwrap());
        assert!(whole == joined, "contours {contours}");
        assert_eq!(Octree::from_bytes(&joined).unwrap().component_kinds(), [8, 9, 10, 11]);
    }
}

#[test]
fn statements_of_obj_materials_count() {
    let files = Files::new();
    files.write("a.mtl", "newmtl lamp\nKe 2 1 0\nPr 0.25\nPm 0.75\nd 0.5\nnewmtl wall\nTr 1\nKe junk\n");
    let mesh = files.accept(
        "a.obj",
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 4 0 0\nv 5 0 0\nv 4 1 0\nusemtl lamp\nf 1 2 3\nusemtl wall\nf 4 5 6\n",
    );
    assert_eq!(mesh.warnings, ["a.mtl: line 8: cannot read 'Ke junk'; it is ignored"]);
    let found = voxels(&octree(&mesh, &settings(5, ALL)));
    let at = |left: bool| found.iter().find(|v| v.leaf && (v.at[0] < 0.5) == left).unwrap();
    let (lamp, wall) = (at(true), at(false));
    assert_eq!((lamp.emission, lamp.material, wall.emission, wall.material), ([2.0, 1.0, 0.0], 1, [0.0; 3], 2));
    assert!(near(lamp.surface[0], 0.25) && near(lamp.surface[1], 0.75) && near(lamp.opacity, 0.5));
    assert_eq!((wall.surface, wall.opacity), ([1.0, 0.0], 1.0), "Tr 1 alone is no opacity");
}
