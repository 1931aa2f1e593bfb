"""Reads every test vector: the valid ones to the values in their JSON, the invalid ones not at all.

Usage: check_vectors.py FOLDER, the one with valid and invalid in it. Exit code 1 if anything differs.
"""

import json
import pathlib
import sys

from reader import NO_PARENT, Reader, Refused

# Rules that a file should keep rather than must: such files are read.
SHOULD = {"B012", "A006"}


def difference(found, expected, where):
    """The first difference of two JSON values, or None. Numbers may differ by rounding."""
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


def describe(reader):
    """What the JSON beside a valid vector says, name and purpose apart."""
    header = reader.header
    return {
        "version": [header.major, header.minor],
        "required_features": header.required_features,
        "optional_features": header.optional_features,
        "sections": [
            {"tag": s.tag.decode("utf-8", "replace"), "flags": s.flags, "bytes": s.length} for s in reader.sections
        ],
        "blocks": [
            {
                "object": b.entry.object, "parent": b.entry.parent, "position": b.entry.cube_position,
                "scale": b.entry.cube_scale, "codec": b.entry.codec.value, "slots": b.array,
                "contours": b.info.contour_count,
                "attachments": [{"type": a.kind, "bytes": a.size} for a in b.info.attachments],
            }
            for b in reader.blocks
        ],
        "objects": reader.objects,
    }


def main(folder):
    failures, voxels = [], 0
    valid = sorted((folder / "valid").glob("*.esvo"))
    for path in valid:
        expected = json.loads(path.with_suffix(".json").read_text("utf-8"))
        expected.pop("about")
        if expected.pop("file") != path.name:
            failures.append(f"{path.name}: the JSON is that of another file")
        try:
            found = describe(Reader(path.read_bytes()))
        except Refused as error:
            failures.append(f"{path.name} is refused: {error}")
            continue
        voxels += sum(len(node["voxels"]) for o in found["objects"] for node in o["nodes"])
        differs = difference(found, expected, path.name)
        if differs:
            failures.append(differs)
    index = json.loads((folder / "invalid" / "index.json").read_text("utf-8"))
    for entry in index:
        try:
            Reader((folder / "invalid" / entry["file"]).read_bytes())
            refused = None
        except Refused as error:
            refused = error.rule
        expected = None if entry["rule"] in SHOULD else entry["rule"]
        if refused != expected:
            failures.append(f"{entry['file']}: refused by {refused}, expected {expected} ({entry['cause']})")
    for failure in failures:
        print(failure)
    print(f"{len(valid)} valid vectors with {voxels} voxels, {len(index)} invalid ones: {len(failures)} failures")
    return 1 if failures or not valid or not index else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
