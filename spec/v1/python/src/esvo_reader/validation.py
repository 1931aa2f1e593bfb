"""The rules that opening a file does not check: gaps, checksums, and everything in the blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

import numpy as np

from . import kinds, opening
from .blocks import Block, check_block_crc
from .codecs import bit_count
from .components import check_components
from .errors import EsvoError, Finding, Findings
from .records import (
    CONSTANT,
    CORNER_ENTRY,
    HEADER,
    NO_PARENT,
    PAGE_SLOTS,
    PLAIN_ENTRY,
    POPCOUNT,
    SECTION_ENTRY,
    Array,
    field,
)
from .voxels import contour_places
from .walking import Trace, Walk

if TYPE_CHECKING:
    from .octree import Octree

#: Bytes that are compared with zero at once.
CHUNK = 1 << 24


def check(octree: Octree) -> List[Finding]:
    """Findings about a file that could be opened."""
    findings = Findings()
    check_sections(octree, findings)
    check_gaps(octree, findings)
    check_block_order(octree, findings)
    if octree.parts is not None:
        octree.parts.check_order(findings)
    _Blocks(octree, findings).check()
    return findings.items


def check_sections(octree: Octree, findings: Findings) -> None:
    """D004 of the sections that opening does not read, M001, M002."""
    for entry in octree.sections:
        if bytes(entry["tag"]) not in (b"OBJT", b"BLKT", b"PART", b"INDX", b"META"):
            opening.check_section_crc(octree.data, entry, findings)
    try:
        members = octree.metadata
    except EsvoError as error:
        findings.items += error.findings
        return
    for name in opening.REGISTERED:
        if not isinstance(members.get(name, ""), str):
            at = next(int(entry["offset"]) for entry in octree.sections if bytes(entry["tag"]) == b"META")
            findings.add("M002", at, f"the metadata have {name!r} with a value that is no string")


def check_gaps(octree: Octree, findings: Findings) -> None:
    """D009."""
    header, blocks = octree.header, octree.blocks
    ranges = [(0, HEADER.itemsize)]
    start = int(header["directory_offset"])
    ranges.append((start, start + SECTION_ENTRY.itemsize * len(octree.sections)))
    for entry in octree.sections:
        if bytes(entry["tag"]) != b"BLKS":
            ranges.append((int(entry["offset"]), int(entry["offset"] + entry["length"])))
    if octree.parts is not None:
        starts, ends = octree.parts.ranges()
    else:
        starts = blocks["file_offset"].astype(np.int64)
        ends = starts + blocks["stored_size"].astype(np.int64)
    low = np.concatenate([[r[0] for r in ranges], starts])
    high = np.concatenate([[r[1] for r in ranges], ends])
    at = first_nonzero_outside(octree.data, low, high)
    findings.require(at is None, "D009", at or 0, "bytes that belong to no part of the file are not zero")


def first_nonzero_outside(data: Array, low: Array, high: Array) -> Optional[int]:
    """Offset of the first byte that is not zero and in none of the ranges from `low` to `high`; None without one."""
    order = np.argsort(low, kind="stable")
    starts = np.append(low[order], len(data))
    ends = np.maximum.accumulate(np.concatenate([[0], high[order]]))
    for gap in np.flatnonzero(starts > ends):
        for at in range(int(ends[gap]), int(starts[gap]), CHUNK):
            wrong = np.flatnonzero(data[at : min(at + CHUNK, int(starts[gap]))])
            if wrong.size:
                return at + int(wrong[0])
    return None


def check_block_order(octree: Octree, findings: Findings) -> None:
    """B012."""
    blocks = octree.blocks
    below = np.flatnonzero(blocks["parent"] != NO_PARENT)
    # Blocks by object, and in the order of the table within it.
    below = below[np.argsort(blocks["object"][below], kind="stable")]
    owner, parent = blocks["object"][below], blocks["parent"][below]
    for row in np.flatnonzero((owner[1:] == owner[:-1]) & (parent[1:] < parent[:-1]))[:1]:
        index = int(below[row + 1])
        at = octree.block_entry_offset(index, "parent")
        findings.add("B012", at, f"block {index} of parent {parent[row + 1]} comes after one of parent {parent[row]}")


class _Blocks:
    """The rules of blocks, and those of objects that take all of an object's blocks."""

    def __init__(self, octree: Octree, findings: Findings) -> None:
        self.octree, self.findings = octree, findings
        self.walk = Walk(octree, findings)
        #: For each object what its blocks hold, and its deepest level.
        self.counts = {
            name: np.zeros(len(octree.objects), np.int64)
            for name in ("descriptors", "leaf_voxels", "contours", "far_pointers")
        }
        self.deepest = np.zeros(len(octree.objects), np.int64)
        #: Objects with an error: what follows from it is not reported again.
        self.broken: set[int] = set()
        #: Which attributes the blocks of an object have: the first block with and the first without.
        self.attributes: Dict[Tuple[int, str], Dict[bool, int]] = {}

    def check(self) -> None:
        for number in range(len(self.octree.objects)):
            self.walk.enter_root(number)
        for index in range(len(self.octree.blocks)):
            before = len(self.findings.errors)
            number = int(self.octree.blocks["object"][index])
            self.check_block(index, number)
            if len(self.findings.errors) > before:
                self.broken.add(number)
        for number in range(len(self.octree.objects)):
            if number not in self.broken:
                self.check_object(number)
        self.check_attribute_sets()

    def check_block(self, index: int, number: int) -> None:
        findings, octree = self.findings, self.octree
        entry = octree.blocks[index]
        if entry["codec"] == 0 and octree.parts is None:
            check_block_crc(octree.data, index, entry, findings)
        try:
            block = octree.block(index)
        except EsvoError as error:
            findings.items += error.findings
            return
        before = len(findings.errors)
        check_parts(block, findings)
        self.note_attributes(block, number)
        trace = self.walk.visit(block)
        if trace is None:
            reached = number in self.broken
            findings.require(reached, "B010", block.at(0), f"nothing refers to block {index}")
        elif len(findings.errors) == before:
            check_values(trace, findings)
            nodes = trace.nodes
            self.counts["descriptors"][number] += len(nodes)
            self.counts["leaf_voxels"][number] += POPCOUNT[nodes["leaf_mask"]].sum()
            self.counts["contours"][number] += POPCOUNT[nodes["contour_mask"]].sum()
            self.counts["far_pointers"][number] += field(nodes, "far").sum()
            self.deepest[number] = max(self.deepest[number], int(nodes["level"].max()) + 1)

    def check_object(self, number: int) -> None:
        """O003, O005."""
        entry = self.octree.objects[number]
        at = self.octree.object_entry_offset(number, "levels")
        says, found = int(entry["levels"]), int(self.deepest[number])
        self.findings.require(
            says == found, "O003", at, f"object {number} says {says} levels, its deepest voxel is at {found}"
        )
        for name, counts in self.counts.items():
            says, found = int(entry[name]), int(counts[number])
            at = self.octree.object_entry_offset(number, name)
            self.findings.require(says == found, "O005", at, f"object {number} says {says} {name}, there are {found}")

    def note_attributes(self, block: Block, number: int) -> None:
        there = block.attachments.keys()
        for name, those in (
            ("colours", kinds.WITH_COLORS),
            ("normals", kinds.WITH_NORMALS),
            ("ambient occlusion", {kinds.AMBIENT_BLOCKS}),
        ):
            self.attributes.setdefault((number, name), {}).setdefault(bool(there & those), block.index)

    def check_attribute_sets(self) -> None:
        """A006."""
        for (_, name), blocks in self.attributes.items():
            if len(blocks) == 2:
                at = int(self.octree.blocks["file_offset"][max(blocks.values())])
                self.findings.add(
                    "A006", at, f"block {blocks[True]} has {name}, block {blocks[False]} of the same object has none"
                )


