//! Counts of voxels and bytes of an octree.

use std::ops::ControlFlow;

use crate::block::BlockParts;
use crate::check::topology::{Step, Visitor, walk};
use crate::file::*;
use crate::{Broken, ChildDescriptor, ComponentFormat, Octree};

/// The bytes of an image by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Bytes {
    /// Child descriptors.
    pub descriptors: u64,
    /// Far pointers.
    pub far_pointers: u64,
    /// Page headers.
    pub page_headers: u64,
    /// Unused slots of descriptor arrays, which keep siblings in pairs and within a page.
    pub gaps: u64,
    /// Info sections with their attachment directories.
    pub info_sections: u64,
    /// Contour values.
    pub contours: u64,
    /// Colour blocks, plain and constant colours.
    pub colors: u64,
    /// Normal blocks and plain normals.
    pub normals: u64,
    /// Colours and normals of corners.
    pub corners: u64,
    /// Ambient occlusion blocks.
    pub ambient: u64,
    /// Components: emission, roughness and metalness, opacity, material, and named ones.
    #[serde(skip_serializing_if = "is_zero")]
    pub components: u64,
    /// Attachments of other types.
    pub other_attachments: u64,
    /// Alignment within blocks, and from their end to the end of the page.
    pub padding: u64,
}

fn is_zero(bytes: &u64) -> bool {
    *bytes == 0
}

/// The component attachments of one type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ComponentStats {
    /// Attachment type.
    pub kind: u32,
    /// Its name in the specification.
    pub name: &'static str,
    /// Format in the first block that has it.
    #[serde(flatten)]
    pub format: ComponentFormat,
    /// Number of blocks that have it. In all others, every voxel has the default.
    pub blocks: u64,
    /// Size of all of them in bytes.
    pub bytes: u64,
}

/// The component attachments of an octree by type, in order. Reads no voxels.
pub fn component_stats(octree: &Octree) -> Vec<ComponentStats> {
    let of = |kind: u32| {
        let sizes = octree.parts().iter().flat_map(|parts| &parts.attachments).filter(|a| a.0 == kind).map(|a| a.2);
        Some(ComponentStats {
            kind,
            name: attachment::name(kind),
            format: octree.component_format(kind)?,
            blocks: sizes.clone().count() as u64,
            bytes: sizes.sum(),
        })
    };
    octree.component_kinds().into_iter().filter_map(of).collect()
}

impl Bytes {
    /// The sum, which is the size of the image.
    pub fn total(&self) -> u64 {
        self.named().iter().map(|(_, bytes)| bytes).sum()
    }

    /// Name and number of bytes of each purpose, in the order within a block. Components are left out where there are none.
    pub fn named(&self) -> Vec<(&'static str, u64)> {
        let mut named = vec![
            ("descriptors", self.descriptors),
            ("far pointers", self.far_pointers),
            ("page headers", self.page_headers),
            ("gaps", self.gaps),
            ("info sections", self.info_sections),
            ("contours", self.contours),
            ("colors", self.colors),
            ("normals", self.normals),
            ("corners", self.corners),
            ("ambient occlusion", self.ambient),
            ("components", self.components),
            ("other attachments", self.other_attachments),
            ("padding", self.padding),
        ];
        named.retain(|entry| *entry != ("components", 0));
        named
    }
}

/// Counts of an octree, over all objects.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Stats {
    /// Objects.
    pub objects: u64,
    /// Blocks.
    pub blocks: u64,
    /// Level of the deepest voxel; the root is level 0.
    pub levels: u32,
    /// Child descriptors: voxels that are not leaves, roots included.
    pub descriptors: u64,
    /// Voxels, not counting the roots.
    pub voxels: u64,
    /// Leaf voxels.
    pub leaf_voxels: u64,
    /// Contours.
    pub contours: u64,
    /// Far pointers.
    pub far_pointers: u64,
    /// Average number of children per descriptor.
    pub branching: f64,
    /// Voxels at each level, 0 (the roots) to [`levels`](Self::levels).
    pub voxels_per_level: Vec<u64>,
    /// The bytes of the image by purpose.
    pub bytes: Bytes,
    /// Size of the image in bytes.
    pub image_bytes: u64,
    /// Image bytes per voxel.
    pub bytes_per_voxel: f64,
}

