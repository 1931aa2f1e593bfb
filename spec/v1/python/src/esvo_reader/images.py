"""The images of the blocks of an octree that is to be written (sections 4.2, 5, 6, 8)."""

from __future__ import annotations

from typing import List, Optional, Tuple

import numpy as np

from . import kinds
from .container import bytes_of
from .records import (
    ATTACHMENT_ENTRY,
    CONSTANT,
    INFO_SECTION,
    MAX_IMAGE_BYTES,
    MAX_LEVELS,
    PAGE_BYTES,
    PAGE_SLOTS,
    Array,
)
from .shades import color_words, constant, normal_words, plain_values
from .trees import Plan, make_levels, ranges


class Tree:
    """An octree in blocks, of leaf voxels in the order of their paths.

    `positions` is int64 (n, 3), `colors` uint8 (n, 4) and `normals` float64 (n, 3), or None.
    """

    def __init__(self, positions: Array, levels: int, colors: Optional[Array], normals: Optional[Array]) -> None:
        tree = make_levels(positions, levels)
        self.levels, self.leaf_voxels = levels, len(positions)
        self._plan = plan = Plan(tree)
        self.descriptors = len(plan.slot)
        #: Of each block the index of its parent, -1 of the root block.
        self.parents = plan.parents
        self._cells = np.concatenate([level.position for level in tree[:-1]])
        # Of all voxels but the root: their child slots, colours and normals.
        self._child = np.concatenate([level.child for level in tree[1:]])
        self._colors = None if colors is None else color_words(colors, tree)
        self._normals = None if normals is None else normal_words(normals, tree)
        self._valid = np.add.reduceat(1 << self._child, plan.first)
        order = np.lexsort((plan.slot, plan.block))
        bounds = np.searchsorted(plan.block[order], np.arange(len(plan.owners) + 1)).tolist()
        #: uint8: the image of each block.
        self.images: List[Array] = []
        for block, (low, high) in enumerate(zip(bounds, bounds[1:])):
            self.images.append(self._image(block, order[low:high]))
        self._set_far_pointers()

    def cubes(self) -> Tuple[Array, Array]:
        """Of each block the position of its cube, in units of 2^-23 of the root cube's edge, and its scale."""
        owners = np.array(self._plan.owners)
        scale = MAX_LEVELS - self._plan.level[owners]
        return self._cells[owners] << scale[:, None], scale

    def _image(self, block: int, own: Array) -> Array:
        """The image of a block with these descriptors, but for its far pointers."""
        plan, count = self._plan, self._plan.array_slots[block]
        attachments = self._attachments(own, count)
        info = 8 * count
        pool = end = info + INFO_SECTION.itemsize + ATTACHMENT_ENTRY.itemsize * len(attachments)
        found = []
        for kind, body in attachments:
            end += -end % 8
            found.append((kind, end - info, len(body)))
            end += len(body)
        image = np.zeros(end + -end % PAGE_BYTES, np.uint8)
        slots = image[:info].view("<u8")
        slots[::PAGE_SLOTS] = count - PAGE_SLOTS * np.arange(len(slots[::PAGE_SLOTS]))
        slots[plan.slot[own]] = self._words(own)
        record = image[info:][: INFO_SECTION.itemsize].view(INFO_SECTION)
        record["block"], record["array_slots"], record["first_descriptor"] = block, count, count - 2
        record["contour_offset"], record["attachment_count"] = (pool - info) // 4, len(attachments)
        directory = image[info + INFO_SECTION.itemsize : pool].view(ATTACHMENT_ENTRY)
        directory[:] = np.array(found, ATTACHMENT_ENTRY) if found else 0
        for (_, at, size), (_, body) in zip(found, attachments):
            image[info + at :][:size] = body
        return image

    def _words(self, own: Array) -> Array:
        """uint64: child descriptors."""
        plan, valid = self._plan, self._valid[own]
        is_leaf = plan.level[own] == self.levels - 1
        cut = plan.cut[own]
        target = np.where(cut, plan.far[own], plan.children[own])
        pointer = np.where(is_leaf, 0, target - plan.slot[own])
        words: Array = np.where(is_leaf, valid, 0) | valid << 8 | cut << 16 | pointer << 17
        return words.astype(np.uint64)

    def _attachments(self, own: Array, count: int) -> List[Tuple[int, Array]]:
        """Type and bytes of the attachments of a block."""
        plan = self._plan
        first, number, slot = plan.first[own], plan.count[own], plan.slot[own]
        found: List[Tuple[int, Array]] = []
        color = None if self._colors is None else constant(self._colors[ranges(first, number)])
        if color is not None:
            record = np.zeros(1, CONSTANT)
            record["red"], record["green"], record["blue"] = color
            found.append((kinds.CONSTANT_COLOR, bytes_of(record)))
        elif self._colors is not None:
            values = plain_values(self._colors, first, number, self._child, count, slot)
            found.append((kinds.PLAIN_COLORS, bytes_of(values)))
        if self._normals is not None:
            values = plain_values(self._normals, first, number, self._child, count, slot)
            found.append((kinds.PLAIN_NORMALS, bytes_of(values)))
        return found

    def _set_far_pointers(self) -> None:
        """They count slots from their descriptors, so that they need the places of all blocks."""
        plan = self._plan
        starts = np.concatenate([[0], np.cumsum([len(image) // 8 for image in self.images])])
        if 8 * int(starts[-1]) > MAX_IMAGE_BYTES:
            raise ValueError("the octree takes more than 2^32 slots, the most that a file can have")
        for block, (owner, parent) in enumerate(zip(plan.owners, plan.parents)):
            if parent >= 0:
                distance = starts[block] + 2 - starts[parent] - plan.slot[owner]
                self.images[parent][: 8 * plan.array_slots[parent]].view("<u8")[plan.far[owner]] = distance
