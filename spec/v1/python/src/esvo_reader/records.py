"""The records of the format: byte layouts as numpy dtypes, bit layouts as `Bits`.

Names, offsets and types are those of `esvo.ksy`; a test compares them. All numbers are little-endian. Section numbers
refer to the specification.
"""

from __future__ import annotations

from typing import Any, Dict, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

PAGE_SLOTS = 1024
PAGE_BYTES = 8192
NO_PARENT = 0xFFFFFFFF
#: Bytes of an image of 2^32 slots (section 10).
MAX_IMAGE_BYTES = 1 << 35
MAX_LEVELS = 23
IDENTIFIER = b"\xabESVO 1\xbb\r\n\x1a\n"

#: Section 2.1.
HEADER = np.dtype(
    [
        ("identifier", "S12"),
        ("major", "<u2"),
        ("minor", "<u2"),
        ("required_features", "<u8"),
        ("optional_features", "<u8"),
        ("file_length", "<u8"),
        ("directory_offset", "<u8"),
        ("directory_count", "<u4"),
        ("directory_crc", "<u4"),
        ("head", "<u4"),
        ("header_crc", "<u4"),
    ]
)

#: Section 2.2.
SECTION_ENTRY = np.dtype(
    [
        ("tag", "S4"),
        ("flags", "<u4"),
        ("offset", "<u8"),
        ("length", "<u8"),
        ("crc", "<u4"),
        ("reserved", "<u4"),
    ]
)

#: Section 3. `octree_to_mesh` is stored by columns.
OBJECT_ENTRY = np.dtype(
    [
        ("octree_to_mesh", "<f8", (16,)),
        ("root_block", "<u4"),
        ("levels", "<u4"),
        ("root_slot", "<u8"),
        ("descriptors", "<u8"),
        ("leaf_voxels", "<u8"),
        ("contours", "<u8"),
        ("far_pointers", "<u8"),
        ("reserved", "u1", (16,)),
    ]
)

#: Section 4.1.
BLOCK_ENTRY = np.dtype(
    [
        ("object", "<u4"),
        ("parent", "<u4"),
        ("cube_position", "<u4", (3,)),
        ("cube_scale", "<u4"),
        ("image_offset", "<u8"),
        ("image_size", "<u8"),
        ("file_offset", "<u8"),
        ("stored_size", "<u8"),
        ("codec", "<u4"),
        ("crc", "<u4"),
        ("reserved", "<u8"),
    ]
)

#: Section 4.3.
PART_ENTRY = np.dtype(
    [
        ("block", "<u4"),
        ("size", "<u4"),
        ("first_level", "u1"),
        ("last_level", "u1"),
        ("reserved", "<u2"),
    ]
)

#: Section 4.3.
PART_HEADER = np.dtype(
    [
        ("crc", "<u4"),
        ("size", "<u4"),
        ("block", "<u4"),
        ("first_level", "u1"),
        ("last_level", "u1"),
        ("codec", "u1"),
        ("reserved", "u1"),
    ]
)

#: Section 6.
INFO_SECTION = np.dtype(
    [
        ("block", "<u4"),
        ("array_slots", "<u4"),
        ("first_descriptor", "<u4"),
        ("contour_offset", "<u4"),
        ("contour_count", "<u4"),
        ("attachment_count", "<u4"),
        ("reserved", "<u8"),
    ]
)

#: Section 6.
ATTACHMENT_ENTRY = np.dtype(
    [
        ("kind", "<u4"),
        ("offset", "<u4"),
        ("size", "<u8"),
    ]
)

#: Section 8.1. `indices` has 2 bits for each of 16 texels, the lowest bits for texel 0; likewise in normal blocks.
COLOR_BLOCK = np.dtype([("head", "<u4"), ("indices", "<u4")])

#: Section 8.2.
NORMAL_BLOCK = np.dtype([("base", "<u4"), ("u_indices", "<u4"), ("axes", "<u4"), ("v_indices", "<u4")])

#: Section 8.3.
CONSTANT = np.dtype([("red", "u1"), ("green", "u1"), ("blue", "u1"), ("zero", "u1", (5,))])

