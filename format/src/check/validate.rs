//! Validation: checks every rule of the specification and reports all findings.

use std::ops::ControlFlow;
use std::path::Path;

use crate::block::BlockParts;
use crate::check::metadata;
use crate::check::report::Report;
use crate::check::stored::{gaps, wrong_checksums};
use crate::check::topology::{Bits, Step, Visitor, Walked, ones, walk};
use crate::check::validate_components::check_components;
use crate::check::validate_values::check_values;
use crate::file::open::{Contents, map};
use crate::file::*;
use crate::octree::Stored;
use crate::{Broken, ChildDescriptor, FormatError, Octree, OpenOptions, ids};

/// Checks a file against every rule. If [`Octree::open`] fails, its error is the only finding.
///
/// # Errors
/// The file cannot be read, or exceeds the limits of this library.
pub fn validate_file(path: &Path) -> Result<Report, FormatError> {
    validate_file_with(path, &OpenOptions::default())
}

/// Like [`validate_file`], with a limit to the memory for compressed blocks.
///
/// # Errors
/// The file cannot be read, or exceeds the limits.
pub fn validate_file_with(path: &Path, options: &OpenOptions) -> Result<Report, FormatError> {
    let mut report = Report::default();
    let result = map(path).and_then(|map| {
        let contents = Contents::read(&map)?;
        gaps(&map, &contents.ranges).for_each(|finding| report.add(finding));
        contents.into_mapped(map, options)
    });
    finish(report, result)
}

/// Checks a file in memory against every rule, like [`validate_file`].
///
/// # Errors
/// The file exceeds the limits of this library.
pub fn validate_bytes(bytes: &[u8]) -> Result<Report, FormatError> {
    validate_bytes_with(bytes, &OpenOptions::default())
}

/// Like [`validate_bytes`], with a limit to the memory for blocks.
///
/// # Errors
/// The file exceeds the limits.
pub fn validate_bytes_with(bytes: &[u8], options: &OpenOptions) -> Result<Report, FormatError> {
    let mut report = Report::default();
    let result = Contents::read(bytes).and_then(|contents| {
        gaps(bytes, &contents.ranges).for_each(|finding| report.add(finding));
        contents.into_owned(bytes, options)
    });
    finish(report, result)
}

fn finish(mut report: Report, opened: Result<Octree, FormatError>) -> Result<Report, FormatError> {
    match opened {
        Ok(octree) => check(&octree, &mut report),
        Err(FormatError::Broken(broken)) => report.add(broken),
        Err(other) => return Err(other),
    }
    Ok(report)
}

/// Checks an octree that was opened or made in memory: tables, blocks, checksums, every descriptor and contour, unused
/// space. Time is linear in the size of the image; memory is half a bit per byte of it.
pub fn validate(octree: &Octree) -> Report {
    let mut report = Report::default();
    check(octree, &mut report);
    report
}

impl Octree {
    /// Whether the blocks of this octree may be written again, with new checksums. Of a file: the checksums of all blocks
    /// and every other rule, as [`validate`] checks them. Of a [part](crate::StreamReader::partial) of a file, whose
    /// checksums were compared on reading: every other rule. True for an octree that this program made.
    ///
    /// Reads the whole file at the first call; the result is kept. Whatever writes an octree calls this and fails with
    /// its error: [`write`](Self::write) and its variants, [`oct::write`](crate::oct::write()),
    /// [`with_ambient_occlusion`](Self::with_ambient_occlusion), [`diff`](crate::diff::diff). Call it too before
    /// [`slots`](Self::slots) are copied to a new octree. [`OpenOptions::verify`] does not change it.
    ///
    /// A mapped file that changes after this call is not noticed.
    ///
    /// # Errors
    /// The first rule of level *must* found broken.
    pub fn verified(&self) -> Result<(), Broken> {
        // Not computed within `get_or_init`, see `compared`.
        if self.verified.get().is_none() {
            let _ = self.verified.set(verify(self));
        }
        self.verified.get().cloned().unwrap_or(Ok(()))
    }
}

fn verify(octree: &Octree) -> Result<(), Broken> {
    if matches!(octree.stored, Stored::Made) {
        return Ok(());
    }
    octree.compared()?;
    let mut report = Report::default();
    check_meta(octree, &mut report);
    check_contents(octree, &mut report);
    if report.is_ok() {
        // The same walk with fewer checks.
        let _ = octree.sound.set(Ok(()));
        return Ok(());
    }
    // Without an error in the list, warnings have filled it.
    let first = report.findings.iter().find(|finding| !finding.warning).or(report.findings.first());
    first.map_or(Ok(()), |finding| Err(finding.broken.clone()))
}

