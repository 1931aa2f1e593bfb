"""The command line: python -m esvo_reader validate|info FILE..."""

from __future__ import annotations

import argparse
import json
import sys
from typing import List, Optional

from . import EsvoError, Octree, validate
from . import open as open_octree


def info(octree: Octree) -> str:
    """What is in a file, in lines."""
    header = octree.header
    lines = [
        f"version {header['major']}.{header['minor']}, required features {header['required_features']:#x}, "
        f"optional features {header['optional_features']:#x}, {header['file_length']} bytes",
    ]
    for s in octree.sections:
        # A tag can be any four bytes, and metadata any text: what a terminal may act on is escaped.
        tag = ascii(bytes(s["tag"]).ljust(4, b"\0").decode("latin-1"))
        lines.append(f"section {tag}: {s['length']} bytes at {s['offset']}, flags {s['flags']:#x}")
    for number, o in enumerate(octree.objects):
        lines.append(
            f"object {number}: {o['levels']} levels, {o['descriptors']} descriptors, {o['leaf_voxels']} leaf voxels, "
            f"{o['contours']} contours, {o['far_pointers']} far pointers"
        )
    if octree.instances is not None:
        for number, i in enumerate(octree.instances):
            lines.append(f"instance {number}: object {i['object']}, by columns {i['mesh_to_scene'].tolist()}")
    if octree.hash is not None:
        lines.append(f"SHA-256 {octree.hash['sha256'].tobytes().hex()}, id {octree.hash['id'].tobytes().hex()}")
    for index, b in enumerate(octree.blocks):
        codec = {0: "as it is", 1: "Zstandard", 2: "fields"}[int(b["codec"])]
        lines.append(
            f"block {index}: object {b['object']}, cube at {b['cube_position'].tolist()} of scale {b['cube_scale']}, "
            f"{b['image_size']} bytes, stored as {b['stored_size']} ({codec})"
        )
    if octree.metadata:
        lines.append(f"metadata: {json.dumps(octree.metadata)}")
    return "\n".join(lines)


def check_file(path: str) -> bool:
    """Prints the findings about a file; returns whether it is sound."""
    findings = validate(path)
    for finding in findings:
        print(f"{path}: {finding}")
    errors = sum(f.severity == "error" for f in findings)
    print(f"{path}: {errors} errors, {len(findings) - errors} warnings")
    return errors == 0


def main(arguments: Optional[List[str]] = None) -> int:
    """Exit code 0 if all files are sound, 1 if one is not, 2 if one cannot be read."""
    parser = argparse.ArgumentParser(prog="esvo_reader", description="Reads esvo files.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, what in (("validate", "prints the rules that files break"), ("info", "prints what is in files")):
        command = commands.add_parser(name, help=what, description=what)
        command.add_argument("files", nargs="+", metavar="FILE")
    chosen = parser.parse_args(arguments)
    code = 0
    for path in chosen.files:
        try:
            if chosen.command == "info":
                print(info(open_octree(path)))
            elif not check_file(path):
                code = max(code, 1)
        except EsvoError as error:
            print(f"{path}: {error}", file=sys.stderr)
            code = max(code, 1)
        except OSError as error:
            print(f"{path}: {error.strerror or error}", file=sys.stderr)
            code = 2
    return code


if __name__ == "__main__":
    sys.exit(main())
