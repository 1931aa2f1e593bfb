"""Octrees of parts of files: any closed set of parts makes one of its own (section 11.3)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
import zstandard

from .blocks import Block, decompress
from .errors import Findings
from .fields import Fields
from .layout import Layout, make_leaves
from .opening import crc
from .records import HAS_BIT, MAX_LEVELS, NO_PARENT, PART_HEADER, POPCOUNT, Array, field
from .streaming import container
from .walking import BlockWalk, Entrance, child_position, object_traces

if TYPE_CHECKING:
    from .octree import Octree


class Body(NamedTuple):
    """A part that was read."""

    first_level: int
    last_level: int
    #: uint8: what follows the header.
    data: Array


class Piece(NamedTuple):
    """A block, and the parts of it that are in the set."""

    #: Its index in the file.
    block: int
    #: Its entry of the block table; where it is in the image is not used.
    entry: Any
    #: By level.
    bodies: List[Body]
    #: Whether these are all of its parts.
    whole: bool


def first_level(entry: Any) -> int:
    """The level of the first descriptors of a block."""
    return 0 if entry["parent"] == NO_PARENT else MAX_LEVELS + 1 - int(entry["cube_scale"])


def closed(pieces: Sequence[Piece]) -> List[Piece]:
    """The blocks that the octree of a set has: those whose parents have the parts that refer to them.

    Raises `ValueError` where a part lacks one before it, or a block its parent.
    """
    last: Dict[int, int] = {}
    owners: Dict[int, int] = {}
    found = []
    for piece in pieces:
        above = int(piece.entry["parent"])
        level = first_level(piece.entry)
        if above != NO_PARENT and above not in last:
            raise ValueError(f"block {piece.block} cannot be used without block {above}, its parent")
        owners[piece.block] = int(piece.entry["object"])
        if above != NO_PARENT and owners[above] != owners[piece.block]:
            raise ValueError(f"block {piece.block} has another object than block {above}, its parent")
        for body in piece.bodies:
            if body.first_level != level:
                raise ValueError(f"block {piece.block} lacks the part from level {level} on")
            level = body.last_level + 1
        if above == NO_PARENT or last[above] >= first_level(piece.entry) - 1:
            last[piece.block] = level - 1
            found.append(piece)
        else:
            # Nothing refers to it, and to none below it.
            last[piece.block] = -1
    return found


def assemble(objects: Array, pieces: Sequence[Piece], limit: int) -> bytes:
    """The file of a closed set of parts, without codecs. `objects`: the object table; `pieces`: in the order of blocks.

    A block whose parent lacks the part that refers to it is left out.

    Raises `ValueError` where the set is not closed, `EsvoError` where something in it is damaged.
    """
    if not pieces:
        raise ValueError("expected at least one part")
    return _Assembly(objects, closed(pieces), limit).run()


class _Links(BlockWalk):
    """Walks a block of codec 0 or 1 and notes where it refers to other blocks, whatever they are."""

    def __init__(self, objects: Array, findings: Findings, block: Block) -> None:
        walk: Any = SimpleNamespace(
            octree=SimpleNamespace(objects=objects), findings=findings, level=MAX_LEVELS + 1, entrances={}
        )
        super().__init__(walk, block)
        #: The descriptors that have children in other blocks, of type `NODE`.
        self.outer: List[Any] = []

    def enter(self, node: Array, first: int, nonleaf: int, level: int) -> None:
        self.outer.append(node.copy())


class _Assembly:
    """The making of an octree of parts."""

    def __init__(self, objects: Array, pieces: Sequence[Piece], limit: int) -> None:
        self.objects, self.pieces, self.limit = objects, pieces, limit
        #: Of each block of the set its new index.
        self.new = {piece.block: place for place, piece in enumerate(pieces)}
        #: Which children of the descriptor that refers to a block there are, as a mask.
        self.entered = {piece.block: 1 for piece in pieces if piece.entry["parent"] == NO_PARENT}
        #: Blocks by parent, cube and scale.
        self.cubes = {self._cube(piece.entry): piece.block for piece in pieces}

    @staticmethod
    def _cube(entry: Any) -> Tuple[int, ...]:
        return (int(entry["parent"]), *entry["cube_position"].tolist(), int(entry["cube_scale"]))

    def run(self) -> bytes:
        made: List[Union[Layout, _Mended]] = []
        for piece in self.pieces:
            codec, size = int(piece.entry["codec"]), int(piece.entry["image_size"])
            at, name = int(piece.entry["file_offset"]), f"block {piece.block}"
            findings = Findings()
            findings.require(
                size <= self.limit, "LIMIT", at, f"{name} has {size} bytes, more than max_block_bytes = {self.limit}"
            )
            reached = piece.block in self.entered
            findings.require(reached, "B010", at, f"nothing refers to {name}")
            findings.settle()
            try:
                made.append(self._layout(piece) if codec == 2 else self._mended(piece))
            except (ValueError, MemoryError, zstandard.ZstdError) as error:
                findings.add("S006" if codec == 2 else "B005", at, f"{name}: {error}")
            findings.settle()
        sizes = [part.size for part in made]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        image = np.zeros(int(starts[-1]), np.uint8)

        def start(index: int) -> Optional[int]:
            return int(starts[self.new[index]]) // 8 if index in self.new else None

        for place, part in enumerate(made):
            image[starts[place] : starts[place + 1]] = part.image(place, int(starts[place]) // 8, start, True)
        return self._file(image, starts)

    def _layout(self, piece: Piece) -> Layout:
        """Codec 2: the fields that are left, laid out anew."""
        fields = Fields(int(piece.entry["image_size"]), decompress)
        for body in piece.bodies:
            fields.add(body.data.tobytes(), body.last_level - body.first_level + 1)
        if not piece.whole:
            fields.cut()
        self.entered.update(fields.entered())
        return Layout(fields)

    def _mended(self, piece: Piece) -> _Mended:
        """Codec 0 or 1: the image as it is, but for what leads to other blocks."""
        size = int(piece.entry["image_size"])
        data = piece.bodies[0].data
        image = data.copy() if piece.entry["codec"] == 0 else np.frombuffer(decompress(data.tobytes(), size), np.uint8)
        if len(image) != size:
            raise ValueError(f"{len(image)} bytes instead of {size}")
        entry = piece.entry.copy()
        entry["image_offset"] = 0
        block = Block(piece.block, entry, image.copy(), PART_HEADER.itemsize)
        level = first_level(entry)
        position = entry["cube_position"].astype(np.int64)[None]
        if level:
            children = np.flatnonzero(HAS_BIT[self.entered[piece.block]])
            position = child_position(np.repeat(position, len(children), axis=0), children, level - 1)
        findings = Findings()
        links = _Links(self.objects, findings, block)
        links.run(Entrance(level, position))
        findings.settle()
        targets = []
        for node in links.outer:
            cube = (piece.block, *node["position"].tolist(), MAX_LEVELS - int(node["level"]))
            target = self.cubes.get(cube)
            if target is not None:
                self.entered[target] = int(node["valid_mask"]) & ~int(node["leaf_mask"])
            targets.append(target)
        return _Mended(block, links.outer, targets)

    def _file(self, image: Array, starts: Array) -> bytes:
        """The file of the image, with the tables of the set."""
        kept = sorted({int(piece.entry["object"]) for piece in self.pieces})
        roots = {int(p.entry["object"]): p.block for p in self.pieces if p.entry["parent"] == NO_PARENT}
        objects = self.objects[kept].copy()
        places = [self.new[roots[number]] for number in kept]
        objects["root_block"], objects["root_slot"] = places, starts[places] // 8 + 2
        entries = np.array([piece.entry for piece in self.pieces])
        entries["object"] = [kept.index(int(number)) for number in entries["object"]]
        entries["parent"] = [NO_PARENT if p == NO_PARENT else self.new[int(p)] for p in entries["parent"]]
        sizes = np.diff(starts)
        entries["image_offset"], entries["image_size"] = starts[:-1], sizes
        entries["stored_size"], entries["codec"] = sizes, 0
        entries["crc"] = [crc(image[low:high]) for low, high in zip(starts, starts[1:])]
        self._count(objects, container(objects, entries, image))
        return container(objects, entries, image)

    def _count(self, objects: Array, data: bytes) -> None:
        """Counts what is in each object, and checks the pointers of all."""
        from .octree import from_bytes

        octree = from_bytes(data)
        for number, entry in enumerate(objects):
            deepest, sums = 0, dict.fromkeys(("descriptors", "leaf_voxels", "contours", "far_pointers"), 0)
            for trace in object_traces(octree, number, None):
                nodes = trace.nodes
                deepest = max(deepest, int(nodes["level"].max()) + 1)
                sums["descriptors"] += len(nodes)
                sums["leaf_voxels"] += int(POPCOUNT[nodes["leaf_mask"]].sum())
                sums["contours"] += int(POPCOUNT[nodes["contour_mask"]].sum())
                sums["far_pointers"] += int(field(nodes, "far").sum())
            entry["levels"] = deepest
            for name, count in sums.items():
                entry[name] = count


class _Mended:
    """A block of codec 0 or 1 in an octree of parts."""

    def __init__(self, block: Block, outer: Sequence[Any], targets: Sequence[Optional[int]]) -> None:
        """`outer`: the descriptors with children in other blocks; `targets`: those blocks, None if not in the set."""
        self.block, self.outer, self.targets = block, outer, targets
        self.size = len(block.image)

    def image(self, index: int, start: int, starts: Callable[[int], Optional[int]], partial: bool = True) -> Array:
        """As `Layout.image`, of which `partial` always holds here."""
        data = self.block.image
        data[self.block.info_at :][:4].view("<u4")[0] = index
        slots = data[: 8 * len(self.block.slots)].view("<u8")
        for node, target in zip(self.outer, self.targets):
            slot = int(node["slot"])
            pointer = slot + int(field(node, "child_pointer"))
            if target is None:
                make_leaves(slots, slot, pointer)
            else:
                place = starts(target)
                assert place is not None
                slots[pointer] = place + 2 - start - slot
        return data


def of_octree(octree: Octree, parts: Sequence[int]) -> bytes:
    """The file of a closed set of parts of a file; `parts` are indices into the section PART."""
    table = octree.parts
    if table is None:
        raise ValueError("the blocks of this file are not stored in parts")
    findings = Findings()
    chosen: Dict[int, List[Body]] = {}
    for part in sorted(set(parts), key=lambda part: int(table.entries["first_level"][part])):
        entry = table.entries[part]
        body = Body(int(entry["first_level"]), int(entry["last_level"]), table.body(part, findings))
        chosen.setdefault(int(entry["block"]), []).append(body)
    pieces = [
        Piece(index, octree.blocks[index], bodies, len(bodies) == len(table.of_block(index)))
        for index, bodies in sorted(chosen.items())
    ]
    return assemble(octree.objects, pieces, octree.max_block_bytes)
