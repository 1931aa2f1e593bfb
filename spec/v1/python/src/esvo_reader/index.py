"""The index of a file with parts, and its rules (section 4.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Dict, List, NamedTuple, Tuple

import numpy as np
import zstandard

from .blocks import decompress
from .errors import Findings
from .fields import BYTES, MAX_RATIO, Rest, Streams
from .opening import crc
from .records import PAGE_BYTES, Array

if TYPE_CHECKING:
    from .parts import Parts

BLOCK_COLUMNS = ("index", "object", "parent", "x", "y", "z", "scale", "codec", "image_pages")
PART_COLUMNS = ("block", "size", "first_level", "last_level", "gap_low", "gap_high")
LINK_COLUMNS = ("offset", "size", "crc", "object", "first_level", "x", "y", "z", "scale")


class Page(NamedTuple):
    """A page: its columns by name, int64; of crc and differences the real values."""

    blocks: Dict[str, Array]
    parts: Dict[str, Array]
    links: Dict[str, Array]


def read_page(data: bytes) -> Page:
    """A page of its bytes. Raises `ValueError` where they are none."""
    rest = Rest(data)
    counts = [rest.number(4) for _ in range(3)]
    names = (BLOCK_COLUMNS, PART_COLUMNS, LINK_COLUMNS)
    total = sum(4 * count * len(columns) for count, columns in zip(counts, names))
    if total // MAX_RATIO > rest.left():
        raise ValueError(f"a page of {total} bytes")
    streams = Streams(Rest(decompress(rest.take(rest.left()), total)), None, decompress)
    found: List[Dict[str, Array]] = []
    for count, columns in zip(counts, names):
        found.append({name: streams.words(count, BYTES) for name in columns})
    blocks, parts, _links = found
    blocks["index"] = np.cumsum(blocks["index"], dtype=np.uint32)
    blocks["parent"] = blocks["index"] - blocks["parent"]
    parts["block"] = np.cumsum(parts["block"], dtype=np.uint32)
    if (parts["block"] >= counts[0]).any():
        raise ValueError("a part of no block of the page")
    offsets, end = [], 0
    for size, low, high in zip(*(parts[name].tolist() for name in ("size", "gap_low", "gap_high"))):
        offsets.append(end + 8 * (high << 32 | low))
        end = offsets[-1] + size
        end += -end % 8
        if end >= 1 << 63:
            raise ValueError("a part beyond all files")
    page = Page(*({name: column.astype(np.int64) for name, column in table.items()} for table in found))
    page.parts["offset"] = np.array(offsets, np.int64)
    return page


def check_index(data: Array, tables: Dict[bytes, Any], parts: Parts) -> None:
    """I001 to I003."""
    findings, section = Findings(), tables[b"INDX"]
    low, size = int(section["offset"]), int(section["length"])
    pages_at, pages_size = 0, 0
    if b"PAGE" in tables:
        pages_at, pages_size = int(tables[b"PAGE"]["offset"]), int(tables[b"PAGE"]["length"])
    stack = [(low, size)]
    ranges: List[Tuple[int, int]] = []
    blocks: List[int] = []
    seen = 0
    while stack:
        at, size = stack.pop()
        page = None
        try:
            page = read_page(data[at : at + size].tobytes())
        except (ValueError, MemoryError, zstandard.ZstdError) as error:
            findings.add("I001", at, f"a page of the index: {error}")
        findings.settle()
        assert page is not None
        findings.require(same_blocks(page, parts), "I003", at, "a page of the index differs from the block table")
        findings.settle()
        findings.require(same_parts(page, parts), "I003", at, "a page of the index differs from the table of parts")
        findings.settle()
        blocks += page.blocks["index"].tolist()
        seen += len(page.parts["size"])
        for start, length, checksum in zip(*(page.links[name].tolist() for name in ("offset", "size", "crc"))):
            inside = length > 0 and start + length <= pages_size
            stored = data[pages_at + start : pages_at + start + length]
            findings.require(inside and crc(stored) == checksum, "I002", at, f"a link to {length} bytes at {start}")
            ranges.append((start, start + length))
            stack.append((pages_at + start, length))
        # Pages that are linked twice would be read without end.
        once = sum(end - start for start, end in ranges) <= pages_size
        findings.require(once, "I002", at, "pages of the index overlap")
        findings.settle()
    ranges.sort()
    ends = [0, *(end for _, end in ranges)]
    whole = ends[:-1] == [start for start, _ in ranges] and ends[-1] == pages_size
    findings.require(whole, "I002", pages_at, "pages of the index overlap or leave room")
    findings.settle()
    all_there = sorted(blocks) == list(range(len(parts.blocks))) and seen == len(parts.entries)
    findings.require(all_there, "I003", low, "the index has not each block and each part once")
    findings.settle()


def same_blocks(page: Page, parts: Parts) -> bool:
    """Whether the blocks of a page are in the block table so."""
    blocks, table = page.blocks, parts.blocks
    index = blocks["index"]
    if (index >= len(table)).any():
        return False
    entries = table[index]
    cube = np.stack([blocks["x"], blocks["y"], blocks["z"]], axis=1)
    pairs = (
        (blocks["object"], entries["object"]),
        (blocks["parent"], entries["parent"]),
        (blocks["scale"], entries["cube_scale"]),
        (blocks["codec"], entries["codec"]),
        (blocks["image_pages"] * PAGE_BYTES, entries["image_size"]),
        (cube, entries["cube_position"]),
    )
    return all(bool((found == expected).all()) for found, expected in pairs)


def same_parts(page: Page, parts: Parts) -> bool:
    """Whether the parts of a page are in the table of parts so, and in order."""
    found = page.parts
    offsets = found["offset"] + (parts.offsets[0] if len(parts.offsets) else 0)
    order = np.searchsorted(parts.offsets, offsets)
    if (np.diff(found["offset"]) <= 0).any() or (order >= len(parts.entries)).any():
        return False
    entries = parts.entries[order]
    same = (offsets == parts.offsets[order]) & (page.blocks["index"][found["block"]] == entries["block"])
    for name in ("size", "first_level", "last_level"):
        same &= found[name] == entries[name]
    return bool(same.all())
