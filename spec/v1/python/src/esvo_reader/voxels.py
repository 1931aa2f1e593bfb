"""Voxels with their attributes decoded, as numpy arrays with one row for each voxel."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Dict, Optional, Sequence

import numpy as np

from . import codecs, kinds
from .blocks import Block
from .errors import Findings
from .records import (
    CHILD_CORNER,
    HAS_BIT,
    MAX_LEVELS,
    RANK,
    Array,
    field,
)


@dataclass(frozen=True)
class Voxels:
    """Voxels of an octree; every array has a row for each. Attributes that none of them has are None."""

    #: int64 (n,): slot of the image with the descriptor whose child the voxel is.
    slot: Array
    #: uint8 (n,): its child slot there, 0 to 7.
    child: Array
    #: uint8 (n,): 1 to 23.
    level: Array
    #: uint32 (n, 3): lower corner in units of 2^-23 of the root cube's edge.
    position: Array
    #: bool (n,): whether it is a leaf; if not, it has a descriptor of its own.
    leaf: Array
    #: uint32 (n,): the word of its contour, 0 without; `decode_contours` decodes it.
    contour: Optional[Array] = None
    #: float64 (n, 3): red, green, blue, sRGB-encoded, 0 to 1; NaN without.
    color: Optional[Array] = None
    #: float64 (n,): opacity, 0 to 1; NaN without.
    alpha: Optional[Array] = None
    #: float64 (n, 3): unit vector; NaN without.
    normal: Optional[Array] = None
    #: float64 (n,): ambient occlusion, 0 (no light) to 1; NaN without.
    ambient: Optional[Array] = None
    #: uint32 (n, 8, 2): colour and raw normal at the corners as stored (section 8.6). Colour, alpha and normal of such
    #: voxels are those of their middle; `interpolate_corners` gives those of other points.
    corners: Optional[Array] = None
    #: uint8 (n,): whose corners these are: 1 the voxel's own, 2 those of the voxel above, 0 it has none.
    corners_of: Optional[Array] = None

    def __len__(self) -> int:
        return len(self.slot)

    @property
    def size(self) -> Array:
        """float64 (n,): edge of the cube in octree space, where the root cube is [0, 1]³."""
        result: Array = np.ldexp(1.0, -self.level.astype(np.int32))
        return result

    @property
    def lower(self) -> Array:
        """float64 (n, 3): lower corner of the cube in octree space."""
        result: Array = self.position * 2.0**-MAX_LEVELS
        return result

    @property
    def center(self) -> Array:
        """float64 (n, 3): middle of the cube in octree space."""
        result: Array = self.lower + self.size[:, None] / 2
        return result


def concatenate(parts: Sequence[Voxels]) -> Voxels:
    """The voxels of all parts. Where only some parts have an attribute, the rows of the others are NaN or 0."""
    columns: Dict[str, Any] = {}
    for column in fields(Voxels):
        arrays = [getattr(part, column.name) for part in parts]
        there = [a for a in arrays if a is not None]
        if not there:
            columns[column.name] = None
            continue
        like = there[0]
        empty = np.nan if like.dtype.kind == "f" else 0
        columns[column.name] = np.concatenate(
            [
                np.full((len(part), *like.shape[1:]), empty, like.dtype) if a is None else a
                for part, a in zip(parts, arrays)
            ]
        )
    return Voxels(**columns)


def no_voxels() -> Voxels:
    return Voxels(
        np.zeros(0, np.int64),
        np.zeros(0, np.uint8),
        np.zeros(0, np.uint8),
        np.zeros((0, 3), np.uint32),
        np.zeros(0, bool),
    )


def decode_voxels(block: Block, nodes: Array, chosen: Array) -> Voxels:
    """Voxels below descriptors of a block. `chosen` says which child slots of each, bool (len(nodes), 8)."""
    row, child = np.nonzero(HAS_BIT[nodes["valid_mask"]] & chosen)
    node = nodes[row]
    slot = node["slot"] - block.start
    voxels = {
        "contour": contour_words(block, nodes)[row, child] if nodes["contour_mask"].any() else None,
        **attributes(block, slot, child),
    }
    level = node["level"] + np.uint8(1)
    half = np.left_shift(1, MAX_LEVELS - level.astype(np.int64))[:, None]
    position = (node["position"] + half * CHILD_CORNER[child]).astype(np.uint32)
    return Voxels(node["slot"], child.astype(np.uint8), level, position, HAS_BIT[node["leaf_mask"], child], **voxels)


def contour_words(block: Block, nodes: Array) -> Array:
    """Words of the contours of descriptors, uint32 (len(nodes), 8), 0 where there is none (section 5)."""
    place = contour_places(block, nodes)
    has = HAS_BIT[nodes["contour_mask"]]
    inside = has & (place >= 0) & (place < len(block.contours))
    findings = Findings()
    findings.require((inside == has).all(), "K002", block.at(0), f"block {block.index}: contours outside of the pool")
    findings.settle()
    result: Array = np.where(has, block.contours[np.where(inside, place, 0)], 0) if has.any() else has.astype(np.uint32)
    return result


def contour_places(block: Block, nodes: Array) -> Array:
    """Index into the contour pool for every child slot of descriptors, int64 (len(nodes), 8); not checked."""
    first = 2 * (nodes["slot"] - block.start) + field(nodes, "contour_pointer") - block.pool_at // 4
    result: Array = first[:, None] + RANK[nodes["contour_mask"]]
    return result


def gather(block: Block, kind: int, places: Array, wanted: Array) -> Array:
    """Words of an attachment at places that are checked where they are wanted (A007); 0 elsewhere."""
    words = block.words(kind)
    unit = 2 if kind == kinds.CORNERS else 1
    inside = (places >= unit * len(block.slots)) & (places + unit <= len(words))
    findings = Findings()
    findings.require(
        (inside | ~wanted).all(), "A007", block.at(0), f"block {block.index}: values outside of attachment {kind}"
    )
    findings.settle()
    used = inside & wanted
    if unit == 1:
        result: Array = np.where(used, words[np.where(used, places, 0)], 0)
    else:
        result = np.where(used[..., None], words[np.where(used, places, 0)[..., None] + np.arange(2)], 0)
    return result


def attributes(block: Block, slot: Array, child: Array) -> Dict[str, Optional[Array]]:
    """The columns of `Voxels` that the attachments of a block give its voxels."""
    found: Dict[str, Optional[Array]] = {}
    there = block.attachments
    everywhere = np.ones(len(slot), bool)
    if kinds.COLOR_BLOCKS in there:
        found["color"] = codecs.color_blocks(block.words(kinds.COLOR_BLOCKS), slot, child)
    if kinds.CONSTANT_COLOR in there:
        found["color"] = codecs.constant_color(there[kinds.CONSTANT_COLOR], len(slot))
    if kinds.PLAIN_COLORS in there:
        places = codecs.plain_places(block.words(kinds.PLAIN_COLORS), slot, child)
        found["color"], found["alpha"] = codecs.plain_colors(gather(block, kinds.PLAIN_COLORS, places, everywhere))
    if kinds.NORMAL_BLOCKS in there:
        found["normal"] = codecs.normal_blocks(block.words(kinds.NORMAL_BLOCKS), slot, child)
    if kinds.PLAIN_NORMALS in there:
        places = codecs.plain_places(block.words(kinds.PLAIN_NORMALS), slot, child)
        found["normal"] = codecs.normalised(codecs.raw_normals(gather(block, kinds.PLAIN_NORMALS, places, everywhere)))
    if kinds.AMBIENT_BLOCKS in there:
        found["ambient"] = codecs.ambient_blocks(there[kinds.AMBIENT_BLOCKS], slot, child)
    if kinds.CORNERS in there:
        entries = there[kinds.CORNERS][: 8 * len(block.slots)].view("<u8")[slot]
        places, source = codecs.corner_places(entries, child)
        values = gather(block, kinds.CORNERS, places, np.repeat(source[:, None] > 0, 8, axis=1))
        middle = np.full(3, 0.5)
        found["corners"], found["corners_of"] = values, source
        found["color"], found["alpha"], found["normal"] = codecs.interpolate_corners(values, source, child, middle)
    return found
