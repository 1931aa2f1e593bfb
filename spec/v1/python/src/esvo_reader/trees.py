"""The octree of a set of voxels, cut into blocks, and the slot of each descriptor (sections 4.2 and 5).

All leaf voxels are at the deepest level. Voxels of a level are in the order of their paths: that of the child slots
from the root on.
"""

from __future__ import annotations

from typing import List, NamedTuple, Tuple

import numpy as np

from .records import PAGE_SLOTS, Array

#: A voxel with at least this many slots of descriptors below it gets a block for them. Below each of its eight children
#: are fewer then, so that a block has less than 32768 slots, with page headers and gaps: child pointers reach all of
#: it, and far pointers lead to other blocks only.
BLOCK_SLOTS = 4000


class Level(NamedTuple):
    """The voxels of a level."""

    #: int64 (n, 3): positions in units of the level's edge.
    position: Array
    #: int64 (n,): the child slot of each in the voxel above.
    child: Array
    #: int64 (n,): index of the voxel above in its level.
    parent: Array
    #: int64 (n + 1,): where the children of each begin in the level below; with those of all at the end.
    start: Array
    #: int64 (n,): the first leaf voxel below each.
    leaf: Array


def spread(values: Array) -> Array:
    """The lowest 21 bits of uint64, each moved to three times its place."""
    values = values & np.uint64(0x1FFFFF)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values


def path_order(position: Array) -> Array:
    """int64: the order of leaf voxels by path."""
    axes = position.astype(np.uint64)
    low, high = (
        sum((spread(part[:, axis]) << np.uint64(axis) for axis in range(3)), np.zeros(len(axes), np.uint64))
        for part in (axes, axes >> np.uint64(21))
    )
    return np.lexsort((low, high)) if high.any() else np.argsort(low, kind="stable")


def make_levels(position: Array, levels: int) -> List[Level]:
    """The voxels of all levels above these leaf voxels, int64 (n, 3), which are in the order of their paths."""
    found: List[Level] = []
    start = leaf = np.arange(len(position) + 1)
    for _ in range(levels):
        child = (position & 1) @ np.array([1, 2, 4])
        above = position >> 1
        first = np.ones(len(position), bool)
        first[1:] = (above[1:] != above[:-1]).any(axis=1)
        found.append(Level(position, child, np.cumsum(first) - 1, start, leaf[:-1]))
        start = np.append(np.flatnonzero(first), len(position))
        leaf = np.append(leaf[start[:-1]], leaf[-1])
        position = above[start[:-1]]
    root = np.zeros(1, np.int64)
    found.append(Level(position, root, root, start, leaf[:-1]))
    return found[::-1]