impl Stats {
    /// Nothing counted yet.
    pub(super) fn none(objects: usize, blocks: usize, image_bytes: u64) -> Self {
        let objects = objects as u64;
        let mut voxels_per_level = vec![0; 24];
        voxels_per_level[0] = objects;
        Self { objects, blocks: blocks as u64, voxels_per_level, image_bytes, ..Self::default() }
    }

    /// Counts a descriptor whose children are at `level`, 1 to 23.
    pub(super) fn count(&mut self, level: u32, descriptor: ChildDescriptor) {
        let voxels = u64::from(descriptor.valid_mask().count_ones());
        self.levels = self.levels.max(level);
        self.descriptors += 1;
        self.voxels += voxels;
        self.leaf_voxels += u64::from(descriptor.leaf_mask().count_ones());
        self.contours += u64::from(descriptor.contour_mask().count_ones());
        self.voxels_per_level[level as usize] += voxels;
    }

    /// What follows from the counts.
    pub(super) fn averages(&mut self) {
        self.voxels_per_level.truncate(self.levels as usize + 1);
        self.branching = self.voxels as f64 / self.descriptors.max(1) as f64;
        self.bytes_per_voxel = self.image_bytes as f64 / self.voxels.max(1) as f64;
    }
}

struct Counter<'a>(&'a mut Stats);

impl Visitor for Counter<'_> {
    /// Parts that cannot be reached are not counted.
    fn broken(&mut self, _finding: Broken) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn descriptor(&mut self, _object: u32, step: &Step, descriptor: ChildDescriptor) {
        self.0.count(step.level, descriptor);
    }

    fn far_pointer(&mut self, _slot: u32) {
        self.0.far_pointers += 1;
    }
}

/// Counts voxels and bytes in one walk. If the octree is not [sound](Octree::sound), only the parts that can be reached
/// are counted, and the rest of the descriptor arrays counts as gaps.
pub fn stats(octree: &Octree) -> Stats {
    let (objects, blocks) = (octree.objects().len(), octree.blocks().len());
    let mut stats = Stats::none(objects, blocks, octree.slots().len() as u64 * 8);
    walk(octree, &mut Counter(&mut stats));
    stats.bytes = bytes(octree, &stats);
    stats.averages();
    stats
}

fn bytes(octree: &Octree, stats: &Stats) -> Bytes {
    let mut bytes = Bytes::default();
    octree.parts().iter().for_each(|parts| bytes.add(parts));
    bytes.finish(stats);
    bytes
}

impl Bytes {
    /// Adds what a block says of itself. The descriptor array counts as gaps.
    pub(super) fn add(&mut self, parts: &BlockParts) {
        let headers = u64::from(parts.array_slots.div_ceil(PAGE_SLOTS)) * 8;
        self.page_headers += headers;
        self.gaps += u64::from(parts.array_slots) * 8 - headers;
        self.info_sections += INFO_BYTES + parts.attachments.len() as u64 * ATTACHMENT_BYTES;
        self.contours += u64::from(parts.contour_count) * 4;
        for &(kind, _, size) in &parts.attachments {
            *match kind {
                attachment::CORNERS => &mut self.corners,
                kind if attachment::COLORS.contains(&kind) => &mut self.colors,
                kind if attachment::NORMALS.contains(&kind) => &mut self.normals,
                attachment::AMBIENT_BLOCKS => &mut self.ambient,
                kind if attachment::has_components(kind) => &mut self.components,
                _ => &mut self.other_attachments,
            } += size;
        }
    }

    /// Takes the counted descriptors and far pointers out of the gaps. What is left of the image is padding.
    pub(super) fn finish(&mut self, stats: &Stats) {
        self.descriptors = stats.descriptors * 8;
        self.far_pointers = stats.far_pointers * 8;
        self.gaps -= self.descriptors + self.far_pointers;
        self.padding = stats.image_bytes - self.total();
    }
}
