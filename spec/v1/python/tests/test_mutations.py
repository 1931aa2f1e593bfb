"""Damaged files: the error of the package or findings, never anything else."""

import random
import zlib

import numpy as np
import pytest
from common import INVALID, INVALID_FOLDER, VALID

import esvo_reader
from esvo_reader import records

PATHS = VALID + [INVALID_FOLDER / entry["file"] for entry in INVALID]
ROUNDS = 12


def with_checksums(data):
    """The file with all checksums as its bytes ask for, as far as its parts can be found: damage then gets further."""
    header = np.frombuffer(data, records.HEADER, 1)[0]
    start, count = int(header["directory_offset"]), int(header["directory_count"])
    end = start + 32 * count
    if count > 1024 or end > len(data):
        return data
    entries = [np.frombuffer(data, records.SECTION_ENTRY, 1, start + 32 * number)[0] for number in range(count)]
    ranges = {bytes(e["tag"]): (int(e["offset"]), int(e["offset"]) + int(e["length"])) for e in entries}
    parts = seal_parts(data, ranges) if int(header["required_features"]) & 2 else None
    for number, entry in enumerate(entries):
        low, high = int(entry["offset"]), int(entry["offset"]) + int(entry["length"])
        if high > len(data):
            continue
        if entry["tag"] == b"BLKT":
            for index, at in enumerate(range(low, high - 71, 72)):
                block = np.frombuffer(data, records.BLOCK_ENTRY, 1, at)[0]
                stored = int(block["file_offset"]), int(block["file_offset"]) + int(block["stored_size"])
                of = data[stored[0] : stored[1]] if parts is None else parts.get(index, b"")
                data[at + 60 : at + 64] = zlib.crc32(of).to_bytes(4, "little")
        if not entry["flags"] & 2:
            crc = zlib.crc32(data[low:high])
            data[start + 32 * number + 24 : start + 32 * number + 28] = crc.to_bytes(4, "little")
    data[52:56] = zlib.crc32(data[start:end]).to_bytes(4, "little")
    data[60:64] = zlib.crc32(data[:60]).to_bytes(4, "little")
    return data


def seal_parts(data, ranges):
    """Corrects the checksums of the parts that can be found. Returns those of each block, by level."""
    (low, high), (at, _) = ranges.get(b"PART", (0, 0)), ranges.get(b"BLKS", (0, 0))
    found = {}
    for place in range(low, min(high, len(data)) - 11, 12):
        part = np.frombuffer(data, records.PART_ENTRY, 1, place)[0]
        size = int(part["size"])
        if size > 16 and at + size <= len(data):
            data[at : at + 4] = zlib.crc32(data[at + 4 : at + size]).to_bytes(4, "little")
        found.setdefault(int(part["block"]), []).append((int(part["first_level"]), bytes(data[at : at + 4])))
        at += size + -size % 8
    return {block: b"".join(crc for _, crc in sorted(parts)) for block, parts in found.items()}


def use(data):
    """Does what there is to do with a file. Returns whether it is sound."""
    octree = esvo_reader.from_bytes(bytes(data))
    findings = octree.validate()
    sound = not any(f.severity == "error" for f in findings)
    for call in (
        lambda: octree.metadata,
        octree.descriptors,
        lambda: octree.leaves(2),
        lambda: [octree.voxels(nodes) for number in range(len(octree.objects)) for nodes in octree.walk(number)],
        lambda: follow(octree, int(octree.objects["root_slot"][0])),
    ):
        try:
            call()
        except esvo_reader.EsvoError:
            assert not sound
    return sound


def follow(octree, slot):
    """Some paths from a slot on."""
    for _ in range(23):
        below = [s for s in octree.children(slot).tolist() if s >= 0]
        if not below:
            break
        slot = below[-1]


def places_to_damage(data, count, rng):
    """Bytes that are not zero and their neighbours more often than others: most of a small file is padding."""
    used = np.flatnonzero(np.frombuffer(bytes(data), np.uint8))
    for _ in range(count):
        yield min(max(int(rng.choice(used)) + rng.choice((-4, -1, 0, 0, 0, 0, 1, 4)), 0), len(data) - 1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_damaged_files_raise_only_the_error_of_the_package(path):
    rng = random.Random(path.stem)
    original = path.read_bytes()
    for round_ in range(ROUNDS):
        data = bytearray(original)
        for at in places_to_damage(data, rng.choice((1, 1, 2, 8)), rng):
            data[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, data[at] ^ 1 << rng.randrange(8)))
        if len(data) > 64 and round_ % 4:
            data = with_checksums(data)
        try:
            use(data)
        except esvo_reader.EsvoError as error:
            assert error.findings


@pytest.mark.parametrize("path", VALID[::8], ids=lambda path: path.stem)
def test_cut_files_are_refused(path):
    data = path.read_bytes()
    for size in (0, 1, 11, 63, 64, 100, len(data) // 2, len(data) - 1):
        with pytest.raises(esvo_reader.EsvoError) as error:
            esvo_reader.from_bytes(data[:size])
        assert error.value.rule == ("H001" if size < 64 else "H004")
