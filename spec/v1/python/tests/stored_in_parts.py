"""Stores octrees in parts with an index (sections 4.3 to 4.5), for tests: codecs, parts and pages can be chosen."""

import zlib

import numpy as np
import zstandard

from esvo_reader import field, kinds, records
from esvo_reader.fields import BASE, BYTES, CONTOUR_NORMAL, CONTOUR_REST
from esvo_reader.index import BLOCK_COLUMNS, LINK_COLUMNS, PART_COLUMNS
from esvo_reader.records import NO_PARENT, POPCOUNT


def frame(data):
    return zstandard.ZstdCompressor(level=9).compress(bytes(data))


def number(value):
    """Seven bits in each byte."""
    digits = []
    while True:
        value, low = value >> 7, value & 127
        digits.append(low | 128 * (value > 0))
        if not value:
            return bytes(digits)


def split(words, layout):
    """The streams of fields of words."""
    words = np.asarray(words, np.uint32)
    return b"".join((words >> low & (1 << width) - 1).astype(np.uint8).tobytes() for low, width in layout)


def body(octree, block, trace, shift, first, last, form):
    """The bytes of a part of a block after its header: its descriptors of these levels.

    `shift` is what the indices of the octree's blocks are greater in the file.
    """
    nodes = trace[np.lexsort((trace["slot"], trace["level"]))]
    begin = int(nodes["level"][0])
    data = bytearray()
    if first == begin:
        data += len(block.slots).to_bytes(4, "little") + bytes([len(block.attachments)])
        for kind, content in block.attachments.items():
            data += kind.to_bytes(2, "little") + (content.tobytes() if kind == kinds.CONSTANT_COLOR else b"")
    nodes = nodes[(nodes["level"] >= first) & (nodes["level"] <= last)]
    counts = [int((nodes["level"] == level).sum()) for level in range(first, last + 1)]
    data += np.array(counts, "<u4").tobytes()
    streams = joined_streams(octree, block, nodes, shift)
    data += bytes([form]) + number(len(streams)) + (frame(streams) if form == 1 else streams)
    return bytes(data)


