//! Several octrees in one.

use crate::{FormatError, Octree};

/// The objects of all these octrees, in order. Pointers are distances within an object, so only the tables and the block
/// numbers in the info sections change.
///
/// # Errors
/// More slots than an image can have.
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
