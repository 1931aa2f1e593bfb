//! Components of voxels: laid out in every way, through files, parts and joins, and compared.

mod common;

use common::{Colors, Rng, Shape, bytes_of};
use esvo_format::file::attachment;
use esvo_format::{
    AssembleOptions, BlockStore, Column, ComponentFormat, NumberFormat, Octree, Region, StreamReader, Tree, Voxel,
    WriteOptions, assemble, component_stats, diff, join, oct, pack, stats, validate,
};
use glam::{DMat4, DVec3};

const LAYOUTS: [AssembleOptions; 3] = [
    AssembleOptions { block_slots: 1 << 20, near_limit: 32767 },
    AssembleOptions { block_slots: 64, near_limit: 5 },
    AssembleOptions { block_slots: 500, near_limit: 32767 },
];

const VELOCITY: ComponentFormat = ComponentFormat { components: 3, number: NumberFormat::F32 };

fn shape(seed: u64) -> Shape {
    let colors = [Colors::None, Colors::One, Colors::Many][seed as usize % 3];
    Shape { seed, levels: 7, valid: 100, leaf: 60, contour: 60, colors, normals: seed.is_multiple_of(2), nodes: 1500 }
}

/// A tree whose voxels have components of several types: of few voxels, of one value for all, of values that neighbours share.
fn tree(seed: u64) -> Tree {
    let mut tree = shape(seed).tree();
    let mut rng = Rng(seed);
    let voxels = tree.voxels() as usize;
    let mut column = |kind: u32, format: ComponentFormat, value: &mut dyn FnMut(usize) -> [f64; 3]| {
        let values = (0..voxels).flat_map(|k| format.encode(&value(k))[..format.words()].to_vec()).collect();
        tree.columns.push(Column { kind, format, values });
    };
    column(attachment::EMISSION, ComponentFormat::EMISSION, &mut |_| {
        if rng.chance(5) { [0, 1, 2].map(|_| rng.below(1 << 16) as f64 / 256.0) } else { [0.0; 3] }
    });
    column(attachment::ROUGHNESS_METALNESS, ComponentFormat::ROUGHNESS_METALNESS, &mut |_| [0.25, 1.0, 0.0]);
    column(attachment::OPACITY, ComponentFormat::OPACITY, &mut |_| [1.0, 0.0, 0.0]);
    column(attachment::MATERIAL, ComponentFormat::MATERIAL, &mut |k| [(k / 40 % 3) as f64, 0.0, 0.0]);
    if seed.is_multiple_of(2) {
        column(20, VELOCITY, &mut |k| if k % 7 < 5 { [1.5, -2.0, 1e30] } else { [k as f64, 0.0, -0.25] });
    }
    tree
}

/// Slot of the descriptor, child slot, and number of the voxel in the tree.
fn voxels(tree: &Tree, octree: &Octree, object: usize) -> Vec<(u32, u8, usize)> {
    let mut found = Vec::new();
    let mut stack = vec![(0, octree.objects()[object].root_slot as u32)];
    while let Some((index, slot)) = stack.pop() {
        let node = &tree.nodes[index];
        let valid = (0..8).filter(|child| node.valid >> child & 1 != 0);
        found.extend((node.first_voxel as usize..).zip(valid).map(|(voxel, child)| (slot, child, voxel)));
        stack.extend(tree.children(index).filter_map(|(child, index)| Some((index, octree.child(slot, child)?))));
    }
    found
}

/// A reader of components.
type Read = fn(&Octree, u32, u8, u32) -> Option<[f64; 4]>;

fn right(octree: &Octree, slot: u32, child: u8, kind: u32) -> Option<[f64; 4]> {
    octree.components(slot, child, kind).map(|c| c.numbers)
}

/// The number of voxels whose components are not those of the tree.
fn wrong(tree: &Tree, octree: &Octree, object: usize, read: Read) -> usize {
    let mut wrong = 0;
    for (slot, child, voxel) in voxels(tree, octree, object) {
        for column in &tree.columns {
            let expected = column.format.decode(column.value(voxel)).numbers;
            let default = column.format.decode(&column.format.default_of(column.kind)).numbers;
            wrong += usize::from(read(octree, slot, child, column.kind).unwrap_or(default) != expected);
        }
    }
    wrong
}

fn laid_out(tree: &Tree, options: &AssembleOptions) -> Octree {
    let octree = assemble(tree, DMat4::IDENTITY, options).expect("a well-formed tree");
    let octree = Octree::from_bytes(&bytes_of(&octree)).expect("our own bytes");
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    octree
}

