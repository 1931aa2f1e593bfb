//! Merges several octrees into one.

use crate::{FormatError, Octree};

/// An octree with the objects of all these octrees, in order. Pointers are distances within an object, so only the
/// tables and the block numbers in the info sections change.
///
/// # Errors
/// The image would have more than 2^32 slots.
pub(super) fn merge(mut octrees: Vec<Octree>) -> Result<Octree, FormatError> {
    if octrees.len() == 1 {
        return Ok(octrees.remove(0));
    }
    let (mut objects, mut blocks, mut image) = (Vec::new(), Vec::new(), Vec::<u64>::new());
    for octree in octrees {
        let (first_object, first_block, first_slot) = (objects.len() as u32, blocks.len() as u32, image.len());
        image.extend_from_slice(octree.slots());
        for (index, (block, parts)) in octree.blocks().iter().zip(octree.parts()).enumerate() {
            let mut block = *block;
            block.object += first_object;
            block.image_offset += first_slot as u64 * 8;
            if block.parent != crate::file::NO_PARENT {
                block.parent += first_block;
            }
            blocks.push(block);
            // The low word of the info section.
            let info = &mut image[first_slot + (parts.start + parts.array_slots) as usize];
            *info = *info & !0xffff_ffff | u64::from(first_block + index as u32);
        }
        for object in octree.objects() {
            let mut object = *object;
            object.root_block += first_block;
            object.root_slot += first_slot as u64;
            objects.push(object);
        }
    }
    Octree::from_parts(objects, blocks, image)
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};

    use super::*;
    use crate::{AssembleOptions, Contour, RawNormal, Tree, Voxel, assemble, oct, validate};

    /// A chain of nodes, each with two leaves as siblings, in several blocks.
    fn chain(nodes: u8, colors: bool) -> Octree {
        let mut tree = Tree::default();
        let voxel = |k: u8, leaf| Voxel {
            color: colors.then_some([k, 255 - k, 7]),
            normal: colors.then_some(RawNormal(u32::from(k) << 14)),
            contour: k.is_multiple_of(3).then_some(Contour(0x1234_5678 + u32::from(k))),
            leaf,
        };
        let opened: Vec<usize> = (0..nodes)
            .map(|k| {
                let mut children = [None; 8];
                children[usize::from(k % 8)] = Some(voxel(k, true));
                children[usize::from((k + 5) % 8)] = Some(voxel(k + 200, true));
                if k + 1 < nodes {
                    children[usize::from((k + 3) % 8)] = Some(voxel(k + 100, false));
                }
                tree.open(&children)
            })
            .collect();
        opened.into_iter().rev().for_each(|index| tree.close(index));
        let transform = DMat4::from_translation(DVec3::splat(f64::from(nodes)));
        assemble(&tree, transform, &AssembleOptions { block_slots: 64, near_limit: 1 }).expect("a well-formed tree")
    }

    /// All properties of the voxels of an object.
    fn contents(octree: &Octree, object: usize) -> Vec<String> {
        let mut stack = vec![octree.objects()[object].root_slot as u32];
        let mut found = vec![format!("{}", octree.octree_to_mesh(object))];
        while let Some(slot) = stack.pop() {
            for child in (0..8).filter(|child| octree.descriptor(slot).valid_mask() >> child & 1 != 0) {
                let (contour, below) = (octree.contour(slot, child), octree.child(slot, child));
                let (color, normal) = (octree.color(slot, child), octree.normal(slot, child));
                found.push(format!("{child} {} {contour:?} {color:?} {normal:?}", below.is_some()));
                stack.extend(below);
            }
        }
        found
    }

    #[test]
    fn objects_stay_what_they_are() {
        let octrees = || vec![chain(20, true), chain(1, false), chain(23, true)];
        let merged = merge(octrees()).expect("three octrees");
        assert!(merged.blocks().len() > 4, "more blocks than objects");
        assert!(validate(&merged).is_ok(), "{:?}", validate(&merged).findings);
        let mut bytes = Vec::new();
        let lost = oct::write_to(&merged, &mut bytes).expect("a sound octree");
        assert!(lost.is_empty(), "{lost:?}");
        let back = oct::from_bytes(&bytes).expect("our own file");
        assert!(back.lost.is_empty(), "{:?}", back.lost);
        for (index, octree) in octrees().iter().enumerate() {
            assert_eq!(contents(&merged, index), contents(octree, 0), "merged object {index}");
            assert_eq!(contents(&back.octree, index), contents(octree, 0), "object {index}, there and back");
        }
    }
}
