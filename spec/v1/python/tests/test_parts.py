"""Octrees of parts of files, by the tables and by the index: the vectors of `streaming_parts`.

With ESVO_BLESS=1 the vectors are written anew, of the cases below. They are what this reader makes of the cases; a test
of the Rust library compares them with what that makes.
"""

import io
import json
import os
import zlib

import numpy as np
import pytest
import zstandard
from common import VECTORS
from stored_in_parts import Packed

import esvo_reader
from esvo_reader import EsvoError, IndexReader, records, trees, write_voxels

FOLDER = VECTORS / "streaming_parts"
ALL = [0.0] * 3, [1.0] * 3

# File, what is wanted, a sentence. Wanted is an object, a box and a level, or a set of parts by block and first level.
CASES = [
    ("valid/parts_levels", (0, *ALL, 5), "the upper levels of the root block and of two others"),
    ("valid/parts_levels", (0, *ALL, 6), "all blocks, three of them without their last level"),
    ("valid/parts_levels", (0, [0.5] * 3, [0.53] * 3, 8), "all levels of some blocks"),
    ("valid/parts_levels", [[0, 0]], "no block below the root block"),
    ("valid/parts_levels", [[0, 0], [3, 5], [1, 4], [1, 7]], "a set of parts"),
    ("valid/parts_pages", (0, *ALL, 5), "the upper levels of the only block"),
    ("valid/parts_pages", (0, *ALL, 8), "all levels but the last, with far pointers"),
    ("valid/parts_pages", (0, *ALL, 9), "everything, so the image is that of the file"),
    ("valid/parts_blocks", (0, *ALL, 2), "the root block with contours and colours of voxels that become leaves"),
    ("valid/parts_blocks", [[0, 0], [2, 2]], "one of two blocks below"),
    ("valid/parts_corners", [[0, 0], [1, 2]], "values at corners"),
    ("valid/parts_plain", (0, *ALL, 1), "a part that has more levels than are wanted"),
    ("valid/parts_whole", (0, *ALL, 1), "a block of codec 0"),
    ("streaming_parts/mixed", (0, *ALL, 3), "blocks of codec 0, 1 and 2 below each other, without the deepest"),
    ("streaming_parts/mixed", (0, *ALL, 5), "most levels"),
    ("streaming_parts/mixed", (0, [0.9, 0.4, 0.0], [1.0, 0.6, 0.2], 6), "a box, for which some pages are not read"),
    ("streaming_parts/mixed", (0, [0.5] * 3, [0.5] * 3, 6), "a point in the middle, that no voxel is near"),
    ("streaming_parts/mixed", (1, *ALL, 6), "the other object"),
    ("streaming_parts/mixed", [[0, 0], [1, 2]], "a block that is left out, as the part that refers to it is not there"),
    ("streaming_parts/mixed", "roots", "the first parts of both root blocks"),
    ("streaming_parts/mixed", "all", "everything, both objects"),
]
INDEX = [] if os.environ.get("ESVO_BLESS") else json.loads((FOLDER / "index.json").read_text("utf-8"))


