"""Decodes contours and attributes (sections 7 and 8), many at once.

Functions that take `slot` and `child` decode the voxels in these child slots of the descriptors at these slots of one
block: both are integer arrays of shape (n,). Results are float64. Colours are red, green, blue, sRGB-encoded, 0 to 1;
alpha and ambient occlusion are 0 to 1; normals have length 1.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np

from .records import (
    AMBIENT_BLOCK,
    CHILD_CORNER,
    CONSTANT,
    CORNER_ENTRY,
    HAS_BIT,
    PLAIN_ENTRY,
    POPCOUNT,
    RANK,
    Array,
)

#: What `decode_contours` returns. Lengths are in units of the voxel's edge.
CONTOUR = np.dtype([("normal", "<f8", (3,)), ("position", "<f8"), ("thickness", "<f8")])
#: The eight corners of child slot i, as bits of the lattice of 3 x 3 x 3 points, shape (8, 8).
LATTICE: Array = ((CHILD_CORNER[:, None] + CHILD_CORNER) * (1, 3, 9)).sum(axis=2)


def signed(words: Array, shift: int) -> Array:
    """i32(w << shift), as float64."""
    return (words.astype(np.uint32) << np.uint32(shift)).view(np.int32).astype(np.float64)


def shifted(words: Array, shift: int) -> Array:
    """u32(w << shift), as float64."""
    return (words.astype(np.uint32) << np.uint32(shift)).astype(np.float64)


def normalised(vectors: Array) -> Array:
    """Vectors of length 1, shape (..., 3); +z where they are zero."""
    length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    result: Array = np.where(length > 0, vectors / np.where(length > 0, length, 1), (0.0, 0.0, 1.0))
    return result


def bit_count(words: Array) -> Array:
    """Set bits of each word of 32 bits."""
    parts = np.ascontiguousarray(words, np.uint32)[..., None].view(np.uint8)
    result: Array = POPCOUNT[parts].sum(axis=-1)
    return result


def decode_contours(words: Array) -> Array:
    """Contours of shape words.shape, of type `CONTOUR` (section 7). Normals are not of length 1."""
    words = np.asarray(words, np.uint32)
    result = np.empty(words.shape, CONTOUR)
    for axis, shift in enumerate((14, 20, 26)):
        result["normal"][..., axis] = signed(words, shift) * 2.0**-26
    result["position"] = signed(words, 7) * 2.0**-25 * 0.75
    result["thickness"] = words * 2.0**-25 * 0.75
    return result


def texel_index(words: Array, slot: Array, child: Array) -> Array:
    """The index of 2 bits of each voxel's texel."""
    texel = child.astype(np.int64) + 8 * (slot % 2)
    result: Array = words.astype(np.int64) >> 2 * texel & 3
    return result


