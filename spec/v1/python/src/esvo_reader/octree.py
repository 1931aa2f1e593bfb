"""The octree file as one object."""

from __future__ import annotations

import os
from collections import OrderedDict
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import opening, partial, streaming, validation
from .blocks import Block, block_image
from .errors import EsvoError, Finding, Findings
from .parts import Parts, read_parts
from .records import (
    BLOCK_ENTRY,
    CHILD_DESCRIPTOR,
    DESCRIPTOR,
    HAS_BIT,
    MAX_LEVELS,
    OBJECT_ENTRY,
    PAGE_SLOTS,
    PART_HEADER,
    POPCOUNT,
    RANK,
    Array,
)
from .scene import matrices_of, read_hash, read_instances
from .voxels import Voxels, concatenate, decode_voxels, no_voxels
from .walking import object_traces

#: Blocks that are kept: how many, and how many bytes of those that were decompressed.
CACHE_BLOCKS, CACHE_BYTES = 1024, 256 << 20
#: Slots that are taken apart at once: few enough for the processor's caches.
CHUNK = 1 << 16


class Descriptor(NamedTuple):
    """A child descriptor (section 5)."""

    leaf_mask: int
    valid_mask: int
    far: bool
    child_pointer: int
    contour_mask: int
    contour_pointer: int

    @property
    def nonleaf_mask(self) -> int:
        """Which children have a descriptor."""
        return self.valid_mask & ~self.leaf_mask


