"""Components of voxels: emission, roughness and metalness, opacity, material, and named ones (section 8.7)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Optional

import numpy as np

from . import kinds
from .errors import Findings
from .records import COMPONENT_HEAD, HAS_BIT, PLAIN_ENTRY, POPCOUNT, RANK, Array

if TYPE_CHECKING:
    from .blocks import Block
    from .octree import Octree
    from .voxels import Voxels
    from .walking import Trace

#: Words of the head.
HEAD = 2
#: How the numbers of a format are stored, and what they are divided by.
NUMBERS = {
    1: ("u1", 1),
    2: ("u1", 255),
    3: ("<u2", 1),
    4: ("<u2", 65535),
    5: ("<f2", 1),
    6: ("<u4", 1),
    7: ("<f4", 1),
}
RGB9E5 = 8
#: What the types of the registry can have: number of components, formats.
REGISTERED = {
    kinds.EMISSION: (3, (RGB9E5, 5, 7)),
    kinds.ROUGHNESS_METALNESS: (2, (2, 4)),
    kinds.OPACITY: (1, (2, 4)),
    kinds.MATERIAL: (1, (1, 3, 6)),
}


class Head(NamedTuple):
    """What the head of an attachment says."""

    components: int
    number: int
    constant: bool

    @property
    def unit(self) -> int:
        """Words of a value."""
        if self.number == RGB9E5:
            return 1
        return -(-self.components * np.dtype(NUMBERS[self.number][0]).itemsize // 4)


def head_of(words: Array, kind: int) -> Optional[Head]:
    """The head of an attachment; `None` if it is none of this type (A009)."""
    head: Any = words[:HEAD].view(COMPONENT_HEAD)[0]
    components, number, form = int(head["count"]), int(head["number"]), int(head["form"])
    if number not in (*NUMBERS, RGB9E5) or form > 1 or head["zero"].any():
        return None
    if not 1 <= components <= 4 or (number == RGB9E5 and components != 3):
        return None
    if kind in REGISTERED:
        count, numbers = REGISTERED[kind]
        if components != count or number not in numbers:
            return None
    return Head(components, number, form == 1)


def check_heads(block: Block, findings: Findings) -> None:
    """A003 and A009 of the component attachments of a block. Sets `block.heads`."""
    slots = len(block.slots)
    for number, entry in enumerate(block.attachment_entries):
        kind = int(entry["kind"])
        if kind not in kinds.WITH_COMPONENTS:
            continue
        data, name = block.attachments[kind], f"block {block.index}: attachment {kind}"
        at = block.at(block.info_at + 32 + 16 * number + 8)
        findings.require(len(data) >= 4 * HEAD and len(data) % 4 == 0, "A003", at, f"{name} has {len(data)} bytes")
        findings.settle()
        head = head_of(data.view("<u4"), kind)
        where = block.at(block.info_at + int(entry["offset"]))
        findings.require(head is not None, "A009", where, f"{name} has the head {data[:8].tobytes().hex()}")
        findings.settle()
        assert head is not None
        values = len(data) // 4 - HEAD - (0 if head.constant else slots)
        right = values == head.unit if head.constant else values >= 0 and values % head.unit == 0
        findings.require(right, "A003", at, f"{name} has {len(data)} bytes")
        findings.settle()
        block.heads[kind] = head


def decode(values: Array, head: Head) -> Array:
    """float64 (n, components) of values, uint32 (n, unit)."""
    values = np.ascontiguousarray(values)
    if head.number == RGB9E5:
        mantissa = values >> np.array([0, 9, 18], np.uint32) & 511
        result: Array = np.ldexp(mantissa.astype(np.float64), (values >> 27).astype(np.int32) - 24)
        return result
    dtype, divisor = NUMBERS[head.number]
    numbers: Array = values.view(dtype)[:, : head.components].astype(np.float64) / divisor
    return numbers


def components_of(octree: Octree, voxels: Voxels, kind: int) -> Array:
    """float64 (n, k): the components of type `kind` of voxels of an octree; NaN where the file has none.

    The default of roughness and opacity is 1, that of all others is 0.
    """
    parts = []
    block_of = np.array([octree.block_of_slot(int(slot)) for slot in np.unique(voxels.slot)], np.int64)
    block_of = block_of[np.searchsorted(np.unique(voxels.slot), voxels.slot)]
    for index in np.unique(block_of):
        rows = np.flatnonzero(block_of == index)
        block = octree.block(int(index))
        if kind in block.attachments:
            slot = voxels.slot[rows] - block.start
            parts.append((rows, decode_of(block, kind, slot, voxels.child[rows])))
    width = max((part.shape[1] for _, part in parts), default=1)
    result: Array = np.full((len(voxels), width), np.nan)
    for rows, part in parts:
        result[rows, : part.shape[1]] = part
    return result


def decode_of(block: Block, kind: int, slot: Array, child: Array) -> Array:
    """The components of voxels by slot of the descriptor in the block and child slot; NaN where there are none."""
    head, words = block.heads[kind], block.words(kind)
    if head.constant:
        return np.repeat(decode(words[None, HEAD:], head), len(slot), axis=0)
    entry = words[HEAD + slot]
    mask = PLAIN_ENTRY["mask"].of(entry)
    rank = np.where(HAS_BIT[mask, child], RANK[mask, child], POPCOUNT[mask])
    place = PLAIN_ENTRY["first"].of(entry).astype(np.int64) + rank * head.unit
    some = entry != 0
    inside = (place >= HEAD + len(block.slots)) & (place + head.unit <= len(words))
    findings = Findings()
    name = f"block {block.index}: values outside of attachment {kind}"
    findings.require((inside | ~some).all(), "A007", block.at(0), name)
    findings.settle()
    found = decode(words[np.where(some, place, HEAD)[:, None] + np.arange(head.unit)], head)
    found[~some] = np.nan
    return found


def check_components(trace: Trace, kind: int, used_slots: Array, findings: Findings) -> None:
    """A005, A007, A008 and A010 of a component attachment. `used_slots` says which slots hold a descriptor."""
    block, nodes = trace.block, trace.nodes
    head, words = block.heads[kind], block.words(kind)
    entries = block.attachment_entries
    start = block.info_at + int(entries["offset"][entries["kind"] == kind][0])
    name = f"block {block.index}: attachment {kind}"
    values_at = HEAD if head.constant else HEAD + len(block.slots)
    values = words[values_at:].reshape(-1, head.unit)
    with np.errstate(invalid="ignore"):
        numbers = decode(values, head)
    wrong = ~np.isfinite(numbers).all(axis=1)
    if kind == kinds.EMISSION:
        wrong |= (numbers < 0).any(axis=1)
    if head.number != RGB9E5:
        width = np.dtype(NUMBERS[head.number][0]).itemsize * head.components
        wrong |= values.view("u1").reshape(len(values), -1)[:, width:].any(axis=1)
    for row in np.flatnonzero(wrong)[:1]:
        findings.add("A010", block.at(start + 4 * (values_at + head.unit * row)), f"{name}: value {row} is no value")
    if head.constant:
        return
    entry = words[HEAD:values_at]
    for slot in np.flatnonzero((entry != 0) & ~used_slots)[:1]:
        findings.add("A005", block.at(start + 4 * (HEAD + slot)), f"{name}: an entry of slot {slot}, no descriptor")
    slot = nodes["slot"] - block.start
    entry, valid = entry[slot], nodes["valid_mask"]
    mask = PLAIN_ENTRY["mask"].of(entry).astype(np.uint8)
    first = PLAIN_ENTRY["first"].of(entry).astype(np.int64)
    count = np.where(entry != 0, POPCOUNT[mask] + ((valid & ~mask) != 0), 0) * head.unit
    good = ((mask & ~valid) == 0) & ((entry == 0) | ((first >= values_at) & (first + count <= len(words))))
    for row in np.flatnonzero(~good)[:1]:
        where = block.at(start + 4 * (HEAD + slot[row]))
        findings.add("A007", where, f"{name}: the entry of slot {slot[row]} leads to no values")
    if good.all():
        change = np.zeros(len(words) - values_at + 1, np.int64)
        some = entry != 0
        np.add.at(change, first[some] - values_at, 1)
        np.add.at(change, first[some] + count[some] - values_at, -1)
        for place in np.flatnonzero(np.cumsum(change[:-1]) != 1)[:1]:
            where = block.at(start + 4 * (values_at + place))
            findings.add("A008", where, f"{name}: a value does not belong to exactly one descriptor")