def spiral(turns, edge):
    """Voxels along a curve, with colours and normals."""
    t = np.linspace(0, 1, 4000)[:, None]
    angle = 2 * np.pi * turns * t
    curve = np.concatenate([0.5 + 0.46 * np.cos(angle), 0.5 + 0.46 * np.sin(angle), t * 0.98], axis=1)
    positions = np.unique((curve * edge).astype(int), axis=0)
    colors = np.where(positions[:, 2:] < edge // 3, (200, 60, 20), positions * 255 // edge).astype(np.uint8)
    return positions, colors, positions - edge // 2


def octree_of(block_slots, *arguments, **options):
    """An octree in blocks that are smaller than usual."""
    usual, trees.BLOCK_SLOTS = trees.BLOCK_SLOTS, block_slots
    try:
        file = io.BytesIO()
        write_voxels(file, *arguments, origin=(0, 0, 0), levels=6, **options)
    finally:
        trees.BLOCK_SLOTS = usual
    return esvo_reader.from_bytes(file.getvalue())


def mixed():
    """Two objects of several blocks each, of all codecs, with a part for each level, and an index of several pages.

    Returns the file, and the octrees.
    """
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    first = octree_of(24, *spiral(1.5, 64))
    second = octree_of(40, spiral(0.75, 64)[0], (10, 20, 30), matrix=matrix)
    # Few blocks of codec 0, as their images are large.
    codecs = {0: 2, 1: 0, 2: 1, 3: 2, 6: 0, 7: 1}
    packed = Packed(
        [first, second],
        lambda block: codecs.get(block, 2),
        lambda block, low, high: [(low, low), (low + 1, high)] if block % 3 == 0 and high > low else [(low, high)],
        form=2,
    )
    # A page for the children of each block that has some, but for those of the first object's root block.
    by_parent = {}
    for block, entry in enumerate(packed.blocks):
        by_parent.setdefault(int(entry["parent"]), []).append(block)
    roots = by_parent.pop(0xFFFFFFFF)
    groups = [sorted(roots + by_parent.pop(0)), *(by_parent[key] for key in sorted(by_parent))]
    return packed.file(groups), (first, second)


def ranges_of(octree, parts):
    entries, offsets = octree.parts.entries, octree.parts.offsets
    return [[int(offsets[part]), int(entries["size"][part])] for part in parts]


def names_of(octree, parts):
    entries = octree.parts.entries
    return [[int(entries["block"][part]), int(entries["first_level"][part])] for part in parts]


def part_numbers(octree, names):
    known = {tuple(name): part for part, name in enumerate(names_of(octree, range(len(octree.parts.entries))))}
    return sorted(known[tuple(name)] for name in names)


def chosen(octree, wanted):
    """The parts of a case."""
    if isinstance(wanted, tuple):
        number, low, high, level = wanted
        return octree.parts_for(low, high, level, number)
    if wanted == "all":
        return list(range(len(octree.parts.entries)))
    if wanted == "roots":
        return part_numbers(octree, [[int(block), 0] for block in octree.objects["root_block"]])
    return part_numbers(octree, wanted)


class Reader:
    """Ranges of a file, and which were asked for."""

    def __init__(self, data):
        self.data, self.asked = data, []

    def __call__(self, offset, length):
        self.asked.append([offset, length])
        return bytes(self.data[offset : offset + length])


def pages_read(data, wanted):
    """The pages of the index that are read for a case."""
    reader = Reader(data)
    index = IndexReader(reader, gap=-1)
    index._first = b""
    head = len(reader.asked)
    number, low, high, level = wanted
    index.parts_for(low, high, level, number)
    return reader.asked[head:]


def bless():
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "mixed.esvo").write_bytes(mixed()[0])
    counts, lines = {}, []
    for file, wanted, about in CASES:
        data = (VECTORS / f"{file}.esvo").read_bytes()
        octree = esvo_reader.from_bytes(data)
        parts = chosen(octree, wanted)
        name = file.split("/")[1]
        counts[name] = counts.get(name, 0) + 1
        line = {"part": f"{name}_{counts[name]}.esvo", "file": f"{file}.esvo", "about": about}
        if isinstance(wanted, tuple):
            line.update(zip(("object", "low", "high", "level"), wanted))
            line["pages"] = pages_read(data, wanted)
        line["parts"], line["ranges"] = names_of(octree, parts), ranges_of(octree, parts)
        lines.append(json.dumps(line, separators=(",", ":"), sort_keys=True))
        (FOLDER / line["part"]).write_bytes(octree.partial(parts).data.tobytes())
    (FOLDER / "index.json").write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


if os.environ.get("ESVO_BLESS"):
    bless()
    INDEX = json.loads((FOLDER / "index.json").read_text("utf-8"))


def only(data, ranges):
    """The file with all else overwritten."""
    kept = bytearray(b"\xa5" * len(data))
    for offset, size in ranges:
        kept[offset : offset + size] = data[offset : offset + size]
    return bytes(kept)


def tables(octree):
    """Where header, directory and tables are, but the index."""
    sections = [s for s in octree.sections if bytes(s["tag"]) in (b"OBJT", b"BLKT", b"PART")]
    start = int(octree.header["directory_offset"])
    places = [[int(s["offset"]), int(s["length"])] for s in sections]
    return [[0, 64], [start, 32 * len(octree.sections)], *places]


def test_the_vectors_are_those_of_the_cases():
    assert [entry["about"] for entry in INDEX] == [about for _, _, about in CASES]
    files = {entry["part"] for entry in INDEX} | {"index.json", "mixed.esvo"}
    assert {path.name for path in FOLDER.iterdir()} == files


