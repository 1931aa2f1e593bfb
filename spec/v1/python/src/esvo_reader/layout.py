"""The layout that makes an image of the fields of a block of codec 2 (section 4.4)."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from . import kinds
from .fields import BLOCK, FAR, NEAR, NONE, Fields, value_counts
from .records import ATTACHMENT_ENTRY, INFO_SECTION, PAGE_BYTES, PAGE_SLOTS, POPCOUNT, Array


class Group(NamedTuple):
    """Siblings that have their slots."""

    level: int
    #: Indices into the level.
    nodes: range
    slot: int


class Layout:
    """Where everything lies in the image of a block."""

    def __init__(self, fields: Fields) -> None:
        """Raises `ValueError` where the fields make no block."""
        self.fields, self.levels = fields, fields.levels
        self.groups: List[Group] = []
        self.cursor = 2
        self.next = [0] * len(self.levels)
        #: Distance from each descriptor with children to what its child pointer leads to.
        self.pointers: Dict[int, int] = {}
        #: Far pointers: their slots, those of their descriptors, and where they lead in the block.
        self.far: List[Tuple[int, int, int]] = []
        #: The same of those to other blocks: with the number of the link in its level.
        self.outer: List[Tuple[int, int, int, int]] = []
        self._run()
        #: Where the info section and the contour pool begin, in bytes, and how many contours there are.
        self.info = 8 * self.cursor
        self.pool = self.info + INFO_SECTION.itemsize + ATTACHMENT_ENTRY.itemsize * len(fields.kinds)
        self.contours = sum(len(level.contours) for level in fields.levels)
        end = self.pool + 4 * self.contours
        #: Type, first byte and size of each attachment.
        self.places: List[Tuple[int, int, int]] = []
        for number, (kind, _) in enumerate(fields.kinds):
            values = sum(len(level.values[number][1]) for level in fields.levels)
            size = kinds.attachment_bytes(kind, self.cursor, values)
            at = end + -end % 8
            self.places.append((kind, at, size))
            end = at + size
        #: Bytes of the image.
        self.size = end + -end % PAGE_BYTES

    def image(self, index: int, start: int, starts: Callable[[int], Optional[int]], partial: bool = False) -> Array:
        """uint8: the image, as block `index`, which begins at slot `start`; `starts` says the same of other blocks.

        `partial`: voxels become leaves whose children are in a block of which it says None. Raises `ValueError` where a
        pointer does not reach.
        """
        fields, info, pool, count = self.fields, self.info, self.pool, self.cursor
        data = np.zeros(self.size, np.uint8)
        slots = data[:info].view("<u8")
        slots[::PAGE_SLOTS] = count - PAGE_SLOTS * np.arange(len(slots[::PAGE_SLOTS]))
        _write_descriptors(self, data, slots)
        _write_outer(self, slots, start, starts, partial)
        record = data[info : info + INFO_SECTION.itemsize].view(INFO_SECTION)
        record["block"], record["array_slots"], record["first_descriptor"] = index, count, count - 2
        record["contour_offset"], record["contour_count"] = (pool - info) // 4, self.contours
        record["attachment_count"] = len(fields.kinds)
        directory = data[info + INFO_SECTION.itemsize : pool].view(ATTACHMENT_ENTRY)
        for number, (kind, at, size) in enumerate(self.places):
            directory["kind"][number], directory["offset"][number], directory["size"][number] = kind, at - info, size
            _write_attachment(self, number, data[at : at + size])
        return data

    def _place(self, level: int, count: int) -> Group:
        if level >= len(self.levels):
            raise ValueError("the last level has children")
        start = self.next[level]
        nodes = range(start, start + count)
        self.next[level] += count
        needed = count + int((self.levels[level].links[start : start + count] >= FAR).sum())
        if self.cursor % PAGE_SLOTS == 0 or self.cursor % PAGE_SLOTS + needed > PAGE_SLOTS:
            self.cursor += -self.cursor % PAGE_SLOTS + 2
        group = Group(level, nodes, self.cursor)
        self.cursor += needed
        self.cursor += self.cursor % 2
        self.groups.append(group)
        return group

    def _run(self) -> None:
        links = [level.links.tolist() for level in self.levels]
        counts = [POPCOUNT[level.nonleaf].tolist() for level in self.levels]
        outer = [0] * len(self.levels)
        group = self._place(0, len(self.levels[0].valid))
        # Each entry: a group, how many of its members are done, and its next far pointer.
        stack = [(group, 0, group.slot + len(group.nodes))]
        while stack:
            group, done, pointer = stack.pop()
            if done == len(group.nodes):
                continue
            node, slot, level = group.nodes[done], group.slot + done, group.level
            link = links[level][node]
            stack.append((group, done + 1, pointer + (link >= FAR)))
            if link == NONE:
                continue
            if link == BLOCK:
                self.outer.append((pointer, slot, level, outer[level]))
                outer[level] += 1
                self.pointers[slot] = pointer - slot
                continue
            below = self._place(level + 1, counts[level][node])
            stack.append((below, 0, below.slot + len(below.nodes)))
            self.pointers[slot] = (below.slot if link == NEAR else pointer) - slot
            if link == FAR:
                self.far.append((pointer, slot, below.slot - slot))


def _write_descriptors(layout: Layout, data: Array, slots: Array) -> None:
    fields, pool = layout.fields, layout.pool
    contour_at = [0] * len(fields.levels)
    written = 0
    words = data[pool:].view("<u4")
    for level, nodes, slot in layout.groups:
        columns = fields.levels[level]
        for node, at in zip(nodes, range(slot, slot + len(nodes))):
            valid, nonleaf = int(columns.valid[node]), int(columns.nonleaf[node])
            far = int(columns.links[node] >= FAR)
            pointer = layout.pointers.get(at, 0)
            mask = int(columns.contour_masks[node])
            contours = int(POPCOUNT[mask])
            contour_pointer = pool // 4 + written - 2 * at if contours else 0
            if pointer >= 1 << 15 or contour_pointer >= 1 << 24:
                raise ValueError("a pointer does not reach")
            low = pointer << 17 | far << 16 | valid << 8 | (valid & ~nonleaf)
            slots[at] = (contour_pointer << 8 | mask) << 32 | low
            first = contour_at[level]
            words[written : written + contours] = columns.contours[first : first + contours]
            contour_at[level] += contours
            written += contours
    for pointer, _, distance in layout.far:
        slots[pointer] = distance


def make_leaves(slots: Array, slot: int, pointer: int) -> None:
    """Makes leaves of all voxels of the descriptor at a slot, and clears its far pointer. The contours stay."""
    word = int(slots[slot])
    valid = word >> 8 & 0xFF
    slots[slot], slots[pointer] = word >> 32 << 32 | valid << 8 | valid, 0


def _write_outer(
    layout: Layout, slots: Array, start: int, starts: Callable[[int], Optional[int]], partial: bool
) -> None:
    for pointer, slot, level, number in layout.outer:
        block = int(layout.levels[level].children[number])
        target = starts(block)
        if target is None and partial:
            make_leaves(slots, slot, pointer)
            continue
        distance = 0 if target is None else target + 2 - start - slot
        if not 0 < distance < 1 << 32:
            raise ValueError(f"block {block} cannot be reached")
        slots[pointer] = distance


def _write_attachment(layout: Layout, number: int, data: Array) -> None:
    fields, count = layout.fields, layout.cursor
    kind, constant = fields.kinds[number]
    if kind == kinds.CONSTANT_COLOR:
        data[:] = np.frombuffer(constant, np.uint8)
        return
    at = [0] * len(fields.levels)
    written = 0
    if kind in (kinds.COLOR_BLOCKS, kinds.AMBIENT_BLOCKS, kinds.NORMAL_BLOCKS):
        pairs = data.view("<u8").reshape(-1, 2 if kind == kinds.NORMAL_BLOCKS else 1)
        for level, nodes, slot in layout.groups:
            some = (len(nodes) + 1) // 2
            values = fields.levels[level].values[number][1].reshape(-1, pairs.shape[1])
            pairs[slot // 2 : slot // 2 + some] = values[at[level] : at[level] + some]
            at[level] += some
        return
    cells: Any = data.view("<u8" if kind == kinds.CORNERS else "<u4")
    for level, nodes, slot in layout.groups:
        columns = fields.levels[level]
        masks, values = columns.values[number]
        assert masks is not None
        own = value_counts(kind, masks[nodes.start : nodes.stop], columns.valid[nodes.start : nodes.stop])
        for place, node, some in zip(range(slot, slot + len(nodes)), nodes, own.tolist()):
            first, mask = count + written, int(masks[node])
            if kind == kinds.CORNERS:
                cells[place] = (2 * first if some else 0) << 32 | mask
            elif first >= 1 << 24:
                raise ValueError("a plain value is too far away")
            else:
                cells[place] = first << 8 | mask
            cells[first : first + some] = values[at[level] : at[level] + some]
            at[level] += some
            written += some