def check_parts(block: Block, findings: Findings) -> None:
    """K004, P006 of the bytes between the parts of a block, A005 of the constant colour."""
    wrong = np.flatnonzero((block.contours & np.uint32(0x3FFFF)) == 0)
    for place in wrong[:1]:
        findings.add("K004", block.at(block.pool_at + 4 * place), f"block {block.index}: contour {place} has no normal")
    low = [0, block.pool_at] + [block.info_at + int(e["offset"]) for e in block.attachment_entries]
    high = [block.directory_end, block.pool_end] + [
        block.info_at + int(e["offset"]) + int(e["size"]) for e in block.attachment_entries
    ]
    at = first_nonzero_outside(block.image, np.array(low), np.array(high))
    findings.require(
        at is None, "P006", block.at(at or 0), f"block {block.index}: bytes between its parts are not zero"
    )
    if kinds.CONSTANT_COLOR in block.attachments:
        unused = block.attachments[kinds.CONSTANT_COLOR].view(CONSTANT)["zero"]
        name = f"block {block.index}: unused bytes of the constant colour are not zero"
        findings.require(not unused.any(), "A005", block.at(attachment_at(block, kinds.CONSTANT_COLOR)), name)


def attachment_at(block: Block, kind: int) -> int:
    """Where an attachment is in its block, in bytes."""
    entries = block.attachment_entries
    return block.info_at + int(entries["offset"][entries["kind"] == kind][0])


