//! Dumps as text and for JSON: the tables of an octree, a block slot by slot, a voxel by its path.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::ControlFlow;

use serde::Serialize;

use crate::check::topology::{Step, Visitor, walk};
use crate::file::{NO_PARENT, PAGE_SLOTS, attachment};
use crate::{Broken, ChildDescriptor, Contour, FormatError, Octree};

/// The object and block tables.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TablesDump {
    /// The objects.
    pub objects: Vec<ObjectDump>,
    /// The blocks.
    pub blocks: Vec<BlockHead>,
}

/// An entry of the object table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectDump {
    /// Transform from octree space to mesh space, column by column.
    pub octree_to_mesh: [f64; 16],
    /// Index of the root block.
    pub root_block: u32,
    /// Slot of the root's descriptor in the image.
    pub root_slot: u64,
    /// Level of the deepest voxel.
    pub levels: u32,
    /// Child descriptors.
    pub descriptors: u64,
    /// Leaf voxels.
    pub leaf_voxels: u64,
    /// Contour values.
    pub contours: u64,
    /// Far pointers.
    pub far_pointers: u64,
}

/// A block's entry in the block table and its info section.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockHead {
    /// Index in the block table.
    pub block: u32,
    /// Index of the object.
    pub object: u32,
    /// Index of the parent block; `None` for root blocks.
    pub parent: Option<u32>,
    /// Lower corner of its cube in units of 2^-23 of the root cube.
    pub cube_position: [u32; 3],
    /// Scale of its cube.
    pub cube_scale: u32,
    /// Offset in the image in bytes.
    pub image_offset: u64,
    /// Size in the image in bytes.
    pub image_size: u64,
    /// Offset in the file in bytes.
    pub file_offset: u64,
    /// Stored size in bytes.
    pub stored_size: u64,
    /// Codec of the stored bytes, see [`crate::file::BlockEntry::codec`].
    pub codec: u32,
    /// Length of the descriptor array in slots. The info section follows it.
    pub array_slots: u32,
    /// Number of values in the contour pool.
    pub contour_count: u32,
    /// Offset of the contour pool from the start of the block in bytes.
    pub contour_offset: u64,
    /// The attachments.
    pub attachments: Vec<AttachmentDump>,
}

/// An attachment of a block.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AttachmentDump {
    /// Its type.
    pub kind: u32,
    /// Offset from the start of the block in bytes.
    pub offset: u64,
    /// Size in bytes.
    pub size: u64,
}

/// A block slot by slot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BlockDump {
    /// Table entry and info section.
    #[serde(flatten)]
    pub head: BlockHead,
    /// Every slot of the descriptor array.
    pub slots: Vec<SlotDump>,
    /// The words of the contour pool, decoded.
    pub contours: Vec<ContourDump>,
}

/// A slot of a descriptor array.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SlotDump {
    /// Its number in the block.
    pub slot: u32,
    /// Its value.
    pub value: u64,
    /// What it is.
    #[serde(flatten)]
    pub purpose: Purpose,
}

/// The purpose of a slot of a descriptor array, found by following pointers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum Purpose {
    /// The first slot of a page.
    PageHeader {
        /// Distance in slots to the info section.
        to_info: u64,
    },
    /// A child descriptor.
    Descriptor {
        /// Path of its voxel: child slots from the root, one digit each.
        path: String,
        /// Level of its voxel.
        level: u32,
        /// Valid mask.
        valid: u8,
        /// Leaf mask.
        leaf: u8,
        /// Contour mask.
        contours: u8,
        /// Distance in slots to the first child or the far pointer.
        child_pointer: u32,
        /// Whether the child pointer leads to a far pointer.
        far: bool,
        /// Distance in words to the first contour.
        contour_pointer: u32,
    },
    /// A far pointer.
    FarPointer {
        /// Distance in slots from the descriptor to its first child.
        distance: u64,
    },
    /// No pointer leads to it.
    Unused,
}

/// A contour, stored and decoded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContourDump {
    /// The stored word.
    pub word: u32,
    /// Normal `n` of the planes, not normalised.
    pub normal: [f64; 3],
    /// `n·p` at the middle of the slab, `p` from the voxel's centre in voxel units.
    pub position: f64,
    /// Distance of the planes in units of `n·p`.
    pub thickness: f64,
}

