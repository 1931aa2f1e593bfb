//! Joins several octrees into one.

use crate::file::{MAX_IMAGE_SLOTS, NO_PARENT};
use crate::octree::{Image, Stored};
use crate::{FormatError, Octree};

/// An octree with the objects of all these octrees, in order, at their places. Blocks are copied with all their attachments.
/// Pointers are distances within an object, so only the tables and the block numbers in the info sections change. Metadata and
/// unknown sections are left out: they say something about a file.
///
/// The checksums of files are compared first, whatever [`OpenOptions::verify`](crate::OpenOptions::verify) says.
///
/// # Errors
/// No octree; a damaged one (B006, D009); an image of more than 2^32 slots, before anything is copied.
pub fn join(octrees: &[&Octree]) -> Result<Octree, FormatError> {
    if octrees.is_empty() {
        return Err(FormatError::Limit("no octrees were given: an octree has at least one object".into()));
    }
    let slots: u64 = octrees.iter().map(|octree| octree.slots().len() as u64).sum();
    if slots > MAX_IMAGE_SLOTS {
        return Err(FormatError::Limit(format!(
            "the octrees have {slots} slots together, expected at most 2^32: join fewer"
        )));
    }
    let mut made = true;
    for octree in octrees {
        if let Stored::File { .. } = octree.stored {
            octree.compared()?;
        }
        made &= matches!(octree.stored, Stored::Made);
    }
    let (mut objects, mut blocks, mut image) = (Vec::new(), Vec::new(), Vec::<u64>::with_capacity(slots as usize));
    for octree in octrees {
        let (first_object, first_block, first_slot) = (objects.len() as u32, blocks.len() as u32, image.len());
        image.extend_from_slice(octree.slots());
        for (index, (block, parts)) in octree.blocks().iter().zip(octree.parts()).enumerate() {
            let mut block = *block;
            block.object += first_object;
            block.image_offset += first_slot as u64 * 8;
            if block.parent != NO_PARENT {
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
    crate::check::tables::check_objects(&objects, 0)?;
    crate::check::tables::check_blocks(&blocks, 0, &objects, Some(image.len() as u64 * 8))?;
    let stored = if made { Stored::Made } else { Stored::Taken };
    Octree::new(objects, blocks, String::new(), Vec::new(), Image::Owned(image), None, stored)
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
        let joined = join(&octrees().iter().collect::<Vec<_>>()).expect("three octrees");
        assert!(joined.blocks().len() > 4, "more blocks than objects");
        assert!(validate(&joined).is_ok(), "{:?}", validate(&joined).findings);
        let mut bytes = Vec::new();
        let lost = oct::write_to(&joined, &mut bytes).expect("a sound octree");
        assert!(lost.is_empty(), "{lost:?}");
        let back = oct::from_bytes(&bytes).expect("our own file");
        assert!(back.lost.is_empty(), "{:?}", back.lost);
        for (index, octree) in octrees().iter().enumerate() {
            assert_eq!(contents(&joined, index), contents(octree, 0), "joined object {index}");
            assert_eq!(contents(&back.octree, index), contents(octree, 0), "object {index}, there and back");
        }
    }

    #[test]
    fn what_is_damaged_or_nothing_is_refused() {
        assert!(matches!(join(&[]), Err(FormatError::Limit(_))));
        let mut bytes = Vec::new();
        chain(20, true).write_to(&mut bytes).expect("writes");
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        for verify in [true, false] {
            let options = crate::OpenOptions { verify, ..crate::OpenOptions::default() };
            let damaged = Octree::from_bytes_with(&bytes, &options).expect("only a checksum is wrong");
            let result = join(&[&chain(1, false), &damaged]);
            assert!(matches!(result, Err(FormatError::Broken(broken)) if broken.rule == crate::ids::BLOCK_CHECKSUM));
        }
    }
}
