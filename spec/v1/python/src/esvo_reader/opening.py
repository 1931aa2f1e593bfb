"""Header, directory and tables: what is read when a file is opened, and their rules."""

from __future__ import annotations

import json
import math
import zlib
from typing import Any, Dict, List, Tuple

import numpy as np

from .errors import Findings
from .records import (
    HEADER,
    IDENTIFIER,
    MAX_IMAGE_BYTES,
    MAX_LEVELS,
    NO_PARENT,
    PAGE_BYTES,
    SECTION_ENTRY,
    Array,
)

REQUIRED, OWN_CHECKSUMS = 1, 2
NEEDED = (b"OBJT", b"BLKT", b"BLKS")
KNOWN = (*NEEDED, b"PART", b"INDX", b"PAGE", b"META", b"INST", b"HASH")
#: Required feature bit 0: some block is compressed.
COMPRESSED = 1
#: Required feature bit 1: the blocks are stored in parts.
IN_PARTS = 2
#: How deep arrays and objects in META may be nested.
MAX_NESTING = 64


def crc(data: Array) -> int:
    """CRC-32 of bytes (section 1)."""
    return zlib.crc32(data.data)


def record(data: Array, offset: int, dtype: np.dtype[Any]) -> Any:
    """The record at an offset, which must be in the data."""
    return data[offset : offset + dtype.itemsize].view(dtype)[0]


def records(data: Array, offset: int, count: int, dtype: np.dtype[Any]) -> Array:
    """A view of consecutive records, which must be in the data."""
    return data[offset : offset + count * dtype.itemsize].view(dtype)


def read_header(data: Array, whole: bool = True) -> Any:
    """The header (section 2.1). `whole`: whether the data are all of the file, so that its length can be checked."""
    findings = Findings()
    if len(data) < HEADER.itemsize or data[:12].tobytes() != IDENTIFIER:
        findings.add("H001", 0, "the identifier or a part of the header is missing")
        findings.settle()
    header = record(data, 0, HEADER)
    findings.require(header["major"] == 1, "H002", 12, f"major version {header['major']}, this reader knows 1")
    findings.settle()
    findings.require(crc(data[:60]) == header["header_crc"], "H005", 60, "the checksum of the header is wrong")
    findings.settle()
    unknown = int(header["required_features"]) & ~(COMPRESSED | IN_PARTS)
    findings.require(not unknown, "H003", 16, f"required feature bits {unknown:#x} are unknown")
    length = int(header["file_length"])
    findings.require(
        not whole or length == len(data), "H004", 32, f"the file has {len(data)} bytes, its header says {length}"
    )
    findings.settle()
    return header


def read_sections(data: Array, header: Any) -> Array:
    """The directory (section 2.2). Checksums are checked only of the sections that opening reads."""
    findings, total = Findings(), int(header["file_length"])
    start, count = int(header["directory_offset"]), int(header["directory_count"])
    end = start + SECTION_ENTRY.itemsize * count
    inside = HEADER.itemsize <= start and end <= total and start % 8 == 0
    findings.require(inside, "D001", 40, f"directory at byte {start} with {count} entries")
    findings.settle()
    findings.require(count <= 1024, "D008", 48, f"the directory has {count} entries, at most 1024 are allowed")
    findings.settle()
    findings.require(crc(data[start:end]) == header["directory_crc"], "D002", start, "the directory is damaged")
    findings.settle()
    sections = records(data, start, count, SECTION_ENTRY)
    ranges = [(0, HEADER.itemsize), (start, end)]
    for number, entry in enumerate(sections):
        at, tag = start + SECTION_ENTRY.itemsize * number, bytes(entry["tag"])
        low, size = int(entry["offset"]), int(entry["length"])
        unused = int(entry["flags"]) & ~(REQUIRED | OWN_CHECKSUMS)
        findings.require(not unused and entry["reserved"] == 0, "D007", at, f"section {tag!r}: reserved bits are set")
        inside = low % 8 == 0 and low + size <= total
        findings.require(inside, "D003", at, f"section {tag!r} at byte {low} with {size} bytes")
        known = tag in KNOWN or not entry["flags"] & REQUIRED
        findings.require(known, "D005", at, f"section {tag!r} is required, but unknown")
        ranges.append((low, low + size))
    tags = [bytes(entry["tag"]) for entry in sections]
    for tag in sorted({*tags, *NEEDED}):
        findings.require(tags.count(tag) == 1, "D006", start, f"section {tag!r} occurs {tags.count(tag)} times")
    findings.settle()
    findings.require(not overlap(ranges), "D003", start, "sections overlap each other, the header or the directory")
    findings.settle()
    found = {bytes(entry["tag"]): int(entry["offset"] + entry["length"]) for entry in sections}
    head = max(end, found[b"OBJT"], found[b"INDX"]) if b"INDX" in found else 0
    findings.require(header["head"] == head, "H006", 56, f"the head has {head} bytes, the header says {header['head']}")
    findings.settle()
    return sections


