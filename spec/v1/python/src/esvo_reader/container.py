"""Header, directory and places of sections, for files that this package makes (section 2)."""

from __future__ import annotations

from typing import List, NamedTuple, Sequence

import numpy as np

from .opening import OWN_CHECKSUMS, crc
from .records import HEADER, IDENTIFIER, PAGE_BYTES, SECTION_ENTRY, Array


class Section(NamedTuple):
    """A section, without its bytes."""

    tag: bytes
    flags: int
    #: In bytes.
    length: int
    #: CRC-32 of the bytes. Not used where the flags say that the section has checksums of its own.
    crc: int = 0


def places(lengths: Sequence[int]) -> List[int]:
    """Offsets of sections that follow header and directory in this order; the last one is BLKS."""
    at, result = HEADER.itemsize + len(lengths) * SECTION_ENTRY.itemsize, []
    for number, length in enumerate(lengths):
        at += -at % (PAGE_BYTES if number == len(lengths) - 1 else 8)
        result.append(at)
        at += length
    return result


def front(sections: Sequence[Section], required_features: int = 0) -> bytes:
    """Header and directory of a file that ends with the last of these sections."""
    offsets = places([s.length for s in sections])
    directory = np.zeros(len(sections), SECTION_ENTRY)
    for entry, section, at in zip(directory, sections, offsets):
        entry["tag"], entry["flags"], entry["offset"], entry["length"] = section.tag, section.flags, at, section.length
        entry["crc"] = 0 if section.flags & OWN_CHECKSUMS else section.crc
    header = np.zeros(1, HEADER)
    header["identifier"], header["major"], header["required_features"] = IDENTIFIER, 1, required_features
    header["file_length"] = offsets[-1] + sections[-1].length
    header["directory_offset"], header["directory_count"] = HEADER.itemsize, len(sections)
    header["directory_crc"] = crc(bytes_of(directory))
    header["header_crc"] = crc(bytes_of(header)[:-4])
    return header.tobytes() + directory.tobytes()


def bytes_of(table: Array) -> Array:
    """uint8: the bytes of an array."""
    result: Array = np.ascontiguousarray(table).view(np.uint8).reshape(-1)
    return result