fn check(octree: &Octree, report: &mut Report) {
    check_meta(octree, report);
    wrong_checksums(octree).into_iter().for_each(|finding| report.add(finding));
    check_contents(octree, report);
}

/// Checks all rules except those of the metadata and of the stored bytes.
fn check_contents(octree: &Octree, report: &mut Report) {
    check_table_order(octree, report);
    if let Some((at, what)) = &octree.part_order {
        report.add(Broken::new(ids::PART_ORDER, *at, what.clone()));
    }
    let mut walker = Walker::new(octree, std::mem::take(report));
    let walked = walk(octree, &mut walker);
    let Walker { report: found, tallies, reached, far_pointers, contours, .. } = walker;
    *report = found;
    if walked.complete {
        check_tallies(octree, &tallies, report);
    }
    for (index, parts) in octree.parts().iter().enumerate() {
        let blocks = BlockCheck { octree, index, parts, walked: &walked, far_pointers: &far_pointers };
        blocks.page_headers(report);
        blocks.contour_values(&contours, reached.has(index), report);
        blocks.attachments(reached.has(index), report);
        blocks.gaps(report);
        // The descriptors after a broken pointer are unclaimed. Reporting them as unused would only repeat the finding.
        if walked.complete && reached.has(index) {
            blocks.unused_slots(report);
        } else if walked.complete {
            let at = octree.offset(octree.blocks()[index].image_offset);
            report.add(Broken::new(ids::BLOCK_REACHED, at, format!("no pointer leads to block {index}")));
        }
    }
    check_uniform(octree, report);
}

fn check_meta(octree: &Octree, report: &mut Report) {
    if octree.meta().is_empty() {
        return;
    }
    let start = octree.origin.map_or(0, |origin| origin.meta);
    match metadata::parse(octree.meta().as_bytes()) {
        Ok(found) => {
            for (at, name) in found.not_strings {
                let what = format!("the metadata: the value of {name:?} is not a string");
                report.add(Broken::new(ids::META_MEMBERS, start + at as u64, what));
            }
        }
        // Only of an octree in memory: one that was read has been refused.
        Err((at, what)) => {
            report.add(Broken::new(ids::META_JSON, start + at as u64, format!("the metadata: {what}")));
        }
    }
}

fn check_table_order(octree: &Octree, report: &mut Report) {
    let mut last = vec![0; octree.objects().len()];
    for (index, block) in octree.blocks().iter().enumerate().filter(|(_, b)| b.parent != NO_PARENT) {
        let last = &mut last[block.object as usize];
        if block.parent < *last {
            let what = format!("block {index} of parent {} comes after a block of parent {last}", block.parent);
            report.add(Broken::new(ids::BLOCK_ORDER, octree.offset(block.image_offset), what));
        }
        *last = block.parent.max(*last);
    }
}

/// The counts of an object.
#[derive(Clone, Copy, Default)]
struct Tally {
    levels: u32,
    descriptors: u64,
    leaf_voxels: u64,
    contours: u64,
    far_pointers: u64,
}

/// Collects findings, counts and used slots during the walk.
struct Walker<'a> {
    octree: &'a Octree,
    report: Report,
    tallies: Vec<Tally>,
    object: usize,
    /// Blocks with descriptors that were visited.
    reached: Bits,
    /// Block of the last descriptor.
    block: u32,
    /// Slots that hold a far pointer.
    far_pointers: Bits,
    /// Words of the image that hold a contour of a voxel.
    contours: Bits,
}

impl<'a> Walker<'a> {
    fn new(octree: &'a Octree, report: Report) -> Self {
        Self {
            octree,
            report,
            tallies: vec![Tally::default(); octree.objects().len()],
            object: 0,
            reached: Bits::new(octree.blocks().len()),
            block: NO_PARENT,
            far_pointers: Bits::new(octree.slots().len()),
            contours: Bits::new(octree.words().len()),
        }
    }
}

