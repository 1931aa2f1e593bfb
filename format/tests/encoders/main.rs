//! Compares the encoders of colour and normal blocks with the method of the paper's authors on synthetic blocks. The
//! test `builder/tests/encoders.rs` does the same on blocks of real scenes and prints tables.

mod authors;
mod blocks;
mod compare;

#[test]
fn colors_are_no_less_accurate_than_the_authors_method() {
    for (name, blocks) in blocks::color_sets(1000) {
        compare::colors(name, &blocks, None);
    }
}

#[test]
fn normals_are_no_less_accurate_than_the_authors_method() {
    for (name, blocks) in blocks::normal_sets(1000) {
        compare::normals(name, &blocks, None);
    }
}

#[test]
fn blocks_of_an_octree_are_what_it_holds() {
    use esvo_format::{Octree, RawNormal};
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/plain.esvo");
    let octree = Octree::open(&path).unwrap();
    let (colors, normals) = blocks::of_octree(&octree);
    let voxels = esvo_format::stats(&octree).voxels as usize;
    assert_eq!(colors.iter().flatten().flatten().count(), voxels);
    assert_eq!(normals.iter().flatten().flatten().count(), voxels);
    // The first child of the root is in the first block, at the texel of its child slot.
    let root = octree.objects()[0].root_slot as u32;
    let child = octree.descriptor(root).valid_mask().trailing_zeros() as u8;
    let [r, g, b, _] = octree.plain_color(root, child).unwrap();
    let half = 8 * ((root - octree.parts()[0].start) % 2) as usize;
    assert_eq!(colors[0][half + child as usize], Some([r, g, b]));
    assert_eq!(normals[0][half + child as usize], octree.plain_normal(root, child).map(RawNormal::decode));
}
