//! Prints every leaf voxel of an octree: lower corner and edge in mesh units, and colour.
//!
//! `cargo run -p esvo-examples --example read_leaves -- FILE.esvo`; without a file, a small octree is made first.

use std::error::Error;
use std::path::Path;

use esvo_format::{AssembleOptions, FormatError, Octree, Tree, Voxel, assemble};
use glam::{DMat4, DVec3};

fn main() -> Result<(), Box<dyn Error>> {
    let octree = match std::env::args().nth(1) {
        Some(file) => Octree::open(Path::new(&file))?,
        None => two_voxels()?,
    };
    // Checks all descriptors once. An octree that passes can be walked without further checks.
    octree.sound()?;
    let mut leaves = 0;
    for (number, object) in octree.objects().iter().enumerate() {
        let to_mesh = octree.octree_to_mesh(number);
        walk(&octree, object.root_slot as u32, &mut |child_of, child, corner, edge| {
            let low = to_mesh.transform_point3(corner);
            let size = to_mesh.transform_vector3(DVec3::splat(edge));
            println!("{low:.4} {size:.4} {:?}", octree.color(child_of, child));
            leaves += 1;
        });
    }
    println!("{leaves} leaf voxels");
    Ok(())
}

/// Visits the leaf voxels below a descriptor: the descriptor's slot, the child slot, and lower corner and edge in octree
/// space, where the root cube is `[0, 1]³`.
fn walk(octree: &Octree, root: u32, visit: &mut impl FnMut(u32, u8, DVec3, f64)) {
    let mut stack = vec![(root, DVec3::ZERO, 1.0)];
    while let Some((slot, corner, edge)) = stack.pop() {
        let valid = octree.descriptor(slot).valid_mask();
        for child in (0..8u8).filter(|child| valid >> child & 1 != 0) {
            // Bit 0 of a child slot is x, bit 1 is y, bit 2 is z.
            let offset = DVec3::new((child & 1).into(), (child >> 1 & 1).into(), (child >> 2).into());
            let (corner, edge) = (corner + offset * edge / 2.0, edge / 2.0);
            match octree.child(slot, child) {
                Some(below) => stack.push((below, corner, edge)),
                None => visit(slot, child, corner, edge),
            }
        }
    }
}

/// Two voxels of level 1, a red one and a blue one, in a root cube with an edge of 2 mesh units.
fn two_voxels() -> Result<Octree, FormatError> {
    let leaf = |color| Some(Voxel { color: Some(color), leaf: true, ..Voxel::default() });
    let mut children = [None; 8];
    (children[0], children[7]) = (leaf([255, 0, 0]), leaf([0, 0, 255]));
    let mut tree = Tree::default();
    let root = tree.open(&children);
    tree.close(root);
    assemble(&tree, DMat4::from_scale(DVec3::splat(2.0)), &AssembleOptions::default())
}