def overlap(ranges: List[Tuple[int, int]]) -> bool:
    """Whether any two of the ranges [a, b) and [c, d) overlap: a < d and c < b (section 1.2).

    An empty range overlaps one that it lies strictly inside.
    """
    ordered = sorted(ranges)
    return any(a[1] > b[0] for a, b in zip(ordered, ordered[1:]))


def check_section_crc(data: Array, entry: Any, findings: Findings) -> None:
    """D004 for one section; reads all of it unless flag bit 1 is set."""
    low, size = int(entry["offset"]), int(entry["length"])
    right = 0 if entry["flags"] & OWN_CHECKSUMS else crc(data[low : low + size])
    findings.require(entry["crc"] == right, "D004", low, f"section {bytes(entry['tag'])!r} is damaged")


def parse_metadata(text: bytes, offset: int) -> Dict[str, Any]:
    """The members of the section META (section 2.3)."""
    findings = Findings()
    members: Any = None
    try:
        members = json.loads(
            text.decode("utf-8"),
            parse_constant=_refuse_constant,
            parse_float=_finite,
            parse_int=_whole,
            object_pairs_hook=_different_names,
        )
        findings.require(isinstance(members, dict), "M001", offset, "the metadata are not a JSON object")
        _check_values(members)
    except (ValueError, OverflowError, RecursionError) as error:
        findings.add("M001", offset, f"the metadata are not JSON in UTF-8: {error}")
    findings.settle()
    result: Dict[str, Any] = members
    return result


def _refuse_constant(constant: str) -> Any:
    raise ValueError(f"{constant} is not JSON")


def _finite(number: str) -> float:
    """A number with a fraction or an exponent; it must round to a finite binary64."""
    value = float(number)
    if not math.isfinite(value):
        raise ValueError(f"binary64 cannot hold {number}")
    return value


def _whole(number: str) -> int:
    _finite(number)
    return int(number)


def _different_names(pairs: List[Tuple[str, Any]]) -> Dict[str, Any]:
    members = dict(pairs)
    if len(members) < len(pairs):
        raise ValueError("a name occurs twice in one object")
    return members


def _check_values(value: Any) -> None:
    """Arrays and objects are nested at most 64 deep, and strings have no halves of surrogate pairs."""
    values, depth = [value], 0
    while values:
        strings = [v for v in values if isinstance(v, str)]
        objects = [v for v in values if isinstance(v, dict)]
        strings += [name for v in objects for name in v]
        if any("\ud800" <= character <= "\udfff" for text in strings for character in text):
            raise ValueError("half of a surrogate pair")
        arrays = [v for v in values if isinstance(v, list)]
        depth += bool(arrays or objects)
        if depth > MAX_NESTING:
            raise ValueError(f"arrays and objects are nested more than {MAX_NESTING} deep")
        values = [v for a in arrays for v in a] + [v for o in objects for v in o.values()]


