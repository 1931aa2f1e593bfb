//! Emission, roughness and metalness, opacity, material and other components of voxels (spec section 8.7).

use crate::block::BlockParts;
use crate::file::attachment;
use crate::values::components::{Form, HEAD_WORDS};
use crate::values::plain::{plain_entry, plain_rank};
use crate::{ComponentFormat, Components, Octree};

impl Octree {
    /// Components of type `kind` of child `child` of the descriptor at `slot`. `None` if the file says nothing about them: the
    /// voxel has the default of the type.
    pub fn components(&self, slot: u32, child: u8, kind: u32) -> Option<Components> {
        let parts = &self.parts[self.block_of(slot) as usize];
        let words = self.attachment_words(parts, kind)?;
        let (format, form) = ComponentFormat::from_head(words)?;
        let first = match form {
            Form::Constant => HEAD_WORDS,
            Form::Entries => {
                let entry = *words.get(HEAD_WORDS + (slot - parts.start) as usize)?;
                let (mask, first) = plain_entry(entry);
                if entry == 0 {
                    return None;
                }
                first + plain_rank(mask, child) * format.words()
            }
        };
        Some(format.decode(words.get(first..first + format.words())?))
    }

    /// The light that a voxel emits: red, green and blue, linear, with the primaries of sRGB. 1 is the radiance at which a
    /// picture is white. For the parameters see [`components`](Self::components).
    pub fn emission(&self, slot: u32, child: u8) -> [f32; 3] {
        let found = self.components(slot, child, attachment::EMISSION);
        found.map_or([0.0; 3], |c| [0, 1, 2].map(|k| c.numbers[k] as f32))
    }

    /// Roughness and metalness of a voxel, 0 to 1. For the parameters see [`components`](Self::components).
    pub fn roughness_metalness(&self, slot: u32, child: u8) -> [f32; 2] {
        let found = self.components(slot, child, attachment::ROUGHNESS_METALNESS);
        found.map_or([1.0, 0.0], |c| [0, 1].map(|k| c.numbers[k] as f32))
    }

    /// Opacity of a voxel, 0 to 1. For the parameters see [`components`](Self::components).
    pub fn opacity(&self, slot: u32, child: u8) -> f32 {
        self.components(slot, child, attachment::OPACITY).map_or(1.0, |c| c.numbers[0] as f32)
    }

    /// Number of the material of a voxel. For the parameters see [`components`](Self::components).
    pub fn material(&self, slot: u32, child: u8) -> u32 {
        self.components(slot, child, attachment::MATERIAL).map_or(0, |c| c.numbers[0] as u32)
    }

    /// The types of component attachments that some block has, in order.
    pub fn component_kinds(&self) -> Vec<u32> {
        let all = self.parts.iter().flat_map(|parts: &BlockParts| &parts.attachments).map(|a| a.0);
        let mut kinds: Vec<u32> = all.filter(|kind| attachment::has_components(*kind)).collect();
        kinds.sort_unstable();
        kinds.dedup();
        kinds
    }

    /// Format of the component attachment of type `kind` in the first block that has it.
    pub fn component_format(&self, kind: u32) -> Option<ComponentFormat> {
        let words = self.parts.iter().find_map(|parts| self.attachment_words(parts, kind))?;
        Some(ComponentFormat::from_head(words)?.0)
    }
}