class Plan:
    """Where the descriptors of an octree lie. They are numbered level by level, in the order of the voxels."""

    def __init__(self, levels: List[Level]) -> None:
        self.levels = levels
        split = levels[:-1]
        sizes = [len(level.position) for level in split]
        #: int64: the number of the first descriptor of each level, and how many there are.
        self.offsets: Array = np.concatenate([[0], np.cumsum(sizes)])
        #: int64 (n,): the level of each descriptor.
        self.level: Array = np.repeat(np.arange(len(split)), sizes)
        #: int64 (n,): how many children its voxel has.
        self.count: Array = np.concatenate([np.diff(level.start) for level in split])
        #: int64 (n,): the first of them; voxels are numbered as descriptors are, without the root, leaf voxels last.
        self.first: Array = np.concatenate([level.start[:-1] for level in split]) + self.offsets[self.level + 1] - 1
        self._cut()
        self._number_blocks()
        self._place()

    def _cut(self) -> None:
        """Says of each descriptor whether its voxel's children are in a block of their own."""
        cut = [np.zeros(len(level.position), bool) for level in self.levels[:-1]]
        weight = np.zeros(len(cut[-1]), np.int64)
        for level in range(len(cut) - 2, -1, -1):
            cut[level + 1] = weight >= BLOCK_SLOTS
            begin = self.levels[level].start[:-1]
            group = np.diff(self.levels[level].start) + np.add.reduceat(cut[level + 1].astype(np.int64), begin)
            weight = group + group % 2 + np.add.reduceat(np.where(cut[level + 1], 0, weight), begin)
        #: bool (n,).
        self.cut: Array = np.concatenate(cut)

    def _number_blocks(self) -> None:
        """Numbers the blocks in the order of their parents."""
        # First in the order of the descriptors whose far pointers lead to them; 0 is the root block.
        owners = np.flatnonzero(self.cut)
        below = np.zeros(len(self.cut), np.int64)
        holder = np.zeros(len(self.cut), np.int64)
        below[owners] = np.arange(1, len(owners) + 1)
        for number, level in enumerate(self.levels[1:-1], 1):
            own = slice(int(self.offsets[number]), int(self.offsets[number + 1]))
            above = below[int(self.offsets[number - 1]) : int(self.offsets[number])]
            holder[own] = above[level.parent]
            below[own] = np.where(self.cut[own], below[own], holder[own])
        parents = holder[owners]
        leaf = np.concatenate([level.leaf for level in self.levels[:-1]])
        final = np.zeros(len(owners) + 1, np.int64)
        self.parents, self.owners = [-1], [0]
        known = np.zeros(1, np.int64)
        while True:
            rows = np.flatnonzero(np.isin(parents, known))
            if not rows.size:
                break
            rows = rows[np.lexsort((leaf[owners[rows]], final[parents[rows]]))]
            final[rows + 1] = np.arange(len(rows)) + len(self.owners)
            self.owners += owners[rows].tolist()
            self.parents += final[parents[rows]].tolist()
            known = rows + 1
        #: int64 (n,): the block of each descriptor, and that of the descriptors of its voxel's children.
        self.block: Array = final[holder]
        self.below: Array = final[below]
        self._leaf = leaf

    def _place(self) -> None:
        """Groups of siblings depth first, as section 4.4 lays them out."""
        inner = np.flatnonzero(self.level < len(self.levels) - 2)
        inner = inner[np.lexsort((self.level[inner], self._leaf[inner], self.below[inner]))]
        # A cut voxel is one of a group; its children are the descriptors after those of the levels above.
        child = self.first[inner] + 1
        siblings = self.count[inner]
        cuts = np.concatenate([[0], np.cumsum(self.cut)])
        fars = cuts[child + siblings] - cuts[child]
        sizes = siblings + fars
        sizes += sizes % 2
        bounds = np.searchsorted(self.below[inner], np.arange(len(self.owners) + 1))
        slots = np.zeros(len(inner), np.int64)
        #: The length of the descriptor array of each block.
        self.array_slots: List[int] = []
        for block, (low, high) in enumerate(zip(bounds, bounds[1:])):
            # The root's descriptor is a group of its own, of one and a gap.
            own = np.concatenate([[2], sizes[low:high]]) if block == 0 else sizes[low:high]
            placed, end = pack(own)
            slots[low:high] = placed[1:] if block == 0 else placed
            self.array_slots.append(end)
        #: int64 (n,): the slot of each descriptor in its block.
        self.slot: Array = np.full(len(self.cut), 2)
        members = ranges(child, siblings)
        self.slot[members] = ranges(slots, siblings)
        #: int64 (n,): the slot of the first child's descriptor, in the block that it is in; 0 without one.
        self.children: Array = np.zeros(len(self.cut), np.int64)
        self.children[inner] = slots
        #: int64 (n,): the slot of the far pointer; 0 without one.
        self.far: Array = np.zeros(len(self.cut), np.int64)
        far = np.repeat(slots + siblings, siblings) + cuts[members] - cuts[np.repeat(child, siblings)]
        self.far[members] = np.where(self.cut[members], far, 0)


def ranges(first: Array, count: Array) -> Array:
    """int64: the numbers of all ranges of `count` from `first` on, one range after the other."""
    steps = np.arange(int(count.sum()))
    result: Array = steps + np.repeat(first - (np.cumsum(count) - count), count)
    return result


def pack(sizes: Array) -> Tuple[Array, int]:
    """The slot of each group of a block, of even sizes, and where the last ends. No group begins in a page's first two
    slots or crosses its end."""
    ends = np.cumsum(sizes)
    slots = np.empty(len(sizes), np.int64)
    at = page = 0
    while at < len(sizes):
        before = int(ends[at] - sizes[at])
        last = int(np.searchsorted(ends, before + PAGE_SLOTS - 2, side="right"))
        slots[at:last] = PAGE_SLOTS * page + 2 + ends[at:last] - sizes[at:last] - before
        at, page = last, page + 1
    return slots, int(slots[-1] + sizes[-1])