impl Visitor for Walker<'_> {
    fn broken(&mut self, finding: Broken) -> ControlFlow<()> {
        self.report.add(finding);
        ControlFlow::Continue(())
    }

    fn descriptor(&mut self, object: u32, step: &Step, descriptor: ChildDescriptor) {
        self.object = object as usize;
        if self.block != step.block {
            self.reached.insert(step.block as usize);
            self.block = step.block;
        }
        let tally = &mut self.tallies[self.object];
        tally.levels = tally.levels.max(step.level);
        tally.descriptors += 1;
        tally.leaf_voxels += u64::from(ones(descriptor.leaf_mask()));
        tally.contours += u64::from(ones(descriptor.contour_mask()));
    }

    fn contours(&mut self, step: &Step, first: usize, count: u32) -> ControlFlow<()> {
        if let Some(word) = self.contours.insert_run(first, count) {
            let what = format!("the contour belongs to the descriptor at slot {} and to another", step.slot);
            self.report.add(Broken::new(ids::CONTOUR_ONCE, self.octree.offset(word as u64 * 4), what));
        }
        ControlFlow::Continue(())
    }

    fn far_pointer(&mut self, slot: u32) {
        self.far_pointers.insert(slot as usize);
        self.tallies[self.object].far_pointers += 1;
    }

    fn enter(&mut self, step: &Step, index: u32) -> ControlFlow<()> {
        let block = &self.octree.blocks()[index as usize];
        let scale = 24 - step.level;
        if (block.cube_position, block.cube_scale) != (step.position, scale) {
            let what = format!(
                "block {index} has the cube at {:?} of scale {}, its descriptors the cube at {:?} of scale {scale}",
                block.cube_position, block.cube_scale, step.position
            );
            self.report.add(Broken::new(ids::BLOCK_CUBE, self.octree.offset(block.image_offset), what));
        }
        ControlFlow::Continue(())
    }
}

fn check_tallies(octree: &Octree, tallies: &[Tally], report: &mut Report) {
    for (index, (object, tally)) in octree.objects().iter().zip(tallies).enumerate() {
        let at = octree.origin.map_or(0, |origin| origin.objects) + index as u64 * OBJECT_BYTES;
        if object.levels != tally.levels {
            let what =
                format!("object {index} has {} levels, its deepest voxel is at level {}", object.levels, tally.levels);
            report.add(Broken::new(ids::OBJECT_LEVELS, at + 132, what));
        }
        let counts = [
            ("descriptors", object.descriptors, tally.descriptors),
            ("leaf voxels", object.leaf_voxels, tally.leaf_voxels),
            ("contours", object.contours, tally.contours),
            ("far pointers", object.far_pointers, tally.far_pointers),
        ];
        for (field, (name, said, found)) in counts.into_iter().enumerate() {
            if said != found {
                let what = format!("object {index} has {found} {name}, its entry says {said}");
                report.add(Broken::new(ids::OBJECT_COUNTS, at + 144 + 8 * field as u64, what));
            }
        }
    }
}

/// The checks of one block after its descriptors have been walked.
struct BlockCheck<'a> {
    octree: &'a Octree,
    index: usize,
    parts: &'a BlockParts,
    walked: &'a Walked,
    far_pointers: &'a Bits,
}

