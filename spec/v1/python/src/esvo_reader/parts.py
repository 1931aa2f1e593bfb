"""The table of parts, and blocks made of their parts (section 4.3)."""

from __future__ import annotations

from typing import Any, List, Optional, Tuple

import numpy as np
import zstandard

from .blocks import decompress
from .errors import Findings
from .fields import Fields
from .index import check_index
from .layout import Layout
from .opening import IN_PARTS, Table, check_section_crc, crc, read_table, record
from .records import MAX_LEVELS, NO_PARENT, PART_ENTRY, PART_HEADER, Array


class Parts:
    """The parts of a file."""

    def __init__(self, data: Array, section: Any, data_section: Any, blocks: Array, blocks_at: int) -> None:
        self.data, self.blocks = data, blocks
        #: Array of `PART_ENTRY`.
        self.entries = read_table(data, section, PART_ENTRY, "S001")
        #: Where the table is in the file.
        self.at = int(section["offset"])
        entries = self.entries
        table = Table(entries, self.at, "part")
        table.require(entries["reserved"] == 0, "S007", "reserved", "expected zero")
        table.require(entries["size"] > PART_HEADER.itemsize, "S002", "size", "no more than a part header")
        number = entries["block"].astype(np.int64)
        there = number < len(blocks)
        table.require(there, "S003", "block", f"there are {len(blocks)} blocks")
        table.findings.settle()
        own = blocks[number]
        lowest = first_levels(own)
        first, last = entries["first_level"].astype(np.int64), entries["last_level"].astype(np.int64)
        table.require((first >= lowest) & (first <= last), "S003", "first_level", "the block has no such levels")
        table.require(last < MAX_LEVELS, "S003", "last_level", "expected at most 22")
        table.require(
            (own["codec"] == 2) | (last == MAX_LEVELS - 1), "S003", "last_level", "expected 22 for a whole block"
        )
        table.findings.settle()
        sizes = entries["size"].astype(np.int64)
        sizes += -sizes % 8
        low, length = int(data_section["offset"]), int(data_section["length"])
        #: int64: where each part starts in the file.
        self.offsets: Array = low + np.concatenate([[0], np.cumsum(sizes)[:-1]])
        table.findings.require(
            int(sizes.sum()) == length, "S002", self.at, f"the parts take {sizes.sum()} bytes, BLKS has {length}"
        )
        table.findings.settle()
        self._sort(table, first, last, blocks_at)

    def _sort(self, table: Table, first: Array, last: Array, blocks_at: int) -> None:
        entries, blocks = self.entries, self.blocks
        #: int64: the parts block by block, by level.
        self.order: Array = np.lexsort((first, entries["block"]))
        owner = entries["block"][self.order].astype(np.int64)
        #: int64: where the parts of each block begin in `order`, and where the last end.
        self.starts: Array = np.searchsorted(owner, np.arange(len(blocks) + 1))
        begins = np.concatenate([[True], owner[1:] != owner[:-1]])
        expected = np.where(begins, first_levels(blocks)[owner], np.concatenate([[0], last[self.order][:-1] + 1]))
        fits = np.ones(len(entries), bool)
        fits[self.order] = first[self.order] == expected
        table.require(fits, "S003", "first_level", "does not follow the part before")
        rows = Table(blocks, blocks_at, "block")
        rows.require(self.starts[1:] > self.starts[:-1], "S003", "object", "it has no part")
        table.findings.items += rows.findings.items
        table.findings.settle()
        rows.require(
            blocks["file_offset"] == self.offsets[self.order[self.starts[:-1]]], "S008", "file_offset", "its first part"
        )
        totals = np.add.reduceat(entries["size"][self.order].astype(np.uint64), self.starts[:-1])
        rows.require(blocks["stored_size"] == totals, "S008", "stored_size", "the sum of its parts")
        rows.findings.settle()

    def ranges(self) -> Tuple[Array, Array]:
        """Where the parts start and end in the file."""
        return self.offsets, self.offsets + self.entries["size"].astype(np.int64)

    def check_order(self, findings: Findings) -> None:
        """S009."""
        key = self.entries["first_level"].astype(np.int64) << 32 | self.entries["block"].astype(np.int64)
        for row in np.flatnonzero(key[1:] <= key[:-1])[:1]:
            at = self.at + PART_ENTRY.itemsize * int(row + 1)
            findings.add("S009", at, f"part {row + 1} is not in the order of level and block")

    def of_block(self, index: int) -> List[int]:
        """The parts of a block, by level."""
        return [int(part) for part in self.order[self.starts[index] : self.starts[index + 1]]]

    def body(self, part: int, findings: Findings) -> Array:
        """What follows the header of a part; checks S004 and S005."""
        entry, at = self.entries[part], int(self.offsets[part])
        stored = self.data[at : at + int(entry["size"])]
        return part_body(stored, entry, int(self.blocks["codec"][entry["block"]]), at, findings)

    def image(self, index: int, limit: int) -> Array:
        """The image of a block of its parts."""
        entry, findings = self.blocks[index], Findings()
        at, size = int(entry["file_offset"]), int(entry["image_size"])
        findings.require(
            size <= limit, "LIMIT", at, f"block {index} has {size} bytes, more than max_block_bytes = {limit}"
        )
        findings.settle()
        parts = self.of_block(index)
        bodies = [self.body(part, findings) for part in parts]
        crcs = np.concatenate([self.data[int(self.offsets[part]) :][:4] for part in parts])
        findings.require(
            crc(crcs) == entry["crc"], "B006", at, f"the checksum of block {index} is not that of its parts"
        )
        findings.settle()
        if entry["codec"] == 0:
            return bodies[0]
        rule = "S006" if entry["codec"] == 2 else "B005"
        try:
            if entry["codec"] == 1:
                return np.frombuffer(decompress(bodies[0].tobytes(), size), np.uint8)
            fields = Fields(size, decompress)
            for part, body in zip(parts, bodies):
                levels = int(self.entries["last_level"][part]) - int(self.entries["first_level"][part]) + 1
                fields.add(body.tobytes(), levels)
            layout = Layout(fields)
            if layout.size != size or layout.cursor != fields.array_slots:
                raise ValueError(f"the fields make {layout.size} bytes and {layout.cursor} slots")
            return layout.image(index, int(entry["image_offset"]) // 8, self._start)
        except (ValueError, MemoryError, zstandard.ZstdError) as error:
            findings.add(rule, at, f"block {index}: {error}")
            findings.settle()
            raise

    def _start(self, block: int) -> Optional[int]:
        return int(self.blocks["image_offset"][block]) // 8 if block < len(self.blocks) else None


def part_body(stored: Array, entry: Any, codec: int, at: int, findings: Findings) -> Array:
    """What follows the header of a part that lies at a byte of the file; checks S004 and S005.

    `entry` is a record of `PART_ENTRY`, `stored` as many bytes as it says, more than a header.
    """
    header = record(stored, 0, PART_HEADER)
    name = f"the part of block {entry['block']} from level {entry['first_level']} on"
    findings.require(crc(stored[4:]) == header["crc"], "S004", at, f"{name} is damaged")
    findings.settle()
    same = all(header[field] == entry[field] for field in ("size", "block", "first_level", "last_level"))
    same = same and header["codec"] == codec and header["reserved"] == 0
    findings.require(same, "S005", at, f"{name} has another header")
    findings.settle()
    return stored[PART_HEADER.itemsize :]


def first_levels(blocks: Array) -> Array:
    """int64: the level of the first descriptors of blocks."""
    level: Array = np.where(blocks["parent"] == NO_PARENT, 0, 24 - blocks["cube_scale"].astype(np.int64))
    return level


def read_parts(data: Array, header: Any, tables: Any, blocks: Array) -> Optional[Parts]:
    """The table of parts, if the file has one; S001."""
    findings, section = Findings(), tables.get(b"PART")
    in_parts = bool(int(header["required_features"]) & IN_PARTS)
    at = 16 if section is None else int(section["offset"])
    findings.require(in_parts == (section is not None), "S001", at, "PART and required feature bit 1 go together")
    findings.settle()
    index = tables.get(b"INDX", tables.get(b"PAGE"))
    if index is not None:
        fits = in_parts and b"INDX" in tables
        findings.require(fits, "I001", int(index["offset"]), "INDX without parts, or PAGE without INDX")
    if section is None or not in_parts:
        findings.settle()
        return None
    findings.settle()
    parts = Parts(data, section, tables[b"BLKS"], blocks, int(tables[b"BLKT"]["offset"]))
    if b"INDX" in tables:
        check_section_crc(data, tables[b"INDX"], findings)
        findings.settle()
        check_index(data, tables, parts)
    return parts
