//! Components of the voxels of a tree, and their attachments (spec section 8.7).

use crate::layout::place::Placed;
use crate::values::components::{Form, HEAD_WORDS};
use crate::values::plain::{plain_count, slots};
use crate::{ComponentFormat, FormatError, Tree, TreeNode};

/// Components of one type for every voxel of a tree.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Column {
    /// Attachment type: 8 to 11 or 16 to 31.
    pub kind: u32,
    /// How the numbers are stored. Must be one that the type can have.
    pub format: ComponentFormat,
    /// The encoded values, [`ComponentFormat::words`] words for each voxel, in the order of the nodes.
    pub values: Vec<u32>,
}

impl Column {
    /// A column for a tree without voxels.
    pub fn new(kind: u32, format: ComponentFormat) -> Self {
        Self { kind, format, values: Vec::new() }
    }

    /// The same column without values.
    pub(crate) fn emptied(&self) -> Self {
        Self::new(self.kind, self.format)
    }

    fn unit(&self) -> usize {
        self.format.words()
    }

    /// The words of a voxel.
    pub fn value(&self, voxel: usize) -> &[u32] {
        &self.values[voxel * self.unit()..][..self.unit()]
    }

    /// Replaces the words of a voxel. Words after those of a value are ignored.
    ///
    /// # Panics
    /// There is no such voxel, or there are too few words.
    pub fn set(&mut self, voxel: usize, words: &[u32]) {
        let unit = self.unit();
        self.values[voxel * unit..][..unit].copy_from_slice(&words[..unit]);
    }

    /// Appends a voxel with the default of the type.
    pub(crate) fn push_default(&mut self) {
        let words = self.format.default_of(self.kind);
        self.values.extend_from_slice(&words[..self.unit()]);
    }

    pub(crate) fn remove(&mut self, voxel: usize) {
        let unit = self.unit();
        self.values.drain(voxel * unit..(voxel + 1) * unit);
    }

    /// Takes the voxels from `first` on out of the column, but leaves those before `end`, which come with both.
    pub(crate) fn split(&mut self, first: usize, end: usize) -> Self {
        let unit = self.unit();
        let values = self.values.get(first * unit..).unwrap_or_default().to_vec();
        self.values.truncate(end * unit);
        Self { values, ..self.emptied() }
    }

    /// What is wrong with a column of a tree with this many voxels.
    pub(crate) fn check(&self, voxels: usize) -> Result<(), FormatError> {
        let (kind, unit) = (self.kind, self.unit());
        if !crate::file::attachment::has_components(kind) || !self.format.fits(kind) {
            let what = format!("attachments of type {kind} do not have components of the format {:?}", self.format);
            return Err(FormatError::Limit(what));
        }
        if self.values.len() != voxels * unit {
            let what = format!(
                "the tree has {} words of components of type {kind} and {voxels} voxels, expected {unit} for every voxel",
                self.values.len()
            );
            return Err(FormatError::Limit(what));
        }
        let emits = kind == crate::file::attachment::EMISSION;
        let good = |words: &[u32]| {
            self.format.is_value(words) && !(emits && self.format.decode(words).used().iter().any(|x| *x < 0.0))
        };
        match self.values.chunks_exact(unit).position(|words| !good(words)) {
            Some(voxel) => Err(FormatError::Limit(format!(
                "the components of type {kind} of voxel {voxel} are not finite, have unused bits, or are less than no light"
            ))),
            None => Ok(()),
        }
    }

    /// How these descriptors of a block store their values, and the size of the attachment in words; `None` if all have the
    /// default. `slots` is the length of the descriptor array.
    pub(crate) fn form(&self, tree: &Tree, placed: &[Placed], slots: u64) -> Option<(Form, u64)> {
        let default = self.format.default_of(self.kind);
        let default = &default[..self.unit()];
        let voxels = || placed.iter().flat_map(|p| range(&tree.nodes[p.node])).map(|voxel| self.value(voxel));
        let first = voxels().next()?;
        if voxels().all(|value| value == first) {
            return (first != default).then_some((Form::Constant, (HEAD_WORDS + self.unit()) as u64));
        }
        let count = |p: &Placed| self.shared(&tree.nodes[p.node], default).map_or(0, |node| node.count());
        let values = placed.iter().map(count).sum::<usize>() * self.unit();
        Some((Form::Entries, HEAD_WORDS as u64 + slots + values as u64))
    }

    /// Which voxels of a node have values of their own; `None` if all have the default.
    fn shared(&self, node: &TreeNode, default: &[u32]) -> Option<Shared> {
        if range(node).all(|voxel| self.value(voxel) == default) {
            return None;
        }
        // The voxels with the most frequent value (the first such) share it, if there are at least two.
        let same = |voxel: usize| {
            let equal = range(node).zip(slots(node.valid)).filter(|(other, _)| self.value(*other) == self.value(voxel));
            equal.fold(0u8, |mask, (_, slot)| mask | 1 << slot)
        };
        let most = range(node).map(same).reduce(|a, b| if b.count_ones() > a.count_ones() { b } else { a });
        let most = most.unwrap_or(0);
        let mask = if most.count_ones() > 1 { node.valid & !most } else { node.valid };
        Some(Shared { valid: node.valid, mask })
    }

    /// Writes the attachment, whose words are zero. `slots` is the length of the descriptor array.
    pub(crate) fn encode(&self, tree: &Tree, placed: &[Placed], slots: usize, form: Form, words: &mut [u32]) {
        words[..HEAD_WORDS].copy_from_slice(&self.format.head(form));
        let unit = self.unit();
        let default = self.format.default_of(self.kind);
        let mut next = HEAD_WORDS + if form == Form::Entries { slots } else { 0 };
        for placed in placed {
            let node = &tree.nodes[placed.node];
            if form == Form::Constant {
                words[next..next + unit].copy_from_slice(self.value(node.first_voxel as usize));
                return;
            }
            let Some(shared) = self.shared(node, &default[..unit]) else { continue };
            words[HEAD_WORDS + placed.slot as usize] = (next as u32) << 8 | u32::from(shared.mask);
            for slot in shared.stored() {
                let voxel = node.first_voxel + (node.valid & ((1 << slot) - 1)).count_ones();
                words[next..next + unit].copy_from_slice(self.value(voxel as usize));
                next += unit;
            }
        }
    }
}

/// The voxels of a node.
fn range(node: &TreeNode) -> std::ops::Range<usize> {
    node.first_voxel as usize..(node.first_voxel + node.valid.count_ones()) as usize
}

/// The voxels of a node with values of their own; the others share one.
struct Shared {
    valid: u8,
    mask: u8,
}

impl Shared {
    fn count(&self) -> usize {
        plain_count(self.mask, self.valid)
    }

    /// The child slots whose values are stored, in order.
    fn stored(&self) -> impl Iterator<Item = u8> {
        slots(self.mask).chain(slots(self.valid & !self.mask).take(1))
    }
}