impl From<Contour> for ContourDump {
    fn from(contour: Contour) -> Self {
        let slab = contour.decode();
        Self { word: contour.0, normal: slab.normal, position: slab.position, thickness: slab.thickness }
    }
}

/// A descriptor, found by its path, and its voxels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeDump {
    /// Index of the object.
    pub object: usize,
    /// Child slots from the root, one digit each.
    pub path: String,
    /// Level of its voxel.
    pub level: u32,
    /// Lower corner of its voxel in units of 2^-23 of the root cube.
    pub position: [u32; 3],
    /// Index of the descriptor's block.
    pub block: u32,
    /// Slot in that block.
    pub slot: u32,
    /// Offset of the descriptor in bytes: in the file, or in the image if its block is compressed or there is no file.
    pub offset: u64,
    /// The descriptor.
    pub value: u64,
    /// Its fields.
    pub fields: Purpose,
    /// Its voxels in slot order; only one if the path leads to a leaf.
    pub voxels: Vec<VoxelDump>,
}

/// A voxel of a descriptor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VoxelDump {
    /// Its child slot.
    pub slot: u8,
    /// Whether it has no descriptor.
    pub leaf: bool,
    /// Slot of its descriptor in the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub descriptor: Option<u32>,
    /// Its contour.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contour: Option<ContourDump>,
    /// Its colour, sRGB-encoded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// Its normal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal: Option<[f32; 3]>,
    /// Alpha of a plain colour, 0 to 255.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha: Option<u8>,
    /// Colours (red, green, blue, alpha) and raw normals at the corners of its cell, which is its cube or an
    /// ancestor's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corners: Option<[([u8; 4], u32); 8]>,
    /// Fraction of the ambient light that reaches it, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient: Option<f32>,
    /// Its components, by attachment type, where the file has them.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub components: BTreeMap<u32, Vec<f64>>,
}

/// The object and block tables of an octree.
pub fn tables(octree: &Octree) -> TablesDump {
    let objects = octree.objects().iter().map(|o| ObjectDump {
        octree_to_mesh: o.octree_to_mesh,
        root_block: o.root_block,
        root_slot: o.root_slot,
        levels: o.levels,
        descriptors: o.descriptors,
        leaf_voxels: o.leaf_voxels,
        contours: o.contours,
        far_pointers: o.far_pointers,
    });
    TablesDump { objects: objects.collect(), blocks: (0..octree.blocks().len()).map(|i| head(octree, i)).collect() }
}

fn head(octree: &Octree, index: usize) -> BlockHead {
    let (entry, parts) = (&octree.blocks()[index], &octree.parts()[index]);
    let attachment =
        |&(kind, at, size): &(u32, u64, u64)| AttachmentDump { kind, offset: at - entry.image_offset, size };
    BlockHead {
        block: index as u32,
        object: entry.object,
        parent: (entry.parent != NO_PARENT).then_some(entry.parent),
        cube_position: entry.cube_position,
        cube_scale: entry.cube_scale,
        image_offset: entry.image_offset,
        image_size: entry.image_size,
        file_offset: entry.file_offset,
        stored_size: entry.stored_size,
        codec: entry.codec,
        array_slots: parts.array_slots,
        contour_count: parts.contour_count,
        contour_offset: parts.contour_words as u64 * 4 - entry.image_offset,
        attachments: parts.attachments.iter().map(attachment).collect(),
    }
}

/// Collects the purposes of the slots of one block.
struct Purposes<'a> {
    octree: &'a Octree,
    start: u32,
    found: Vec<Option<Purpose>>,
}

impl Purposes<'_> {
    fn set(&mut self, slot: u32, purpose: impl FnOnce() -> Purpose) {
        let place = slot.checked_sub(self.start).and_then(|slot| self.found.get_mut(slot as usize));
        if let Some(place) = place {
            *place = Some(purpose());
        }
    }
}

