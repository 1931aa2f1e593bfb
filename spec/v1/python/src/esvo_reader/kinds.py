"""The attachment types of the registry: their numbers and their sizes (section 8)."""

from __future__ import annotations

COLOR_BLOCKS, NORMAL_BLOCKS, CONSTANT_COLOR, AMBIENT_BLOCKS, PLAIN_COLORS, PLAIN_NORMALS, CORNERS = range(1, 8)
WITH_COLORS = frozenset({COLOR_BLOCKS, CONSTANT_COLOR, PLAIN_COLORS, CORNERS})
WITH_NORMALS = frozenset({NORMAL_BLOCKS, PLAIN_NORMALS, CORNERS})
#: Bytes for each pair of slots.
PAIR_BYTES = {COLOR_BLOCKS: 8, NORMAL_BLOCKS: 16, AMBIENT_BLOCKS: 8}
#: Bytes for each slot, and as many for each value.
ENTRY_BYTES = {PLAIN_COLORS: 4, PLAIN_NORMALS: 4, CORNERS: 8}
CONSTANT_BYTES = 8
EMISSION, ROUGHNESS_METALNESS, OPACITY, MATERIAL = range(8, 12)
#: Types with components, whose heads say what their values are; the metadata say what those from 16 on mean.
WITH_COMPONENTS = frozenset({*range(8, 12), *range(16, 32)})


def attachment_bytes(kind: int, slots: int, values: int) -> int:
    """The size of an attachment of a block with this many slots; `values` counts those of types with entries."""
    if kind in PAIR_BYTES:
        return PAIR_BYTES[kind] * ((slots + 1) // 2)
    if kind in ENTRY_BYTES:
        return ENTRY_BYTES[kind] * (slots + values)
    return CONSTANT_BYTES
