"""Colours and normals of voxels, averaged up the octree and encoded as plain values (sections 8.2, 8.3, 8.5).

Averages are taken of whole numbers, so that the same voxels give the same bytes on every machine.
"""

from __future__ import annotations

from typing import List, Optional, Tuple

import numpy as np

from .records import Array
from .trees import Level

#: Length of a normal while it is added up.
UNIT = 1 << 20
OPAQUE = 255


def color_words(colors: Array, levels: List[Level]) -> Array:
    """uint32: the colours R, G, B, A of all voxels but the root, level by level, from those of the leaf voxels.

    `colors` is uint8 (n, 4). A voxel that is split has the mean of the leaf voxels below it, channels as they are
    stored, weighted by alpha; its alpha is the mean of theirs.
    """
    sums = colors.astype(np.int64)
    sums[:, :3] *= sums[:, 3:]
    leaves = np.ones(len(colors), np.int64)
    found = [words_of(colors)]
    for level in levels[-2:0:-1]:
        begin = level.start[:-1]
        sums, leaves = np.add.reduceat(sums, begin), np.add.reduceat(leaves, begin)
        mean = np.empty((len(sums), 4), np.uint8)
        mean[:, :3] = rounded(sums[:, :3], np.maximum(sums[:, 3:], 1))
        mean[:, 3] = rounded(sums[:, 3], leaves)
        found.append(words_of(mean))
    return np.concatenate(found[::-1])


def words_of(channels: Array) -> Array:
    """uint32 (n,): four bytes each."""
    result: Array = np.ascontiguousarray(channels).view("<u4").reshape(-1)
    return result


def rounded(dividend: Array, divisor: Array) -> Array:
    """The nearest whole number of a quotient of those; halves are rounded up."""
    result: Array = (2 * dividend + divisor) // (2 * divisor)
    return result


def normal_words(normals: Array, levels: List[Level]) -> Array:
    """uint32: the raw normals of all voxels but the root, level by level, from those of the leaf voxels.

    `normals` is float64 (n, 3), of any length; of length 0 they are taken as +z. A voxel that is split has the mean of
    the leaf voxels below it.
    """
    x, y, z = normals.T
    length = np.sqrt(x * x + y * y + z * z)[:, None]
    unit = np.where(length > 0, normals / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
    sums = np.rint(unit * UNIT).astype(np.int64)
    found = [raw_words(sums)]
    for level in levels[-2:0:-1]:
        sums = np.add.reduceat(sums, level.start[:-1])
        found.append(raw_words(sums))
    return np.concatenate(found[::-1])


def raw_words(vectors: Array) -> Array:
    """uint32 (n,): the raw normals of directions, int64 (n, 3); +z for those of length 0."""
    axis = np.abs(vectors).argmax(axis=1)
    rows = np.arange(len(vectors))
    axis = np.where(vectors[rows, axis] == 0, 2, axis)
    main = vectors[rows, axis]
    scale = np.maximum(np.abs(main), 1).astype(np.float64)
    # Section 8.2: (t, u, v), (v, t, u), (u, v, t).
    u, v = (vectors[rows, (axis + step) % 3] / scale for step in (1, 2))
    low = np.clip(np.rint(v * 2.0**13), -(1 << 13), (1 << 13) - 1).astype(np.int64) & 0x3FFF
    # v is the fraction of u.
    high = np.clip(np.rint((u * 2.0**31 - low * 8) / 2.0**17), -(1 << 14), (1 << 14) - 1).astype(np.int64) & 0x7FFF
    words: Array = low | high << 14 | axis << 29 | (main < 0).astype(np.int64) << 31
    return words.astype(np.uint32)


def plain_values(words: Array, first: Array, count: Array, child: Array, slots: int, slot: Array) -> Array:
    """uint32: the attachment of plain values of a block with a descriptor array of this many slots.

    `words` and `child` are of all voxels. The descriptors of the block, in the order of their slots, have `count`
    voxels from `first` on, and lie at `slot`. The value that most of these voxels have is stored once, if more than one
    has it.
    """
    rank = np.arange(8)
    there = rank < count[:, None]
    voxel = np.where(there, first[:, None] + rank, 0)
    value = np.where(there, words[voxel], 0)
    equal = np.stack([((value == value[:, k, None]) & there).sum(axis=1) for k in range(8)], axis=1)
    equal = np.where(there, equal, 0)
    best = equal.argmax(axis=1)
    rows = np.arange(len(first))
    common = value[rows, best]
    shared = equal[rows, best] > 1
    own = there & ~(shared[:, None] & (value == common[:, None]))
    mask = (own << child[voxel]).sum(axis=1)
    stored = np.concatenate([own, shared[:, None]], axis=1)
    values = np.concatenate([value, common[:, None]], axis=1)[stored]
    used = stored.sum(axis=1)
    entries = np.zeros(slots, np.uint32)
    entries[slot] = mask | (slots + np.cumsum(used) - used) << 8
    result: Array = np.concatenate([entries, values.astype(np.uint32)])
    return result


def constant(words: Array) -> Optional[Tuple[int, int, int]]:
    """The one colour of these voxels, if they are opaque and have the same."""
    color = int(words[0])
    if color >> 24 != OPAQUE or (words != words[0]).any():
        return None
    return color & 255, color >> 8 & 255, color >> 16 & 255