@pytest.mark.parametrize("entry", INDEX, ids=lambda entry: entry["part"].split(".")[0])
def test_parts_as_an_octree(entry):
    data = (VECTORS / entry["file"]).read_bytes()
    octree = esvo_reader.from_bytes(data)
    parts = part_numbers(octree, entry["parts"])
    assert ranges_of(octree, parts) == entry["ranges"]
    if "level" in entry:
        assert octree.parts_for(entry["low"], entry["high"], entry["level"], entry["object"]) == parts
    expected = (VECTORS / "streaming_parts" / entry["part"]).read_bytes()
    assert esvo_reader.from_bytes(expected).validate() == []
    assert octree.partial(parts).data.tobytes() == expected
    # The parts do not need the others.
    for number in {part for part in range(len(octree.parts.entries)) if part not in parts}:
        at, size = ranges_of(octree, [number])[0]
        data = data[:at] + b"\xa5" * size + data[at + size :]
    assert esvo_reader.from_bytes(data).partial(parts).data.tobytes() == expected


@pytest.mark.parametrize("entry", [e for e in INDEX if "level" in e], ids=lambda e: e["part"].split(".")[0])
def test_parts_by_the_index(entry):
    data = (VECTORS / entry["file"]).read_bytes()
    head = [0, int(esvo_reader.from_bytes(data).header["head"])]
    reader = Reader(only(data, [head, *entry["pages"], *entry["ranges"]]))
    index = IndexReader(reader)
    places = index.parts_for(entry["low"], entry["high"], entry["level"], entry["object"])
    assert [[place.owner, int(place.entry["first_level"])] for place in places] == entry["parts"]
    assert [[place.offset, int(place.entry["size"])] for place in places] == entry["ranges"]
    part = index.octree(entry["low"], entry["high"], entry["level"], entry["object"])
    assert part.data.tobytes() == (FOLDER / entry["part"]).read_bytes()
    assert index.requests == len(reader.asked)
    assert index.bytes_read == sum(min(size, len(data) - offset) for offset, size in reader.asked)


@pytest.mark.parametrize("entry", INDEX[::3], ids=lambda entry: entry["part"].split(".")[0])
def test_the_levels_that_are_there_are_those_of_the_file(entry):
    octree = esvo_reader.open(VECTORS / entry["file"])
    if "level" not in entry or [entry["low"], entry["high"]] != list(ALL):
        return
    part = esvo_reader.open(FOLDER / entry["part"])
    for level in range(1, entry["level"] + 1):
        whole, found = octree.leaves(level, entry["object"]), part.leaves(level)
        for name in ("position", "level", "color", "normal", "contour"):
            expected = getattr(whole, name)
            assert expected is None or np.array_equal(expected, getattr(found, name), equal_nan=True), name


def test_the_file_of_all_codecs_is_that_of_the_octrees():
    data = (FOLDER / "mixed.esvo").read_bytes()
    octree = esvo_reader.from_bytes(data)
    assert octree.validate() == []
    assert set(octree.blocks["codec"].tolist()) == {0, 1, 2}
    tags = {bytes(s["tag"]): int(s["length"]) for s in octree.sections}
    assert tags[b"PAGE"] > 0
    # Frames depend on the version of Zstandard; images do not.
    _, octrees = mixed()
    images = [tree.block(k) for tree in octrees for k in range(len(tree.blocks))]
    for index, expected in enumerate(images):
        block = octree.block(index)
        image = expected.image.copy()
        image[expected.info_at :][:4].view("<u4")[0] = index
        assert np.array_equal(block.image, image)


def test_sets_that_are_not_closed():
    octree = esvo_reader.open(VECTORS / "valid" / "parts_levels.esvo")
    with pytest.raises(ValueError, match="its parent"):
        octree.partial(part_numbers(octree, [[1, 4]]))
    with pytest.raises(ValueError, match="lacks the part from level 4 on"):
        octree.partial(part_numbers(octree, [[0, 0], [1, 7]]))
    with pytest.raises(ValueError, match="at least one part"):
        octree.partial([])
    with pytest.raises(ValueError, match="not stored in parts"):
        esvo_reader.open(VECTORS / "valid" / "two_blocks.esvo").partial([0])


