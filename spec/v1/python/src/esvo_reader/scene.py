"""What a file says of its octrees as a whole: instances (section 3.1), SHA-256 and id (section 2.5)."""

from __future__ import annotations

import hashlib
from typing import Any, Dict, Optional

import numpy as np

from . import opening
from .errors import Findings
from .records import Array

#: Section 3.1. `mesh_to_scene` has the upper three rows of the matrix, by columns.
INSTANCE_ENTRY = np.dtype([("object", "<u4"), ("reserved", "<u4"), ("mesh_to_scene", "<f8", (12,))])
#: Section 2.5.
FILE_HASH = np.dtype([("sha256", "u1", (32,)), ("id", "u1", (16,))])
MAX_INSTANCES = 1 << 23


def read_instances(data: Array, sections: Dict[bytes, Any], objects: int) -> Optional[Array]:
    """The table of instances of a file with so many objects; None without the section. N001 to N004."""
    section = sections.get(b"INST")
    if section is None:
        return None
    entries = opening.read_table(data, section, INSTANCE_ENTRY, "N001")
    table = opening.Table(entries, int(section["offset"]), "instance")
    table.findings.require(len(entries) <= MAX_INSTANCES, "N001", table.offset, f"{len(entries)} instances")
    table.require(entries["object"] < objects, "N002", "object", f"there are {objects} objects")
    table.require(entries["reserved"] == 0, "N004", "reserved", "expected zero")
    matrices = matrices_of(entries).transpose(0, 2, 1).reshape(-1, 16)
    table.require(opening.usable_transforms(matrices), "N003", "mesh_to_scene", "expected a matrix with an inverse")
    table.findings.settle()
    return entries


def matrices_of(entries: Array) -> Array:
    """float64 (n, 4, 4): the matrix from mesh space to scene space of each instance."""
    result: Array = np.zeros((len(entries), 4, 4))
    result[:, :3] = entries["mesh_to_scene"].reshape(-1, 4, 3).transpose(0, 2, 1)
    result[:, 3, 3] = 1
    return result


def read_hash(data: Array, sections: Dict[bytes, Any]) -> Optional[Any]:
    """The record `FILE_HASH`; None without the section. F001."""
    section = sections.get(b"HASH")
    if section is None:
        return None
    findings = Findings()
    at, size, flags = int(section["offset"]), int(section["length"]), int(section["flags"])
    whole = size == FILE_HASH.itemsize and bool(flags & opening.OWN_CHECKSUMS)
    findings.require(whole, "F001", at, f"the section HASH has {size} bytes and flags {flags:#x}")
    findings.settle()
    return opening.record(data, at, FILE_HASH)


def check_hash(data: Array, sections: Dict[bytes, Any], findings: Findings) -> None:
    """F002. Reads the whole file."""
    found = read_hash(data, sections)
    if found is None:
        return
    at = int(sections[b"HASH"]["offset"])
    digest = hashlib.sha256(data[:at].data)
    digest.update(bytes(32))
    digest.update(data[at + 32 :].data)
    right = digest.digest() == found["sha256"].tobytes()
    findings.require(right, "F002", at, "the SHA-256 of the file is another")
