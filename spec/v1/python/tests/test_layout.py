"""Compares the records of the package with esvo.ksy: names, offsets and types."""

import numpy as np
import pytest
import yaml
from common import SPECIFICATION

from esvo_reader import kinds, records

KSY = yaml.safe_load((SPECIFICATION / "esvo.ksy").read_text("utf-8"))
TYPES = KSY["types"]
WIDTHS = {"u1": 8, "u2": 16, "u4": 32, "u8": 64, "f8": 64}

# What in the package is which type of the .ksy. A color_block of the .ksy and one of numpy differ in how often they say
# that there are indices: sixteen times 2 bits there, a word here.
DTYPES = {
    "header": records.HEADER,
    "section_entry": records.SECTION_ENTRY,
    "object_entry": records.OBJECT_ENTRY,
    "block_entry": records.BLOCK_ENTRY,
    "part_entry": records.PART_ENTRY,
    "part_header": records.PART_HEADER,
    "info_section": records.INFO_SECTION,
    "attachment_entry": records.ATTACHMENT_ENTRY,
    "color_block": records.COLOR_BLOCK,
    "normal_block": records.NORMAL_BLOCK,
    "constant_color": records.CONSTANT,
    "corner_value": records.CORNER_VALUE,
    "component_head": records.COMPONENT_HEAD,
}
BITS = {
    "child_descriptor": records.CHILD_DESCRIPTOR,
    "distance": records.DISTANCE,
    "ambient_block": records.AMBIENT_BLOCK,
    "plain_entry": records.PLAIN_ENTRY,
    "corner_entry": records.CORNER_ENTRY,
}


def ksy_fields(name):
    """Name, first bit, width and number of values of every field of a type, until one that repeats to the end."""
    at, found = 0, []
    for field in TYPES[name]["seq"]:
        repeat = field.get("repeat-expr", 1)
        if field.get("repeat") == "eos" or not isinstance(repeat, int):
            break
        kind = field.get("type")
        if "contents" in field:
            width, repeat = 8, sum(len(c) if isinstance(c, str) else 1 for c in field["contents"])
        elif "size" in field:
            width, repeat = 8, field["size"]
        elif kind in WIDTHS:
            width = WIDTHS[kind]
        else:
            assert kind[0] == "b", f"{name}.{field['id']} has type {kind}"
            width = int(kind[1:])
        found.append((field["id"], at, width, repeat))
        at += width * repeat
    return found


def ksy_kind(name, field):
    return next(f.get("type") for f in TYPES[name]["seq"] if f["id"] == field)


def test_numbers_are_little_endian():
    assert (KSY["meta"]["endian"], KSY["meta"]["bit-endian"]) == ("le", "le")
    for dtype in DTYPES.values():
        for field, _ in dtype.fields.values():
            assert field.base.byteorder in "<|" or (np.little_endian and field.base.byteorder == "=")


@pytest.mark.parametrize("name", DTYPES)
def test_dtype(name):
    dtype, end = DTYPES[name], 0
    expected = ksy_fields(name)
    assert list(dtype.names) == [field for field, *_ in expected]
    for field, at, width, repeat in expected:
        sub, offset = dtype.fields[field][:2]
        kind = ksy_kind(name, field)
        assert (8 * offset, 8 * sub.itemsize) == (at, width * repeat), field
        assert (sub.base.kind == "f") == (kind == "f8"), field
        assert sub.base.itemsize * 8 == width or width < 8 or sub.kind == "S", field
        end = at + width * repeat
    assert 8 * dtype.itemsize == end


@pytest.mark.parametrize("name", BITS)
def test_bits(name):
    assert [(field, *bits) for field, bits in BITS[name].items()] == ksy_fields(name)


def test_every_record_of_the_ksy_is_compared():
    plain = {
        "object_table",
        "block_table",
        "part_table",
        "block_image",
        "slot",
        "contour",
        "color_blocks",
        "normal_blocks",
        "ambient_blocks",
        "plain_values",
        "corner_values",
        "component_values",
    }
    assert set(TYPES) == set(DTYPES) | set(BITS) | plain


def test_codecs_and_attachments_have_their_numbers():
    numbers = {name: number for number, name in KSY["enums"]["attachment"].items()}
    names = {
        "ambient_blocks": "AMBIENT_BLOCKS",
        "color_blocks": "COLOR_BLOCKS",
        "normal_blocks": "NORMAL_BLOCKS",
        "constant_color": "CONSTANT_COLOR",
        "plain_colors": "PLAIN_COLORS",
        "plain_normals": "PLAIN_NORMALS",
        "corners": "CORNERS",
        "emission": "EMISSION",
        "roughness_metalness": "ROUGHNESS_METALNESS",
        "opacity": "OPACITY",
        "material": "MATERIAL",
    }
    assert {name: getattr(kinds, constant) for name, constant in names.items()} == numbers
    assert KSY["enums"]["codec"] == {0: "raw", 1: "zstandard", 2: "fields"}


def test_the_identifier_is_that_of_the_ksy():
    contents = TYPES["header"]["seq"][0]["contents"]
    assert b"".join(c.encode() if isinstance(c, str) else bytes([c]) for c in contents) == records.IDENTIFIER