impl Visitor for Purposes<'_> {
    /// Of a damaged block, the parts that can be reached are shown.
    fn broken(&mut self, _: Broken) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn descriptor(&mut self, _: u32, step: &Step, descriptor: ChildDescriptor) {
        self.set(step.slot, || fields(descriptor, path_to(step.position, step.level - 1)));
    }

    fn far_pointer(&mut self, slot: u32) {
        let distance = self.octree.slots()[slot as usize];
        self.set(slot, || Purpose::FarPointer { distance });
    }
}

fn fields(descriptor: ChildDescriptor, path: String) -> Purpose {
    Purpose::Descriptor {
        level: path.len() as u32,
        path,
        valid: descriptor.valid_mask(),
        leaf: descriptor.leaf_mask(),
        contours: descriptor.contour_mask(),
        child_pointer: descriptor.child_ptr(),
        far: descriptor.far(),
        contour_pointer: descriptor.contour_ptr(),
    }
}

/// The path of the voxel of level `level` with its lower corner at `position`.
fn path_to(position: [u32; 3], level: u32) -> String {
    let slot = |level: u32| (0..3).map(|axis| (position[axis] >> (22 - level) & 1) << axis).sum::<u32>();
    (0..level).map(|level| char::from(b'0' + slot(level) as u8)).collect()
}

/// Dumps a block slot by slot. Follows every pointer of the image to find the purpose of each slot, which takes time
/// linear in the size of the image. Slots after broken pointers are shown as unused.
///
/// # Errors
/// There is no such block.
pub fn block(octree: &Octree, index: usize) -> Result<BlockDump, FormatError> {
    let Some(parts) = octree.parts().get(index) else {
        let count = octree.blocks().len();
        return Err(FormatError::Limit(format!("there is no block {index}: the octree has {count}, counted from 0")));
    };
    let mut purposes = Purposes { octree, start: parts.start, found: vec![None; parts.array_slots as usize] };
    walk(octree, &mut purposes);
    let values = &octree.slots()[parts.start as usize..][..parts.array_slots as usize];
    let slots = purposes.found.into_iter().zip(values).zip(0..).map(|((purpose, &value), slot)| {
        let otherwise = if slot % PAGE_SLOTS == 0 { Purpose::PageHeader { to_info: value } } else { Purpose::Unused };
        SlotDump { slot, value, purpose: purpose.unwrap_or(otherwise) }
    });
    let contours = octree.words()[parts.contour_words..][..parts.contour_count as usize].iter();
    Ok(BlockDump {
        head: head(octree, index),
        slots: slots.collect(),
        contours: contours.map(|word| Contour(*word).into()).collect(),
    })
}

/// Dumps the descriptor at the end of a path of child slots from the root of an object, with its voxels. If the path
/// leads to a leaf voxel: the descriptor of its parent, with only that voxel.
///
/// # Errors
/// The octree is not sound, there is no such object, or the path leaves the octree.
pub fn node(octree: &Octree, object: usize, path: &[u8]) -> Result<NodeDump, FormatError> {
    octree.sound()?;
    let Some(entry) = octree.objects().get(object) else {
        let count = octree.objects().len();
        return Err(FormatError::Limit(format!("there is no object {object}: the octree has {count}, counted from 0")));
    };
    let (mut slot, mut position) = (entry.root_slot as u32, [0u32; 3]);
    let mut only = None;
    for (level, &child) in path.iter().enumerate() {
        let end = level + 1 == path.len();
        let descriptor = octree.descriptor(slot);
        if child < 8
            && let Some(next) = octree.child(slot, child)
        {
            slot = next;
            for (axis, x) in position.iter_mut().enumerate() {
                *x += u32::from(child >> axis & 1) << (22 - level);
            }
        } else if child < 8 && end && descriptor.valid_mask() >> child & 1 != 0 {
            only = Some(child);
        } else {
            let there: Vec<String> = (0..8)
                .filter(|c| descriptor.valid_mask() >> c & 1 != 0)
                .map(|c| format!("{c}{}", if descriptor.leaf_mask() >> c & 1 != 0 { " (leaf)" } else { "" }))
                .collect();
            let what = format!(
                "there is no voxel at {} below {}, only at {}",
                child,
                if level == 0 { "the root".into() } else { format!("path {}", digits(&path[..level])) },
                there.join(", ")
            );
            return Err(FormatError::Limit(what));
        }
    }
    let above = &path[..path.len() - usize::from(only.is_some())];
    let (descriptor, block) = (octree.descriptor(slot), octree.block_of(slot));
    let shown = (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0 && only.is_none_or(|only| only == *c));
    Ok(NodeDump {
        object,
        path: digits(above),
        level: above.len() as u32,
        position,
        block,
        slot: slot - octree.parts()[block as usize].start,
        offset: octree.offset(u64::from(slot) * 8),
        value: descriptor.0,
        fields: fields(descriptor, digits(above)),
        voxels: shown.map(|child| voxel(octree, slot, child)).collect(),
    })
}

