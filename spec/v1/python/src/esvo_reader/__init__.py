"""Reads esvo files: sparse voxel octrees in the layout in which ray casters read them.

An implementation of version 1 of the specification, written from its text alone. `open` maps a file and reads its
tables; an `Octree` has everything else.
"""

from __future__ import annotations

import os
from typing import List, Union

from .blocks import Block
from .codecs import CONTOUR, decode_contours, interpolate_corners
from .components import components_of
from .errors import EsvoError, Finding
from .octree import Descriptor, Octree, from_bytes
from .octree import open_file as open
from .records import (
    ATTACHMENT_ENTRY,
    BLOCK_ENTRY,
    DESCRIPTOR,
    HEADER,
    INFO_SECTION,
    NO_PARENT,
    NODE,
    OBJECT_ENTRY,
    SECTION_ENTRY,
    field,
)
from .served import IndexReader, read_file
from .voxels import Voxels
from .writing import write_grid, write_voxels

__version__ = "1.0.0"

__all__ = [
    "ATTACHMENT_ENTRY",
    "BLOCK_ENTRY",
    "CONTOUR",
    "DESCRIPTOR",
    "HEADER",
    "INFO_SECTION",
    "NODE",
    "NO_PARENT",
    "OBJECT_ENTRY",
    "SECTION_ENTRY",
    "Block",
    "Descriptor",
    "EsvoError",
    "Finding",
    "IndexReader",
    "Octree",
    "Voxels",
    "components_of",
    "decode_contours",
    "field",
    "from_bytes",
    "interpolate_corners",
    "open",
    "read_file",
    "validate",
    "write_grid",
    "write_voxels",
]


def validate(path: Union[str, os.PathLike[str]]) -> List[Finding]:
    """All findings about a file, whether it can be opened or not. It is sound if none has the severity "error".

    A part that is broken hides what depends on it: a file with a damaged header has findings about the header only.
    Raises `OSError` where the file cannot be read.
    """
    try:
        return open(path).validate()
    except EsvoError as error:
        return error.findings