def read_table(data: Array, section: Any, dtype: np.dtype[Any], rule: str) -> Array:
    """A view of the entries of the object or block table."""
    findings = Findings()
    low, size = int(section["offset"]), int(section["length"])
    check_section_crc(data, section, findings)
    whole = size > 0 and size % dtype.itemsize == 0
    findings.require(
        whole, rule, low, f"section {bytes(section['tag'])!r} has {size} bytes, no multiple of {dtype.itemsize} above 0"
    )
    findings.settle()
    return records(data, low, size // dtype.itemsize, dtype)


class Table:
    """Reports entries of a table that break a rule, one finding for each rule."""

    def __init__(self, entries: Array, offset: int, name: str) -> None:
        self.entries, self.offset, self.name = entries, offset, name
        self.findings = Findings()

    def require(self, good: Any, rule: str, field: str, what: str) -> None:
        """`good` says of each entry whether it keeps the rule. The finding shows the first that does not."""
        if good.all():
            return
        bad = np.flatnonzero(~good)
        dtype = self.entries.dtype
        assert dtype.fields is not None
        at = self.offset + int(bad[0]) * dtype.itemsize + dtype.fields[field][1]
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        value = self.entries[field][bad[0]].tolist()
        self.findings.add(rule, at, f"{self.name} {bad[0]}: {field} {value}: {what}{more}")


def check_objects(objects: Array, offset: int) -> None:
    """The rules of section 3 that need the object table only."""
    table = Table(objects, offset, "object")
    usable = usable_transforms(objects["octree_to_mesh"])
    table.require(usable, "O004", "octree_to_mesh", "expected a finite, affine, invertible transform")
    levels = objects["levels"]
    table.require((levels >= 1) & (levels <= MAX_LEVELS), "O003", "levels", "expected 1 to 23")
    table.require(~objects["reserved"].any(axis=1), "O006", "reserved", "expected zeros")
    table.findings.settle()


def usable_transforms(m: Array) -> Array:
    """Which transforms are finite, have the last row 0 0 0 1, and a determinant that is a normal number."""
    c = np.asarray(m).T
    with np.errstate(all="ignore"):
        determinant = (
            c[0] * (c[5] * c[10] - c[9] * c[6])
            - c[4] * (c[1] * c[10] - c[9] * c[2])
            + c[8] * (c[1] * c[6] - c[5] * c[2])
        )
        normal = np.isfinite(determinant) & (np.abs(determinant) >= np.finfo(np.float64).tiny)
    affine = (c[3] == 0) & (c[7] == 0) & (c[11] == 0) & (c[15] == 1)
    usable: Array = np.isfinite(m).all(axis=1) & affine & normal
    return usable


def check_blocks(header: Any, data_section: Any, objects: Array, blocks: Array, offset: int) -> None:
    """The rules of section 4.1 that need the tables only."""
    table = Table(blocks, offset, "block")
    check_image_ranges(table)
    check_tree(table, objects)
    check_codecs(table, header)
    if not int(header["required_features"]) & IN_PARTS:
        check_places(table, data_section)


def check_image_ranges(table: Table) -> None:
    """B002, B003, B011."""
    blocks = table.entries
    size, at = blocks["image_size"], blocks["image_offset"]
    table.require((size % PAGE_BYTES == 0) & (size > 0), "B002", "image_size", "expected a multiple of 8192 above 0")
    table.require(at % PAGE_BYTES == 0, "B002", "image_offset", "expected a multiple of 8192")
    table.findings.settle()
    # Sizes are cut so that the sum cannot wrap.
    ends = np.cumsum(np.minimum(size, MAX_IMAGE_BYTES + PAGE_BYTES), dtype=np.uint64)
    starts = np.concatenate([ends[:1] * 0, ends[:-1]])
    table.require(at == starts, "B003", "image_offset", "expected the end of the block before")
    table.require(ends <= MAX_IMAGE_BYTES, "B011", "image_size", "the image has more than 2^32 slots")
    table.findings.settle()


def check_tree(table: Table, objects: Array) -> None:
    """B007, B008, B009, and O002 for the roots."""
    blocks = table.entries
    index = np.arange(len(blocks))
    table.require(blocks["reserved"] == 0, "B009", "reserved", "expected zero")
    owner, parent = blocks["object"].astype(np.int64), blocks["parent"].astype(np.int64)
    is_root = parent == NO_PARENT
    owned = owner < len(objects)
    table.require(owned, "B007", "object", f"there are {len(objects)} objects")
    owner = np.where(owned, owner, 0)
    named = objects["root_block"][owner] == index
    table.require(~is_root | named, "B007", "parent", "no parent, but no object has this block as root block")
    before = is_root | (parent < index)
    above = np.where(before & ~is_root, parent, 0)
    table.require(
        before & (is_root | (blocks["object"][above] == blocks["object"])),
        "B007",
        "parent",
        "expected an earlier block of the same object",
    )
    table.findings.settle()
    scale = blocks["cube_scale"].astype(np.int64)
    in_range = (scale >= 1) & (scale <= MAX_LEVELS)
    table.require(in_range, "B008", "cube_scale", "expected 1 to 23")
    edge = np.left_shift(1, np.where(in_range, scale, 0))[:, None]
    corner = blocks["cube_position"].astype(np.int64)
    # A root block has the root cube; every other cube is in that of its parent.
    outer_edge = np.where(is_root[:, None], 1 << MAX_LEVELS, edge[above])
    outer = np.where(is_root[:, None], 0, corner[above])
    inside = (corner % edge == 0) & (corner >= outer) & (corner + edge <= outer + outer_edge)
    table.require(inside.all(axis=1), "B008", "cube_position", "expected a multiple of the edge, in the parent's cube")
    table.require(~is_root | (scale == MAX_LEVELS), "B008", "cube_scale", "expected 23 for a root block")
    table.findings.settle()


def check_roots(objects: Array, blocks: Array, offset: int) -> None:
    """O002."""
    table = Table(objects, offset, "object")
    root = objects["root_block"].astype(np.int64)
    there = root < len(blocks)
    entries = blocks[np.where(there, root, 0)]
    is_root = there & (entries["object"] == np.arange(len(objects))) & (entries["parent"] == NO_PARENT)
    table.require(is_root, "O002", "root_block", "expected a block of the object without a parent")
    first = entries["image_offset"] // 8 + 2
    table.require(~is_root | (objects["root_slot"] == first), "O002", "root_slot", "expected slot 2 of the root block")
    table.findings.settle()


def check_codecs(table: Table, header: Any) -> None:
    """B005, as far as the table tells."""
    blocks, features = table.entries, int(header["required_features"])
    codec, size = blocks["codec"], blocks["image_size"]
    in_parts = bool(features & IN_PARTS)
    # Parts of whole blocks have a header before the stored bytes.
    stored = blocks["stored_size"] - np.where((codec < 2) & in_parts, 16, 0).astype(np.uint64)
    raw = codec == 0
    table.require(codec <= 2, "B005", "codec", "this reader knows 0, 1 and 2")
    table.require(raw | bool(features & COMPRESSED), "B005", "codec", "needs required feature bit 0")
    table.require((codec != 2) | in_parts, "B005", "codec", "needs required feature bit 1")
    table.require(~raw | (stored == size), "B005", "stored_size", "differs from the size in the image, with codec 0")
    # A byte of a Zstandard frame stands for at most 32768 bytes, one of a stream for less than 8.
    most = np.where(codec == 2, 8 * 32768, 32768).astype(np.uint64)
    table.require(raw | (size // most <= stored), "B005", "stored_size", "too few bytes for the size in the image")
    table.findings.settle()


def check_places(table: Table, section: Any) -> None:
    """B004 and the end of the image (B003)."""
    blocks = table.entries
    size, stored, at = blocks["image_size"], blocks["stored_size"], blocks["file_offset"]
    raw = blocks["codec"] == 0
    low, length = int(section["offset"]), int(section["length"])
    end = low + length
    # Nothing below wraps: lengths that exceed the section are found before they are added.
    fits = (stored <= length) & (at >= low) & (at <= end) & (at % PAGE_BYTES == 0)
    ends = np.where(fits, at + (stored + (PAGE_BYTES - 1)) // PAGE_BYTES * PAGE_BYTES, 0)
    table.require(fits & (ends <= end), "B004", "file_offset", "the block does not lie in BLKS at a multiple of 8192")
    table.findings.settle()
    order = np.argsort(at, kind="stable")
    apart = np.ones(len(blocks), bool)
    apart[order[1:]] = ends[order][:-1] <= at[order][1:]
    table.require(apart, "B004", "file_offset", "the block overlaps another")
    table.findings.settle()
    if raw.all():
        image_end = int(blocks["image_offset"][-1] + size[-1])
        table.require(
            at == blocks["image_offset"] + low, "B004", "file_offset", "blocks are not stored as in the image"
        )
        table.findings.require(
            image_end == length, "B003", table.offset, f"the image has {image_end} bytes, BLKS has {length}"
        )
    table.findings.settle()
