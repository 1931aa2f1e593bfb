"""Reads a file by byte ranges, with its index instead of its tables (sections 4.5 and 11.3)."""

from __future__ import annotations

import os
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Set, Tuple, Union

import numpy as np
import zstandard

from .errors import EsvoError, Finding, Findings
from .index import Page, read_page
from .octree import Octree, from_bytes
from .opening import check_objects, check_section_crc, crc, read_header, read_sections, read_table
from .partial import Body, Piece, assemble, first_level
from .parts import part_body
from .records import BLOCK_ENTRY, MAX_LEVELS, NO_PARENT, OBJECT_ENTRY, PAGE_BYTES, PART_ENTRY, PART_HEADER, Array

#: What is asked for first: the head of most files (section 4.5).
FIRST_BYTES = 32768
#: Ranges with at most so many bytes between them are asked for at once.
GAP_BYTES = 4096
#: The object of a link to a page that has blocks of several.
ALL_OBJECTS = 0xFFFFFFFF
#: Returns bytes of the file: from an offset on, as many as it is asked for, fewer only where the file ends.
ReadRange = Callable[[int, int], bytes]


class Place(NamedTuple):
    """A part of a file that can be read."""

    #: The index of the block, and its entry, of `BLOCK_ENTRY`, without what the index does not say.
    owner: int
    block: Any
    #: A record of `PART_ENTRY`.
    entry: Any
    #: Where the part is in the file, in bytes.
    offset: int
    #: Whether it is the last part of the block.
    last: bool


