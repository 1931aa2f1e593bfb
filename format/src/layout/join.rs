//! Joins several octrees into one.

use std::collections::BTreeMap;

use crate::file::{InstanceEntry, MAX_IMAGE_SLOTS, NO_PARENT, attachment};
use crate::metadata::ObjectMetadata;
use crate::octree::{Image, Stored};
use crate::{FormatError, Metadata, Octree};

/// An octree with the objects of all these octrees, in order, at their places. Blocks are copied with all their attachments.
/// Pointers are distances within an object, so only the tables and the block numbers in the info sections change.
///
/// Members of the [metadata](Metadata) that all octrees have alike stay what they are. All others go to the objects of their octree
/// ([`ObjectMetadata::metadata`]); unit, up axis and handedness are then left out, as they are those of the whole space. What
/// attachments are (`attachments`) is said of the whole. Instances
/// stay; if only some octrees have any, the objects of the others get one each. Unknown sections and ids are left out: they
/// say something about a file.
///
/// The checksums of files are compared first, whatever [`OpenOptions::verify`](crate::OpenOptions::verify) says.
///
/// # Errors
/// No octree; a damaged one (B006, D009); an image of more than 2^32 slots, before anything is copied; attachments of the same type and of
/// different meaning.
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
    let mut joined = Octree::new(objects, blocks, String::new(), Vec::new(), Image::Owned(image), None, stored)?;
    let mut metadata = join_metadata(octrees);
    metadata.attachments = join_names(octrees)?;
    if !metadata.is_empty() {
        joined.meta = metadata.to_string();
    }
    joined.set_instances(join_instances(octrees))?;
    Ok(joined)
}

/// The instances of all octrees; none if no octree has any.
fn join_instances(octrees: &[&Octree]) -> Vec<InstanceEntry> {
    if octrees.iter().all(|octree| octree.instances.is_empty()) {
        return Vec::new();
    }
    let mut first = 0;
    let mut joined = Vec::new();
    for octree in octrees {
        joined.extend(octree.placed().into_iter().map(|one| InstanceEntry { object: one.object + first, ..one }));
        first += octree.objects.len() as u32;
    }
    joined
}

/// What the attachments are whose meaning the metadata give (spec 8.7).
///
/// # Errors
/// A type that two octrees have is not the same in both.
fn join_names(octrees: &[&Octree]) -> Result<Option<serde_json::Map<String, serde_json::Value>>, FormatError> {
    let (mut joined, mut known) = (serde_json::Map::new(), BTreeMap::new());
    for (index, octree) in octrees.iter().enumerate() {
        let names = Metadata::parse(&octree.meta).unwrap_or_default().attachments.unwrap_or_default();
        for kind in octree.component_kinds().into_iter().filter(|kind| *kind >= attachment::NAMED_FIRST) {
            let of = |entry: &serde_json::Value| ["name", "unit"].map(|member| entry.get(member).cloned());
            let entry = names.get(&kind.to_string()).cloned().unwrap_or_default();
            let (first, meaning) = known.entry(kind).or_insert_with(|| (index, of(&entry)));
            if *meaning != of(&entry) {
                return Err(FormatError::Limit(format!(
                    "attachments of type {kind} have another name or unit in octree {first} than in octree {index}, counted from 0: \
                     give one of them another type"
                )));
            }
        }
        joined.extend(names);
    }
    Ok((!joined.is_empty()).then_some(joined))
}

/// Members of a file that are not those of an object: they hold for all of its space, or for its blocks.
const OF_SPACE: [&str; 4] = ["unit", "up", "handedness", "attachments"];

fn join_metadata(octrees: &[&Octree]) -> Metadata {
    // Text that is no JSON object cannot have been read from a file.
    let mut all: Vec<Metadata> =
        octrees.iter().map(|octree| Metadata::parse(&octree.meta).unwrap_or_default()).collect();
    let some_placed = octrees.iter().any(|octree| !octree.instances.is_empty());
    let (mut objects, mut instances) = (Vec::new(), Vec::new());
    for (metadata, octree) in all.iter_mut().zip(octrees) {
        let resized = |list: &mut Vec<ObjectMetadata>, length| {
            let mut list = std::mem::take(list);
            list.resize(length, ObjectMetadata::default());
            list
        };
        objects.push(resized(&mut metadata.objects, octree.objects.len()));
        instances.push(resized(&mut metadata.instances, if some_placed { octree.placed().len() } else { 0 }));
    }
    let members: Vec<_> = all.iter().map(Metadata::members).collect();
    let mut common = members.first().cloned().unwrap_or_default();
    common.retain(|name, value| members.iter().all(|other| other.get(name) == Some(value)));
    for (members, objects) in members.into_iter().zip(&mut objects) {
        let own = members.into_iter().filter(|(name, _)| !common.contains_key(name) && !OF_SPACE.contains(&&name[..]));
        let own: serde_json::Map<_, _> = own.collect();
        for object in objects {
            // What is known about the object itself is more exact.
            let known = std::mem::replace(&mut object.metadata, own.clone());
            object.metadata.extend(known);
        }
    }
    let mut joined = Metadata::parse(&serde_json::Value::from(common).to_string()).unwrap_or_default();
    joined.objects = without_empty_end(objects.concat());
    joined.instances = without_empty_end(instances.concat());
    joined
}

/// The list up to the last entry that says anything.
fn without_empty_end(mut list: Vec<ObjectMetadata>) -> Vec<ObjectMetadata> {
    while list.last().is_some_and(|last| *last == ObjectMetadata::default()) {
        list.pop();
    }
    list
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
    fn metadata_and_instances_stay_with_their_objects() {
        let (mut a, mut b, c) = (chain(3, true), chain(2, false), chain(1, false));
        a.set_meta(r#"{"unit":1,"up":"+y","license":"MIT","title":"A","x":[1]}"#.into());
        b.set_meta(
            r#"{"unit":1,"up":"+z","license":"MIT","objects":[{"name":"b","metadata":{"title":"own"}}],"title":"B"}"#
                .into(),
        );
        let text = |octrees: &[&Octree]| join(octrees).expect("small octrees").meta().to_owned();
        assert_eq!(
            text(&[&a, &b]),
            r#"{"license":"MIT","objects":[{"metadata":{"title":"A","x":[1]}},{"metadata":{"title":"own"},"name":"b"}],"unit":1.0}"#
        );
        assert_eq!(text(&[&c, &c]), "", "nothing is known");
        assert_eq!(text(&[&a]), r#"{"license":"MIT","title":"A","unit":1.0,"up":"+y","x":[1]}"#);
        let at = |x: f64| DMat4::from_translation(DVec3::new(x, 0.0, 0.0));
        b.set_instances(vec![InstanceEntry::new(0, at(1.0)), InstanceEntry::new(0, at(2.0))]).expect("object 0");
        let joined = join(&[&a, &b, &c]).expect("small octrees");
        let places: Vec<_> = joined.instances().iter().map(|one| (one.object, one.matrix())).collect();
        assert_eq!(places, [(0, at(0.0)), (1, at(1.0)), (1, at(2.0)), (2, at(0.0))]);
        assert!(b.set_instances(vec![InstanceEntry::new(1, at(0.0))]).is_err_and(|broken| broken.rule == "N002"));
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
