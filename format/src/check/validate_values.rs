//! Checks of the attachments with plain values and values at corners (spec sections 8.5 and 8.6).

use crate::block::BlockParts;
use crate::check::topology::Bits;
use crate::file::attachment;
use crate::values::plain::{OWN_CUBE, plain_count, plain_entry};
use crate::{ChildDescriptor, NodeCorners, Octree, ids};

/// Checks an attachment of type `kind`: the entry of every descriptor must refer to values that no other entry refers
/// to, and the entries of all other slots must be zero.
///
/// `add` receives each finding: rule, byte of the image, description.
pub(crate) fn check_values(
    octree: &Octree,
    parts: &BlockParts,
    kind: u32,
    is_descriptor: impl Fn(usize) -> bool,
    mut add: impl FnMut(&'static str, u64, String),
) {
    let Some(words) = octree.attachment_words(parts, kind) else { return };
    let Some((_, at, _)) = parts.attachments.iter().find(|attachment| attachment.0 == kind) else { return };
    let array = parts.array_slots as usize;
    // Words per entry, and words per value.
    let unit = if kind == attachment::CORNERS { 2 } else { 1 };
    let mut used = Bits::new(words.len());
    let mut complete = true;
    for (slot, entry) in words.chunks_exact(unit).take(array).enumerate() {
        let place = at + (slot * unit * 4) as u64;
        let descriptor = parts.start as usize + slot;
        if !is_descriptor(descriptor) {
            if entry.iter().any(|word| *word != 0) {
                let what =
                    format!("attachment type {kind} has an entry for slot {descriptor}, which has no descriptor");
                add(ids::ATTACHMENT_UNUSED, place, what);
            }
            continue;
        }
        let valid = ChildDescriptor(octree.slots()[descriptor]).valid_mask();
        let (first, count, fits) = match *entry {
            [mask, first] => {
                let count = NodeCorners { mask, first: 0 }.count();
                (first as usize, count, mask < OWN_CUBE << 1 && first.is_multiple_of(2) && (count > 0 || first == 0))
            }
            _ => {
                let (mask, first) = plain_entry(entry[0]);
                (first, plain_count(mask, valid), mask & !valid == 0)
            }
        };
        let range = first..first.saturating_add(count * unit);
        if !fits || count > 0 && (range.start < array * unit || range.end > words.len()) {
            let what = format!(
                "entry {entry:x?} of slot {descriptor} in attachment type {kind} does not fit its descriptor, \
                 or leads out of the attachment"
            );
            add(ids::ATTACHMENT_ENTRY, place, what);
            complete = false;
            continue;
        }
        // Runs must have 1 to 64 words.
        let mut runs = range.clone().step_by(32).map(|word| (word, (range.end - word).min(32) as u32));
        if let Some(word) = runs.find_map(|(word, count)| used.insert_run(word, count)) {
            let what = format!("a value of attachment type {kind} belongs to slot {descriptor} and to another");
            add(ids::ATTACHMENT_ONCE, at + word as u64 * 4, what);
        }
    }
    let free = (array * unit..words.len()).find(|word| !used.has(*word));
    if let Some(word) = free.filter(|_| complete) {
        let what = format!("a value of attachment type {kind} belongs to no descriptor");
        add(ids::ATTACHMENT_ONCE, at + word as u64 * 4, what);
    }
}
