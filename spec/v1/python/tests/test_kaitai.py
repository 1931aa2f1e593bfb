"""Compares every valid vector, field by field, with the parser that the Kaitai Struct compiler makes of esvo.ksy.

Needs the folder of that parser in ESVO_KAITAI and the package kaitaistruct; check.sh provides both where node and npm
are installed.
"""

import os
import sys

import numpy as np
import pytest
from common import VALID

import esvo_reader
from esvo_reader import kinds, records

FOLDER = os.environ.get("ESVO_KAITAI")
if not FOLDER:
    pytest.skip("no parser by the Kaitai compiler: check.sh makes one where node and npm are", allow_module_level=True)
sys.path.insert(0, FOLDER)
kaitaistruct = pytest.importorskip("kaitaistruct")
from esvo import Esvo  # noqa: E402


def plain(value):
    """A value of either side as one of Python."""
    if isinstance(value, np.generic):
        value = value.tolist()
    if isinstance(value, np.ndarray):
        value = value.tobytes() if value.dtype == np.uint8 else value.tolist()
    if isinstance(value, kaitaistruct.KaitaiStruct):
        raise TypeError(value)
    return getattr(value, "value", value)


def same_fields(record, parsed):
    """Asserts that all fields of a record are those of an object of the parser."""
    for name in record.dtype.names:
        expected = getattr(parsed, name)
        found = plain(record[name])
        if isinstance(expected, bytes) and record.dtype[name].kind == "S":
            found = found.ljust(len(expected), b"\0")
        assert found == plain(expected), name


def same_bits(bits, words, parsed):
    """Asserts that all bit fields of words are those of objects of the parser."""
    for name, field in bits.items():
        if field.repeat == 1:
            assert field.of(words).tolist() == [int(getattr(p, name)) for p in parsed], name
        else:
            parts = [records.Bits(field.low + k * field.width, field.width).of(words) for k in range(field.repeat)]
            assert np.stack(parts, axis=1).tolist() == [getattr(p, name) for p in parsed], name


@pytest.mark.parametrize("path", VALID, ids=lambda path: path.stem)
def test_same_as_the_kaitai_parser(path):
    octree = esvo_reader.open(path)
    parsed = Esvo.from_file(str(path))
    with parsed._io:
        same_fields(octree.header, parsed.header)
        assert len(octree.sections) == len(parsed.directory)
        tables = {}
        for entry, expected in zip(octree.sections, parsed.directory):
            same_fields(entry, expected)
            tables[expected.tag] = expected
        objects, blocks = tables[b"OBJT"].objects.entries, tables[b"BLKT"].blocks.entries
        assert (len(octree.objects), len(octree.blocks)) == (len(objects), len(blocks))
        for entry, expected in zip(octree.objects, objects):
            same_fields(entry, expected)
        for index, expected in enumerate(blocks):
            same_fields(octree.blocks[index], expected)
            same_block(octree.block(index))


def same_block(block):
    image = Esvo.BlockImage(kaitaistruct.KaitaiStream(kaitaistruct.BytesIO(block.image.tobytes())))
    same_fields(block.info, image.info)
    same_bits(records.DISTANCE, block.slots, [s.far_pointer for s in image.slots])
    same_bits(records.CHILD_DESCRIPTOR, block.slots, [s.descriptor for s in image.slots])
    contours = esvo_reader.decode_contours(block.contours)
    assert block.contours.tolist() == [c.word for c in image.contours]
    assert contours["normal"].tolist() == [[c.nx, c.ny, c.nz] for c in image.contours]
    assert contours["position"].tolist() == [c.position for c in image.contours]
    assert contours["thickness"].tolist() == [c.thickness for c in image.contours]
    for entry, expected in zip(block.attachment_entries, image.info.attachments):
        same_fields(entry, expected)
        assert block.attachments[expected.kind].tobytes() == expected.body
        same_attachment(block, expected)


def same_attachment(block, expected):
    kind, slots = expected.kind, len(block.slots)
    if kind in (kinds.COLOR_BLOCKS, kinds.NORMAL_BLOCKS):
        dtype, parsed = {
            kinds.COLOR_BLOCKS: (records.COLOR_BLOCK, "colors"),
            kinds.NORMAL_BLOCKS: (records.NORMAL_BLOCK, "normals"),
        }[kind]
        for found, pair in zip(block.attachments[kind].view(dtype), getattr(expected, parsed).pairs):
            for name in dtype.names:
                value = getattr(pair, name)
                if isinstance(value, list):
                    value = sum(index << 2 * texel for texel, index in enumerate(value))
                assert found[name] == value, name
    if kind == kinds.CONSTANT_COLOR:
        same_fields(block.attachments[kind].view(records.CONSTANT)[0], expected.constant_color)
    if kind == kinds.AMBIENT_BLOCKS:
        same_bits(records.AMBIENT_BLOCK, block.attachments[kind].view("<u8"), expected.ambient.pairs)
    if kind in (kinds.PLAIN_COLORS, kinds.PLAIN_NORMALS):
        same_bits(records.PLAIN_ENTRY, block.words(kind)[:slots], expected.plain.entries)
        assert block.words(kind)[slots:].tolist() == expected.plain.values
    if kind in kinds.WITH_COMPONENTS:
        parsed = expected.components
        same_fields(block.attachments[kind][:8].view(records.COMPONENT_HEAD)[0], parsed.head)
        first = 2 if block.heads[kind].constant else 2 + slots
        assert len(parsed.entries) == first - 2
        same_bits(records.PLAIN_ENTRY, block.words(kind)[2:first], parsed.entries)
        assert block.words(kind)[first:].tolist() == parsed.values
    if kind == kinds.CORNERS:
        same_bits(records.CORNER_ENTRY, block.words(kind)[: 2 * slots].view("<u8"), expected.corners.entries)
        for found, value in zip(block.words(kind)[2 * slots :].view(records.CORNER_VALUE), expected.corners.values):
            same_fields(found, value)