impl BlockCheck<'_> {
    /// Whether a slot of the image holds a descriptor.
    fn is_descriptor(&self, slot: usize) -> bool {
        self.walked.claimed.has(slot) && !self.far_pointers.has(slot)
    }

    fn add(&self, report: &mut Report, rule: &'static str, image_byte: u64, what: &str) {
        report.add(Broken::new(rule, self.octree.offset(image_byte), format!("block {}: {what}", self.index)));
    }

    fn array(&self) -> std::ops::Range<u32> {
        self.parts.start..self.parts.start + self.parts.array_slots
    }

    /// Checks the headers of pages without claimed slots. The walk has checked the others.
    fn page_headers(&self, report: &mut Report) {
        let array = self.array();
        for page in array.clone().step_by(PAGE_SLOTS as usize) {
            let end = page.saturating_add(PAGE_SLOTS).min(array.end);
            let expected = u64::from(array.end - page);
            if self.octree.slots()[page as usize] != expected
                && !(page..end).any(|slot| self.walked.claimed.has(slot as usize))
            {
                let what = format!(
                    "page header {:#x} is not the distance to the info section",
                    self.octree.slots()[page as usize]
                );
                self.add(report, ids::PAGE_HEADER, u64::from(page) * 8, &what);
            }
        }
    }

    fn unused_slots(&self, report: &mut Report) {
        let array = self.array();
        // Blocks start at pages, that is, at multiples of 64 slots.
        for slot in self.walked.claimed.missing(array.start as usize..array.end as usize) {
            if self.octree.slots()[slot] != 0 && !slot.is_multiple_of(PAGE_SLOTS as usize) {
                let what = format!("slot {slot} is unused, but not zero");
                self.add(report, ids::INFO_RESERVED, slot as u64 * 8, &what);
            }
        }
    }

    fn contour_values(&self, used: &Bits, reached: bool, report: &mut Report) {
        let pool = self.parts.contour_words..self.parts.contour_words + self.parts.contour_count as usize;
        let values = &self.octree.words()[pool.clone()];
        for (word, value) in pool.zip(values) {
            // The normal is the low 18 bits.
            if value << 14 == 0 {
                self.add(report, ids::CONTOUR_NORMAL, word as u64 * 4, "the normal of the contour is zero");
            }
            if self.walked.complete && reached && !used.has(word) {
                self.add(report, ids::CONTOUR_ONCE, word as u64 * 4, "the contour belongs to no voxel");
            }
        }
    }

    fn attachments(&self, reached: bool, report: &mut Report) {
        for &(kind, at, _) in &self.parts.attachments {
            let words_per_pair = match kind {
                attachment::COLOR_BLOCKS | attachment::AMBIENT_BLOCKS => 2,
                attachment::NORMAL_BLOCKS => 4,
                attachment::COLOR_CONSTANT => {
                    let words = &self.octree.words()[(at / 4) as usize..][..2];
                    if words[0] >> 24 != 0 || words[1] != 0 {
                        self.add(
                            report,
                            ids::ATTACHMENT_UNUSED,
                            at,
                            "unused bytes of the constant colour are not zero",
                        );
                    }
                    continue;
                }
                attachment::COLORS_PLAIN | attachment::NORMALS_PLAIN | attachment::CORNERS => {
                    if self.walked.complete && reached {
                        check_values(
                            self.octree,
                            self.parts,
                            kind,
                            |slot| self.is_descriptor(slot),
                            |rule, at, what| {
                                self.add(report, rule, at, &what);
                            },
                        );
                    }
                    continue;
                }
                kind if attachment::has_components(kind) => {
                    if self.walked.complete && reached {
                        let is_descriptor = |slot| self.is_descriptor(slot);
                        check_components(self.octree, self.parts, kind, is_descriptor, |rule, at, what| {
                            self.add(report, rule, at, &what);
                        });
                    }
                    continue;
                }
                attachment::VENDOR_FIRST..=attachment::VENDOR_LAST => continue,
                _ => {
                    self.add(report, ids::ATTACHMENT_TYPE, at, &format!("attachment type {kind} is not registered"));
                    continue;
                }
            };
            if self.walked.complete && reached {
                self.unused_pairs(kind, at, words_per_pair, report);
            }
        }
    }

    fn unused_pairs(&self, kind: u32, at: u64, words_per_pair: usize, report: &mut Report) {
        let words = &self.octree.words()[(at / 4) as usize..];
        let array = self.array();
        for (pair, words) in array.clone().step_by(2).zip(words.chunks_exact(words_per_pair)) {
            let used = (pair..array.end).take(2).any(|slot| self.is_descriptor(slot as usize));
            if !used && words.iter().any(|w| *w != 0) {
                let at = at + u64::from(pair - array.start) / 2 * words_per_pair as u64 * 4;
                let what =
                    format!("attachment type {kind} has values for the pair at slot {pair}, which has no descriptor");
                self.add(report, ids::ATTACHMENT_UNUSED, at, &what);
            }
        }
    }

    /// Checks that the space between and after the parts of the block is zero.
    fn gaps(&self, report: &mut Report) {
        let block = &self.octree.blocks()[self.index];
        let info = u64::from(self.array().end) * 8;
        let info_end = info + INFO_BYTES + self.parts.attachments.len() as u64 * ATTACHMENT_BYTES;
        let pool = self.parts.contour_words as u64 * 4;
        let mut used = vec![(info, info_end), (pool, pool + u64::from(self.parts.contour_count) * 4)];
        used.extend(self.parts.attachments.iter().map(|&(_, at, size)| (at, at + size)));
        used.sort_unstable();
        let ends = used.iter().map(|range| range.1);
        let starts = used.iter().skip(1).map(|range| range.0).chain([block.image_offset + block.image_size]);
        let image: &[u8] = bytemuck::cast_slice(self.octree.slots());
        for (from, to) in ends.zip(starts) {
            if let Some(at) = image[from as usize..to as usize].iter().position(|b| *b != 0) {
                let what = "a byte between or after the parts of the block is not zero";
                self.add(report, ids::INFO_RESERVED, from + at as u64, what);
            }
        }
    }
}

fn check_uniform(octree: &Octree, report: &mut Report) {
    let kinds: [(&str, &[u32]); 3] = [
        ("colours", &attachment::COLORS),
        ("normals", &attachment::NORMALS),
        ("ambient occlusion", &[attachment::AMBIENT_BLOCKS]),
    ];
    for (name, kinds) in kinds {
        let has = |index: usize| octree.parts()[index].attachments.iter().any(|a| kinds.contains(&a.0));
        for (index, block) in octree.blocks().iter().enumerate() {
            let root = octree.objects()[block.object as usize].root_block as usize;
            if has(index) != has(root) {
                let what =
                    format!("only one of blocks {root} and {index}, which belong to the same object, has {name}");
                report.add(Broken::new(ids::ATTACHMENT_UNIFORM, octree.offset(block.image_offset), what));
            }
        }
    }
}