def test_blocks_that_nothing_refers_to_are_left_out():
    octree = esvo_reader.open(FOLDER / "mixed.esvo")
    parts = octree.parts
    # A block that the second part of its parent refers to.
    below, block = next(
        (k, int(entry["parent"]))
        for k, entry in enumerate(octree.blocks)
        if entry["parent"] != 0xFFFFFFFF
        and len(parts.of_block(int(entry["parent"]))) == 2
        and 23 - entry["cube_scale"] >= parts.entries["first_level"][parts.of_block(int(entry["parent"]))[1]]
    )
    chain, above = [], int(octree.blocks["parent"][block])
    while above != 0xFFFFFFFF:
        chain += parts.of_block(above)
        above = int(octree.blocks["parent"][above])
    first = parts.of_block(block)[:1]
    alone = octree.partial([*chain, *first])
    with_orphan = octree.partial([*chain, *first, *parts.of_block(below)])
    assert with_orphan.data.tobytes() == alone.data.tobytes()


def test_files_with_parts_give_parts_by_blocks():
    octree = esvo_reader.open(VECTORS / "valid" / "parts_blocks.esvo")
    assert octree.part([0, 2]).data.tobytes() == octree.partial(part_numbers(octree, [[0, 0], [2, 2]])).data.tobytes()


@pytest.mark.parametrize("gap", [0, 100, 1 << 20])
def test_ranges_close_to_each_other_are_read_at_once(gap):
    data = (FOLDER / "mixed.esvo").read_bytes()
    reader = Reader(data)
    index = IndexReader(reader, gap=gap)
    index._first = b""
    octree = index.octree(level=4)
    assert octree.validate() == []
    between = [b[0] - a[0] - a[1] for a, b in zip(reader.asked[1:], reader.asked[2:])]
    assert all(distance > gap or distance < 0 for distance in between)
    assert index.requests < 4 or gap < 1 << 20


def test_damage_is_found():
    """Every byte that is read is checked."""
    data = (FOLDER / "mixed.esvo").read_bytes()
    entry = next(e for e in INDEX if e["file"] == "streaming_parts/mixed.esvo" and e.get("level") == 5)
    head = [0, int(esvo_reader.from_bytes(data).header["head"])]
    rng = np.random.default_rng(7)
    for offset, size in [head, *entry["pages"], *entry["ranges"]]:
        at = int(offset + rng.integers(size))
        damaged = bytearray(data)
        damaged[at] ^= 1 << int(rng.integers(8))
        with pytest.raises(EsvoError):
            IndexReader(Reader(damaged)).octree(level=5)


def test_short_answers_and_files_without_an_index():
    data = (FOLDER / "mixed.esvo").read_bytes()
    with pytest.raises(EsvoError) as error:
        IndexReader(Reader(data[: len(data) // 2])).octree()
    assert error.value.rule == "H004"
    with pytest.raises(EsvoError) as error:
        IndexReader(Reader((VECTORS / "valid" / "two_blocks.esvo").read_bytes()))
    assert error.value.rule == "H006"
    with pytest.raises(IndexError):
        IndexReader(Reader(data)).parts_for(number=2)


def with_index(data, page):
    """The file with another root page of the index, at its end, and right checksums."""
    data = bytearray(data) + bytes(-len(data) % 8)
    at = len(data)
    data += page
    header = np.frombuffer(data, records.HEADER, 1)
    start, count = int(header["directory_offset"][0]), int(header["directory_count"][0])
    entries = np.frombuffer(data, records.SECTION_ENTRY, count, start)
    row = entries["tag"].tolist().index(b"INDX")
    entries["offset"][row], entries["length"][row], entries["crc"][row] = at, len(page), zlib.crc32(page)
    header["file_length"], header["head"] = len(data), len(data)
    header["directory_crc"] = zlib.crc32(entries.tobytes())
    header["header_crc"] = zlib.crc32(header.tobytes()[:60])
    return bytes(data)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("file", ["valid/parts_blocks", "streaming_parts/mixed"])
def test_an_index_that_lies_raises_only_the_error_of_the_package(file):
    data = (VECTORS / f"{file}.esvo").read_bytes()
    page = esvo_reader.from_bytes(data).section(b"INDX").tobytes()
    columns = zstandard.ZstdDecompressor().decompress(page[12:])
    assert IndexReader(Reader(with_index(data, page))).octree(level=3).validate() == []
    rng, refused = np.random.default_rng(11), 0
    for _ in range(30):
        changed = bytearray(columns)
        changed[rng.integers(len(changed))] = rng.choice([0, 1, 2, 0x7F, 0x80, 0xFF])
        frame = zstandard.ZstdCompressor().compress(bytes(changed))
        try:
            IndexReader(Reader(with_index(data, page[:12] + frame))).octree(level=3)
        except EsvoError:
            refused += 1
    assert refused > 5