class Octree:
    """An esvo file, opened: header, directory and tables were read and checked, blocks are read on demand.

    Slots are counted from the start of the image, as in the specification. Bytes that break a rule raise `EsvoError`
    and nothing else; arguments that are out of range raise `IndexError` or `ValueError`. Arrays are views of the file
    where that is possible, and such views cannot be written to.
    """

    def __init__(self, data: Array, max_block_bytes: int = 1 << 30) -> None:
        """`data`: the file, uint8. `max_block_bytes`: a compressed block that has more when decompressed is refused."""
        self._data = data
        #: A compressed block that has more bytes when decompressed is refused.
        self.max_block_bytes = max_block_bytes
        self._kept: OrderedDict[int, Block] = OrderedDict()
        self._kept_bytes = 0
        #: A record of `HEADER`.
        self.header: Any = opening.read_header(data)
        #: Array of `SECTION_ENTRY`: the directory.
        self.sections: Array = opening.read_sections(data, self.header)
        tables = {bytes(s["tag"]): s for s in self.sections}
        #: Array of `OBJECT_ENTRY`: the object table.
        self.objects: Array = opening.read_table(data, tables[b"OBJT"], OBJECT_ENTRY, "O001")
        #: Array of `BLOCK_ENTRY`: the block table.
        self.blocks: Array = opening.read_table(data, tables[b"BLKT"], BLOCK_ENTRY, "B001")
        self._section = tables
        objects_at, blocks_at = int(tables[b"OBJT"]["offset"]), int(tables[b"BLKT"]["offset"])
        opening.check_objects(self.objects, objects_at)
        opening.check_blocks(self.header, tables[b"BLKS"], self.objects, self.blocks, blocks_at)
        #: The parts, if the blocks are stored in parts.
        self.parts: Optional[Parts] = read_parts(data, self.header, tables, self.blocks)
        #: Array of `INSTANCE_ENTRY`: the scene; None if it has every object once, at its own place.
        self.instances: Optional[Array] = read_instances(data, tables, len(self.objects))
        #: A record of `FILE_HASH`: SHA-256 and id of the file, where it has them.
        self.hash: Optional[Any] = read_hash(data, tables)
        opening.check_roots(self.objects, self.blocks, objects_at)
        self._image_ends = (self.blocks["image_offset"] + self.blocks["image_size"]).astype(np.int64) // 8

    def __repr__(self) -> str:
        return f"<Octree: {len(self.objects)} objects, {len(self.blocks)} blocks, {len(self._data)} bytes>"

    @property
    def data(self) -> Array:
        """uint8: all bytes of the file."""
        return self._data

    @property
    def metadata(self) -> Dict[str, Any]:
        """Members of the section META; none without one."""
        section = self._section.get(b"META")
        if section is None:
            return {}
        findings = Findings()
        opening.check_section_crc(self._data, section, findings)
        findings.settle()
        return opening.parse_metadata(self.section(b"META").tobytes(), int(section["offset"]))

    @property
    def image(self) -> Array:
        """uint64: all slots of the image, with page headers, info sections and attachments; a view of the file.

        Raises `ValueError` where a block is compressed, as there is no image in the file then.
        """
        if self.blocks["codec"].any() or self.parts is not None:
            raise ValueError("some blocks are compressed: ask for single blocks")
        return self.section(b"BLKS").view("<u8")

    def section(self, tag: bytes) -> Array:
        """Bytes of a section, uint8. Raises `KeyError` where there is none."""
        entry = self._section[tag]
        return self._data[int(entry["offset"]) : int(entry["offset"] + entry["length"])]

    def octree_to_mesh(self, number: int = 0) -> Array:
        """float64 (4, 4): an object's transform from octree space, where the root cube is [0, 1]³, to mesh space.

        `matrix @ (x, y, z, 1)` is the point in mesh space.
        """
        result: Array = self.objects["octree_to_mesh"][number].reshape(4, 4).T
        return result

    def mesh_to_scene(self, instance: int) -> Array:
        """float64 (4, 4): the matrix of an instance from mesh space to scene space."""
        if self.instances is None:
            raise IndexError(f"instance {instance}: the file has none")
        result: Array = matrices_of(self.instances[instance : instance + 1])[0]
        return result

    def block(self, index: int) -> Block:
        """A block, decompressed if need be; checks its info section and its attachment directory."""
        if not 0 <= index < len(self.blocks):
            raise IndexError(f"block {index}: the file has blocks 0 to {len(self.blocks) - 1}")
        if index in self._kept:
            self._kept.move_to_end(index)
            return self._kept[index]
        entry = self.blocks[index]
        if self.parts is not None:
            block = Block(index, entry, self.parts.image(index, self.max_block_bytes), PART_HEADER.itemsize)
        else:
            block = Block(index, entry, block_image(self._data, index, entry, self.max_block_bytes))
        self._kept[index] = block
        self._kept_bytes += block.own_bytes
        while len(self._kept) > 1 and (self._kept_bytes > CACHE_BYTES or len(self._kept) > CACHE_BLOCKS):
            self._kept_bytes -= self._kept.popitem(last=False)[1].own_bytes
        return block

    def block_of_slot(self, slot: int) -> Optional[int]:
        """Index of the block with a slot of the image; None if the slot is beyond the image."""
        index = int(np.searchsorted(self._image_ends, slot, side="right"))
        return index if slot >= 0 and index < len(self.blocks) else None

    def object_entry_offset(self, number: int, field: str) -> int:
        """Where a field of the object table is in the file, in bytes."""
        return self._entry_offset(b"OBJT", OBJECT_ENTRY, number, field)

    def block_entry_offset(self, index: int, field: str) -> int:
        """Where a field of the block table is in the file, in bytes."""
        return self._entry_offset(b"BLKT", BLOCK_ENTRY, index, field)

    def _entry_offset(self, tag: bytes, dtype: np.dtype[Any], row: int, field: str) -> int:
        assert dtype.fields is not None
        return int(self._section[tag]["offset"]) + row * dtype.itemsize + dtype.fields[field][1]

    def _word(self, slot: int) -> int:
        """A slot of a descriptor array that is no page header."""
        index = self.block_of_slot(slot)
        if index is not None:
            block = self.block(index)
            local = slot - block.start
            if local < len(block.slots) and local % PAGE_SLOTS:
                return int(block.slots[local])
        raise IndexError(f"slot {slot} is in no descriptor array")

    def descriptor(self, slot: int) -> Descriptor:
        """The child descriptor at a slot of the image. What is there is not checked to be one."""
        word = self._word(slot)
        leaf, valid, far, pointer, contours, contour_pointer = (
            word >> bits.low & (1 << bits.width) - 1 for bits in CHILD_DESCRIPTOR.values()
        )
        return Descriptor(leaf, valid, bool(far), pointer, contours, contour_pointer)

    def children(self, slot: int) -> Array:
        """int64 (8,): slots of the image with the descriptors of the child slots; -1 for leaf voxels and empty ones."""
        d = self.descriptor(slot)
        result = np.full(8, -1, np.int64)
        if not d.nonleaf_mask:
            return result
        first = slot + d.child_pointer
        index = self.block_of_slot(slot)
        assert index is not None
        findings, at = Findings(), self.block(index).at(8 * (slot - self.block(index).start))
        try:
            if d.far:
                word = self._word(first)
                findings.require(0 < word < 1 << 32, "C004", at, f"slot {slot} has a far pointer {word:#x}")
                first = slot + (word & 0xFFFFFFFF)
            findings.require(first > slot, "C002", at, f"slot {slot} has a child pointer of 0")
            findings.settle()
            self._word(first)
            self._word(first + int(POPCOUNT[d.nonleaf_mask]) - 1)
        except IndexError as error:
            findings.add("C002", at, f"slot {slot}: {error}")
            findings.settle()
        has = HAS_BIT[d.nonleaf_mask]
        result[has] = first + RANK[d.nonleaf_mask][has]
        return result

    def descriptors(self) -> Array:
        """All child descriptors of the file in the order of their slots, of type `DESCRIPTOR`.

        Reads the descriptor arrays from start to end and follows no pointers: in a sound file whatever is no page
        header, no gap and no far pointer is a descriptor. Far pointers are known by the descriptors that refer to them,
        which come before them.
        """
        result = self._collect(np.uint64, lambda block, low, there: block.slots[low : low + CHUNK][there])
        return result.view(DESCRIPTOR)

    def descriptor_slots(self) -> Array:
        """int64: the slot of the image of each of `descriptors`."""
        return self._collect(np.int64, lambda block, low, there: np.flatnonzero(there) + (block.start + low))

    def _collect(self, dtype: type[np.generic], values: Callable[[Block, int, Array], Array]) -> Array:
        """One value for each descriptor. The function takes a block, a slot, and a bool for each slot from there on."""
        # The table may say any number: no more memory is taken than for what the image can hold.
        count = sum(map(int, self.objects["descriptors"]))
        result = np.empty(min(count, int(self._image_ends[-1])), dtype)
        used = 0
        for index in range(len(self.blocks)):
            block = self.block(index)
            for low, there in descriptor_masks(block.slots):
                found = values(block, low, there)
                if used + len(found) <= len(result):
                    result[used : used + len(found)] = found
                used += len(found)
        if used != count:
            at = self.object_entry_offset(0, "descriptors")
            raise EsvoError([Finding("O005", "error", at, f"the objects say {count} descriptors, there are {used}")])
        return result

    def walk(self, number: int = 0, level: Optional[int] = None) -> Iterator[Array]:
        """For each block of an object its descriptors, breadth first, of type `NODE`. Every pointer is checked.

        With a `level`, 1 to 23, only descriptors whose voxels are above that level, and only blocks that have such.
        """
        for trace in object_traces(self, self._object(number), _level(level)):
            yield trace.nodes

    def voxels(self, nodes: Array) -> Voxels:
        """All voxels that are children of descriptors of one block, of type `NODE`, as `walk` returns them."""
        if not len(nodes):
            return no_voxels()
        index = self.block_of_slot(int(nodes["slot"][0]))
        if index is None:
            raise IndexError(f"slot {nodes['slot'][0]} is beyond the image")
        return decode_voxels(self.block(index), nodes, np.ones((len(nodes), 8), bool))

    def iter_leaves(self, level: Optional[int] = None, number: int = 0) -> Iterator[Voxels]:
        """As `leaves`, in parts: those of one block at a time, for files that do not fit into memory."""
        wanted = _level(level)
        for trace in object_traces(self, self._object(number), wanted):
            chosen = HAS_BIT[trace.nodes["leaf_mask"]]
            if wanted is not None:
                chosen = chosen | (trace.nodes["level"] + 1 == wanted)[:, None]
            yield decode_voxels(trace.block, trace.nodes, chosen)

    def leaves(self, level: Optional[int] = None, number: int = 0) -> Voxels:
        """The leaf voxels of an object, block by block.

        With a `level`, 1 to 23, the octree is cut there: leaf voxels down to that level, and all voxels of that level.
        Blocks that only have deeper ones are not read.
        """
        parts: List[Voxels] = list(self.iter_leaves(level, number))
        return concatenate(parts) if parts else no_voxels()

    def blocks_for(
        self,
        low: Sequence[float] = (0, 0, 0),
        high: Sequence[float] = (1, 1, 1),
        level: int = MAX_LEVELS,
        number: int = 0,
    ) -> List[int]:
        """Blocks that show an object in a box of octree space, faces included, down to a level (section 11.3).

        In the order of the table: parents come first. The root block is always among them.
        """
        return streaming.blocks_for(self, self._object(number), low, high, level)

    def part(self, blocks: Sequence[int]) -> Octree:
        """The octree of some blocks, in memory; voxels that are split in other blocks become leaves (section 11.3).

        Reads and checks these blocks only. Raises `ValueError` if the parent of one is missing.
        """
        if self.parts is not None:
            return self.partial([part for index in sorted(set(blocks)) for part in self.parts.of_block(index)])
        for index in blocks:
            self.block(index)
        return from_bytes(streaming.part(self, blocks), self.max_block_bytes)

    def parts_for(
        self,
        low: Sequence[float] = (0, 0, 0),
        high: Sequence[float] = (1, 1, 1),
        level: int = MAX_LEVELS,
        number: int = 0,
    ) -> List[int]:
        """Parts that show an object in a box of octree space, faces included, down to a level (section 11.3).

        Indices into the section PART, in its order. There are none if the blocks are not stored in parts.
        """
        if self.parts is None:
            return []
        return streaming.parts_for(self.parts, self.blocks_for(low, high, level, number), level)

    def partial(self, parts: Sequence[int]) -> Octree:
        """The octree of some parts, in memory; voxels that are split in other parts become leaves (section 11.3).

        `parts` are indices into the section PART. Reads and checks these parts only. Raises `ValueError` if one of them
        needs another that is missing.
        """
        return from_bytes(partial.of_octree(self, parts), self.max_block_bytes)

    def validate(self) -> List[Finding]:
        """All findings by the rules that opening did not check. No errors: the file is sound. Reads all of the file."""
        return validation.check(self)

    def _object(self, number: int) -> int:
        if not 0 <= number < len(self.objects):
            raise IndexError(f"object {number}: the file has objects 0 to {len(self.objects) - 1}")
        return number