fn digits(path: &[u8]) -> String {
    path.iter().map(|slot| char::from(b'0' + slot)).collect()
}

fn voxel(octree: &Octree, slot: u32, child: u8) -> VoxelDump {
    let descriptor = octree.child(slot, child);
    VoxelDump {
        slot: child,
        leaf: descriptor.is_none(),
        descriptor,
        contour: octree.contour(slot, child).map(ContourDump::from),
        color: octree.color(slot, child),
        normal: octree.normal(slot, child).map(|n| n.to_array()),
        alpha: octree.plain_color(slot, child).map(|color| color[3]).filter(|alpha| *alpha != u8::MAX),
        corners: octree.corners(slot, child).map(|cell| cell.corners.map(|value| (value.color, value.normal.0))),
        ambient: octree.ambient(slot, child),
        components: components(octree, slot, child),
    }
}

fn components(octree: &Octree, slot: u32, child: u8) -> BTreeMap<u32, Vec<f64>> {
    let parts = &octree.parts()[octree.block_of(slot) as usize];
    let kinds = parts.attachments.iter().map(|a| a.0).filter(|kind| attachment::has_components(*kind));
    kinds.filter_map(|kind| Some((kind, octree.components(slot, child, kind)?.used().to_vec()))).collect()
}

/// Parses a path: child slots as digits 0 to 7, optionally separated by `/`. The root is the empty path or `/`.
///
/// # Errors
/// Other characters, or more than 23 digits.
pub fn parse_path(text: &str) -> Result<Vec<u8>, FormatError> {
    let path: Option<Vec<u8>> =
        text.bytes().filter(|byte| *byte != b'/').map(|b| (b'0'..=b'7').contains(&b).then(|| b - b'0')).collect();
    path.filter(|path| path.len() <= 23).ok_or_else(|| {
        FormatError::Limit(format!(
            "{text} is not a path, expected at most 23 child slots from 0 to 7, e.g. 0/3/7 or 037"
        ))
    })
}

/// A number with its unit, in the plural unless the number is 1.
fn count(number: impl Into<u64>, unit: &str) -> String {
    let number = number.into();
    format!("{number} {unit}{}", if number == 1 { "" } else { "s" })
}

impl fmt::Display for TablesDump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, o) in self.objects.iter().enumerate() {
            writeln!(
                f,
                "object {index}: {}, root at slot {} in block {}; {}, {}, {}, {}",
                count(o.levels, "level"),
                o.root_slot,
                o.root_block,
                count(o.descriptors, "descriptor"),
                count(o.leaf_voxels, "leaf voxel"),
                count(o.contours, "contour"),
                count(o.far_pointers, "far pointer")
            )?;
            writeln!(f, "  octree to mesh, by columns: {:?}", o.octree_to_mesh)?;
        }
        self.blocks.iter().try_for_each(|block| write!(f, "{block}"))
    }
}