class IndexReader:
    """A file with an index, of which only the ranges are read that are needed.

    Bytes that break a rule raise `EsvoError`, and so does an answer of another length. What `read` raises passes
    through. The octrees are those that `Octree.partial` makes of the same parts.
    """

    def __init__(self, read: ReadRange, gap: int = GAP_BYTES, max_block_bytes: int = 1 << 30) -> None:
        """Reads the head. `gap`: ranges with at most so many bytes between them are read at once."""
        self._read, self._gap, self._max_block_bytes = read, gap, max_block_bytes
        #: How many ranges were asked for, and how many bytes were read in all.
        self.requests = self.bytes_read = 0
        first = self._fetch(0, FIRST_BYTES, short=True)
        #: A record of `HEADER`.
        self.header: Any = read_header(np.frombuffer(first, np.uint8), whole=False)
        findings, head = Findings(), int(self.header["head"])
        inside = 0 < head <= int(self.header["file_length"])
        findings.require(inside, "H006", 56, f"a head of {head} bytes: without an index, open the file as a whole")
        findings.require(head <= max_block_bytes, "LIMIT", 56, f"the head has {head} bytes, at most {max_block_bytes}")
        findings.settle()
        self._first = first
        if head > len(first):
            first += self._fetch(len(first), head - len(first))
        data = np.frombuffer(first, np.uint8)[:head]
        #: Array of `SECTION_ENTRY`: the directory.
        self.sections: Array = read_sections(data, self.header)
        tables = {bytes(s["tag"]): s for s in self.sections}
        #: Array of `OBJECT_ENTRY`: the object table.
        self.objects: Array = read_table(data, tables[b"OBJT"], OBJECT_ENTRY, "O001")
        check_objects(self.objects, int(tables[b"OBJT"]["offset"]))
        check_section_crc(data, tables[b"INDX"], findings)
        findings.settle()
        low = int(tables[b"INDX"]["offset"])
        self._root = self._page(data[low : low + int(tables[b"INDX"]["length"])].tobytes(), low)
        self._pages: Dict[int, Page] = {}
        self._pages_at, self._pages_size = 0, 0
        if b"PAGE" in tables:
            self._pages_at, self._pages_size = int(tables[b"PAGE"]["offset"]), int(tables[b"PAGE"]["length"])
        self._blocks_at, self._blocks_size = int(tables[b"BLKS"]["offset"]), int(tables[b"BLKS"]["length"])

    def parts_for(
        self,
        low: Sequence[float] = (0, 0, 0),
        high: Sequence[float] = (1, 1, 1),
        level: int = MAX_LEVELS,
        number: int = 0,
    ) -> List[Place]:
        """Parts that show an object in a box of octree space, faces included, down to a level, by their offsets.

        Reads the pages of the index that can have such; each page once.
        """
        if not 0 <= number < len(self.objects):
            raise IndexError(f"object {number}: the file has objects 0 to {len(self.objects) - 1}")
        box = np.asarray(low, np.float64), np.asarray(high, np.float64)
        found: List[Place] = []
        seen: Set[int] = set()
        pages = [self._root]
        while pages:
            wanted: Dict[int, Tuple[int, int]] = {}
            for page in pages:
                found += self._chosen(page, box, level, number)
                wanted.update(self._links(page, box, level, number))
            # A page that is linked twice would be read without end.
            findings = Findings()
            findings.require(seen.isdisjoint(wanted), "I002", self._pages_at, "a page of the index is linked twice")
            findings.settle()
            seen.update(wanted)
            self._read_pages({at: link for at, link in wanted.items() if at not in self._pages})
            pages = [self._pages[at] for at in wanted]
        return sorted(found, key=lambda place: place.offset)

    def octree(
        self,
        low: Sequence[float] = (0, 0, 0),
        high: Sequence[float] = (1, 1, 1),
        level: int = MAX_LEVELS,
        number: int = 0,
    ) -> Octree:
        """The octree of the parts that show an object in a box down to a level, in memory.

        Voxels that are split in other parts are leaves in it.
        """
        places = self.parts_for(low, high, level, number)
        try:
            return self.read(places)
        except ValueError as error:
            # What an index leads to is closed, unless it differs from the tables.
            raise EsvoError([Finding("I003", "error", 0, f"the index: {error}")]) from error

    def read(self, places: Sequence[Place]) -> Octree:
        """The octree of some parts, in memory. Raises `ValueError` if one of them needs another that is missing."""
        bodies: Dict[int, List[Tuple[Place, Body]]] = {}
        ordered = sorted(places, key=lambda place: place.offset)
        ranges = [(place.offset, int(place.entry["size"])) for place in ordered]
        for place, stored in zip(ordered, self._fetch_all(ranges)):
            entry, findings = place.entry, Findings()
            data = part_body(np.frombuffer(stored, np.uint8), entry, int(place.block["codec"]), place.offset, findings)
            body = Body(int(entry["first_level"]), int(entry["last_level"]), data)
            bodies.setdefault(place.owner, []).append((place, body))
        pieces = []
        for index, parts in sorted(bodies.items()):
            parts.sort(key=lambda part: part[1].first_level)
            block = parts[0][0].block.copy()
            block["file_offset"] = parts[0][0].offset
            pieces.append(Piece(index, block, [body for _, body in parts], any(place.last for place, _ in parts)))
        return from_bytes(assemble(self.objects, pieces, self._max_block_bytes), self._max_block_bytes)

    def _fetch(self, offset: int, length: int, short: bool = False) -> bytes:
        """Reads a range; `short`: fewer bytes will do."""
        data = self._read(offset, length)
        self.requests += 1
        self.bytes_read += len(data)
        findings = Findings()
        right = len(data) <= length if short else len(data) == length
        findings.require(right, "H004", offset, f"{len(data)} bytes were read from there on, expected {length}")
        findings.settle()
        return data

    def _fetch_all(self, ranges: Sequence[Tuple[int, int]]) -> List[bytes]:
        """The bytes of ranges that are in order, offset and length; what lies close together is read at once."""
        result: List[bytes] = []
        group: List[Tuple[int, int]] = []

        def flush() -> None:
            start, end = group[0][0], max(at + length for at, length in group)
            # The first answer may have more than the head.
            data = self._first[start:end] if end <= len(self._first) else self._fetch(start, end - start)
            result.extend(data[at - start : at - start + length] for at, length in group)
            group.clear()

        for at, length in ranges:
            if group and at > sum(group[-1]) + self._gap:
                flush()
            group.append((at, length))
        if group:
            flush()
        return result

    def _page(self, data: bytes, at: int) -> Page:
        """A page of the index; I001, and of its blocks and parts what must hold in any file."""
        findings, page = Findings(), None
        try:
            page = read_page(data)
        except (ValueError, MemoryError, zstandard.ZstdError) as error:
            findings.add("I001", at, f"a page of the index: {error}")
        findings.settle()
        assert page is not None
        blocks, parts, links = page.blocks, page.parts, page.links
        scale, codec = blocks["scale"], blocks["codec"]
        sound = (scale >= 1) & (scale <= MAX_LEVELS) & (codec <= 2) & (blocks["image_pages"] > 0)
        sound &= (blocks["object"] < len(self.objects)) & (blocks["image_pages"] < 1 << 22)
        cubes = links["scale"] <= MAX_LEVELS
        for axis in "xyz":
            sound &= blocks[axis] < 1 << MAX_LEVELS
            cubes &= links[axis] < 1 << MAX_LEVELS
        findings.require(sound.all(), "I003", at, "a page of the index has a block that no file has")
        right = (parts["first_level"] <= parts["last_level"]) & (parts["last_level"] < MAX_LEVELS)
        right &= parts["size"] > PART_HEADER.itemsize
        findings.require(right.all(), "I003", at, "a page of the index has a part that no file has")
        findings.require(cubes.all(), "I002", at, "a page of the index has a link with a cube that there is not")
        findings.settle()
        return page

    def _read_pages(self, links: Dict[int, Tuple[int, int]]) -> None:
        """Reads the pages at these offsets in PAGE, of these sizes and checksums."""
        findings = Findings()
        order = sorted(links)
        for at in order:
            inside = 0 < links[at][0] <= self._pages_size - at
            findings.require(inside, "I002", self._pages_at, f"a link to {links[at][0]} bytes at {at}")
        findings.settle()
        stored = self._fetch_all([(self._pages_at + at, links[at][0]) for at in order])
        for at, data in zip(order, stored):
            right = crc(np.frombuffer(data, np.uint8)) == links[at][1]
            findings.require(right, "I002", self._pages_at + at, "a page of the index is damaged")
            findings.settle()
            self._pages[at] = self._page(data, self._pages_at + at)

    def _links(self, page: Page, box: Tuple[Array, Array], level: int, number: int) -> Dict[int, Tuple[int, int]]:
        """The links of a page that can lead to what is wanted: size and checksum by offset."""
        links = page.links
        own = (links["object"] == number) | (links["object"] == ALL_OBJECTS)
        rows = np.flatnonzero(own & (links["first_level"] < level) & meets(links, box)).tolist()
        return {int(links["offset"][row]): (int(links["size"][row]), int(links["crc"][row])) for row in rows}

    def _chosen(self, page: Page, box: Tuple[Array, Array], level: int, number: int) -> List[Place]:
        """The parts of a page that are wanted."""
        blocks, parts = page.blocks, page.parts
        root = blocks["parent"] == NO_PARENT
        wanted = (blocks["object"] == number) & (root | meets(blocks, box))
        entries = np.zeros(len(root), BLOCK_ENTRY)
        for name in ("object", "parent", "codec"):
            entries[name] = blocks[name]
        entries["cube_position"] = np.stack([blocks[axis] for axis in "xyz"], axis=1)
        entries["cube_scale"], entries["image_size"] = blocks["scale"], blocks["image_pages"] * PAGE_BYTES
        found: List[Place] = []
        last = np.zeros(len(root), np.int64)
        np.maximum.at(last, parts["block"], parts["last_level"])
        findings = Findings()
        for row in np.flatnonzero(wanted[parts["block"]] & (parts["first_level"] < level)).tolist():
            block = int(parts["block"][row])
            entry = np.zeros(1, PART_ENTRY)[0]
            entry["block"] = blocks["index"][block]
            for name in ("size", "first_level", "last_level"):
                entry[name] = parts[name][row]
            offset, size = int(parts["offset"][row]), int(parts["size"][row])
            name = f"the part of block {entry['block']} from level {entry['first_level']} on"
            findings.require(offset + size <= self._blocks_size, "I003", 0, f"{name} is not in BLKS")
            fits = entry["first_level"] >= first_level(entries[block])
            findings.require(fits, "I003", 0, f"{name} begins above the block")
            is_last = int(entry["last_level"]) == int(last[block])
            found.append(Place(int(entry["block"]), entries[block], entry, self._blocks_at + offset, is_last))
        findings.settle()
        return found


def meets(columns: Dict[str, Array], box: Tuple[Array, Array]) -> Array:
    """Which cubes meet a box of octree space, faces included."""
    unit = 2.0**-MAX_LEVELS
    edge = np.ldexp(unit, columns["scale"].astype(np.int32))
    result: Array = np.ones(len(edge), bool)
    for axis, low, high in zip("xyz", *box):
        face = columns[axis] * unit
        result &= (low <= face + edge) & (face <= high)
    return result


def read_file(path: Union[str, os.PathLike[str]]) -> ReadRange:
    """Reads ranges of a file; it is opened for each."""

    def read(offset: int, length: int) -> bytes:
        with open(path, "rb") as file:
            file.seek(offset)
            return file.read(length)

    return read