def _level(level: Optional[int]) -> Optional[int]:
    if level is not None and not 1 <= level <= MAX_LEVELS:
        raise ValueError(f"level {level}: expected 1 to {MAX_LEVELS}")
    return level


def descriptor_masks(slots: Array) -> Iterator[Tuple[int, Array]]:
    """Which slots of a descriptor array hold descriptors: bool for `CHUNK` slots at a time, with the first of them."""
    far = np.zeros(len(slots), bool)
    for low in range(0, len(slots), CHUNK):
        words = slots[low : low + CHUNK]
        mark_far_pointers(words, low, far)
        there = words & np.uint64(0xFF00) != 0
        there &= ~far[low : low + CHUNK]
        there[::PAGE_SLOTS] = False
        yield low, there


def mark_far_pointers(words: Array, low: int, far: Array) -> None:
    """Marks the slots that the descriptors in these slots, from slot `low` on, use as far pointers."""
    has = words & np.uint64(1 << CHILD_DESCRIPTOR["far"].low) != 0
    has[::PAGE_SLOTS] = False
    local = np.flatnonzero(has)
    target = local + low + CHILD_DESCRIPTOR["child_pointer"].of(words[local]).astype(np.int64)
    marks: memoryview = far.data
    # In order: whether a slot with a far bit is a far pointer itself is known when it is reached.
    for slot, pointer in zip((local + low).tolist(), target.tolist()):
        if not marks[slot] and pointer < len(marks):
            marks[pointer] = True


def open_file(path: Union[str, os.PathLike[str]], max_block_bytes: int = 1 << 30) -> Octree:
    """Opens a file: maps it and reads header, directory and tables. Exported as `esvo_reader.open`.

    The file stays mapped as long as the octree or an array from it is in use, and must not be made shorter meanwhile.
    Raises `OSError` where it cannot be read, `EsvoError` where it breaks a rule.
    """
    size = os.path.getsize(path)
    data: Array = np.asarray(np.memmap(path, np.uint8, "r")) if size else np.zeros(0, np.uint8)
    return Octree(data, max_block_bytes)


def from_bytes(data: Union[bytes, bytearray, memoryview], max_block_bytes: int = 1 << 30) -> Octree:
    """The octree of a file in memory."""
    view = np.frombuffer(data, np.uint8) if len(data) else np.zeros(0, np.uint8)
    return Octree(view, max_block_bytes)