impl fmt::Display for BlockHead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "block {} of object {}, ", self.block, self.object)?;
        match self.parent {
            Some(parent) => write!(f, "below block {parent}")?,
            None => write!(f, "a root block")?,
        }
        writeln!(f, ": cube at {:?} of scale {}", self.cube_position, self.cube_scale)?;
        writeln!(
            f,
            "  {} bytes at {} of the image; stored with codec {} in {} bytes at {}",
            self.image_size, self.image_offset, self.codec, self.stored_size, self.file_offset
        )?;
        writeln!(
            f,
            "  array of {}, {} at byte {}",
            count(self.array_slots, "slot"),
            count(self.contour_count, "contour"),
            self.contour_offset
        )?;
        for AttachmentDump { kind, offset, size } in &self.attachments {
            let name = attachment::name(*kind);
            writeln!(f, "  attachment {kind} ({name}): {size} bytes at byte {offset}")?;
        }
        Ok(())
    }
}

impl fmt::Display for BlockDump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.head)?;
        let mut unused = 0;
        for slot in &self.slots {
            // Runs of unused zero slots are printed as one line.
            if slot.purpose == Purpose::Unused && slot.value == 0 {
                unused += 1;
                continue;
            }
            write_unused(f, &mut unused)?;
            writeln!(f, "{:8}  {:016x}  {}", slot.slot, slot.value, slot.purpose)?;
        }
        write_unused(f, &mut unused)?;
        for (index, contour) in self.contours.iter().enumerate() {
            writeln!(f, "contour {index}: {contour}")?;
        }
        Ok(())
    }
}

fn write_unused(f: &mut fmt::Formatter<'_>, count: &mut u32) -> fmt::Result {
    if *count > 0 {
        writeln!(f, "          {count} unused")?;
    }
    *count = 0;
    Ok(())
}

impl fmt::Display for Purpose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PageHeader { to_info } => write!(f, "page header: info section {to_info} slots on"),
            Self::FarPointer { distance } => write!(f, "far pointer: {distance} slots from its descriptor"),
            Self::Unused => write!(f, "unused, but not zero"),
            Self::Descriptor { path, level, valid, leaf, contours, child_pointer, far, contour_pointer } => {
                let path = if path.is_empty() { "/" } else { path };
                write!(f, "descriptor of {path} (level {level}): valid {valid:08b}, leaf {leaf:08b}")?;
                if *child_pointer != 0 {
                    let what = if *far { "far pointer" } else { "children" };
                    write!(f, ", {what} {child_pointer} slots on")?;
                }
                if *contours != 0 {
                    write!(f, ", contours {contours:08b} from {contour_pointer} words on")?;
                }
                Ok(())
            }
        }
    }
}

impl fmt::Display for ContourDump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { word, normal: [x, y, z], position, thickness } = self;
        write!(f, "{word:08x}: normal {x:.5} {y:.5} {z:.5}, position {position:.5}, thickness {thickness:.5}")
    }
}

impl fmt::Display for NodeDump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "object {}, block {}, slot {}, byte {}: {:016x}\n{}, cube at {:?}",
            self.object, self.block, self.slot, self.offset, self.value, self.fields, self.position
        )?;
        for voxel in &self.voxels {
            write!(f, "  {}: ", voxel.slot)?;
            match voxel.descriptor {
                Some(slot) => write!(f, "descriptor at slot {slot} of the image")?,
                None => write!(f, "leaf")?,
            }
            if let Some(contour) = &voxel.contour {
                write!(f, "; contour {contour}")?;
            }
            if let Some([r, g, b]) = voxel.color {
                write!(f, "; colour {r:.4} {g:.4} {b:.4}")?;
            }
            if let Some([x, y, z]) = voxel.normal {
                write!(f, "; normal {x:.5} {y:.5} {z:.5}")?;
            }
            if let Some(alpha) = voxel.alpha {
                write!(f, "; alpha {alpha}")?;
            }
            for (corner, ([r, g, b, a], normal)) in voxel.corners.iter().flatten().enumerate() {
                write!(f, "; corner {corner}: {r:02x}{g:02x}{b:02x}{a:02x} {normal:08x}")?;
            }
            if let Some(ambient) = voxel.ambient {
                write!(f, "; ambient {ambient:.4}")?;
            }
            for (kind, numbers) in &voxel.components {
                let numbers: Vec<String> = numbers.iter().map(|x| format!("{x:.5}")).collect();
                write!(f, "; {} ({kind}) {}", attachment::name(*kind), numbers.join(" "))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