#[test]
fn every_layout_keeps_every_number() {
    for seed in 0..6 {
        let tree = tree(seed);
        for layout in LAYOUTS {
            let octree = laid_out(&tree, &layout);
            assert_eq!(wrong(&tree, &octree, 0, right), 0, "seed {seed}, {layout:?}");
            let found = component_stats(&octree);
            let kinds: Vec<u32> = found.iter().map(|s| s.kind).collect();
            // All is opaque: there is no attachment for it.
            let expected: &[u32] = if seed % 2 == 0 { &[8, 9, 11, 20] } else { &[8, 9, 11] };
            assert_eq!(kinds, expected, "seed {seed}");
            assert_eq!(found.iter().map(|s| s.bytes).sum::<u64>(), stats(&octree).bytes.components);
            // One value for all: 12 bytes in each block.
            assert_eq!(found[1].bytes, 12 * octree.blocks().len() as u64);
        }
    }
}

#[test]
fn a_broken_decoder_is_caught() {
    /// Takes the first value of a descriptor for all of its voxels.
    fn first(octree: &Octree, slot: u32, _: u8, kind: u32) -> Option<[f64; 4]> {
        let valid = octree.descriptor(slot).valid_mask();
        right(octree, slot, valid.trailing_zeros() as u8, kind)
    }
    /// Takes no entry for the default of all types, 0.
    fn zero(octree: &Octree, slot: u32, child: u8, kind: u32) -> Option<[f64; 4]> {
        right(octree, slot, child, kind).or(Some([0.0; 4]))
    }
    let tree = tree(2);
    let octree = laid_out(&tree, &LAYOUTS[1]);
    assert!(wrong(&tree, &octree, 0, first) > 50);
    assert!(wrong(&tree, &octree, 0, zero) > 50, "opacity is 1");
}

#[test]
fn trees_keep_columns_when_they_are_cut_joined_and_changed() {
    let mut whole = Tree::default();
    whole.columns.push(Column::new(11, ComponentFormat::MATERIAL));
    let voxel = |leaf| Some(Voxel { leaf, ..Voxel::default() });
    let id = |tree: &mut Tree, node: usize, slot: usize, id: f64| {
        tree.set_components(node, slot, 0, &ComponentFormat::MATERIAL.encode(&[id]));
    };
    let mut part = Tree::default();
    part.columns.push(Column::new(11, ComponentFormat::MATERIAL));
    let root = whole.open(&[voxel(false), None, voxel(true), None, voxel(false), None, None, None]);
    (0..3).zip([0, 2, 4]).for_each(|(k, slot)| id(&mut whole, root, slot, f64::from(k) + 1.0));
    let first = part.open(&[None, voxel(true), None, voxel(true), None, None, None, voxel(true)]);
    (0..3).zip([1, 3, 7]).for_each(|(k, slot)| id(&mut part, first, slot, f64::from(k) + 10.0));
    part.remove_voxel(first, 3);
    part.close(first);
    whole.append(&part);
    let last = whole.open(&[voxel(false), None, None, None, None, None, None, None]);
    id(&mut whole, last, 0, 99.0);
    let leaf = whole.open(&[None, voxel(true), None, None, None, None, None, None]);
    id(&mut whole, leaf, 1, 98.0);
    whole.close(leaf);
    whole.close(last);
    assert_eq!(whole.columns[0].values, [1, 2, 3, 10, 12, 99, 98]);
    // The last subtree becomes a block of its own.
    let mut cut = whole.clone();
    cut.close(root);
    let one_piece = assemble(&cut, DMat4::IDENTITY, &LAYOUTS[0]).expect("a tree");
    let below = whole.detach(last);
    assert_eq!(
        (&whole.columns[0].values[..], &below.columns[0].values[..]),
        (&[1, 2, 3, 10, 12, 99][..], &[99, 98][..])
    );
    let store = BlockStore::in_memory();
    let cube = ([0, 0, 1 << 22], 22);
    whole.attach(store.put(pack(&below, Some(cube), &LAYOUTS[0]).expect("a block")).expect("room"));
    whole.close(root);
    // The node that was detached stays, with the attributes of its voxels.
    let number = store.put(pack(&whole, None, &LAYOUTS[0]).expect("a block")).expect("room");
    let octree = store.octree(number, DMat4::IDENTITY).expect("an octree");
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    assert!(diff::diff(&one_piece, &octree, 9).expect("sound").is_empty());
    // Malformed columns are refused.
    for bad in [
        Column { kind: 11, format: ComponentFormat::MATERIAL, values: vec![0; 6] },
        Column { kind: 11, format: ComponentFormat::EMISSION, values: vec![0; 7] },
        Column { kind: 12, format: ComponentFormat::OPACITY, values: vec![0; 7] },
        Column { kind: 10, format: ComponentFormat::OPACITY, values: vec![256; 7] },
    ] {
        cut.columns = vec![bad];
        assert!(assemble(&cut, DMat4::IDENTITY, &LAYOUTS[0]).is_err());
    }
}

