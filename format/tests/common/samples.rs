//! Small octrees that together cover every part of a file.

use esvo_format::file::attachment;
use esvo_format::{
    AssembleOptions, Column, ComponentFormat, Contour, CornerValue, NodeCorners, NumberFormat, Octree, RawNormal, Tree,
    Voxel, assemble,
};
use glam::{DMat4, DVec3, Vec3};

/// Which attributes the voxels of a sample have.
#[derive(Clone, Copy, Default)]
struct With {
    contours: bool,
    colors: Option<fn(usize) -> [u8; 3]>,
    normals: bool,
}

/// Voxel number `k` of a tree.
fn voxel(with: With, k: usize, leaf: bool) -> Voxel {
    let direction = Vec3::new(1.0, 0.25 * (k % 5) as f32 - 0.5, 0.5 - 0.125 * (k % 7) as f32);
    let normal = Contour::encode_normal(direction.as_dvec3().to_array()).expect("not zero");
    Voxel {
        color: with.colors.map(|color| color(k)),
        normal: with.normals.then(|| RawNormal::encode(direction)),
        contour: (with.contours && k.is_multiple_of(2)).then(|| {
            let lo = k as f64 - 8.0;
            Contour::encode_bounds(normal, lo, lo + 4.0).expect("a thin slab")
        }),
        leaf,
    }
}

/// A tree of three levels: two non-leaf children of the root, the first with one non-leaf child and the second with
/// two.
fn branching(with: With) -> Tree {
    let mut tree = Tree::default();
    let mut next = 0;
    let mut node = |tree: &mut Tree, slots: &[(usize, bool)]| {
        let mut children = [None; 8];
        for &(slot, leaf) in slots {
            children[slot] = Some(voxel(with, next, leaf));
            next += 1;
        }
        tree.open(&children)
    };
    let root = node(&mut tree, &[(0, false), (3, true), (6, false)]);
    let a = node(&mut tree, &[(1, true), (7, false)]);
    let b = node(&mut tree, &[(0, true), (1, true), (2, true), (5, true)]);
    tree.close(b);
    tree.close(a);
    let c = node(&mut tree, &[(0, false), (4, false), (5, true)]);
    for slots in [&[(2, true)][..], &[(0, true), (7, true)]] {
        let leaves = node(&mut tree, slots);
        tree.close(leaves);
    }
    tree.close(c);
    tree.close(root);
    tree
}

fn octree(tree: &Tree, options: &AssembleOptions) -> Octree {
    let transform = DMat4::from_translation(DVec3::new(-1.0, 0.5, 2.0)) * DMat4::from_scale(DVec3::splat(4.0));
    assemble(tree, transform, options).expect("a well-formed tree")
}

fn rainbow(k: usize) -> [u8; 3] {
    [(k * 20) as u8, (255 - k * 16) as u8, (k * 90) as u8]
}

/// A tree with plain values, some of whose colours are not opaque.
fn plain() -> Tree {
    let mut tree = branching(With { contours: true, colors: Some(|k| rainbow(k / 2)), normals: true });
    tree.plain = true;
    tree.alphas = (0..tree.voxels()).map(|k| if k % 4 == 3 { 100 } else { 255 }).collect();
    tree
}

/// Corners: for some descriptors the whole lattice, for others only the corners of existing voxels and those of the
/// voxel itself.
fn corners() -> Tree {
    let mut tree = branching(With::default());
    for (k, node) in tree.nodes.iter().enumerate() {
        // Children 0 and 7 use the first and the last points of the lattice.
        let mask = [(1 << 27) - 1, 1 << 27 | 0x361b, 0x07ff_e000][k % 3];
        let corners = NodeCorners { mask, first: tree.corner_values.len() as u32 };
        let value = |i: usize| CornerValue {
            color: [(i * 9) as u8, rainbow(k)[1], 200, if i % 7 == 6 { 0 } else { 255 }],
            normal: RawNormal::encode(Vec3::new(0.5, k as f32 - 2.5, i as f32 / 9.0 - 1.0)),
        };
        assert_ne!(node.valid, 0);
        tree.corner_values.extend((0..corners.count()).map(value));
        tree.corners.push(corners);
    }
    tree
}

/// Components of every registered type and a named one: of some voxels, of all alike, of none.
fn components() -> Tree {
    let mut tree = branching(With { colors: Some(rainbow), ..With::default() });
    let voxels = tree.voxels() as usize;
    let mut column = |kind: u32, format: ComponentFormat, value: &dyn Fn(usize) -> Vec<f64>| {
        let values = (0..voxels).flat_map(|k| format.encode(&value(k))[..format.words()].to_vec()).collect();
        tree.columns.push(Column { kind, format, values });
    };
    let glows = |k: usize| if k % 4 == 1 { vec![k as f64, 0.5, 100.0] } else { vec![0.0; 3] };
    column(attachment::EMISSION, ComponentFormat::EMISSION, &glows);
    column(attachment::ROUGHNESS_METALNESS, ComponentFormat::ROUGHNESS_METALNESS, &|_| vec![0.2, 1.0]);
    column(attachment::OPACITY, ComponentFormat::OPACITY, &|_| vec![1.0]);
    column(attachment::MATERIAL, ComponentFormat::MATERIAL, &|k| vec![(k / 3) as f64]);
    let velocity = ComponentFormat { components: 3, number: NumberFormat::F16 };
    column(16, velocity, &|k| vec![k as f64 - 4.0, 0.25, if k == 5 { -1e-3 } else { 0.0 }]);
    tree
}

/// The smallest octree: one leaf voxel.
pub(crate) fn single_voxel() -> Octree {
    let mut tree = Tree::default();
    let mut children = [None; 8];
    children[5] = Some(Voxel { leaf: true, ..Voxel::default() });
    let root = tree.open(&children);
    tree.close(root);
    assemble(&tree, DMat4::IDENTITY, &AssembleOptions::default()).expect("a well-formed tree")
}

/// Name and octree of each sample.
pub(crate) fn samples() -> Vec<(&'static str, Octree)> {
    let plain = With::default();
    let one_block = AssembleOptions::default();
    let far = AssembleOptions { near_limit: 1, ..one_block };
    let blocks = AssembleOptions { block_slots: 64, near_limit: 32767 };
    let everything = With { contours: true, colors: Some(rainbow), normals: true };
    let mut with_meta = octree(&branching(everything), &one_block);
    with_meta.set_meta(r#"{"source":"a test","license":"CC0-1.0"}"#.into());
    vec![
        ("single_voxel", single_voxel()),
        ("contours", octree(&branching(With { contours: true, ..plain }), &one_block)),
        ("far_pointers", octree(&branching(plain), &far)),
        ("blocks", octree(&branching(With { contours: true, colors: Some(rainbow), ..plain }), &blocks)),
        ("colors", octree(&branching(With { colors: Some(rainbow), ..plain }), &one_block)),
        ("constant_color", octree(&branching(With { colors: Some(|_| [200, 100, 50]), ..plain }), &one_block)),
        ("normals", octree(&branching(With { normals: true, ..plain }), &one_block)),
        ("ambient", {
            let mut tree = branching(plain);
            tree.ambient = (0..tree.voxels()).map(|k| (255 - k * k) as u8).collect();
            octree(&tree, &one_block)
        }),
        ("plain", octree(&self::plain(), &one_block)),
        ("corners", octree(&corners(), &blocks)),
        ("components", octree(&components(), &blocks)),
        ("everything", with_meta),
    ]
}
