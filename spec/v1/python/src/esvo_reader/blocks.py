"""Single blocks: their bytes, decompressed if need be, and where their parts are (sections 4.2, 6, 8)."""

from __future__ import annotations

from typing import Any, Dict

import numpy as np
import zstandard

from . import components, kinds
from .errors import Findings
from .opening import crc, overlap, record, records
from .records import (
    ATTACHMENT_ENTRY,
    INFO_SECTION,
    PAGE_SLOTS,
    Array,
)

ZSTANDARD_MAGIC = b"\x28\xb5\x2f\xfd"
#: Window of frames whose blocks are smaller than it.
MAX_WINDOW = 1 << 27


class Block:
    """A block as it is in memory. Everything is a view of `image`, the bytes of the block.

    Making one checks the rules of page headers, of the info section and of the attachment directory: P001 to P006, A001
    to A004, A009. Offsets are in bytes from the start of the block.
    """

    def __init__(self, index: int, entry: Any, image: Array, skip: int = 0) -> None:
        """`skip`: bytes of the stored block before the image, where that is not compressed."""
        #: Index into the block table.
        self.index = index
        #: The entry of the block table.
        self.entry = entry
        #: uint8, image size: the bytes.
        self.image = image
        #: Slot of the image that is slot 0 of the block.
        self.start = int(entry["image_offset"]) // 8
        self._raw, self._skip = entry["codec"] == 0, skip
        findings = Findings()
        self._find_info(findings)
        self._check_info(findings)
        findings.settle()
        self._find_attachments(findings)
        findings.settle()

    def __repr__(self) -> str:
        return f"<block {self.index}: {len(self.slots)} slots, {len(self.contours)} contours>"

    @property
    def own_bytes(self) -> int:
        """Bytes of memory that the block takes; none if it is a view of the file."""
        return 0 if self._raw else len(self.image)

    def at(self, offset: int) -> int:
        """Where a byte of the block is in the file; the start of the block if that is compressed."""
        return int(self.entry["file_offset"]) + (self._skip + int(offset) if self._raw else 0)

    def _find_info(self, findings: Findings) -> None:
        name, size = f"block {self.index}", len(self.image)
        all_slots = self.image.view("<u8")
        count = int(all_slots[0])
        findings.require(4 <= count <= len(all_slots), "P001", self.at(0), f"{name}: first page header {count:#x}")
        findings.settle()
        #: uint64, one for each slot of the descriptor array.
        self.slots: Array = all_slots[:count]
        headers = self.slots[::PAGE_SLOTS]
        expected = count - PAGE_SLOTS * np.arange(len(headers))
        wrong = np.flatnonzero(headers != expected.astype(np.uint64)) * PAGE_SLOTS
        findings.require(not wrong.size, "P001", self.at(8 * int(wrong[:1].sum())), f"{name}: wrong page headers")
        #: Where the info section is.
        self.info_at = 8 * count
        fits = self.info_at + INFO_SECTION.itemsize <= size
        findings.require(fits, "P002", self.at(self.info_at), f"{name}: the info section does not fit")
        findings.settle()
        #: The info section, a record of `INFO_SECTION`.
        self.info: Any = record(self.image, self.info_at, INFO_SECTION)
        count = int(self.info["attachment_count"])
        findings.require(count <= 64, "A004", self.at(self.info_at + 20), f"{name}: {count} attachments, at most 64")
        findings.settle()

    def _check_info(self, findings: Findings) -> None:
        info, size, count = self.info, len(self.image), len(self.slots)

        def require(condition: object, rule: str, field: str, message: str) -> None:
            assert INFO_SECTION.fields is not None
            at = self.at(self.info_at + INFO_SECTION.fields[field][1])
            findings.require(condition, rule, at, f"block {self.index}: {message}")

        require(info["block"] == self.index, "P003", "block", f"its info section says block {info['block']}")
        require(info["array_slots"] == count, "P002", "array_slots", f"{info['array_slots']} slots, expected {count}")
        first = info["first_descriptor"]
        require(first == count - 2, "P004", "first_descriptor", f"first descriptor {first} slots back, not {count - 2}")
        require(info["reserved"] == 0, "P006", "reserved", "the reserved field of the info section is not zero")
        #: Where the attachment directory ends, where the contour pool starts, and where it ends.
        self.directory_end = (
            self.info_at + INFO_SECTION.itemsize + ATTACHMENT_ENTRY.itemsize * int(info["attachment_count"])
        )
        require(self.directory_end <= size, "P002", "attachment_count", "the attachment directory does not fit")
        findings.settle()
        self.pool_at = self.info_at + 4 * int(info["contour_offset"])
        self.pool_end = self.pool_at + 4 * int(info["contour_count"])
        fits = self.directory_end <= self.pool_at and self.pool_end <= size
        require(fits, "P005", "contour_offset", f"contour pool from byte {self.pool_at} to {self.pool_end}")

    def _find_attachments(self, findings: Findings) -> None:
        #: uint32: the contour pool.
        self.contours: Array = self.image[self.pool_at : self.pool_end].view("<u4")
        directory = self.info_at + INFO_SECTION.itemsize
        #: The attachment directory, an array of `ATTACHMENT_ENTRY`.
        self.attachment_entries: Array = records(
            self.image, directory, int(self.info["attachment_count"]), ATTACHMENT_ENTRY
        )
        #: The bytes of every attachment by its type.
        self.attachments: Dict[int, Array] = {}
        ranges = []
        for number, entry in enumerate(self.attachment_entries):
            kind, size = int(entry["kind"]), int(entry["size"])
            low = self.info_at + int(entry["offset"])
            at = self.at(directory + ATTACHMENT_ENTRY.itemsize * number)
            name = f"block {self.index}: attachment {kind}"
            registered = (
                kinds.COLOR_BLOCKS <= kind <= kinds.CORNERS or kind in kinds.WITH_COMPONENTS or 0x8000 <= kind <= 0xFFFF
            )
            findings.require(registered, "A002", at, f"{name} is neither registered nor a vendor's")
            findings.require(kind not in self.attachments, "A002", at, f"{name} occurs twice")
            findings.require(self._right_size(kind, size), "A003", at + 8, f"{name} has {size} bytes")
            inside = self.pool_end <= low and low + size <= len(self.image) and low % 8 == 0
            findings.require(inside, "A001", at + 4, f"{name} from byte {low} to {low + size}")
            self.attachments[kind] = self.image[low : low + size]
            ranges.append((low, low + size))
        for what, those in (("colours", kinds.WITH_COLORS), ("normals", kinds.WITH_NORMALS)):
            both = sorted(those & self.attachments.keys())
            findings.require(len(both) <= 1, "A002", self.at(directory), f"block {self.index}: {what} in types {both}")
        findings.settle()
        findings.require(not overlap(ranges), "A001", self.at(directory), f"block {self.index}: attachments overlap")
        findings.settle()
        #: What the heads of component attachments say, by type.
        self.heads: Dict[int, components.Head] = {}
        components.check_heads(self, findings)

    def _right_size(self, kind: int, size: int) -> bool:
        """A003."""
        slots = len(self.slots)
        if kind in kinds.PAIR_BYTES:
            return size == kinds.PAIR_BYTES[kind] * ((slots + 1) // 2)
        if kind in kinds.ENTRY_BYTES:
            return size >= kinds.ENTRY_BYTES[kind] * slots and size % kinds.ENTRY_BYTES[kind] == 0
        return kind != kinds.CONSTANT_COLOR or size == kinds.CONSTANT_BYTES

    def words(self, kind: int) -> Array:
        """An attachment of the registry as uint32."""
        return self.attachments[kind].view("<u4")


def block_image(data: Array, index: int, entry: Any, limit: int) -> Array:
    """The bytes of a block; decompressed, and then checked against its checksum, if it has codec 1."""
    at, size = int(entry["file_offset"]), int(entry["image_size"])
    stored = data[at : at + int(entry["stored_size"])]
    if entry["codec"] == 0:
        return stored
    findings = Findings()
    findings.require(size <= limit, "LIMIT", at, f"block {index} has {size} bytes, more than max_block_bytes = {limit}")
    check_block_crc(data, index, entry, findings)
    findings.settle()
    try:
        image = decompress(stored.tobytes(), size)
    except (ValueError, MemoryError, zstandard.ZstdError) as error:
        findings.add("B005", at, f"block {index}: {error}")
        findings.settle()
    return np.frombuffer(image, np.uint8)


def check_block_crc(data: Array, index: int, entry: Any, findings: Findings) -> None:
    """B006; reads the stored bytes."""
    at = int(entry["file_offset"])
    right = crc(data[at : at + int(entry["stored_size"])]) == entry["crc"]
    findings.require(right, "B006", at, f"block {index} is damaged")


def decompress(frame: bytes, size: int) -> bytes:
    """The content of a Zstandard frame, which must be whole and alone, and have `size` bytes of content."""
    if frame[:4] != ZSTANDARD_MAGIC:
        raise ValueError("no Zstandard frame")
    parameters = zstandard.get_frame_parameters(frame)
    if parameters.dict_id:
        raise ValueError("the frame needs a dictionary")
    if parameters.content_size not in (size, zstandard.CONTENTSIZE_UNKNOWN):
        raise ValueError(f"the frame has {parameters.content_size} bytes, expected {size}")
    window = max(MAX_WINDOW, size)
    if parameters.window_size > window:
        raise ValueError(f"the frame has a window of {parameters.window_size} bytes, this reader takes {window}")
    unpacker = zstandard.ZstdDecompressor(max_window_size=1 << 31)
    content = unpacker.decompress(frame, max_output_size=size, allow_extra_data=False)
    if len(content) != size:
        raise ValueError(f"the frame has {len(content)} bytes, expected {size}")
    return content