#[test]
fn every_tool_keeps_them() {
    let (a, b) = (tree(0), tree(3));
    let (first, second) = (laid_out(&a, &LAYOUTS[1]), laid_out(&b, &LAYOUTS[2]));
    let joined = join(&[&first, &second]).expect("two octrees");
    assert!(validate(&joined).findings.is_empty());
    assert_eq!((wrong(&a, &joined, 0, right), wrong(&b, &joined, 1, right)), (0, 0));
    let shaded = first.with_ambient_occlusion(|_, _| 100).expect("room for an attachment");
    assert!(validate(&shaded).findings.is_empty());
    assert_eq!(wrong(&a, &shaded, 0, right), 0);
    #[cfg(feature = "zstd")]
    for options in [
        WriteOptions { compress: Some(3), ..WriteOptions::default() },
        WriteOptions { parts: true, ..WriteOptions::default() },
    ] {
        for (octree, tree) in [(&first, &a), (&shaded, &a)] {
            let mut bytes = Vec::new();
            octree.write_to_with(&mut bytes, &options).expect("writes");
            let back = Octree::from_bytes(&bytes).expect("our own bytes");
            assert!(validate(&back).findings.is_empty());
            assert_eq!(wrong(tree, &back, 0, right), 0, "{options:?}");
            assert!(diff::diff(octree, &back, 9).expect("sound").is_empty());
        }
    }
    // Some blocks of the file.
    let bytes = bytes_of(&first);
    let reader = StreamReader::open(&bytes).expect("our own bytes");
    let region = Region { low: DVec3::ZERO, high: DVec3::splat(0.8) };
    let part = reader.partial(&reader.blocks_for(0, &region, 6)).expect("some blocks");
    assert!(validate(&part).findings.is_empty(), "{}", validate(&part));
    let mut both = vec![(first.objects()[0].root_slot as u32, part.objects()[0].root_slot as u32)];
    let mut compared = 0;
    while let Some((whole, some)) = both.pop() {
        for child in (0..8u8).filter(|child| part.descriptor(some).valid_mask() >> child & 1 != 0) {
            for kind in first.component_kinds() {
                assert_eq!(first.components(whole, child, kind), part.components(some, child, kind));
            }
            compared += 1;
            both.extend(part.child(some, child).map(|below| (first.child(whole, child).expect("a part"), below)));
        }
    }
    assert!(compared > 50);
    // The authors' format has no place for them, and says so.
    let lost = oct::write_to(&first, &mut Vec::new()).expect("a sound octree");
    assert_eq!(lost.iter().filter(|line| line.contains("attachments of type")).count(), 4, "{lost:?}");
}

#[test]
fn joins_keep_what_named_types_are_and_refuse_what_differs() {
    let tree = tree(2);
    let named = |meta: &str| {
        let mut octree = laid_out(&tree, &LAYOUTS[0]);
        octree.set_meta(meta.into());
        octree
    };
    let wind = r#"{"attachments":{"20":{"name":"wind","unit":"m/s"}},"title":"a"}"#;
    let (first, second) = (named(wind), named(&wind.replace("\"a\"", "\"b\"")));
    let joined = join(&[&first, &second]).expect("the same meaning");
    let meta: serde_json::Value = serde_json::from_str(joined.meta()).expect("JSON");
    assert_eq!(meta["attachments"]["20"]["name"], "wind");
    assert_eq!(meta["objects"][1]["metadata"]["title"], "b");
    assert!(validate(&joined).findings.is_empty(), "{}", validate(&joined));
    for other in [wind.replace("wind", "heat"), wind.replace("m/s", "km/h"), String::new()] {
        let error = join(&[&first, &named(&other)]).err().expect("another meaning").to_string();
        assert!(error.contains("type 20 have another name or unit in octree 0 than in octree 1"), "{error}");
    }
}

#[test]
fn differences_are_found_by_number_and_not_by_layout() {
    let mut tree = tree(4);
    let before = laid_out(&tree, &LAYOUTS[0]);
    assert!(diff::diff(&before, &laid_out(&tree, &LAYOUTS[1]), 9).expect("sound").is_empty());
    let words = ComponentFormat::OPACITY.encode(&[0.5]);
    tree.columns[2].set(7, &words);
    let found = diff::diff(&before, &laid_out(&tree, &LAYOUTS[1]), 9).expect("sound");
    assert_eq!((found.total, found.list[0].what), (1, "opacity"));
    assert!(diff::diff_topology(&before, &laid_out(&tree, &LAYOUTS[1]), 9).expect("sound").is_empty());
}

#[test]
fn what_is_not_there_is_the_default() {
    let octree = common::samples::single_voxel();
    let slot = octree.objects()[0].root_slot as u32;
    assert_eq!((octree.emission(slot, 5), octree.roughness_metalness(slot, 5)), ([0.0; 3], [1.0, 0.0]));
    assert_eq!((octree.opacity(slot, 5), octree.material(slot, 5)), (1.0, 0));
    assert_eq!((octree.component_kinds(), component_stats(&octree)), (vec![], vec![]));
}
