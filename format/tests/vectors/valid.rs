//! The valid vectors: every feature alone, then features together.

pub(crate) mod attributes;
pub(crate) mod components;
mod container;
mod spaces;
pub(crate) mod topology;

use esvo_format::{AssembleOptions, assemble};
use glam::{DMat4, DVec3};

use super::common::samples::samples;
use super::common::{Colors, Shape, bytes_of};
use super::writer::{Block, Codec, Order, Plan};
pub(crate) use container::{ENTROPY_LEVELS, entropy_coded, extra};

/// A vector: name, what it is for, the bytes of the file, the image.
pub(crate) struct Vector {
    pub(crate) name: String,
    pub(crate) about: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) image: Vec<u8>,
    /// Whether the library writes the same bytes. True if the file has the library's own layout.
    pub(crate) canonical: bool,
}

/// All of them.
pub(crate) fn vectors() -> Vec<Vector> {
    let mut list = Vec::new();
    let mut add = |name: &str, about: &'static str, plan: Plan| {
        let (bytes, image) = plan.write();
        let canonical = plan.order == Order::Usual
            && plan.minor == 0
            && plan.optional_features == 0
            && plan.flags == 1
            && plan.blocks.iter().all(|b| b.codec == Codec::Raw)
            && plan.extra.iter().all(|e| e.tag != *b"META" || e.flags == 0);
        list.push(Vector { name: name.into(), about, bytes, image, canonical });
    };
    topology::topology(&mut add);
    topology::pages(&mut add);
    topology::blocks(&mut add);
    attributes::contours(&mut add);
    attributes::attributes(&mut add);
    attributes::values(&mut add);
    attributes::edges(&mut add);
    components::components(&mut add);
    spaces::transforms(&mut add);
    container::objects(&mut add);
    container::container(&mut add);
    container::metadata(&mut add);
    container::compressed(&mut add);
    container::frames(&mut add);
    // What the library writes.
    for (name, octree) in samples() {
        let about = match name {
            "single_voxel" => "written by the library: one leaf voxel",
            "contours" => "written by the library: three levels, contours",
            "far_pointers" => "written by the library: three levels, a far pointer for every descriptor with children",
            "blocks" => "written by the library: three levels in three blocks, contours and colours",
            "colors" => "written by the library: three levels, colour blocks",
            "constant_color" => "written by the library: three levels, a constant colour",
            "normals" => "written by the library: three levels, normal blocks",
            "ambient" => "written by the library: three levels, ambient occlusion",
            "plain" => "written by the library: three levels, contours, plain colours with alpha, plain normals",
            "corners" => "written by the library: three levels in several blocks, corners",
            "everything" => "written by the library: three levels, contours, colours, normals, metadata",
            "components" => "written by the library: three levels in three blocks, colours, components of five types",
            other => panic!("{other}: what is it for?"),
        };
        list.push(written(format!("written_{name}"), about, &octree));
    }
    for seed in 0..6 {
        list.push(random(seed));
    }
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/parts");
    for (name, octree) in in_parts() {
        let about = match name {
            "parts_levels" => {
                "written by the library in parts: several levels of several blocks in parts of their own, frames"
            }
            "parts_pages" => "written by the library in parts: one block of three pages, far pointers",
            "parts_whole" => "written by the library in parts: a block of codec 0, as codec 2 cannot give it again",
            _ => "written by the library in parts: the octree of the vector with the rest of the name",
        };
        let bytes = std::fs::read(folder.join(name).with_extension("esvo")).unwrap_or_default();
        let image: &[u8] = bytemuck::cast_slice(octree.slots());
        list.push(Vector { name: name.into(), about, bytes, image: image.to_vec(), canonical: false });
    }
    list
}

/// The octrees of vectors in parts. The files are kept in `parts/`.
pub(crate) fn in_parts() -> Vec<(&'static str, esvo_format::Octree)> {
    let names = [
        ("blocks", "parts_blocks"),
        ("colors", "parts_colors"),
        ("constant_color", "parts_constant_color"),
        ("ambient", "parts_ambient"),
        ("plain", "parts_plain"),
        ("corners", "parts_corners"),
        ("everything", "parts_everything"),
    ];
    let mut list: Vec<(&str, _)> = samples()
        .into_iter()
        .filter_map(|(name, octree)| Some((names.iter().find(|(sample, _)| *sample == name)?.1, octree)))
        .collect();
    let noise = |seed, levels, nodes, normals| Shape {
        seed,
        levels,
        valid: 80,
        leaf: 60,
        contour: 100,
        colors: if normals { Colors::Many } else { Colors::None },
        normals,
        nodes,
    };
    let options = AssembleOptions { block_slots: 300, near_limit: 20 };
    let many = assemble(&noise(7, 8, 400, true).tree(), DMat4::IDENTITY, &options).expect("a small tree");
    list.push(("parts_levels", many));
    let options = AssembleOptions { near_limit: 1000, ..AssembleOptions::default() };
    let pages = assemble(&noise(3, 9, 1400, false).tree(), DMat4::IDENTITY, &options).expect("a small tree");
    list.push(("parts_pages", pages));
    let (bytes, _) = one(1, topology::smallest(5)).write();
    list.push(("parts_whole", esvo_format::Octree::from_bytes(&bytes).expect("a valid vector")));
    list
}

type Add<'a> = dyn FnMut(&str, &'static str, Plan) + 'a;

fn written(name: String, about: &'static str, octree: &esvo_format::Octree) -> Vector {
    let image: &[u8] = bytemuck::cast_slice(octree.slots());
    Vector { name, about, bytes: bytes_of(octree), image: image.to_vec(), canonical: true }
}

fn random(seed: u64) -> Vector {
    let shape = Shape {
        seed: 100 + seed,
        levels: [3, 5, 9, 14, 20, 23][seed as usize],
        valid: [128, 64, 24, 12, 8, 4][seed as usize],
        leaf: 100,
        contour: [0, 255, 128, 60, 200, 128][seed as usize],
        colors: [Colors::Many, Colors::None, Colors::Many, Colors::One, Colors::Many, Colors::Many][seed as usize],
        normals: seed % 3 != 1,
        nodes: 40,
    };
    let near_limit = if seed.is_multiple_of(2) { 32767 } else { 8 };
    let transform = DMat4::from_translation(DVec3::splat(seed as f64)) * DMat4::from_scale(DVec3::splat(0.5));
    let octree = assemble(&shape.tree(), transform, &AssembleOptions { near_limit, ..AssembleOptions::default() });
    written(format!("random_{seed}"), "written by the library: noise", &octree.expect("a small tree"))
}

pub(crate) fn one(levels: u32, block: Block) -> Plan {
    Plan::new(levels, vec![block])
}
