//! Checks of component attachments (spec section 8.7).

use crate::block::BlockParts;
use crate::check::topology::Bits;
use crate::file::attachment;
use crate::values::components::{Form, HEAD_WORDS};
use crate::values::plain::{plain_count, plain_entry};
use crate::{ChildDescriptor, ComponentFormat, Octree, ids};

/// Checks an attachment of type `kind`, whose head and size are right: the entry of every descriptor must be zero or refer to
/// values that no other entry refers to, the entries of all other slots must be zero, and numbers must be finite.
///
/// `add` receives each finding: rule, byte of the image, description.
pub(crate) fn check_components(
    octree: &Octree,
    parts: &BlockParts,
    kind: u32,
    is_descriptor: impl Fn(usize) -> bool,
    mut add: impl FnMut(&'static str, u64, String),
) {
    let Some(words) = octree.attachment_words(parts, kind) else { return };
    let Some((_, at, _)) = parts.attachments.iter().find(|attachment| attachment.0 == kind) else { return };
    let Some((format, form)) = ComponentFormat::from_head(words) else { return };
    let unit = format.words();
    let values = match form {
        Form::Constant => HEAD_WORDS,
        Form::Entries => HEAD_WORDS + parts.array_slots as usize,
    };
    for (index, value) in words.get(values..).unwrap_or_default().chunks_exact(unit).enumerate() {
        let dark = kind == attachment::EMISSION && format.decode(value).used().iter().any(|x| *x < 0.0);
        if dark || !format.is_value(value) {
            let what =
                format!("a value of attachment type {kind} is not finite, is negative, or has unused bits: {value:x?}");
            add(ids::COMPONENT_VALUE, at + (values + index * unit) as u64 * 4, what);
        }
    }
    if form == Form::Constant {
        return;
    }
    let mut used = Bits::new(words.len());
    let mut complete = true;
    for (slot, &entry) in words[HEAD_WORDS..values].iter().enumerate().filter(|(_, entry)| **entry != 0) {
        let place = at + (HEAD_WORDS + slot) as u64 * 4;
        let descriptor = parts.start as usize + slot;
        if !is_descriptor(descriptor) {
            let what = format!("attachment type {kind} has an entry for slot {descriptor}, which has no descriptor");
            add(ids::ATTACHMENT_UNUSED, place, what);
            continue;
        }
        let valid = ChildDescriptor(octree.slots()[descriptor]).valid_mask();
        let (mask, first) = plain_entry(entry);
        let count = plain_count(mask, valid) * unit;
        if mask & !valid != 0 || first < values || first + count > words.len() {
            let what = format!(
                "entry {entry:x} of slot {descriptor} in attachment type {kind} does not fit its descriptor, \
                 or leads out of the attachment"
            );
            add(ids::ATTACHMENT_ENTRY, place, what);
            complete = false;
            continue;
        }
        // At most eight values of four words.
        if let Some(word) = used.insert_run(first, count as u32) {
            let what = format!("a value of attachment type {kind} belongs to slot {descriptor} and to another");
            add(ids::ATTACHMENT_ONCE, at + word as u64 * 4, what);
        }
    }
    let free = (values..words.len()).find(|word| !used.has(*word));
    if let Some(word) = free.filter(|_| complete) {
        let what = format!("a value of attachment type {kind} belongs to no descriptor");
        add(ids::ATTACHMENT_ONCE, at + word as u64 * 4, what);
    }
}
