"""Makes a large file of copies of an octree, each an object of its own: python benchmarks/enlarge.py IN OUT COPIES

For files without compressed blocks. Copies differ in the numbers of their objects and blocks only.
"""

from __future__ import annotations

import argparse
import pathlib
import zlib

import numpy as np

import esvo_reader
from esvo_reader.records import HEADER, IDENTIFIER, INFO_SECTION, NO_PARENT, SECTION_ENTRY


def enlarge(octree, path, copies):
    head = HEADER.itemsize + 3 * SECTION_ENTRY.itemsize
    objects, blocks = np.tile(octree.objects, copies), np.tile(octree.blocks, copies)
    copy = np.repeat(np.arange(copies, dtype=np.uint64), len(octree.blocks))
    image = int(octree.blocks["image_size"].sum())
    data_at = -(-(head + objects.nbytes + blocks.nbytes) // 8192) * 8192

    number = np.repeat(np.arange(copies), len(octree.objects))
    objects["root_block"] += (number * len(octree.blocks)).astype(np.uint32)
    objects["root_slot"] += (number * (image // 8)).astype(np.uint64)
    blocks["object"] += (copy * len(octree.objects)).astype(np.uint32)
    below = blocks["parent"] != NO_PARENT
    blocks["parent"][below] += (copy * len(octree.blocks)).astype(np.uint32)[below]
    blocks["image_offset"] += copy * np.uint64(image)
    blocks["file_offset"] = blocks["image_offset"] + np.uint64(data_at)

    with path.open("wb") as file:
        file.seek(data_at)
        for index, entry in enumerate(blocks):
            block = octree.block(index % len(octree.blocks))
            data = bytearray(block.image.tobytes())
            np.frombuffer(data, INFO_SECTION, 1, block.info_at)["block"] = index
            entry["crc"] = zlib.crc32(data)
            file.write(data)
        sections, at = np.zeros(3, SECTION_ENTRY), head
        for section, tag, table in zip(sections, (b"OBJT", b"BLKT"), (objects, blocks)):
            section["tag"], section["flags"], section["offset"], section["length"] = tag, 1, at, table.nbytes
            section["crc"] = zlib.crc32(table.tobytes())
            at += table.nbytes
        sections[2] = (b"BLKS", 3, data_at, image * copies, 0, 0)
        header = np.zeros(1, HEADER)
        header["identifier"], header["major"], header["file_length"] = IDENTIFIER, 1, data_at + image * copies
        header["directory_offset"], header["directory_count"] = HEADER.itemsize, 3
        header["directory_crc"] = zlib.crc32(sections.tobytes())
        header["header_crc"] = zlib.crc32(header.tobytes()[:60])
        file.seek(0)
        for part in (header, sections, objects, blocks):
            file.write(part.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=pathlib.Path, metavar="IN")
    parser.add_argument("target", type=pathlib.Path, metavar="OUT")
    parser.add_argument("copies", type=int, metavar="COPIES")
    chosen = parser.parse_args()
    enlarge(esvo_reader.open(chosen.source), chosen.target, chosen.copies)


if __name__ == "__main__":
    main()
