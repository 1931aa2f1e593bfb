"""Parts of an octree: which blocks show a region, and the octree that a set of blocks makes (section 11.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, List, Sequence

import numpy as np

from .container import Section, bytes_of, front, places
from .errors import Findings
from .opening import OWN_CHECKSUMS, REQUIRED, crc
from .records import (
    CHILD_DESCRIPTOR,
    MAX_LEVELS,
    NO_PARENT,
    POPCOUNT,
    Array,
    field,
)
from .walking import Trace, Walk

if TYPE_CHECKING:
    from .octree import Octree
    from .parts import Parts


def blocks_for(octree: Octree, number: int, low: Sequence[float], high: Sequence[float], level: int) -> List[int]:
    """The blocks that show an object in a box of octree space down to a level, in the order of the table."""
    blocks = octree.blocks
    unit = 2.0**-MAX_LEVELS
    lower = blocks["cube_position"] * unit
    upper = lower + (2.0 ** blocks["cube_scale"].astype(np.float64) * unit)[:, None]
    meets = ((np.asarray(low) <= upper) & (lower <= np.asarray(high))).all(axis=1)
    first_level = MAX_LEVELS - blocks["cube_scale"].astype(np.int64) + 2
    wanted = (blocks["parent"] == NO_PARENT) | ((first_level <= level) & meets)
    return [int(index) for index in np.flatnonzero(wanted & (blocks["object"] == number))]


def parts_for(parts: Parts, blocks: Sequence[int], level: int) -> List[int]:
    """The parts of these blocks that have descriptors above a level, in the order of the table."""
    entries = parts.entries
    wanted = np.isin(entries["block"], blocks) & (entries["first_level"] < level)
    return [int(part) for part in np.flatnonzero(wanted)]


def part(octree: Octree, blocks: Sequence[int]) -> bytes:
    """A file with the octree of these blocks, which are read and checked; no others are.

    Raises `ValueError` if the parent of a block is missing, or all blocks are.
    """
    chosen = sorted(set(blocks))
    table = octree.blocks
    for index in chosen:
        above = int(table["parent"][index])
        if above != NO_PARENT and above not in chosen:
            raise ValueError(f"block {index} cannot be used without block {above}, its parent")
    if not chosen:
        raise ValueError("expected at least one block")
    sizes = table["image_size"][chosen].astype(np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    image = np.concatenate([octree.block(index).image for index in chosen])
    slots = image.view("<u8")
    kept = sorted({int(table["object"][index]) for index in chosen})
    findings = Findings()
    walk = Walk(octree, findings)
    for number in kept:
        walk.enter_root(number)
    objects, entries = octree.objects[kept].copy(), table[chosen].copy()
    for name in ("levels", "descriptors", "leaf_voxels", "contours", "far_pointers"):
        objects[name] = 0
    for place, index in enumerate(chosen):
        trace = walk.visit(octree.block(index))
        findings.settle()
        if trace is None:
            raise ValueError(f"nothing refers to block {index}")
        first = int(starts[place]) // 8
        info = image[int(starts[place]) + trace.block.info_at :]
        info[:4].view("<u4")[0] = place
        _mend(octree, trace, chosen, starts, slots, first)
        words = slots[first + trace.nodes["slot"] - trace.block.start]
        entry = objects[kept.index(int(table["object"][index])) :][:1]
        entry["levels"] = max(int(entry["levels"][0]), int(trace.nodes["level"].max()) + 1)
        entry["descriptors"] += len(words)
        entry["leaf_voxels"] += int(POPCOUNT[(words & np.uint64(0xFF)).astype(np.uint8)].sum())
        entry["contours"] += int(POPCOUNT[trace.nodes["contour_mask"]].sum())
        entry["far_pointers"] += int(CHILD_DESCRIPTOR["far"].of(words).sum())
    roots = [chosen.index(int(root)) for root in objects["root_block"]]
    objects["root_block"], objects["root_slot"] = roots, starts[roots] // 8 + 2
    entries["object"] = [kept.index(int(number)) for number in entries["object"]]
    entries["parent"] = [NO_PARENT if p == NO_PARENT else chosen.index(int(p)) for p in entries["parent"]]
    entries["image_offset"], entries["stored_size"], entries["codec"] = starts[:-1], sizes, 0
    entries["crc"] = [crc(image[low:high]) for low, high in zip(starts, starts[1:])]
    return container(objects, entries, image)


def _mend(octree: Octree, trace: Trace, chosen: List[int], starts: Array, slots: Array, first: int) -> None:
    """Sets far pointers that lead to other blocks; where they lead to none of the set, children become leaves."""
    nodes, block = trace.nodes, trace.block
    for node in nodes[field(nodes, "far") != 0]:
        local = int(node["slot"]) - block.start
        pointer = local + int(field(node, "child_pointer"))
        distance = int(block.slots[pointer])
        if local + distance < len(block.slots):
            continue
        below = octree.block_of_slot(int(node["slot"]) + distance)
        if below in chosen:
            target = int(starts[chosen.index(below)]) // 8 + 2
            slots[first + pointer] = target - (first + local)
        else:
            word, valid = int(slots[first + local]), int(node["valid_mask"])
            slots[first + local] = word >> 32 << 32 | valid << 8 | valid
            slots[first + pointer] = 0


def container(objects: Array, blocks: Array, image: Array) -> bytes:
    """A file of these tables and this image; sets the file offsets."""
    lengths = [objects.nbytes, blocks.nbytes, image.nbytes]
    offsets = places(lengths)
    blocks["file_offset"] = offsets[2] + blocks["image_offset"]
    bodies = [bytes_of(table) for table in (objects, blocks, image)]
    names = ((b"OBJT", REQUIRED), (b"BLKT", REQUIRED), (b"BLKS", REQUIRED | OWN_CHECKSUMS))
    sections = [Section(tag, flags, len(body), crc(body)) for (tag, flags), body in zip(names, bodies)]
    data = np.zeros(offsets[2] + lengths[2], np.uint8)
    data[: offsets[0]] = np.frombuffer(front(sections), np.uint8)
    for at, body in zip(offsets, bodies):
        data[at : at + len(body)] = body
    return data.tobytes()