def joined_streams(octree, block, nodes, shift):
    nonleaf = nodes["valid_mask"] & ~nodes["leaf_mask"]
    local = nodes["slot"] - block.start
    links, below = [], []
    for node, slot, mask in zip(nodes, local.tolist(), nonleaf.tolist()):
        if mask:
            far = bool(field(node, "far"))
            distance = int(block.slots[slot + int(field(node, "child_pointer"))]) if far else 0
            outer = far and slot + distance >= len(block.slots)
            links.append(2 if outer else int(far))
            below += [octree.block_of_slot(int(node["slot"]) + distance) + shift] if outer else []
    streams = [nodes["valid_mask"].tobytes(), nonleaf.tobytes(), bytes(links)]
    streams.append(split(np.diff(below, prepend=0).astype(np.int64) & 0xFFFFFFFF, BYTES))
    masks = nodes["contour_mask"]
    first = 2 * local + field(nodes, "contour_pointer") - block.pool_at // 4
    contours = np.concatenate([block.contours[a : a + n] for a, n in zip(first, POPCOUNT[masks])] or [[]])
    contours = contours.astype(np.uint32)
    # Every contour has a new normal: token 3, two bits each.
    tokens = (1 << 2 * len(contours)) - 1
    streams += [masks.tobytes(), tokens.to_bytes((len(contours) + 3) // 4, "little")]
    streams += [split(contours, CONTOUR_NORMAL), split(contours, CONTOUR_REST)]
    for kind in block.attachments:
        if kind == kinds.CONSTANT_COLOR:
            continue
        words = block.words(kind)
        entry = words[local]
        mask = (entry & 255).astype(np.uint8)
        used = POPCOUNT[mask] + ((nodes["valid_mask"] & ~mask) != 0)
        values = np.concatenate([words[a : a + n] for a, n in zip((entry >> 8).tolist(), used.tolist())])
        streams += [mask.tobytes(), split(values, BASE if kind == kinds.PLAIN_NORMALS else BYTES)]
    return b"".join(streams)


class Packed:
    """A file with parts of octrees of one object each, whose blocks have codec 0."""

    def __init__(self, octrees, codec, cuts, form):
        """`codec(index)`, and `cuts(index, first, last)`: the levels of the parts of a block of codec 2."""
        self.objects, self.blocks, self.parts = [], [], []
        slots = 0
        for number_, octree in enumerate(octrees):
            shift = len(self.blocks)
            entry = octree.objects[0].copy()
            entry["root_block"] += shift
            entry["root_slot"] += slots
            self.objects.append(entry)
            traces = {octree.block_of_slot(int(t["slot"][0])): t for t in octree.walk()}
            for index in range(len(octree.blocks)):
                self.add_block(octree, index, traces[index], number_, shift, 8 * slots, codec, cuts, form)
            slots += len(octree.image)
        self.parts.sort(key=lambda part: (part[1], part[0]))

    def add_block(self, octree, index, trace, object_, shift, image_at, codec, cuts, form):
        entry, block = octree.blocks[index].copy(), octree.block(index)
        own = index + shift
        entry["object"], entry["codec"] = object_, codec(own)
        entry["image_offset"] += image_at
        if entry["parent"] != NO_PARENT:
            entry["parent"] += shift
        first, last = int(trace["level"].min()), int(trace["level"].max())
        if entry["codec"] == 2:
            bodies = [(a, b, body(octree, block, trace, shift, a, b, form)) for a, b in cuts(own, first, last)]
        else:
            image = block.image.copy()
            image[block.info_at :][:4].view("<u4")[0] = own
            bodies = [(first, 22, frame(image.tobytes()) if entry["codec"] else image.tobytes())]
        crcs = b""
        for a, b, content in bodies:
            header = np.zeros(1, records.PART_HEADER)
            header["size"], header["block"], header["codec"] = len(content) + 16, own, entry["codec"]
            header["first_level"], header["last_level"] = a, b
            sealed = header.tobytes()[4:] + content
            crc = zlib.crc32(sealed).to_bytes(4, "little")
            self.parts.append((own, a, b, crc + sealed))
            crcs += crc
        entry["stored_size"], entry["crc"] = sum(16 + len(content) for _, _, content in bodies), zlib.crc32(crcs)
        self.blocks.append(entry)

    def pages(self, groups):
        """INDX and PAGE.

        `groups`: the blocks of each page, those of the root page first; the blocks of every other page have one parent.
        """
        starts, at = [], 0
        for part in self.parts:
            starts.append(at)
            at += len(part[3]) + -len(part[3]) % 8
        page_of = {block: k for k, group in enumerate(groups) for block in group}
        above = [None] + [page_of[int(self.blocks[group[0]]["parent"])] for group in groups[1:]]
        stored, links, lowest, owners = b"", {k: [] for k in range(len(groups))}, {}, {}
        for k in range(len(groups) - 1, -1, -1):
            own = [part for part in range(len(self.parts)) if self.parts[part][0] in groups[k]]
            below = [lowest[j] for j in range(len(above)) if above[j] == k]
            lowest[k] = min([self.parts[part][1] for part in own] + below)
            owners[k] = {int(self.blocks[block]["object"]) for block in groups[k]}
            page = self.page(groups[k], own, starts, links[k])
            if k:
                cube = self.blocks[int(self.blocks[groups[k][0]]["parent"])]
                (owner,) = owners[k]
                row = [len(stored), len(page), zlib.crc32(page), owner, lowest[k]]
                links[above[k]].append([*row, *cube["cube_position"].tolist(), int(cube["cube_scale"])])
                stored += page
        return page, stored

    def page(self, group, own, starts, links):
        rows, before = [], 0
        for block in group:
            b = self.blocks[block]
            parent = NO_PARENT if b["parent"] == NO_PARENT else int(b["parent"])
            rows.append([block - before, int(b["object"]), block - parent, *b["cube_position"].tolist()])
            rows[-1] += [int(b["cube_scale"]), int(b["codec"]), int(b["image_size"]) // 8192]
            before = block
        parts, before, end = [], 0, 0
        for part in own:
            block, first, last, data = self.parts[part]
            gap, place = (starts[part] - end) // 8, group.index(block)
            parts.append([place - before, len(data), first, last, gap & 0xFFFFFFFF, gap >> 32])
            before, end = place, starts[part] + len(data) + -len(data) % 8
        tables = ((rows, BLOCK_COLUMNS), (parts, PART_COLUMNS), (links, LINK_COLUMNS))
        columns = b"".join(
            split([row[k] & 0xFFFFFFFF for row in table], BYTES) for table, names in tables for k in range(len(names))
        )
        return np.array([len(rows), len(parts), len(links)], "<u4").tobytes() + frame(columns)

    def file(self, groups):
        """The bytes of the file, in the order of section 4.5."""
        index, pages = self.pages(groups)
        data = b"".join(part[3] + bytes(-len(part[3]) % 8) for part in self.parts)
        entries = np.zeros(len(self.parts), records.PART_ENTRY)
        for entry, (block, first, last, part) in zip(entries, self.parts):
            entry["block"], entry["size"], entry["first_level"], entry["last_level"] = block, len(part), first, last
        tags = [b"OBJT", b"INDX", b"BLKS", b"PAGE", b"PART", b"BLKT"]
        blocks = np.array(self.blocks)
        sizes = [192 * len(self.objects), len(index), len(data), len(pages), entries.nbytes, blocks.nbytes]
        places, at = [], 64 + 32 * len(tags)
        for size in sizes:
            at += -at % 8
            places.append(at)
            at += size
        offset, seen = places[2], {}
        for block, _, _, part in self.parts:
            seen.setdefault(block, offset)
            offset += len(part) + -len(part) % 8
        blocks["file_offset"] = [seen[block] for block in range(len(blocks))]
        bodies = [np.array(self.objects).tobytes(), index, data, pages, entries.tobytes(), blocks.tobytes()]
        directory = np.zeros(len(tags), records.SECTION_ENTRY)
        for entry, tag, place, content in zip(directory, tags, places, bodies):
            flags = {b"BLKS": 3, b"INDX": 0, b"PAGE": 0}.get(tag, 1)
            entry["tag"], entry["flags"], entry["offset"], entry["length"] = tag, flags, place, len(content)
            entry["crc"] = 0 if flags & 2 else zlib.crc32(content)
        header = np.zeros(1, records.HEADER)
        header["identifier"], header["major"], header["required_features"] = records.IDENTIFIER, 1, 3
        header["file_length"], header["directory_offset"], header["directory_count"] = at, 64, len(tags)
        header["directory_crc"], header["head"] = zlib.crc32(directory.tobytes()), places[1] + len(index)
        header["header_crc"] = zlib.crc32(header.tobytes()[:60])
        file = bytearray(header.tobytes() + directory.tobytes())
        for place, content in zip(places, bodies):
            file += bytes(place - len(file)) + content
        return bytes(file)