#: Section 8.6: a colour and a raw normal.
CORNER_VALUE = np.dtype([("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1"), ("normal", "<u4")])


#: Section 8.7.
COMPONENT_HEAD = np.dtype([("count", "u1"), ("number", "u1"), ("form", "u1"), ("zero", "u1", (5,))])


class Bits(NamedTuple):
    """A field of some bits of a word: its lowest bit, its width, and how many of that width follow each other."""

    low: int
    width: int
    repeat: int = 1

    def of(self, words: Array) -> Array:
        """The field of each word, as numbers of the type of the words."""
        word = words.dtype.type
        result: Array = words >> word(self.low) & word((1 << self.width) - 1)
        return result


#: Section 5; of a slot as one number of 64 bits.
CHILD_DESCRIPTOR: Dict[str, Bits] = {
    "leaf_mask": Bits(0, 8),
    "valid_mask": Bits(8, 8),
    "far": Bits(16, 1),
    "child_pointer": Bits(17, 15),
    "contour_mask": Bits(32, 8),
    "contour_pointer": Bits(40, 24),
}

#: Page header and far pointer (sections 4.2, 5); of a slot.
DISTANCE: Dict[str, Bits] = {"slots": Bits(0, 32), "zero": Bits(32, 32)}

#: Section 8.4; of 64 bits. The bits below `ref0` are its fraction.
AMBIENT_BLOCK: Dict[str, Bits] = {"ref1": Bits(0, 8), "ref0": Bits(8, 8), "weights": Bits(16, 3, 16)}

#: Section 8.5; of 32 bits.
PLAIN_ENTRY: Dict[str, Bits] = {"mask": Bits(0, 8), "first": Bits(8, 24)}

#: Section 8.6; of 64 bits.
CORNER_ENTRY: Dict[str, Bits] = {
    "mask": Bits(0, 27),
    "own_corners": Bits(27, 1),
    "zero": Bits(28, 4),
    "first": Bits(32, 32),
}


def _descriptor(size: int, word_at: int, fields: Dict[str, Any]) -> np.dtype[Any]:
    """A record with a child descriptor at an offset, as `word` and as the masks in it, and more fields."""
    word = {"word": ("<u8", 0), "leaf_mask": ("u1", 0), "valid_mask": ("u1", 1), "contour_mask": ("u1", 4)}
    placed = {**fields, **{name: (kind, at + word_at) for name, (kind, at) in word.items()}}
    formats, offsets = zip(*placed.values())
    return np.dtype({"names": list(placed), "formats": formats, "offsets": offsets, "itemsize": size})


#: What `Octree.descriptors` returns, 8 bytes: a child descriptor as it is stored, `word`, and the masks, which are
#: bytes of it. `field` gives the other fields of section 5.
DESCRIPTOR = _descriptor(8, 0, {})

#: What `Octree.walk` returns, 32 bytes: the same with the slot of the image, the level of the descriptor's voxel, and
#: its lower corner in units of 2^-23 of the root cube's edge.
NODE = _descriptor(32, 8, {"slot": ("<i8", 0), "level": ("u1", 16), "position": (("<u4", (3,)), 20)})

#: Bit `i` of every mask of 8 bits: POPCOUNT of a mask, RANK[mask, i] set bits below bit i, HAS_BIT[mask, i].
HAS_BIT: Array = (np.arange(256)[:, None] >> np.arange(8) & 1).astype(bool)
POPCOUNT: Array = HAS_BIT.sum(axis=1)
RANK: Array = np.cumsum(HAS_BIT, axis=1) - HAS_BIT
#: x, y and z of child slot i are bits 0, 1 and 2 of i.
CHILD_CORNER: Array = np.arange(8)[:, None] >> np.arange(3) & 1


def field(descriptors: Array, name: str) -> Array:
    """A field of child descriptors, of type `DESCRIPTOR` or `NODE`, by its name in `CHILD_DESCRIPTOR`.

    int64, but bool for "far".
    """
    bits = CHILD_DESCRIPTOR[name].of(descriptors["word"])
    result: Array = bits.astype(bool if name == "far" else np.int64)
    return result