def check_values(trace: Trace, findings: Findings) -> None:
    """The rules that need all descriptors of a block: P006 of slots, K001 to K005, A005, A007, A008, A010."""
    block = trace.block
    free = ~trace.claimed
    free[::PAGE_SLOTS] = False
    for slot in np.flatnonzero(free & (block.slots != 0))[:1]:
        findings.add("P006", block.at(8 * slot), f"block {block.index}: slot {slot} is not used, but not zero")
    check_contours(trace, findings)
    local = trace.nodes["slot"] - block.start
    used = np.zeros(len(block.slots), bool)
    used[local] = True
    for kind in sorted(block.attachments):
        if kind in kinds.PAIR_BYTES:
            pairs = np.append(used, np.zeros(len(used) % 2, bool)).reshape(-1, 2)
            check_empty(block, kind, kinds.PAIR_BYTES[kind], ~pairs[:, 0] & ~pairs[:, 1], findings)
        if kind in kinds.ENTRY_BYTES:
            check_empty(block, kind, kinds.ENTRY_BYTES[kind], ~used, findings)
            check_entries(trace, kind, findings)
        if kind in kinds.WITH_COMPONENTS:
            check_components(trace, kind, used, findings)


def each(findings: Findings, block: Block, slot: Array, good: Array, rule: str, what: str) -> bool:
    """Adds a finding for the first slot that is not good. Returns whether all are."""
    for row in np.flatnonzero(~good)[:1]:
        at = int(slot[row])
        findings.add(rule, block.at(8 * at), f"slot {at} of block {block.index} {what}")
    return bool(good.all())


def uses(first: Array, count: Array, total: int) -> Array:
    """How many of the ranges of `count` from `first` each of `total` values is in."""
    change = np.zeros(total + 1, np.int64)
    np.add.at(change, first, 1)
    np.add.at(change, first + count, -1)
    result: Array = np.cumsum(change[:-1])
    return result


def check_contours(trace: Trace, findings: Findings) -> None:
    """K001, K002, K003, K005."""
    block, nodes = trace.block, trace.nodes
    slot, mask = nodes["slot"] - block.start, nodes["contour_mask"]
    sound = [
        each(findings, block, slot, (mask & ~nodes["valid_mask"]) == 0, "K001", "has contours of empty child slots"),
        each(
            findings,
            block,
            slot,
            (mask != 0) | (field(nodes, "contour_pointer") == 0),
            "K003",
            "has a contour pointer, but no contours",
        ),
    ]
    first, count = contour_places(block, nodes)[:, 0], POPCOUNT[mask]
    inside = (mask == 0) | ((first >= 0) & (first + count <= len(block.contours)))
    sound.append(each(findings, block, slot, inside, "K002", "has contours outside of the pool"))
    if all(sound):
        some = mask != 0
        used = uses(first[some], count[some], len(block.contours))
        for place in np.flatnonzero(used != 1)[:1]:
            name = f"block {block.index}: contour {place} belongs to {used[place]} descriptors"
            findings.add("K005", block.at(block.pool_at + 4 * place), name)


def check_empty(block: Block, kind: int, unit: int, empty: Array, findings: Findings) -> None:
    """A005: attribute blocks or entries of `unit` bytes that are of no descriptor."""
    body = block.attachments[kind][: unit * len(empty)].view("<u4").reshape(-1, unit // 4)
    for row in np.flatnonzero(empty & body.any(axis=1))[:1]:
        at = attachment_at(block, kind) + unit * row
        findings.add(
            "A005", block.at(at), f"block {block.index}: attachment {kind} has values at {row} without a descriptor"
        )


def check_entries(trace: Trace, kind: int, findings: Findings) -> None:
    """A007, A008."""
    block, nodes = trace.block, trace.nodes
    slot, valid, words = nodes["slot"] - block.start, nodes["valid_mask"], block.words(kind)
    if kind == kinds.CORNERS:
        values_at = 2 * len(block.slots)
        entry = words[:values_at].view("<u8")[slot]
        mask = CORNER_ENTRY["mask"].of(entry)
        count = 2 * (bit_count(mask) + 8 * CORNER_ENTRY["own_corners"].of(entry).astype(np.int64))
        first = CORNER_ENTRY["first"].of(entry).astype(np.int64)
        good = (CORNER_ENTRY["zero"].of(entry) == 0) & ((count > 0) | (first == 0)) & (first % 2 == 0)
    else:
        values_at = len(block.slots)
        entry = words[slot]
        mask = PLAIN_ENTRY["mask"].of(entry).astype(np.uint8)
        count = POPCOUNT[mask] + ((valid & ~mask) != 0)
        first = PLAIN_ENTRY["first"].of(entry).astype(np.int64)
        good = (mask & ~valid) == 0
    good &= (count == 0) | ((first >= values_at) & (first + count <= len(words)))
    at = attachment_at(block, kind) + 4 * (values_at // len(block.slots)) * slot
    for row in np.flatnonzero(~good)[:1]:
        name = f"block {block.index}: attachment {kind}: the entry of slot {slot[row]} leads to no values"
        findings.add("A007", block.at(at[row]), name)
    if good.all():
        some = count > 0
        used = uses(first[some] - values_at, count[some], len(words) - values_at)
        for place in np.flatnonzero(used != 1)[:1]:
            where = block.at(attachment_at(block, kind) + 4 * (values_at + place))
            findings.add(
                "A008", where, f"block {block.index}: attachment {kind}: a value belongs to {used[place]} descriptors"
            )
