"""Where the vectors are, and what the JSON next to a valid vector says about a file that was read."""

from __future__ import annotations

import json
import pathlib

import numpy as np

import esvo_reader
from esvo_reader import components_of, decode_contours, field
from esvo_reader.kinds import WITH_COMPONENTS

PACKAGE = pathlib.Path(__file__).parents[1]
SPECIFICATION = PACKAGE.parent
VECTORS = SPECIFICATION / "vectors"
VALID = sorted((VECTORS / "valid").glob("*.esvo"))
INVALID = json.loads((VECTORS / "invalid" / "index.json").read_text("utf-8"))
INVALID_FOLDER = VECTORS / "invalid"
STREAMING = json.loads((VECTORS / "streaming" / "index.json").read_text("utf-8"))


def path_digits(level, position):
    """Child slots from the root to a voxel, a digit each."""
    bits = [sum((int(x) >> (23 - k) & 1) << axis for axis, x in enumerate(position)) for k in range(1, level + 1)]
    return "".join(map(str, bits))


def slab_in_mesh(matrix, contour, center, size):
    """The planes of a contour in mesh space (section 7)."""
    linear, origin = matrix[:3, :3], matrix[:3, 3]
    normal = np.linalg.inv(linear).T @ contour["normal"]
    length = np.sqrt(normal @ normal)
    middle = contour["normal"] @ center + size * contour["position"] + normal @ origin
    low, high = ((middle + side * size * contour["thickness"]) / length for side in (-0.5, 0.5))
    return {"normal": (normal / length).tolist(), "low": float(low), "high": float(high)}


def voxel_facts(octree, number, voxels, row, kinds, values_by_kind):
    """A member of `voxels` of the JSON. What has no value is left out."""
    facts = {"slot": int(voxels.child[row]), "leaf": bool(voxels.leaf[row])}
    if voxels.contour is not None and voxels.contour[row]:
        word = voxels.contour[row]
        contour = decode_contours(word)
        facts["contour"] = {
            "word": int(word),
            "normal": contour["normal"].tolist(),
            "position": float(contour["position"]),
            "thickness": float(contour["thickness"]),
            "mesh": slab_in_mesh(octree.octree_to_mesh(number), contour, voxels.center[row], voxels.size[row]),
        }
    for name in ("color", "normal", "ambient"):
        values = getattr(voxels, name)
        if values is not None and not np.isnan(values[row]).any():
            facts[name] = values[row].tolist()
    # The JSON has the opacity where it is stored.
    if {5, 7} & kinds and not np.isnan(voxels.alpha[row]):
        facts["alpha"] = float(voxels.alpha[row])
    components = {
        str(kind): numbers[row][~np.isnan(numbers[row])].tolist()
        for kind, numbers in values_by_kind.items()
        if not np.isnan(numbers[row]).all()
    }
    if components:
        facts["components"] = components
    if voxels.corners_of is not None and voxels.corners_of[row]:
        facts["own_corners"] = bool(voxels.corners_of[row] == 1)
        color, normal = voxels.corners[row, :, 0], voxels.corners[row, :, 1]
        channels = [[int(c) >> shift & 255 for shift in (0, 8, 16, 24)] for c in color]
        facts["corners"] = [[*c, int(n)] for c, n in zip(channels, normal)]
    return facts


def object_facts(octree, number):
    """A member of `objects` of the JSON."""
    entry = octree.objects[number]
    nodes = []
    for part in octree.walk(number):
        voxels = octree.voxels(part)
        block = octree.block(octree.block_of_slot(int(part["slot"][0])))
        components = {
            kind: components_of(octree, voxels, kind) for kind in sorted(WITH_COMPONENTS & block.attachments.keys())
        }
        rows = {}
        for row, slot in enumerate(voxels.slot.tolist()):
            rows.setdefault(slot, []).append(row)
        for node in part:
            nodes.append(
                {
                    "path": path_digits(int(node["level"]), node["position"]),
                    "level": int(node["level"]),
                    "position": node["position"].tolist(),
                    "block": block.index,
                    "slot": int(node["slot"]) - block.start,
                    "valid": int(node["valid_mask"]),
                    "leaf": int(node["leaf_mask"]),
                    "contours": int(node["contour_mask"]),
                    "far": bool(field(node, "far")),
                    "voxels": [
                        voxel_facts(octree, number, voxels, r, block.attachments.keys(), components)
                        for r in rows[int(node["slot"])]
                    ],
                }
            )
    nodes.sort(key=lambda node: node["path"])
    counts = {name: int(entry[name]) for name in ("levels", "descriptors", "leaf_voxels", "contours", "far_pointers")}
    return {"octree_to_mesh": entry["octree_to_mesh"].tolist(), **counts, "nodes": nodes}


def facts(octree):
    """What the JSON says, apart from the name of the file and what it is for."""
    header = octree.header
    blocks = [octree.block(index) for index in range(len(octree.blocks))]
    return {
        "version": [int(header["major"]), int(header["minor"])],
        "required_features": int(header["required_features"]),
        "optional_features": int(header["optional_features"]),
        "sections": [
            {
                "tag": bytes(s["tag"]).ljust(4, b"\0").decode("latin-1"),
                "flags": int(s["flags"]),
                "bytes": int(s["length"]),
            }
            for s in octree.sections
        ],
        "blocks": [
            {
                "object": int(b.entry["object"]),
                "parent": int(b.entry["parent"]),
                "position": b.entry["cube_position"].tolist(),
                "scale": int(b.entry["cube_scale"]),
                "codec": int(b.entry["codec"]),
                "slots": len(b.slots),
                "contours": len(b.contours),
                "attachments": [{"type": int(a["kind"]), "bytes": int(a["size"])} for a in b.attachment_entries],
            }
            for b in blocks
        ],
        "objects": [object_facts(octree, number) for number in range(len(octree.objects))],
    }


def difference(found, expected, where):
    """The first difference of two JSON values, or None. Numbers may differ by rounding."""
    if expected == "any":
        return None if abs(np.linalg.norm(found) - 1) <= 1e-12 else f"{where}: {found} is not of unit length"
    if isinstance(expected, dict):
        if not isinstance(found, dict) or found.keys() != expected.keys():
            return f"{where}: {found} instead of {expected}"
        pairs = ((found[key], value, f"{where}.{key}") for key, value in expected.items())
    elif isinstance(expected, list):
        if not isinstance(found, list) or len(found) != len(expected):
            return f"{where}: {found} instead of {expected}"
        pairs = ((f, e, f"{where}[{k}]") for k, (f, e) in enumerate(zip(found, expected)))
    elif isinstance(expected, float) or isinstance(found, float):
        same = abs(found - expected) <= 1e-12 * max(1.0, abs(expected))
        return None if same else f"{where}: {found} instead of {expected}"
    else:
        return None if found == expected else f"{where}: {found} instead of {expected}"
    return next((d for d in (difference(*pair) for pair in pairs) if d), None)


def open_vector(name):
    """A valid vector by its name."""
    return esvo_reader.open(SPECIFICATION / "vectors" / "valid" / f"{name}.esvo")