def color_blocks(words: Array, slot: Array, child: Array) -> Array:
    """Colours of shape (n, 3) from attachment type 1 (section 8.1)."""
    pair = words.reshape(-1, 2)[slot // 2]
    head = pair[:, 0]
    ref0 = np.stack([shifted(head, s) for s in (16, 21, 27)], axis=1) * 2.0**-32
    ref1 = np.stack([shifted(head, s) for s in (0, 5, 11)], axis=1) * 2.0**-32
    weight = np.array([1, 0, 2 / 3, 1 / 3])[texel_index(pair[:, 1], slot, child), None]
    result: Array = weight * ref0 + (1 - weight) * ref1
    return result


def raw_normals(words: Array) -> Array:
    """Points on the cube [-1, 1]³, shape words.shape + (3,) (section 8.2, base)."""
    words = np.asarray(words, np.uint32)
    t = np.where(words >> np.uint32(31), -1.0, 1.0)
    u, v = signed(words, 3) * 2.0**-31, signed(words, 18) * 2.0**-31
    axis = (words >> np.uint32(29) & np.uint32(3))[..., None]
    orders = [np.stack(o, axis=-1) for o in ((t, u, v), (v, t, u), (u, v, t))]
    result: Array = np.where(axis == 0, orders[0], np.where(axis == 1, orders[1], orders[2]))
    return result


def normal_blocks(words: Array, slot: Array, child: Array) -> Array:
    """Normals of shape (n, 3) from attachment type 2 (section 8.2)."""
    block = words.reshape(-1, 4)[slot // 2]
    grid = np.array([-1, -1 / 3, 1 / 3, 1])
    u = grid[texel_index(block[:, 1], slot, child), None]
    v = grid[texel_index(block[:, 3], slot, child), None]
    axes = block[:, 2]

    def axis(half: Array) -> Array:
        exponent = (half >> np.uint32(16) & np.uint32(15)).astype(np.int64) - 41
        parts = np.stack([signed(half, s) for s in (0, 4, 8)], axis=1)
        scaled: Array = np.ldexp(parts, exponent[:, None])
        return scaled

    return normalised(raw_normals(block[:, 0]) + u * axis(axes << np.uint32(16)) + v * axis(axes))


def constant_color(data: Array, count: int) -> Array:
    """Colours of shape (count, 3) from attachment type 3 (section 8.3)."""
    value = data.view(CONSTANT)[0]
    return np.tile(np.array([value["red"], value["green"], value["blue"]]) / 255, (count, 1))


def ambient_blocks(data: Array, slot: Array, child: Array) -> Array:
    """Ambient occlusion of shape (n,) from attachment type 4 (section 8.4)."""
    block = data.view("<u8")[slot // 2]
    ref1 = AMBIENT_BLOCK["ref1"].of(block)
    ref0 = AMBIENT_BLOCK["ref0"].of(block) + ref1 / 256
    low, width, _ = AMBIENT_BLOCK["weights"]
    texel = child.astype(np.uint64) + np.uint64(8) * (slot % 2).astype(np.uint64)
    weight = (block >> np.uint64(low) + np.uint64(width) * texel & np.uint64(7)).astype(np.float64)
    result: Array = np.minimum((weight * ref0 + (7 - weight) * ref1) / (7 * 255), 1.0)
    return result


def plain_places(words: Array, slot: Array, child: Array) -> Array:
    """Index of each voxel's value into the words of attachment type 5 or 6 (section 8.5); not checked."""
    entry = words[slot]
    mask = PLAIN_ENTRY["mask"].of(entry)
    rank = np.where(HAS_BIT[mask, child], RANK[mask, child], POPCOUNT[mask])
    result: Array = PLAIN_ENTRY["first"].of(entry).astype(np.int64) + rank
    return result


def plain_colors(values: Array) -> Tuple[Array, Array]:
    """Colours of shape (..., 3) and alpha of shape (...) of words R, G, B, A (section 8.5)."""
    channels = np.ascontiguousarray(values)[..., None].view(np.uint8) / 255
    return channels[..., :3], channels[..., 3]


def corner_places(entries: Array, child: Array) -> Tuple[Array, Array]:
    """Where the corners of voxels are, of attachment type 7 (section 8.6); not checked.

    Takes the entry of each voxel's descriptor as uint64. Returns the index of the first word of each of eight values
    into the words of the attachment, shape (n, 8), and whose corners these are, shape (n,): 1 for the voxel's own, 2
    for those of the voxel above, 0 for none.
    """
    mask = CORNER_ENTRY["mask"].of(entries)
    lattice = LATTICE[child].astype(np.uint64)
    own: Array = np.logical_and.reduce(mask[:, None] >> lattice & np.uint64(1), axis=1)
    above = CORNER_ENTRY["own_corners"].of(entries).astype(bool)
    below = mask[:, None] & (np.uint64(1) << lattice) - np.uint64(1)
    rank = np.where(own[:, None], bit_count(below), bit_count(mask)[:, None] + np.arange(8))
    first = CORNER_ENTRY["first"].of(entries).astype(np.int64)
    return first[:, None] + 2 * rank, np.where(own, 1, np.where(above, 2, 0)).astype(np.uint8)


def interpolate_corners(values: Array, source: Array, child: Array, point: Array) -> Tuple[Array, Array, Array]:
    """Colour, alpha and normal within voxels by their corners (section 8.6).

    `values` are pairs of words, shape (n, 8, 2), `source` is as `corner_places` returns it, `point` are points in the
    voxels, 0 to 1 along each axis, of a shape that broadcasts to (n, 3). Returns arrays of shape (n, 3), (n,) and
    (n, 3), NaN where there is no corner that counts.
    """
    own: Array = (source == 1).reshape(-1, 1)
    q = np.where(own, point, (CHILD_CORNER[child] + point) / 2)[:, None, :]
    weight = np.where(CHILD_CORNER == 1, q, 1 - q).prod(axis=2)
    color, alpha = plain_colors(values[..., 0])
    weight = np.where((alpha > 0) & (source[:, None] > 0), weight, 0)
    total = weight.sum(axis=1)
    # Where nothing counts, the division by NaN makes the results NaN.
    total = np.where(total > 0, total, np.nan)
    weight = weight[..., None]
    normal = normalised((weight * normalised(raw_normals(values[..., 1]))).sum(axis=1))
    return (
        (weight * color).sum(axis=1) / total[:, None],
        (weight[..., 0] * alpha).sum(axis=1) / total,
        np.where(np.isnan(total)[:, None], np.nan, normal),
    )
