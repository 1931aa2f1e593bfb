"""What the metadata say (section 2.3): registered members, and the rules M002 to M004, which no reader relies on."""

from __future__ import annotations

from typing import Any, Dict, List, Optional

from .errors import Findings

#: Members whose values should be strings (M002).
STRINGS = ("title", "author", "license", "source", "generator", "created")
#: Members whose values should be whole numbers, and those whose values should be objects (M003).
COUNTS = ("triangles", "cells", "model_voxels")
FREE = ("settings", "displacement", "attachments")
UP = ("+x", "-x", "+y", "-y", "+z", "-z")


def is_number(value: Any) -> bool:
    """Whether a value of a JSON text is a number; in Python, true and false would be, too."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def is_as_registered(name: str, value: Any) -> bool:
    """Whether the value of a member that is neither a string nor a list is as section 2.3 lays down (M003)."""
    if name == "unit":
        return is_number(value) and value > 0
    if name == "up":
        return value in UP
    if name == "handedness":
        return value in ("right", "left")
    if name in COUNTS:
        return is_number(value) and value == int(value) and 0 <= value < 1 << 53
    return name not in FREE or isinstance(value, dict)


def is_bounds(value: Any) -> bool:
    """Whether a value is a box: `low` and `high`, three numbers each, none of `low` above that of `high`."""
    if not isinstance(value, dict):
        return False
    corners = [value.get("low"), value.get("high")]
    if not all(isinstance(c, list) and len(c) == 3 and all(map(is_number, c)) for c in corners):
        return False
    return all(low <= high for low, high in zip(*corners))


def entry_fault(entry: Any, bounds: bool) -> Optional[str]:
    """What is wrong with an entry of `objects` (with bounds) or of `instances`."""
    if not isinstance(entry, dict):
        return "is no object"
    if not isinstance(entry.get("name", ""), str):
        return "has a name that is no string"
    if not isinstance(entry.get("metadata", {}), dict):
        return "has metadata that are no object"
    if bounds and "bounds" in entry and not is_bounds(entry["bounds"]):
        return "has bounds that are no box"
    return None


def list_fault(entries: Any, count: int, bounds: bool) -> Optional[str]:
    """What is wrong with `objects` or `instances` of a file that has so many (M004)."""
    if not isinstance(entries, list):
        return "is no array"
    if len(entries) > count:
        return f"has {len(entries)} entries, the file has {count}"
    faults: List[Optional[str]] = [entry_fault(entry, bounds) for entry in entries]
    return next((f"entry {number} {fault}" for number, fault in enumerate(faults) if fault), None)


def check(members: Dict[str, Any], objects: int, instances: int, at: int, findings: Findings) -> None:
    """M002, M003, M004 of the metadata at a byte of a file with so many objects and instances."""
    for name, value in members.items():
        if name in STRINGS:
            findings.require(isinstance(value, str), "M002", at, f"the metadata have {name!r}, which is no string")
        elif name in ("objects", "instances"):
            bounds = name == "objects"
            fault = list_fault(value, objects if bounds else instances, bounds)
            findings.require(fault is None, "M004", at, f"the metadata: {name!r} {fault}")
        else:
            good = is_as_registered(name, value)
            findings.require(good, "M003", at, f"the metadata have {name!r} with a value that is not as registered")
